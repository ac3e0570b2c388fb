"""What a robot file may say: its sections as pydantic models in SI, those of the parts in `part_schema`.

Importing this module imports pydantic; `stiffscope.robot.robot_file` does so when a file is read.
"""

from __future__ import annotations

import typing
from collections.abc import Iterable  # noqa: TC003 (pydantic reads annotations)
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, PrivateAttr, Tag, ValidationInfo, field_validator

from stiffscope.cad.link import LinkParameters
from stiffscope.cad.materials import AnyMaterial, Material, TransverselyIsotropic, material
from stiffscope.cad.slider import SliderParameters
from stiffscope.errors import InputError
from stiffscope.robot import quantities as q
from stiffscope.robot.fields import (
    Acceleration,
    Density,
    Expansion,
    Length,
    LengthOrZero,
    Mass,
    Modulus,
    Point,
    Ratio,
    Section,
    Stiffness,
)
from stiffscope.robot.part_schema import LinkSection, PartSection, SliderSection  # noqa: TC001 (pydantic reads annotations)
from stiffscope.robot.vocabulary import VOCABULARY

PartName = str
PARTS = ("link", "slider")


class Geometry(Section):
    """The mechanism's dimensions (Tables 1 to 3); the links' length is `link.length`."""

    l: Length
    l1: LengthOrZero
    l2: LengthOrZero
    h: Length
    d: Length
    a_min: Length
    a_max: Length


class Drive(Section):
    """Stiffness of a lead-screw drive along its axis, N/m; the three are alike."""

    stiffness: Stiffness


class Platform(Section):
    """The moving platform with its motor; its mass centre is M."""

    mass: Mass


class Gravity(Section):
    """The field that the robot stands in, along +z of {O}, which points down."""

    acceleration: Acceleration = 9.81


class Isotropic(Section):
    """An isotropic elastic material."""

    youngs_modulus: Modulus
    shear_modulus: Modulus
    density: Density
    expansion: Expansion = 0.0
    source: str = ""

    def build(self, name: str) -> AnyMaterial:
        """The material for CAD and FEA."""
        return Material(name, **self.model_dump())


class Fibrous(Section):
    """A transversely isotropic material, fibres along the part's x."""

    axial_modulus: Modulus
    transverse_modulus: Modulus
    axial_shear_modulus: Modulus
    axial_poisson: Ratio
    transverse_poisson: Ratio
    density: Density
    axial_expansion: Expansion = 0.0
    transverse_expansion: Expansion = 0.0
    source: str = ""

    def build(self, name: str) -> AnyMaterial:
        """The material for CAD and FEA."""
        return TransverselyIsotropic(name, **self.model_dump())


def _kind_of_material(value: Any) -> str:
    fibrous = "axial_modulus" in value if isinstance(value, dict) else isinstance(value, Fibrous)
    return "tagged-fibrous" if fibrous else "tagged-isotropic"


MaterialSection = Annotated[
    Annotated[Isotropic, Tag("tagged-isotropic")] | Annotated[Fibrous, Tag("tagged-fibrous")],
    Discriminator(_kind_of_material),
]


class Effect(Section):
    """An effect adopted from a diagnosis: the nominal robot carries it from then on."""

    effect: str
    place: str
    parameters: dict[str, Ratio] = Field(default_factory=dict)
    provenance: dict[str, Any] = Field(default_factory=dict)

    @field_validator("effect")
    @classmethod
    def _known(cls, value: str) -> str:
        return _one_of(VOCABULARY, value)

    @field_validator("place")
    @classmethod
    def _placed(cls, value: str, info: ValidationInfo) -> str:
        return _one_of(VOCABULARY[info.data["effect"]].places, value) if "effect" in info.data else value

    @field_validator("parameters")
    @classmethod
    def _described(cls, value: dict[str, float], info: ValidationInfo) -> dict[str, float]:
        if "effect" in info.data:
            names = [name for name, _ in VOCABULARY[info.data["effect"]].parameters]
            for name in value:
                _one_of(names, name)
        return value


def _one_of(valid: Iterable[str], value: str) -> str:
    if value not in valid:
        raise ValueError(f"expected one of {', '.join(valid) or '(none)'}, got {q.shown(value)}")
    return value


class RobotFile(Section):
    """A robot as its file describes it; SI, immutable."""

    name: str
    mechanism: Literal["biglide"]
    geometry: Geometry
    drive: Drive
    link: LinkSection  # type: ignore[valid-type]
    slider: SliderSection  # type: ignore[valid-type]
    platform: Platform
    gravity: Gravity = Gravity()
    materials: dict[str, MaterialSection] = Field(default_factory=dict)
    poses: dict[str, Point] = Field(default_factory=dict)
    effects: tuple[Effect, ...] = ()

    _path: Path = PrivateAttr(default=Path())
    _overrides: tuple[str, ...] = PrivateAttr(default=())

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self._path

    @property
    def overrides(self) -> tuple[str, ...]:
        """What `--set` changed."""
        return self._overrides

    def carries(self, effect: str) -> bool:
        """Whether it has adopted such an effect."""
        return any(each.effect == effect for each in self.effects)

    def part(self, name: PartName) -> PartSection:
        """Section of a part."""
        return self.link if name == "link" else self.slider

    def parameters(self, name: PartName) -> LinkParameters | SliderParameters:
        """Shape of a part, checked by cad: InputError names the parameter as in the file."""
        shape: dict[str, Any] = self.part(name).shape()
        return LinkParameters(**shape) if name == "link" else SliderParameters(**shape)

    def material(self, name: PartName) -> AnyMaterial:
        """Material of a part: of this file, or of the table in `stiffscope.cad.materials`."""
        own = {title: section.build(title) for title, section in self.materials.items()}
        try:
            return material(self.part(name).material, own)
        except InputError as error:
            raise InputError(f"{name}.{error}") from error

    def remember(self, path: Path, overrides: typing.Iterable[str]) -> None:
        """Note where it came from."""
        self._path, self._overrides = path, tuple(overrides)

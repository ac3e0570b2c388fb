"""What a robot file may say: sections, keys, dimensions and limits, as pydantic models in SI.

A part's shape has the keys of `cad.link.LinkParameters` or `cad.slider.SliderParameters`: floats are lengths,
whole numbers are counts. Importing this module imports pydantic; `app.robotfile` does so when a file is read.
"""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Iterable  # noqa: TC003 (pydantic reads annotations)
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    PrivateAttr,
    Tag,
    ValidationInfo,
    create_model,
    field_validator,
)

from app import quantities as q
from cad.faces import ENDS, FaceSelector
from cad.link import LinkParameters
from cad.materials import AnyMaterial, Material, TransverselyIsotropic, material
from cad.slider import SliderParameters
from gap.vocabulary import VOCABULARY
from stiffscope import InputError

Source = Literal["fea", "beam", "published"]
PartName = str
PARTS = ("link", "slider")


def _quantity(dimension: q.Dimension, sign: str = "positive") -> BeforeValidator:
    return BeforeValidator(lambda value: q.to_si(value, dimension, sign=sign))


Length = Annotated[float, _quantity(q.LENGTH)]
LengthOrZero = Annotated[float, _quantity(q.LENGTH, "non-negative")]
Coordinate = Annotated[float, _quantity(q.LENGTH, "any")]
Modulus = Annotated[float, _quantity(q.MODULUS)]
Ratio = Annotated[float, _quantity(q.NUMBER, "any")]
Density = Annotated[float, _quantity(q.DENSITY)]
Expansion = Annotated[float, _quantity(q.EXPANSION, "any")]
Mass = Annotated[float, _quantity(q.MASS)]
Stiffness = Annotated[float, _quantity(q.STIFFNESS)]
Acceleration = Annotated[float, _quantity(q.ACCELERATION)]
Duration = Annotated[float, _quantity(q.DURATION)]
Point = tuple[Coordinate, Coordinate, Coordinate]
Vector = tuple[Ratio, Ratio, Ratio]


def _count(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ValueError(f"expected a whole number such as 4, got {q.shown(value)}")
    return value


def _mass_or_cad(value: Any) -> float | str:
    if value == "cad":
        return "cad"
    try:
        return q.to_si(value, q.MASS)
    except ValueError as error:
        raise ValueError(f'{error} (or "cad": the volume of the solid times its density)') from error


def _length_or_auto(value: Any) -> float | None:
    if value is None or value == "auto":
        return None
    try:
        return q.to_si(value, q.LENGTH)
    except ValueError as error:
        raise ValueError(f'{error} (or "auto": what suits the part)') from error


LengthOrAuto = Annotated[float | None, BeforeValidator(_length_or_auto)]
Count = Annotated[int, BeforeValidator(_count)]
MassOrCad = Annotated[float | Literal["cad"], BeforeValidator(_mass_or_cad)]


class Section(BaseModel):
    """A table of the robot file: nothing unknown is let in, nothing changes afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True)


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


class Mesh(Section):
    """How finely a part is meshed; None ("auto" in the file) leaves a length to `fea`."""

    size: LengthOrAuto = None
    envelope: LengthOrAuto = None
    layers: Count = 1
    time_limit: Duration = 120.0
    solver: Literal["multigrid", "direct"] = "multigrid"


def _position(value: Any) -> str | tuple[float, ...]:
    if isinstance(value, list) and len(value) == 3:
        x, y, z = (q.to_si(item, q.LENGTH, sign="any") for item in value)
        return x, y, z
    if isinstance(value, str) and value in ENDS:
        return value
    raise ValueError(f'expected one of {", ".join(ENDS)} or a point such as ["85 mm", 0, 0], got {q.shown(value)}')


def _face_numbers(value: Any) -> tuple[int, ...]:
    return tuple(_count(item) for item in (value if isinstance(value, list) else [value]))


class Face(Section):
    """A choice of faces by geometry; see `stiffscope faces FILE`."""

    kind: str | None = None
    normal: Vector | None = None
    position: Annotated[str | tuple[float, ...], BeforeValidator(_position)] | None = None
    radius: Length | None = None
    index: Annotated[tuple[int, ...], BeforeValidator(_face_numbers)] | None = None

    def selector(self) -> FaceSelector:
        """The choice for cad."""
        return FaceSelector(**dict(self))


class Step(Section):
    """A solid from a STEP file instead of the part's own shape; its faces by geometry, its axes by a frame."""

    file: str
    clamped: tuple[Face, ...] | None = None
    loaded: tuple[Face, ...] | None = None
    origin: Point = (0.0, 0.0, 0.0)
    x: Vector = (1.0, 0.0, 0.0)
    z: Vector = (0.0, 0.0, 1.0)
    reference_point: Point | None = None


class PartSection(Section):
    """What every part says besides its shape."""

    material: str
    compliance: Source = "fea"
    interface: Literal["rigid", "distributed"] = "rigid"
    mesh: Mesh = Mesh()
    step: Step | None = None

    def shape(self) -> dict[str, float | int | str]:
        """The parameters of the part's shape, SI."""
        return {name: getattr(self, name) for name in type(self).model_fields if name not in _COMMON}

    def lengths(self) -> dict[str, float]:
        """The lengths among them, m."""
        return {name: value for name, value in self.shape().items() if isinstance(value, float)}


class _LinkSection(PartSection):
    mass: MassOrCad = "cad"


_COMMON = frozenset(_LinkSection.model_fields)


def _with_shape(name: str, base: type[PartSection], parameters: type) -> type[PartSection]:
    """A section with one key for each field of a part's parameters."""
    kinds = {float: LengthOrZero, int: Count, str: str}
    hints = typing.get_type_hints(parameters)
    fields: dict[str, Any] = {}
    for field in dataclasses.fields(parameters):
        default = ... if field.default is dataclasses.MISSING else field.default
        fields[field.name] = (kinds.get(hints[field.name], hints[field.name]), default)
    return create_model(name, __base__=base, **fields)


LinkSection = _with_shape("LinkSection", _LinkSection, LinkParameters)
SliderSection = _with_shape("SliderSection", PartSection, SliderParameters)


class Effect(Section):
    """An effect adopted from a diagnosis: the nominal robot carries it from then on."""

    effect: str
    place: str
    parameters: dict[str, Ratio] = {}
    provenance: dict[str, Any] = {}

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
    materials: dict[str, MaterialSection] = {}
    poses: dict[str, Point] = {}
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
        """Material of a part: of this file, or of the table in `cad.materials`."""
        wanted = self.part(name).material
        if wanted in self.materials:
            return self.materials[wanted].build(wanted)
        try:
            return material(wanted)
        except InputError as error:
            mine = f"{', '.join(self.materials)} (of this file), " if self.materials else ""
            _, _, message = str(error).partition("expected one of ")
            raise InputError(f"{name}.material: expected one of {mine}{message}") from error

    def check_parts(self) -> None:
        """Raise InputError for what only the parts together can tell."""
        for name in PARTS:
            self.parameters(name)
            self.material(name)

    def remember(self, path: Path, overrides: typing.Iterable[str]) -> None:
        """Note where it came from."""
        self._path, self._overrides = path, tuple(overrides)

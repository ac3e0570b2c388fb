"""What a robot file may say of a part: its shape, material, how it is held and loaded, its mesh, a STEP file.

A part's shape has the keys of `LinkParameters` or `SliderParameters`: floats are lengths,
whole numbers are counts.
"""

from __future__ import annotations

import dataclasses
import typing
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, create_model, field_validator, model_validator

from stiffscope.cad.faces import ENDS, FaceSelector
from stiffscope.cad.link import LinkParameters
from stiffscope.cad.slider import SliderParameters
from stiffscope.cad.solid import Placement
from stiffscope.robot import quantities as q
from stiffscope.robot.fields import (
    Count,
    Duration,
    Foundation,
    Layers,
    Length,
    LengthOrAuto,
    LengthOrZero,
    MassOrCad,
    Point,
    Positive,
    Section,
    Tolerance,
    Vector,
    whole,
)

Source = Literal["fea", "beam", "published"]


class Mesh(Section):
    """How finely a part is meshed; None ("auto" in the file) leaves a length to `fea`, and wants no tolerance."""

    size: LengthOrAuto = None
    envelope: LengthOrAuto = None
    layers: Layers = 1
    tolerance: Tolerance = None
    most_unknowns: Positive = 2_000_000
    time_limit: Duration = 300.0
    solver: Literal["auto", "direct", "multigrid"] = "auto"


def _position(value: Any) -> str | tuple[float, ...]:
    if isinstance(value, list) and len(value) == 3:
        x, y, z = (q.to_si(item, q.LENGTH, sign="any") for item in value)
        return x, y, z
    if isinstance(value, str) and value in ENDS:
        return value
    raise ValueError(f'expected one of {", ".join(ENDS)} or a point such as ["85 mm", 0, 0], got {q.shown(value)}')


def _face_numbers(value: Any) -> tuple[int, ...]:
    return tuple(whole(item) for item in (value if isinstance(value, list) else [value]))


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

    @model_validator(mode="after")
    def _possible(self) -> Self:
        self.selector()
        return self


class Step(Section):
    """A solid from a STEP file instead of the part's own shape; its faces by geometry, its axes by a frame."""

    file: str
    clamped: tuple[Face, ...] | None = None
    loaded: tuple[Face, ...] | None = None
    origin: Point = (0.0, 0.0, 0.0)
    x: Vector = (1.0, 0.0, 0.0)
    z: Vector = (0.0, 0.0, 1.0)
    reference_point: Point | None = None

    @field_validator("clamped", "loaded")
    @classmethod
    def _some(cls, value: tuple[Face, ...] | None) -> tuple[Face, ...] | None:
        if value == ():
            raise ValueError("expected at least one face selector, got none")
        return value

    def placement(self) -> Placement:
        """The part's axes for cad."""
        return Placement(self.origin, self.x, self.z)

    @model_validator(mode="after")
    def _at_right_angles(self) -> Self:
        self.placement()
        return self


class PartSection(Section):
    """What every part says besides its shape."""

    material: str
    compliance: Source = "fea"
    interface: Literal["rigid", "distributed"] = "rigid"
    foundation: Foundation = None
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

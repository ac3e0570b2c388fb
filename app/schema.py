"""What a robot file may say: sections, keys, dimensions and limits, as pydantic models in SI.

The names of a part's keys are those of `cad.link.LinkParameters` and `cad.slider.SliderParameters`.
Importing this module imports pydantic; `app.robotfile` does so when a file is read.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PrivateAttr

from app import quantities as q

Source = Literal["fea", "beam", "published"]
BeamTheory = Literal["euler-bernoulli", "timoshenko"]


def _quantity(dimension: q.Dimension, sign: str = "positive") -> BeforeValidator:
    return BeforeValidator(lambda value: q.to_si(value, dimension, sign=sign))


Length = Annotated[float, _quantity(q.LENGTH)]
LengthOrZero = Annotated[float, _quantity(q.LENGTH, "non-negative")]
Coordinate = Annotated[float, _quantity(q.LENGTH, "any")]
Modulus = Annotated[float, _quantity(q.MODULUS)]
Density = Annotated[float, _quantity(q.DENSITY)]
Expansion = Annotated[float, _quantity(q.EXPANSION, "any")]
Mass = Annotated[float, _quantity(q.MASS)]
Stiffness = Annotated[float, _quantity(q.STIFFNESS)]
Acceleration = Annotated[float, _quantity(q.ACCELERATION)]
Duration = Annotated[float, _quantity(q.DURATION)]
Point = tuple[Coordinate, Coordinate, Coordinate]


def _count(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= 1000:
        raise ValueError(f"expected a whole number from 0 to 1000 such as 4, got {value!r}")
    return value


Count = Annotated[int, BeforeValidator(_count)]


def _mass_or_cad(value: Any) -> float | str:
    if value == "cad":
        return "cad"
    try:
        return q.to_si(value, q.MASS)
    except ValueError as error:
        raise ValueError(f'{error} (or "cad": the volume of the solid times its density)') from error


MassOrCad = Annotated[float | Literal["cad"], BeforeValidator(_mass_or_cad)]


class Section(BaseModel):
    """A table of the robot file: nothing unknown is let in, nothing changes afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


class Geometry(Section):
    """The mechanism's dimensions (Tables 1 to 3); the link's length is `link.length`."""

    l: Length  # noqa: E741 (the paper's name)
    l1: Length
    l2: Length
    h: Length
    d: Length
    a_min: Length
    a_max: Length


class Drives(Section):
    """Stiffness of the lead-screw drives along their axes."""

    limb: Stiffness
    stage: Stiffness


class Platform(Section):
    """The moving platform with its motor."""

    mass: Mass
    mass_centre: Point = (0.0, 0.0, 0.0)


class Gravity(Section):
    """The field that the robot stands in; it acts along +z of {O}, which points down."""

    acceleration: Acceleration = 9.81


class MaterialSection(Section):
    """An isotropic elastic material."""

    youngs_modulus: Modulus
    shear_modulus: Modulus
    density: Density
    expansion: Expansion = 0.0
    source: str = ""


class Mesh(Section):
    """How finely a part is meshed: `size` is the length of an element's edge, `envelope` how far facets may stray."""

    size: Length
    envelope: Length
    time_limit: Duration = 120.0


class PartSection(Section):
    """What every part says besides its shape."""

    material: str
    compliance: Source = "fea"
    beam_theory: BeamTheory = "timoshenko"
    interface: Literal["rigid", "distributed"] = "rigid"
    mesh: Mesh


class Effect(Section):
    """An effect adopted from a diagnosis: it makes the nominal robot more like the real one."""

    effect: str
    place: str
    parameters: dict[str, Any] = {}
    provenance: dict[str, Any] = {}

"""Sections of a robot file on bodies, joints, copies, tool, etc.; SI, base axes {O}, home."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from stiffscope.errors import InputError
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.element_sections import Elements
from stiffscope.robot.file.values import (
    Acceleration,
    Angle,
    AngleOrZero,
    Angles,
    Compliance,
    Coordinate,
    Diagonal,
    Direction,
    Inertia,
    LengthOrZero,
    Lengths,
    LinearCurve,
    Mass,
    MomentAbove,
    Point,
    Ratio,
    RotaryCurve,
    Says,
    Section,
    Stiffness,
    Tilting,
    Torsion,
)
from stiffscope.vjm.joints import DRIVEN, FREE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.robot.file.element_sections import ElementSection

AXES = ("x", "y", "z", "rx", "ry", "rz")
Name = Annotated[str, Says("a name")]


class ElasticBody(Section):
    """A body made of a part, clamped at its base and loaded at its tip; y sets the rotation of its axes about x."""

    part: Name
    base: Point
    tip: Point
    y: Direction | None = None


class InterfaceBody(Section):
    """A body made of a part with named interfaces, its ends NAME.INTERFACE: part origin, axes."""

    part: Name
    at: Point = (0.0, 0.0, 0.0)
    x: Direction = (1.0, 0.0, 0.0)
    y: Direction = (0.0, 1.0, 0.0)


class RigidBody(Section):
    """A rigid body: mass in kg, centre of mass, inertia about it in base axes; `mesh` is for pictures."""

    mass: Mass = 0.0
    centre: Point | None = None
    inertia: Inertia | None = None
    mesh: str | None = None


BodySection = ElasticBody | InterfaceBody | RigidBody


class _Drive(Section):
    @field_validator("range", check_fields=False)
    @classmethod
    def _check_order(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        return check_rising(value)

    @model_validator(mode="after")
    def _one_law(self) -> _Drive:
        given = [key for key in ("stiffness", "curve", "gear") if getattr(self, key, None)]
        if len(given) != 1:
            one = "a stiffness, a curve or a gear" if hasattr(self, "gear") else "a stiffness or a curve"
            raise ValueError(f"expected {one}, got {' and '.join(given) or 'none'}")
        curve = getattr(self, "curve", None) or ()
        for (x0, f0), (x, f) in pairwise(((0.0, 0.0), *curve)):
            if not (x > x0 and f > f0):
                raise ValueError(f"expected a curve that rises from point to point, got {f:g} at {x:g}")
        return self

    @property
    def points(self) -> tuple[tuple[float, float], ...] | None:
        """Points (deflection, force) of the curve, SI; None if it is linear."""
        gear = getattr(self, "gear", None)
        return gear.curve if gear is not None else getattr(self, "curve", None)


def check_rising(value: tuple[float, float] | None) -> tuple[float, float] | None:
    """Return a range; raise ValueError unless its values increase."""
    if value is not None and not value[0] < value[1]:
        raise ValueError(f"expected a lower and a higher value, got {value[0]:g} and {value[1]:g}")
    return value


class LinearDrive(_Drive):
    """A spring along a slide, N/m, or a curve of force, N, over deflection, m; backlash and range, m."""

    stiffness: Stiffness = 0.0
    range: Lengths | None = None
    curve: LinearCurve | None = None
    backlash: LengthOrZero = 0.0


class Gear(Section):
    """A strain-wave gear as its data sheet has it: stiffness k1 up to the torque t1, k2 up to t2, k3 beyond."""

    k1: Torsion
    k2: Torsion
    k3: Torsion
    t1: MomentAbove
    t2: MomentAbove

    @model_validator(mode="after")
    def _check_rising(self) -> Gear:
        if not self.t1 < self.t2:
            raise ValueError(f"expected a torque t1 below t2, got {self.t1:g} and {self.t2:g} N*m")
        return self

    @property
    def curve(self) -> tuple[tuple[float, float], ...]:
        """Points (deflection, torque); extrapolated with the last slope."""
        first = self.t1 / self.k1
        second = first + (self.t2 - self.t1) / self.k2
        return (first, self.t1), (second, self.t2), (second + self.t2 / self.k3, 2.0 * self.t2)


class RotaryDrive(_Drive):
    """A spring about an axis, N·m/rad, a curve of torque over deflection, or a gear; backlash and range, rad."""

    stiffness: Torsion = 0.0
    range: Angles | None = None
    curve: RotaryCurve | None = None
    gear: Gear | None = None
    backlash: AngleOrZero = 0.0


class Bearing(Section):
    """Compliance of a joint's bearing in the directions that the joint holds: m/N, rad/(N·m)."""

    radial: Compliance = 0.0
    axial: Compliance = 0.0
    tilting: Tilting = 0.0


def _kind_of_bearing(value: Any) -> str:
    return "tagged-table" if isinstance(value, dict | Bearing) else "tagged-six"


AnyBearing = Annotated[
    Annotated[Bearing, Tag("tagged-table")] | Annotated[Diagonal, Tag("tagged-six")], Discriminator(_kind_of_bearing)
]


Bearings = Elements | None


class JointSection(Section):
    """A joint between two bodies or ends of bodies; x along `axis`."""

    between: Annotated[tuple[str, str], Says('two bodies or ends such as ["ground", "arm.base"]')]
    type: str
    at: Point
    compliance: AnyBearing | None = None
    bearing: Bearings = None

    @field_validator("between", mode="before")
    @classmethod
    def _two(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple) or len(value) != 2 or not all(isinstance(name, str) for name in value):
            raise ValueError(
                f'expected two bodies or ends of bodies such as ["ground", "arm.base"], got {q.show_value(value)}'
            )
        return value

    def yielding(self, axes: np.ndarray) -> np.ndarray:
        """Return the compliance (6, 6) of its bearing in the joint's axes; zero in free directions.

        ``axes`` (3, 3): the joint's axes as columns, in base axes as written. Raises InputError if
        the bearings do not constrain the same directions as the joint.
        """
        return np.diag(self._diagonal()) if self.bearing is None else self._invert_bearings(axes)

    def _invert_bearings(self, axes: np.ndarray) -> np.ndarray:
        """Invert the sum of its bearings' stiffnesses on the constrained directions."""
        given = self.bearing or ()
        total = sum((each.stiffness(axes) for each in given), np.zeros((6, 6)))
        size = np.sqrt(np.diagonal(total).clip(min=0.0))
        driven = DRIVEN[self.type] if getattr(self, "drive", None) is not None else None
        wanted = set(range(6)) - set(FREE[self.type])
        loose = [AXES[i] for i in sorted(wanted) if size[i] == 0.0]
        held = [i for i in range(6) if size[i] > 0.0]
        stuck = [AXES[i] for i in held if i not in wanted | {driven}]
        if loose:
            raise InputError(f"bearing: expected bearings that hold {', '.join(loose)} too, got {_kinds(given)}")
        if stuck:
            raise InputError(f"bearing: expected bearings that leave {', '.join(stuck)} free, got {_kinds(given)}")
        out, unit = np.zeros((6, 6)), np.outer(size, size)[np.ix_(held, held)]
        out[np.ix_(held, held)] = np.linalg.inv(total[np.ix_(held, held)] / unit) / unit
        return 0.5 * (out + out.T)

    def _diagonal(self) -> tuple[float, ...]:
        given = self.compliance or Bearing()
        if isinstance(given, Bearing):
            along = given.axial if getattr(self, "axis", None) is not None else given.radial
            given = (along, given.radial, given.radial, given.tilting, given.tilting, given.tilting)
        return tuple(0.0 if i in FREE[self.type] else value for i, value in enumerate(given))


def _kinds(elements: Sequence[ElementSection]) -> str:
    return ", ".join(each.kind for each in elements)


class FixedJoint(JointSection):
    """Holds all motions; its axes are the base axes."""


class RevoluteJoint(JointSection):
    """Rotates about its axis; without a drive a spring (N·m/rad) may resist the rotation, unloaded at `rest` (rad)."""

    axis: Direction
    drive: RotaryDrive | None = None
    spring: Torsion | None = None
    rest: Angle = 0.0


class PrismaticJoint(JointSection):
    """Slides along its axis; without a drive a spring (N/m) may resist the motion, unloaded at `rest` (m)."""

    axis: Direction
    drive: LinearDrive | None = None
    spring: Stiffness | None = None
    rest: Coordinate = 0.0


class CylindricalJoint(JointSection):
    """Slides along its axis and rotates about it; a drive acts along the slide."""

    axis: Direction
    drive: LinearDrive | None = None


class UniversalJoint(JointSection):
    """Rotates about `axis`, fixed in the first body, and `axis2`, in the second; a spring (N·m/rad) resists each."""

    axis: Direction
    axis2: Direction
    spring: Torsion | None = None


class SphericalJoint(JointSection):
    """Rotates about all axes; `axis` is axial for its bearing; a spring (N·m/rad) resists all rotations."""

    axis: Direction | None = None
    spring: Torsion | None = None


class PlanarJoint(JointSection):
    """Slides in the plane normal to its axis and rotates about the axis."""

    axis: Direction


JOINTS: dict[str, type[JointSection]] = {
    "fixed": FixedJoint,
    "revolute": RevoluteJoint,
    "prismatic": PrismaticJoint,
    "cylindrical": CylindricalJoint,
    "universal": UniversalJoint,
    "spherical": SphericalJoint,
    "planar": PlanarJoint,
}


class Copies(Section):
    """A copied set of bodies and joints, renamed and rotated about an axis through the origin."""

    of: Name
    as_: tuple[str, ...] = Field(alias="as")
    axis: Direction
    angles: tuple[Angle, ...]

    @field_validator("as_", "angles", mode="before")
    @classmethod
    def _lists(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple):
            message = 'expected a list such as ["leg2", "leg3"] or ["120 deg", "240 deg"]'
            raise ValueError(f"{message}, got {q.show_value(value)}")
        return value


class ToolSection(Section):
    """The tool point M on its body, and the coordinates that define a pose."""

    body: Name
    at: Point
    pose: tuple[Literal["x", "y", "z", "rx", "ry", "rz"], ...]

    @field_validator("pose")
    @classmethod
    def _check_distinct(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if not value or len(set(value)) != len(value):
            raise ValueError(f"expected each of {' '.join(AXES)} at most once, got {' '.join(value) or 'none'}")
        return value


class GravitySection(Section):
    """The gravity field of the robot; no direction is assumed."""

    acceleration: Acceleration = 9.81
    direction: Direction


class MapSection(Section):
    """Two pose coordinates swept by `stiffscope map`; `at`, by default home, sets the others."""

    x: Lengths | None = None
    y: Lengths | None = None
    z: Lengths | None = None
    rx: Angles | None = None
    ry: Angles | None = None
    rz: Angles | None = None
    at: tuple[Any, ...] | None = None

    @field_validator(*AXES)
    @classmethod
    def _check_order(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        return check_rising(value)

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Return the swept coordinates, in the order of a pose."""
        return {name: value for name in AXES if (value := getattr(self, name)) is not None}


class Effect(Section):
    """An effect adopted from a diagnosis: the robot includes it from then on."""

    effect: Name
    place: Name
    parameters: dict[str, Ratio] = Field(default_factory=dict)
    provenance: dict[str, Any] = Field(default_factory=dict)

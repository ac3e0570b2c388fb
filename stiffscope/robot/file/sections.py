"""Sections of a robot file on bodies, joints, copies, tool, etc.; SI, base axes {O}, home."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    create_model,
    field_validator,
    model_validator,
)

from stiffscope.errors import require
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file import values as v
from stiffscope.robot.file.element_sections import Elements
from stiffscope.robot.file.values import Says, Section
from stiffscope.vjm.model.joints import JOINT_TYPES, JointType

AXES = ("x", "y", "z", "rx", "ry", "rz")
Name = Annotated[str, Says("a name")]


class ElasticBody(Section):
    """A body made of a part, clamped at its base, loaded at its tip; y: its rotation about x."""

    part: Name
    base: v.Point
    tip: v.Point
    y: v.Direction | None = None

    @property
    def length(self) -> float:
        """Distance from base to tip, m."""
        return math.dist(self.base, self.tip)


class InterfaceBody(Section):
    """A body made of a part with named interfaces, its ends NAME.INTERFACE: part origin, axes."""

    part: Name
    at: v.Point = (0.0, 0.0, 0.0)
    x: v.Direction = (1.0, 0.0, 0.0)
    y: v.Direction = (0.0, 1.0, 0.0)


class RigidBody(Section):
    """A rigid body: mass, kg, its centre, inertia about it in base axes; `mesh` is for pictures."""

    mass: v.Mass = 0.0
    centre: v.Point | None = None
    inertia: v.Inertia | None = None
    mesh: str | None = None


BodySection = ElasticBody | InterfaceBody | RigidBody


class _Drive(Section):
    @model_validator(mode="after")
    def _check_rising(self) -> _Drive:
        curve = getattr(self, "curve", None) or ()
        for (x0, f0), (x, f) in pairwise(((0.0, 0.0), *curve)):
            require(
                x > x0 and f > f0,
                "",
                "a curve that rises from point to point",
                f"{f:g} at {x:g}",
            )
        return self

    @property
    def points(self) -> tuple[tuple[float, float], ...] | None:
        """Points (deflection, force) of the curve, SI; None if it is linear."""
        gear = getattr(self, "gear", None)
        return gear.curve if gear is not None else getattr(self, "curve", None)


class LinearDrive(_Drive):
    """A spring along a slide, N/m, or a curve of force, N, over m; backlash and range, m."""

    exactly_one = (("stiffness", "curve"),)

    stiffness: v.Stiffness = 0.0
    range: v.Lengths | None = None
    curve: v.LinearCurve | None = None
    backlash: v.LengthOrZero = 0.0


class Gear(Section):
    """A strain-wave gear by its data sheet: stiffness k1 up to torque t1, k2 up to t2, then k3."""

    k1: v.Torsion
    k2: v.Torsion
    k3: v.Torsion
    t1: v.MomentAbove
    t2: v.MomentAbove

    @model_validator(mode="after")
    def _check_rising(self) -> Gear:
        require(
            self.t1 < self.t2,
            "",
            "a torque t1 below t2",
            f"{self.t1:g} and {self.t2:g} N*m",
        )
        return self

    @property
    def curve(self) -> tuple[tuple[float, float], ...]:
        """Points (deflection, torque); extrapolated with the last slope."""
        first = self.t1 / self.k1
        second = first + (self.t2 - self.t1) / self.k2
        return (
            (first, self.t1),
            (second, self.t2),
            (second + self.t2 / self.k3, 2.0 * self.t2),
        )


class RotaryDrive(_Drive):
    """A spring about an axis, N·m/rad, a curve of torque, N·m, or a gear; backlash, range, rad."""

    exactly_one = (("stiffness", "curve", "gear"),)

    stiffness: v.Torsion = 0.0
    range: v.Angles | None = None
    curve: v.RotaryCurve | None = None
    gear: Gear | None = None
    backlash: v.AngleOrZero = 0.0


class Bearing(Section):
    """Compliance of a joint's bearing in the directions that the joint holds: m/N, rad/(N·m)."""

    radial: v.Compliance = 0.0
    axial: v.Compliance = 0.0
    tilting: v.Tilting = 0.0


AnyBearing = Annotated[
    Annotated[Bearing, Tag("tagged-table")] | Annotated[v.Diagonal, Tag("tagged-six")],
    Discriminator(
        lambda each: f"tagged-{'table' if isinstance(each, dict | Bearing) else 'six'}"
    ),
]
Bearings = Elements | None

_BETWEEN = 'two bodies or ends such as ["ground", "arm.base"]'


def _two_names(value: Any) -> Any:
    require(
        isinstance(value, list | tuple) and [type(name) for name in value] == [str] * 2,
        "",
        'two bodies or ends of bodies such as ["ground", "arm.base"]',
        q.show_value(value),
    )
    return value


class JointSection(Section):
    """A joint between two bodies or ends of bodies; x along `axis`."""

    between: Annotated[tuple[str, str], BeforeValidator(_two_names), Says(_BETWEEN)]
    type: str
    at: v.Point
    compliance: AnyBearing | None = None
    bearing: Bearings = None
    carried_by: Literal["first", "second"] = "second"

    describes: ClassVar[JointType]

    def yielding(self, axes: np.ndarray) -> np.ndarray:
        """Return the compliance (6, 6) of its bearing in the joint's axes; zero in free directions.

        ``axes`` (3, 3): the joint's axes as columns, in base axes as written. Raises InputError if
        the bearings do not constrain the same directions as the joint.
        """
        if self.bearing is None:
            return np.diag(self._diagonal())
        total = sum(
            (bearing.stiffness(axes) for bearing in self.bearing), np.zeros((6, 6))
        )
        size = np.sqrt(np.diagonal(total).clip(min=0.0))
        free = self.describes.free
        driven = (
            self.describes.driven if getattr(self, "drive", None) is not None else None
        )
        held = [i for i in range(6) if size[i] > 0.0]
        loose = [AXES[i] for i in range(6) if i not in {*held, *free}]
        stuck = [AXES[i] for i in held if i in free and i != driven]
        kinds = ", ".join(bearing.kind for bearing in self.bearing)
        for wrong, wanted in ((loose, "hold {} too"), (stuck, "leave {} free")):
            form = f"bearings that {wanted.format(', '.join(wrong))}"
            require(not wrong, "bearing", form, kinds)
        out = np.zeros((6, 6))
        unit = np.outer(size, size)[np.ix_(held, held)]
        out[np.ix_(held, held)] = np.linalg.inv(total[np.ix_(held, held)] / unit) / unit
        return 0.5 * (out + out.T)

    def _diagonal(self) -> tuple[float, ...]:
        given = self.compliance or Bearing()
        if isinstance(given, Bearing):
            along = (
                given.axial if getattr(self, "axis", None) is not None else given.radial
            )
            given = (
                along,
                given.radial,
                given.radial,
                given.tilting,
                given.tilting,
                given.tilting,
            )
        return tuple(
            0.0 if i in self.describes.free else value for i, value in enumerate(given)
        )


def _read_joint_type(joint_type: JointType) -> type[JointSection]:
    """Create the section of a type of joint; an axis is at choice where only its bearing asks for it."""
    keys: dict[str, Any] = {}
    if joint_type.needed_axes:
        keys["axis"] = (v.Direction, ...)
    elif joint_type.free:
        keys["axis"] = (v.Direction | None, None)
    if joint_type.needed_axes == 2:
        keys["axis2"] = (v.Direction, ...)
    if joint_type.driven is not None:
        drive = RotaryDrive if joint_type.turns else LinearDrive
        keys["drive"] = (drive | None, None)
    if joint_type.is_uniform:
        spring: Any = v.Torsion if joint_type.turns else v.Stiffness
        keys["spring"] = (spring | None, None)
    if joint_type.is_uniform and joint_type.driven is not None:
        keys["rest"] = (v.Angle if joint_type.turns else v.Coordinate, 0.0)
    name = f"{joint_type.name.title()}Joint"
    doc = joint_type.about
    section = create_model(
        name, __base__=JointSection, __module__=__name__, __doc__=doc, **keys
    )
    section.describes = joint_type
    return section


JOINTS = {
    name: _read_joint_type(joint_type) for name, joint_type in JOINT_TYPES.items()
}
# as names of this module, by which other processes unpickle their instances
globals().update({section.__name__: section for section in JOINTS.values()})


class Copies(Section):
    """A copied set of bodies and joints, renamed and rotated about an axis through the origin."""

    of: Name
    as_: Annotated[tuple[str, ...], Says('names such as ["leg2", "leg3"]')] = Field(
        alias="as"
    )
    axis: v.Direction
    angles: Annotated[tuple[v.Turn, ...], Says('angles such as ["120 deg", "240 deg"]')]

    @field_validator("as_", "angles", mode="before")
    @classmethod
    def _lists(cls, value: Any) -> Any:
        what = 'a list such as ["leg2", "leg3"] or ["120 deg", "240 deg"]'
        require(isinstance(value, list | tuple), "", what, q.show_value(value))
        return value


class ToolSection(Section):
    """The tool point M on its body, and the coordinates that define a pose; none if nothing moves."""

    body: Name
    at: v.Point
    pose: Annotated[
        tuple[Literal["x", "y", "z", "rx", "ry", "rz"], ...],
        Says('coordinates such as ["x", "y", "rz"]'),
    ]

    @field_validator("pose")
    @classmethod
    def _check_distinct(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        require(
            len(set(value)) == len(value),
            "",
            f"each of {' '.join(AXES)} at most once",
            " ".join(value),
        )
        return value


class GravitySection(Section):
    """The gravity field of the robot; no direction is assumed."""

    acceleration: v.Acceleration = 9.81
    direction: v.Direction


class MapSection(Section):
    """Two pose coordinates swept by `stiffscope map`; `at`, by default home, sets the others."""

    x: v.Lengths | None = None
    y: v.Lengths | None = None
    z: v.Lengths | None = None
    rx: v.Angles | None = None
    ry: v.Angles | None = None
    rz: v.Angles | None = None
    at: tuple[Any, ...] | None = None

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Return the swept coordinates, in the order of a pose."""
        return {
            name: value for name in AXES if (value := getattr(self, name)) is not None
        }


class Effect(Section):
    """An effect adopted from a diagnosis: the robot includes it from then on."""

    effect: Name
    place: Name
    parameters: dict[str, v.RatioOrAngle] = Field(default_factory=dict)
    provenance: dict[str, Any] = Field(default_factory=dict)

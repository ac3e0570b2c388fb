"""Joints: their free motions, drives, springs and bearings."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from stiffscope.errors import check_word, require, require_given
from stiffscope.vjm.model.checks import (
    assign,
    axes_along,
    check_array,
    check_compliance,
    check_direction,
    check_name,
    check_vector,
    spell_name,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import ArrayLike, NDArray

    from stiffscope.vjm.model.screws import Array


@dataclass(frozen=True)
class JointType:
    """A type of joint: every fact of it that does not depend on a particular joint.

    Attributes
    ----------
    name : name in robot files.
    about : description for the reference.
    free : free components among x y z rx ry rz in the joint's axes, in the order of its
        coordinates; all others are held.
    needed_axes : axes it needs: none, ``axis``, or ``axis`` and ``axis2``, at any angle.
    driven : component along which a drive acts; None if no drive can move it.
    symbol : how pictures show it: "pin", "rail", "cross", "ball", "disc" or not at all.
    """

    name: str
    about: str
    free: tuple[int, ...]
    needed_axes: int = 1
    driven: int | None = None
    symbol: str = ""

    @cached_property
    def turns(self) -> bool:
        """Whether its drive or spring acts on rotations; else on translations."""
        return any(k > 2 for k in self.free) and self.driven != 0

    @cached_property
    def slides(self) -> bool:
        """Whether a free motion is a translation."""
        return any(k < 3 for k in self.free)

    @cached_property
    def is_uniform(self) -> bool:
        """Whether its free motions have one unit, so that one spring can resist all of them."""
        return len({k > 2 for k in self.free}) == 1

    @cached_property
    def is_ball(self) -> bool:
        """Whether it rotates about any axis, along one geodesic and not in steps."""
        return self.free == (3, 4, 5)

    @cached_property
    def is_steady(self) -> bool:
        """Whether its free directions keep to the first body."""
        return self.is_ball or not any(k > 2 for k in self.free)


JOINT_TYPES = {
    joint_type.name: joint_type
    for joint_type in (
        JointType("fixed", "Holds all motions; its axes are the base axes.", (), 0),
        JointType(
            "revolute",
            "Rotates about its axis; if not driven, a spring may resist, N·m/rad, unloaded at "
            "`rest`, rad.",
            (3,),
            driven=3,
            symbol="pin",
        ),
        JointType(
            "prismatic",
            "Slides along its axis; if not driven, a spring (N/m) may resist, unloaded at `rest` (m).",
            (0,),
            driven=0,
            symbol="rail",
        ),
        JointType(
            "cylindrical",
            "Slides along its axis and rotates about it; a drive acts along the slide.",
            (3, 0),
            driven=0,
            symbol="rail",
        ),
        JointType(
            "universal",
            "Rotates about `axis` of its first body and `axis2` of its second; a `spring` resists each.",
            (3, 4),
            needed_axes=2,
            symbol="cross",
        ),
        JointType(
            "spherical",
            "Rotates about all axes, against a spring (N·m/rad); `axis` is axial for its bearing.",
            (3, 4, 5),
            needed_axes=0,
            symbol="ball",
        ),
        JointType(
            "planar",
            "Slides in the plane normal to its axis and rotates about the axis.",
            (1, 2, 3),
            symbol="disc",
        ),
    )
}
FREE = {name: joint_type.free for name, joint_type in JOINT_TYPES.items()}
LED = tuple(
    name for name, joint_type in JOINT_TYPES.items() if joint_type.driven is not None
)
"""Types that guide a body about or along one axis."""


@dataclass(frozen=True, eq=False)
class Law:
    """Odd, piecewise linear force-deflection law: ``slopes`` (m,) beyond ``starts`` (m,), m or rad.

    The first start is half the backlash, within which the force is zero.
    """

    starts: Array
    slopes: Array

    @classmethod
    def from_curve(cls, curve: ArrayLike, backlash: float = 0.0) -> Law:
        """Create a law from (deflection, force) points (m, 2), extrapolated, and a backlash."""
        points = np.vstack([np.zeros((1, 2)), np.asarray(curve, dtype=float)])
        steps = np.diff(points, axis=0)
        require(
            np.isfinite(points).all() and (steps > 0.0).all(),
            "curve",
            "deflections and forces that rise from 0",
            points[1:].tolist(),
        )
        slopes = steps[:, 1] / steps[:, 0]
        new = np.r_[True, ~np.isclose(slopes[1:], slopes[:-1], rtol=1e-12, atol=0.0)]
        return cls(0.5 * backlash + points[:-1, 0][new], slopes[new])

    @property
    def backlash(self) -> float:
        """Total lost motion, m or rad."""
        return 2.0 * float(self.starts[0])

    @cached_property
    def forces(self) -> Array:
        """Forces (m,) at the starts."""
        return np.concatenate(
            [[0.0], np.cumsum(self.slopes[:-1] * np.diff(self.starts))]
        )

    @cached_property
    def _widths(self) -> Array:
        return np.diff(self.starts, append=np.inf)

    def segment(self, deflection: Array) -> NDArray[np.intp]:
        """Return segments: 0 within the backlash, ±1, ±2, … beyond each start by sign."""
        count = np.searchsorted(self.starts, np.abs(deflection), side="right")
        return np.where(deflection < 0.0, -count, count)

    def line(self, segment: int) -> tuple[float, float]:
        """Return a segment's slope, and the deflection at which its line has zero force."""
        if not segment:
            return 0.0, 0.0
        k = abs(segment) - 1
        offset = self.starts[k] - self.forces[k] / self.slopes[k]
        return float(self.slopes[k]), float(np.sign(segment) * offset)

    def force(self, deflection: Array) -> Array:
        """Return forces at deflections, N or N·m."""
        size = np.abs(deflection)
        out = np.zeros(np.shape(deflection))
        for start, slope, width in zip(
            self.starts, self.slopes, self._widths, strict=True
        ):
            out = out + slope * np.clip(size - start, 0.0, width)
        return np.copysign(out, deflection)

    def slope(self, deflection: Array) -> Array:
        """Return tangent stiffnesses at deflections; 0 within the backlash."""
        return np.concatenate([[0.0], self.slopes])[np.abs(self.segment(deflection))]

    def energy(self, deflection: Array) -> Array:
        """Return strain energies at deflections, J."""
        size = np.abs(deflection)
        out = np.zeros(np.shape(deflection))
        segments = zip(self.starts, self.slopes, self._widths, self.forces, strict=True)
        for start, slope, width, force in segments:
            along = np.clip(size - start, 0.0, width)
            out = out + along * (force + 0.5 * slope * along)
        return out

    def add_compliance(self, compliance: float) -> Law:
        """Add a compliance in series, which may be negative. Raises InputError if none is left."""
        left = 1.0 / self.slopes + compliance
        least = left.min()
        got = f"a compliance of {least:.6g}"
        require(least > 0.0, "", "a drive that yields", got)
        return Law(self.starts + compliance * self.forces, 1.0 / left)


def _check_stiffness(field: str, stiffness: float) -> None:
    require(0.0 < stiffness < np.inf, field, "a stiffness above 0", stiffness)


@dataclass(frozen=True, eq=False)
class Drive:
    """Spring along a joint's free direction, N/m or N·m/rad, and its range relative to home.

    ``law``: its force-deflection law if nonlinear; the stiffness is then its first slope.
    """

    stiffness: float
    low: float = -np.inf
    high: float = np.inf
    law: Law | None = None

    @property
    def unloaded_stiffness(self) -> float:
        """Tangent stiffness without load: 0 with backlash."""
        return 0.0 if self.law is not None and self.law.starts[0] else self.stiffness

    def add_backlash(self, backlash: float) -> Drive:
        """Return the drive with additional backlash."""
        law = self._find_law()
        return replace(self, law=Law(law.starts + 0.5 * backlash, law.slopes))

    def bend_at(self, load: float, below: float, beyond: float) -> Drive:
        """Return the drive with its stiffness multiplied by one factor up to a load and another beyond.

        Raises InputError for a nonlinear drive.
        """
        got = "one with a curve or backlash"
        require(self.law is None, "", "a linear drive", got)
        slopes = self.stiffness * np.array([below, beyond])
        law = Law(np.array([0.0, load / slopes[0]]), slopes)
        return replace(self, stiffness=float(slopes[0]), law=law)

    def add_compliance(self, compliance: float) -> Drive:
        """Add a compliance in series, which may be negative. Raises InputError if none is left."""
        law = self._find_law().add_compliance(compliance)
        return replace(self, stiffness=float(law.slopes[0]), law=self.law and law)

    def _find_law(self) -> Law:
        return self.law or Law(np.zeros(1), np.array([self.stiffness]))


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two nodes, ``first`` and ``second``.

    ``at`` (3,) in m; ``axis`` (3,) is fixed to the first body, ``axis2`` of a universal joint to
    the second. Joint axes: x along ``axis``, y nearest to ``axis2`` (by default the next base axis;
    without ``axis``, base axes), fixed to the first body; origin on the second, or on the first if
    that is what the bearing is ``carried_by`` while the second slides through it; the second of a
    prismatic joint is then the rail, and the axes are fixed to it. In these axes:
    bearing ``compliance`` (6, 6), ``offset`` (6,) of the unloaded second body (encoder offset, lack
    of fit), ``misalignment`` (6,), the twist from the nominal to the actual joint; bodies at home, and
    poses, are nominal. ``spring`` in N/m or N·m/rad resists each free motion of a passive joint (a
    flexure); unloaded at the displacement ``rest`` from home.
    """

    name: str
    first: str
    second: str
    kind: str
    at: Array
    axis: Array | None = None
    axis2: Array | None = None
    drive: Drive | None = None
    compliance: Array | None = None
    offset: Array | None = None
    misalignment: Array | None = None
    spring: float | None = None
    rest: float = 0.0
    carried_by: Literal["first", "second"] = "second"

    def __post_init__(self) -> None:
        here = check_name("joints", self.name)
        check_word(f"{here}.carried_by", self.carried_by, ("first", "second"))
        require(
            self.kind in JOINT_TYPES,
            f"{here}.type",
            f"one of {', '.join(JOINT_TYPES)}",
            f"{self.kind!r}",
        )
        assign(self, "at", check_vector(self.at, f"{here}.at", "a position in m"))
        for key in ("axis", "axis2"):
            if getattr(self, key) is not None:
                assign(self, key, check_direction(getattr(self, key), f"{here}.{key}"))
        for key in ("axis", "axis2")[: self.type.needed_axes]:
            what = f"a direction of a {self.kind} joint"
            require_given(getattr(self, key), f"{here}.{key}", what, "none")
        _check_drive(self, here)
        _check_spring(self, here)
        _check_displacement(self, here)
        _ = self.axes

    @property
    def type(self) -> JointType:
        """Facts of its kind."""
        return JOINT_TYPES[self.kind]

    @property
    def turns(self) -> bool:
        """Whether its drive or spring acts on rotations; else on translations."""
        return self.type.turns

    @property
    def is_on_first(self) -> bool:
        """Whether its bearing stays on the first body while the second slides through it."""
        return self.carried_by == "first" and self.type.slides

    def yield_otherwise(self, fields: Mapping[str, Any]) -> Joint:
        """Return the joint with another compliance, spring, offset or misplaced axis.

        Its name, kind and axes stay, so that only these fields are checked: fits of geometric
        errors change every joint in each step.
        """
        out = copy.copy(self)
        for key, value in fields.items():
            assign(out, key, value)
        here = spell_name("joints", self.name)
        if "compliance" in fields or "offset" in fields or "misalignment" in fields:
            _check_displacement(out, here)
        if "spring" in fields:
            _check_spring(out, here)
        return out

    def move_axis(self, turn: Array, shift: Array) -> Joint:
        """Return the joint with its axis turned (3, 3) and then shifted (3,), at its actual place.

        Its ``axis2``, which is fixed to the second body, stays.
        """
        out = copy.copy(self)
        for known in ("axes", "motions", "cross"):
            vars(out).pop(known, None)
        assign(out, "at", self.at + shift)
        assign(out, "axis", None if self.axis is None else turn @ self.axis)
        assign(out, "misalignment", None)
        return out

    @cached_property
    def axes(self) -> Array:
        """Joint axes x, y, z as columns (3, 3), in base axes at home."""
        if self.axis is None:
            return np.eye(3)
        return axes_along(
            self.axis, self.axis2, spell_name("joints", self.name), ("axis", "axis2")
        )

    @cached_property
    def motions(self) -> tuple[tuple[str, Array], ...]:
        """Free motions: ``R`` or ``P`` with a direction (3,) in base axes at home, or ``S``."""
        if self.type.is_ball:
            return (("S", np.zeros(3)),)
        motions = [("R" if k > 2 else "P", self.axes[:, k % 3]) for k in self.type.free]
        if self.cross:
            motions[1] = ("R", self.cross[1])
        return tuple(motions)

    @cached_property
    def cross(self) -> tuple[Array, Array] | None:
        """Both axes (3,) of a universal joint, in base axes at home; None of another kind."""
        if self.type.needed_axes < 2 or self.axis is None or self.axis2 is None:
            return None
        return self.axis, self.axis2

    @property
    def driven(self) -> int | None:
        """Index of the free motion along which the drive acts; None without a drive."""
        if self.drive is None or self.type.driven is None:
            return None
        return self.type.free.index(self.type.driven)

    @property
    def resistance(self) -> float:
        """Unloaded stiffness of the drive, or of its springs, N/m or N·m/rad; else 0."""
        return (
            self.drive.unloaded_stiffness
            if self.drive is not None
            else self.spring or 0.0
        )

    def resists(self, motion: int) -> bool:
        """Return whether the drive or spring acts along a free motion, given by index."""
        return self.resistance > 0.0 and (self.drive is None or motion == self.driven)

    @cached_property
    def held_components(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Held components along the joint's axes: of translation and of rotation (0, 1, 2).

        A universal joint holds the rotation about the common normal of its axes.
        """
        held = [k for k in range(6) if k not in self.type.free]
        return tuple(k for k in held if k < 3), tuple(k - 3 for k in held if k >= 3)


def _check_displacement(joint: Joint, here: str) -> None:
    """Check its compliance, and where its unloaded ends are."""
    if joint.compliance is not None:
        c = check_compliance(joint.compliance, f"{here}.compliance", semidefinite=True)
        assign(joint, "compliance", c)
    if joint.offset is not None:
        offset = check_array(joint.offset, (6,), f"{here}.offset", "a twist")
        assign(joint, "offset", offset)
    if joint.misalignment is not None:
        misalignment = check_array(
            joint.misalignment, (6,), f"{here}.misalignment", "a twist"
        )
        assign(joint, "misalignment", misalignment)
        _check_kind(joint, f"{here}.misalignment", LED)


def _check_drive(joint: Joint, here: str) -> None:
    drive = joint.drive
    if drive is None:
        return
    _check_kind(joint, f"{here}.drive", LED)
    _check_stiffness(f"{here}.drive.stiffness", drive.stiffness)
    require(
        drive.low < drive.high,
        f"{here}.drive.range",
        "its low end first",
        [drive.low, drive.high],
    )


def _check_spring(joint: Joint, here: str) -> None:
    if joint.spring is None:
        require(not joint.rest, f"{here}.rest", "a spring beside it", "none")
        return
    uniform = [name for name, each in JOINT_TYPES.items() if each.is_uniform]
    _check_kind(joint, f"{here}.spring", uniform)
    passive = joint.drive is None
    require(passive, f"{here}.spring", "a passive joint", "one with a drive")
    _check_stiffness(f"{here}.spring", joint.spring)
    require(
        np.isfinite(joint.rest) and (not joint.rest or joint.type.driven is not None),
        f"{here}.rest",
        "a displacement of a revolute or prismatic joint",
        joint.rest,
    )


def _check_kind(joint: Joint, field: str, kinds: Iterable[str]) -> None:
    require(
        joint.kind in kinds, field, f"a {', '.join(kinds)} joint", f"a {joint.kind} one"
    )

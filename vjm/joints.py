"""Joints: what each kind leaves free, its drive, spring and bearing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.checks import (
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
    from stiffscope.vjm.screws import Array

FREE: dict[str, tuple[int, ...]] = {
    "fixed": (),
    "revolute": (3,),
    "prismatic": (0,),
    "cylindrical": (3, 0),
    "universal": (3, 4),
    "spherical": (3, 4, 5),
    "planar": (1, 2, 3),
}
"""What each kind of joint leaves free of x y z rx ry rz in its axes, in the order of its coordinates; the second axis
of a universal joint need not be square to the first. All else is held."""
DRIVEN = {"revolute": 3, "prismatic": 0, "cylindrical": 0}
"""The component that a drive acts along."""
_ALIKE = ("revolute", "prismatic", "universal", "spherical")  # free motions of one unit, which a spring may resist


@dataclass(frozen=True, eq=False)
class Drive:
    """A spring along the free direction of a joint, N/m or N·m/rad, and the range of its displacement from home."""

    stiffness: float
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two nodes, ``first`` and ``second``.

    ``at`` (3,) in m; ``axis`` (3,) rides on the first body, ``axis2`` of a universal joint on the second. The joint's
    axes have x along ``axis`` and y as near to ``axis2`` as can be (by default the next base axis; without ``axis``,
    the base axes); they ride on the first body, their origin on the second. ``compliance`` (6, 6) of its bearing and
    ``offset`` (6,) of the unloaded second body (encoder offset, lack of fit), both there. ``spring`` in N/m or N·m/rad
    resists each free motion of a passive joint (a flexure); unloaded at the displacement ``rest`` from home.
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
    spring: float | None = None
    rest: float = 0.0

    def __post_init__(self) -> None:
        here = check_name("joints", self.name)
        if self.kind not in FREE:
            raise InputError(f"{here}.type: expected one of {', '.join(FREE)}, got {self.kind!r}")
        assign(self, "at", check_vector(self.at, f"{here}.at", "a position in m"))
        for key in ("axis", "axis2"):
            if getattr(self, key) is not None:
                assign(self, key, check_direction(getattr(self, key), f"{here}.{key}"))
        if self.axis is None and self.kind not in {"fixed", "spherical"}:
            raise InputError(f"{here}.axis: expected the direction of a {self.kind} joint, got none")
        if self.kind == "universal" and self.axis2 is None:
            raise InputError(f"{here}.axis2: expected the second direction of a universal joint, got none")
        self._check_drive(here)
        self._check_spring(here)
        if self.compliance is not None:
            assign(self, "compliance", check_compliance(self.compliance, f"{here}.compliance", semidefinite=True))
        if self.offset is not None:
            assign(self, "offset", check_array(self.offset, (6,), f"{here}.offset", "a twist"))
        _ = self.axes

    def _check_drive(self, here: str) -> None:
        drive = self.drive
        if drive is None:
            return
        if self.kind not in DRIVEN:
            raise InputError(f"{here}.drive: expected a {', '.join(DRIVEN)} joint, got a {self.kind} one")
        if not 0.0 < drive.stiffness < np.inf:
            raise InputError(f"{here}.drive.stiffness: expected a stiffness above 0, got {drive.stiffness}")
        if not drive.low < drive.high:
            raise InputError(f"{here}.drive.range: expected its low end first, got [{drive.low}, {drive.high}]")

    def _check_spring(self, here: str) -> None:
        if self.spring is None:
            return
        if self.kind not in _ALIKE:
            raise InputError(f"{here}.spring: expected a {', '.join(_ALIKE)} joint, got a {self.kind} one")
        if self.drive is not None:
            raise InputError(f"{here}.spring: expected a passive joint, got one with a drive")
        if not 0.0 < self.spring < np.inf:
            raise InputError(f"{here}.spring: expected a stiffness above 0, got {self.spring}")
        if not np.isfinite(self.rest) or (self.rest and self.kind not in DRIVEN):
            raise InputError(f"{here}.rest: expected a displacement of a revolute or prismatic joint, got {self.rest}")

    @cached_property
    def axes(self) -> Array:
        """Columns (3, 3): the joint's x, y, z in base axes at home."""
        here = spell_name("joints", self.name)
        return np.eye(3) if self.axis is None else axes_along(self.axis, self.axis2, here, ("axis", "axis2"))

    @cached_property
    def motions(self) -> tuple[tuple[str, Array], ...]:
        """Free motions in their order: ``R`` or ``P`` and the direction (3,) in base axes at home, or ``S``."""
        if self.kind == "spherical":
            return (("S", np.zeros(3)),)
        motions = [("R" if k > 2 else "P", self.axes[:, k % 3]) for k in FREE[self.kind]]
        if self.kind == "universal" and self.axis2 is not None:
            motions[1] = ("R", self.axis2)
        return tuple(motions)

    @property
    def driven(self) -> int | None:
        """Which of the free motions the drive acts along; None without a drive."""
        return None if self.drive is None else FREE[self.kind].index(DRIVEN[self.kind])

    @property
    def resistance(self) -> float:
        """Stiffness of its drive, or of its spring along each free motion, N/m or N·m/rad; 0 without one."""
        return self.drive.stiffness if self.drive is not None else self.spring or 0.0

    def resists(self, motion: int) -> bool:
        """Whether its drive or spring acts along a free motion, by number."""
        return motion == self.driven if self.drive is not None else self.spring is not None

    @property
    def held_components(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Components along the joint's axes that it holds: of translation, of rotation (0, 1, 2).

        The rotation that a universal joint holds is the one across both of its axes.
        """
        held = [k for k in range(6) if k not in FREE[self.kind]]
        return tuple(k for k in held if k < 3), tuple(k - 3 for k in held if k >= 3)

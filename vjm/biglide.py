"""The Biglide: geometry of Tables 1 to 3, kinematics, and the elastic robot at given poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.checks import checked_compliance, checked_poses
from stiffscope.vjm.elastic import Node, Parallel, Series, Spring, Weight, drive, revolute
from stiffscope.vjm.screws import HALF_TURN, Array, Frame, rotation

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

X, Y, Z = np.eye(3)
SIDES = {1: 1.0, 2: -1.0}  # limb 1 is the left one; x₁ = +1, x₂ = -1
LINKS = (1, 2, 3)
_RIGID = np.zeros((6, 6))
_SLACK = 1e-12  # m; a drive at the very end of its range is still in it


@dataclass(frozen=True)
class Geometry:
    """Dimensions of Table 1 in m, and the range of the two sliding drives a_i = |O O_i| in m."""

    L: float  # link
    l: float  # M to M_i
    l1: float  # O_i to A_i
    l2: float  # B_i to M_i
    h: float  # B_i to B_i1
    d: float  # half of B_i2 B_i3
    a_min: float = 0.20
    a_max: float = 0.55

    def __post_init__(self) -> None:
        for name in ("L", "l", "l1", "l2", "h", "d", "a_min", "a_max"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                msg = f"geometry.{name}: expected a length of at least 0 m, got {value}"
                raise InputError(msg)
        if self.L == 0.0:
            msg = "geometry.L: expected a length above 0 m, got 0.0"
            raise InputError(msg)
        if not self.a_min < self.a_max:
            msg = f"geometry.a_max: expected more than geometry.a_min, {self.a_min} m, got {self.a_max} m"
            raise InputError(msg)


@dataclass(frozen=True)
class Biglide:
    """The robot and its component matrices.

    ``link`` (6, 6): compliance of a link clamped at A_ij, at B_ij in the link's axes (x along it).
    ``slider`` (6, 6): of limb 1's slidable platform at A_1 in axes {O}; limb 2's stands opposite.
    ``drive`` in N/m, masses in kg. ``edits`` change named elements of the tree in turn.
    """

    geometry: Geometry
    link: Array
    slider: Array
    drive: float
    link_mass: float = 0.0
    platform_mass: float = 0.0
    edits: tuple[Callable[[Node], Node], ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "link", checked_compliance(self.link, "link compliance"))
        object.__setattr__(self, "slider", checked_compliance(self.slider, "slider compliance", semidefinite=True))
        for name in ("link_mass", "platform_mass"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                msg = f"{name}: expected a mass of at least 0 kg, got {getattr(self, name)}"
                raise InputError(msg)

    def edited(self, change: Callable[[Node], Node]) -> Biglide:
        """The robot with one more change of its tree."""
        return replace(self, edits=(*self.edits, change))

    def tree(self, poses: ArrayLike) -> Node:
        """The elastic robot at tool points (n, 3) in m, seen from M in axes {O}.

        Raises InputError for an unreachable pose.
        """
        points = checked_poses(poses)
        q = link_angle(self.geometry, points)
        tree: Node = Series(
            "robot",
            (
                Spring("base", _RIGID, Frame(translation=-points)),
                drive("stage.actuator", self.drive, np.concatenate([Y, np.zeros(3)])),
                Spring("stage.guide", _RIGID, Frame(translation=-points * [1.0, 0.0, 1.0])),
                Parallel("limbs", tuple(self._limb(i, q) for i in SIDES)),
                Weight("platform.weight", self.platform_mass),
                Spring("platform", _RIGID),
            ),
        )
        for change in self.edits:
            tree = change(tree)
        return tree

    def stance(self, poses: ArrayLike) -> Array:
        """Only the height matters, and the reach is checked here; an edit may add what depends on all of the pose."""
        points = checked_poses(poses)
        link_angle(self.geometry, points)
        return points if self.edits else points[:, 2:]

    def _limb(self, i: int, q: Array) -> Series:
        """Limb i seen from M, in axes {O}: drive, carriage, slider, then three links side by side."""
        g, side, name = self.geometry, SIDES[i], f"limb{i}"
        to_a = -g.L * (side * np.cos(q)[:, None] * X + np.sin(q)[:, None] * Z) - g.l2 * Z - side * g.l * X
        slider = self.slider if i == 1 else HALF_TURN @ self.slider @ HALF_TURN
        axes = rotation(Y, -q if i == 1 else q - np.pi)
        feet = (-side * g.h * X, side * g.h * X + g.d * Y, side * g.h * X - g.d * Y)
        corner = -side * g.l * X - g.l2 * Z
        links = tuple(self._link(f"{name}.link{j}", Frame(axes, corner + feet[j - 1])) for j in LINKS)
        return Series(
            name,
            (
                drive(f"{name}.actuator", self.drive, np.concatenate([X, np.zeros(3)])),
                Spring(f"{name}.carriage", _RIGID, Frame(translation=to_a - g.l1 * Z)),
                Spring(f"{name}.slider", slider, Frame(translation=to_a)),
                Parallel(f"{name}.links", links),
            ),
        )

    def _link(self, name: str, frame: Frame) -> Series:
        """A link from A_ij to B_ij in its own axes: bearing, link, bearing.

        Its mass centre is the paper's, half-way on the body behind the spring: its own weight does not compress it.
        """
        length = self.geometry.L
        root, middle = Frame(translation=-length * X), Frame(translation=-0.5 * length * X)
        return Series(
            f"{name}.chain",
            (
                Spring(f"{name}.joint_a", _RIGID, root),
                revolute(f"{name}.revolute_a", Y, root),
                Weight(f"{name}.weight", self.link_mass, middle),
                Spring(name, self.link),
                revolute(f"{name}.revolute_b", Y),
                Spring(f"{name}.joint_b", _RIGID),
            ),
            frame,
        )


def link_angle(geometry: Geometry, poses: ArrayLike) -> Array:
    """Inverse kinematics: angle q (n,) in rad between the links and the rail at tool points (n, 3) in m.

    Raises InputError where the links cannot reach or a drive would leave its range.
    """
    points = checked_poses(poses)
    sine, a = _position(geometry, points)
    low = geometry.l1 + geometry.l2
    _refuse(points, (sine > 0.0) & (sine < 1.0), f"z must lie between {low:.6g} and {low + geometry.L:.6g} m")
    for limb in SIDES:
        where = f"the drive of limb{limb} must stay in [{geometry.a_min:.6g}, {geometry.a_max:.6g}] m"
        _refuse(points, _in_range(geometry, a[:, limb - 1]), where)
    return np.arcsin(sine)


def slides(geometry: Geometry, poses: ArrayLike) -> Array:
    """Inverse kinematics: positions (n, 3) in m of limb 1, limb 2 and the stage. Raises as ``link_angle``."""
    points = checked_poses(poses)
    link_angle(geometry, points)
    return np.column_stack([_position(geometry, points)[1], points[:, 1]])


def tool_point(geometry: Geometry, drives: ArrayLike) -> Array:
    """Forward kinematics: tool points (n, 3) from positions (n, 3) of limb 1, limb 2, stage, in m; M hangs below."""
    a = checked_poses(drives)
    cosine = (0.5 * (a[:, 0] + a[:, 1]) - geometry.l) / geometry.L
    if not ((cosine > 0.0) & (cosine < 1.0)).all():
        bad = int(np.flatnonzero(~((cosine > 0.0) & (cosine < 1.0)))[0])
        msg = f"drives {a[bad].tolist()} m: the two slides cannot be joined by links of {geometry.L} m"
        raise InputError(msg)
    z = geometry.l1 + geometry.l2 + geometry.L * np.sqrt(1.0 - cosine**2)
    return np.column_stack([0.5 * (a[:, 1] - a[:, 0]), a[:, 2], z])


def reachable(geometry: Geometry, poses: ArrayLike) -> NDArray[np.bool_]:
    """Whether tool points (n, 3) in m lie inside the workspace; (n,) of bool."""
    sine, a = _position(geometry, checked_poses(poses))
    return (sine > 0.0) & (sine < 1.0) & _in_range(geometry, a).all(axis=1)


def pose_at(geometry: Geometry, q: float, x: float = 0.0, y: float = 0.0) -> Array:
    """Tool point (3,) in m at the link angle ``q`` in rad."""
    return np.array([x, y, geometry.l1 + geometry.l2 + geometry.L * np.sin(q)])


def _position(geometry: Geometry, points: Array) -> tuple[Array, Array]:
    """Sine of the link angle (n,) and slide positions (n, 2) in m, meaningful where 0 < sine < 1."""
    far = 2.0 * geometry.L  # enough to be out of reach
    sine = np.clip(points[:, 2] - geometry.l1 - geometry.l2, -far, far) / geometry.L
    reach = geometry.L * np.sqrt(np.clip(1.0 - sine**2, 0.0, None)) + geometry.l
    return sine, np.column_stack([reach - points[:, 0], reach + points[:, 0]])


def _in_range(geometry: Geometry, a: Array) -> NDArray[np.bool_]:
    return (a >= geometry.a_min - _SLACK) & (a <= geometry.a_max + _SLACK)


def _refuse(points: Array, good: NDArray[np.bool_], expected: str) -> None:
    if not good.all():
        x, y, z = points[int(np.flatnonzero(~good)[0])]
        msg = f"pose {x:.6g},{y:.6g},{z:.6g} m is out of reach: {expected}"
        raise InputError(msg)

"""A mechanism: rigid and elastic bodies, the joints between them, and the tool.

All positions and directions are given in the base axes {O} at one home configuration, where every loop is closed.
An elastic body has two ends, the nodes ``NAME.base`` and ``NAME.tip``; a rigid body is one node, ``NAME``; ``ground``
is the fixed one.
"""

from __future__ import annotations

import copy
import re
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.checks import checked_compliance
from stiffscope.vjm.dynamics import root

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any

    from numpy.typing import ArrayLike

    from stiffscope.vjm.dynamics import Dynamics
    from stiffscope.vjm.screws import Array

GROUND = "ground"
BASE = "<base>"
TOOL = "<tool>"
COORDINATES = ("x", "y", "z", "rx", "ry", "rz")
FREE = {
    "fixed": "",
    "revolute": "R0",
    "prismatic": "P0",
    "cylindrical": "R0 P0",
    "universal": "R0 R1",
    "spherical": "S",
    "planar": "P1 P2 R0",
}
"""Free motions of each kind of joint, in their order: rotations R and slides P along the joint's axes x, y, z (0, 1,
2), S all rotations; the second axis of a universal joint (R1) need not be square to the first."""
_DRIVEN = {"revolute": 0, "prismatic": 0, "cylindrical": 1}  # which of the free motions a drive acts along
_ORTHONORMAL = 1e-9
_PARALLEL = 1e-6


def spelled(table: str, name: str) -> str:
    """A body or joint as a robot file spells it, such as ``joints."leg1.motor"``."""
    return f"{table}.{name}" if re.fullmatch(r"[A-Za-z0-9_-]+", name) else f'{table}."{name}"'


@dataclass(frozen=True, eq=False)
class Elastic:
    """What makes a body elastic: its compliance, and the places of its two ends.

    ``compliance`` (6, 6) in part axes at the tip, clamped at the base; ``error`` (6, 6): bounds on its entries;
    ``base`` and ``tip`` (3,) in m; ``axes`` (3, 3): columns are the part's x, y, z in base axes; ``offset`` (6,): twist
    of the unloaded tip against the base (lack of fit, heat), part axes at the tip. ``dynamics``: its inertia; without
    it, half of the body's mass acts at either end.
    """

    compliance: Array
    base: Array
    tip: Array
    axes: Array
    error: Array | None = None
    offset: Array | None = None
    dynamics: Dynamics | None = None


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body, or an elastic one between two ends.

    ``mass`` in kg; a rigid body's acts at its ``centre`` (3,), an elastic one's as its ``dynamics`` say.
    ``inertia`` (3, 3) about the centre, base axes, kg·m².
    """

    name: str
    mass: float = 0.0
    centre: Array | None = None
    inertia: Array | None = None
    elastic: Elastic | None = None

    def __post_init__(self) -> None:
        here = spelled("bodies", self.name)
        if not self.name or self.name in {GROUND, BASE, TOOL}:
            raise InputError(f"{here}: expected a name of its own, got {self.name!r}")
        if not 0.0 <= self.mass < np.inf:
            raise InputError(f"{here}.mass: expected a mass of at least 0 kg, got {self.mass}")
        if self.centre is not None:
            _set(self, "centre", _vector(self.centre, f"{here}.centre", "a position in m"))
        elif self.mass > 0.0 and self.elastic is None:
            raise InputError(f"{here}.centre: expected the centre of mass of a body with a mass, got none")
        if self.inertia is not None:
            inertia = _array(self.inertia, (3, 3), f"{here}.inertia", "an inertia")
            _ = root(0.5 * (inertia + inertia.T), f"{here}.inertia: expected a positive semidefinite inertia")
            _set(self, "inertia", inertia)
        if self.elastic is not None:
            _set(self, "elastic", _checked_elastic(self.elastic, here))

    @property
    def nodes(self) -> tuple[str, ...]:
        """What a joint can be attached to."""
        return (self.name,) if self.elastic is None else (f"{self.name}.base", f"{self.name}.tip")


def member(
    name: str,
    base: ArrayLike,
    tip: ArrayLike,
    compliance: ArrayLike,
    *,
    y: ArrayLike | None = None,
    mass: float = 0.0,
    error: ArrayLike | None = None,
    dynamics: Dynamics | None = None,
) -> Body:
    """An elastic body whose part axes have x from ``base`` to ``tip`` (3,) and y as near to ``y`` (3,) as can be.

    ``compliance`` and ``error`` (6, 6): of its tip, clamped at its base, in part axes at the tip. ``dynamics``: its
    inertia between these ends.
    """
    here = spelled("bodies", name)
    start, end = _vector(base, f"{here}.base", "a position in m"), _vector(tip, f"{here}.tip", "a position in m")
    axes = axes_along(end - start, y, here)
    bound = None if error is None else np.asarray(error, dtype=float)
    elastic = Elastic(np.asarray(compliance, dtype=float), start, end, axes, bound, dynamics=dynamics)
    return Body(name, mass, elastic=elastic)


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
    ``offset`` (6,) of the unloaded second body (encoder offset, lack of fit), both there.
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

    def __post_init__(self) -> None:
        here = spelled("joints", self.name)
        if not self.name or self.name in {GROUND, BASE, TOOL}:
            raise InputError(f"{here}: expected a name of its own, got {self.name!r}")
        if self.kind not in FREE:
            raise InputError(f"{here}.type: expected one of {', '.join(FREE)}, got {self.kind!r}")
        _set(self, "at", _vector(self.at, f"{here}.at", "a position in m"))
        for key in ("axis", "axis2"):
            if getattr(self, key) is not None:
                _set(self, key, _direction(getattr(self, key), f"{here}.{key}"))
        if self.axis is None and self.kind not in {"fixed", "spherical"}:
            raise InputError(f"{here}.axis: expected the direction of a {self.kind} joint, got none")
        if self.kind == "universal" and self.axis2 is None:
            raise InputError(f"{here}.axis2: expected the second direction of a universal joint, got none")
        if self.drive is not None:
            self._check_drive(self.drive, here)
        if self.compliance is not None:
            _set(self, "compliance", checked_compliance(self.compliance, f"{here}.compliance", semidefinite=True))
        if self.offset is not None:
            _set(self, "offset", _array(self.offset, (6,), f"{here}.offset", "a twist"))
        _ = self.axes

    def _check_drive(self, drive: Drive, here: str) -> None:
        if self.kind not in _DRIVEN:
            raise InputError(f"{here}.drive: expected a {', '.join(_DRIVEN)} joint, got a {self.kind} one")
        if not 0.0 < drive.stiffness < np.inf:
            raise InputError(f"{here}.drive.stiffness: expected a stiffness above 0, got {drive.stiffness}")
        if not drive.low < drive.high:
            raise InputError(f"{here}.drive.range: expected its low end first, got [{drive.low}, {drive.high}]")

    @cached_property
    def axes(self) -> Array:
        """Columns (3, 3): the joint's x, y, z in base axes at home."""
        here = spelled("joints", self.name)
        return np.eye(3) if self.axis is None else axes_along(self.axis, self.axis2, here, ("axis", "axis2"))

    @cached_property
    def motions(self) -> tuple[tuple[str, Array], ...]:
        """Free motions in their order: ``R`` or ``P`` and the direction (3,) in base axes at home, or ``S``."""
        out: list[tuple[str, Array]] = []
        for word in FREE[self.kind].split():
            if word == "S":
                out.append(("S", np.zeros(3)))
            elif self.kind == "universal" and word == "R1" and self.axis2 is not None:
                out.append(("R", self.axis2))
            else:
                out.append((word[0], self.axes[:, int(word[1])]))
        return tuple(out)

    @property
    def driven(self) -> int | None:
        """Which of the free motions the drive acts along; None without a drive."""
        return None if self.drive is None else _DRIVEN[self.kind]


@dataclass(frozen=True, eq=False)
class Tool:
    """The tool point M on a body (or end of one), ``at`` (3,) in m, and the coordinates that command a pose.

    ``pose``: some of x y z (m) and rx ry rz (rotation vector from home, rad), base axes; the others follow.
    """

    body: str
    at: Array
    pose: tuple[str, ...]

    def __post_init__(self) -> None:
        _set(self, "at", _vector(self.at, "tool.at", "a position in m"))
        pose = tuple(self.pose)
        if not pose or len(set(pose)) < len(pose) or not set(pose) <= set(COORDINATES):
            raise InputError(f"tool.pose: expected some of {', '.join(COORDINATES)}, each once, got {list(pose)}")
        _set(self, "pose", pose)

    @property
    def commanded(self) -> list[int]:
        """Places of the commanded coordinates among x y z rx ry rz."""
        return [COORDINATES.index(name) for name in self.pose]

    @property
    def home(self) -> Array:
        """The commanded pose at home (k,)."""
        return np.concatenate([self.at, np.zeros(3)])[self.commanded]


@dataclass(frozen=True, eq=False)
class Change:
    """What an effect does to an element: compliance (6, 6) added, twist (6,) of its unloaded end, in its own axes."""

    compliance: Array | None = None
    offset: Array | None = None


NO_CHANGE = Change()


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Bodies, joints and tool, and ``gravity`` (3,), the acceleration of free fall in m/s², base axes.

    ``base``: what yields between the ground and all that stands on it, at the origin; ``grip``: between the tool's body
    and M, at M; both in base axes at home. Raises InputError for what does not make a mechanism.
    """

    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    tool: Tool
    gravity: Array = field(default_factory=lambda: np.zeros(3))
    base: Change = NO_CHANGE
    grip: Change = NO_CHANGE

    def __post_init__(self) -> None:
        _set(self, "bodies", tuple(self.bodies))
        _set(self, "joints", tuple(self.joints))
        _set(self, "gravity", _vector(self.gravity, "gravity", "an acceleration in m/s²"))
        seen: dict[str, str] = {}
        for here, name in [
            *((spelled("bodies", b.name), b.name) for b in self.bodies),
            *((spelled("joints", j.name), j.name) for j in self.joints),
        ]:
            if name in seen:
                raise InputError(f"{here}: expected a name of its own, got that of {seen[name]}")
            seen[name] = here
        for j in self.joints:
            for node in (j.first, j.second):
                self._check_node(node, f"{spelled('joints', j.name)}.between")
            if self.carrier(j.first) == self.carrier(j.second):
                here = f"{spelled('joints', j.name)}.between"
                raise InputError(f"{here}: expected two bodies, got {j.first} and {j.second}")
        if self.tool.body == GROUND:
            raise InputError("tool.body: expected a body that moves, got ground")
        self._check_node(self.tool.body, "tool.body")
        self._check_connected()

    def _check_node(self, node: str, here: str) -> None:
        if node in self._carriers:
            return
        ends = next((b.nodes for b in self.bodies if b.name == node), None)
        if ends is not None:
            raise InputError(f"{here}: expected an end of the elastic body, {' or '.join(ends)}, got {node!r}")
        known = ", ".join(self._carriers)
        raise InputError(f"{here}: expected a body or an end of one ({known}), got {node!r}")

    def _check_connected(self) -> None:
        reached, grown = {GROUND}, True
        pairs = [(self.carrier(j.first), self.carrier(j.second)) for j in self.joints]
        while grown:
            more = {b for pair in pairs for b in pair if reached & set(pair)} - reached
            reached |= more
            grown = bool(more)
        for body in self.bodies:
            if body.name not in reached:
                here = spelled("bodies", body.name)
                raise InputError(f"{here}: expected joints that connect it with the ground, got none")

    @cached_property
    def _carriers(self) -> dict[str, str]:
        return {GROUND: GROUND} | {node: body.name for body in self.bodies for node in body.nodes}

    def carrier(self, node: str) -> str:
        """Name of the body that a node belongs to."""
        return self._carriers[node]

    def body(self, name: str) -> Body:
        """The body of this name."""
        return next(b for b in self.bodies if b.name == name)

    def joint(self, name: str) -> Joint:
        """The joint of this name."""
        return next(j for j in self.joints if j.name == name)

    @property
    def drives(self) -> tuple[Joint, ...]:
        """Joints with a drive."""
        return tuple(j for j in self.joints if j.drive is not None)

    @property
    def elements(self) -> tuple[str, ...]:
        """Names of all that can yield or be changed: ``BASE``, joints, elastic bodies, ``TOOL``."""
        elastic = (b.name for b in self.bodies if b.elastic is not None)
        return (BASE, *(j.name for j in self.joints), *elastic, TOOL)

    def changed(self, changes: Mapping[str, Change]) -> Mechanism:
        """The mechanism with compliances added and unloaded ends moved, by the name of the element.

        Raises InputError for a name that is no element's and for a compliance that becomes indefinite.
        """
        unknown = sorted(set(changes) - set(self.elements))
        if unknown:
            raise InputError(f"no element {unknown[0]!r}; it has {', '.join(self.elements)}")
        bodies, joints = list(self.bodies), list(self.joints)
        for k, body in enumerate(bodies):
            if body.name in changes and body.elastic is not None:
                bodies[k] = replace(body, elastic=_added(body.elastic, changes[body.name]))
        for k, joint in enumerate(joints):
            if joint.name in changes:
                joints[k] = _added(joint, changes[joint.name])
        base, grip = (
            _added(at, changes[name]) if name in changes else at for name, at in ((BASE, self.base), (TOOL, self.grip))
        )
        for name, change in (("base", base), ("tool", grip)):
            if change.compliance is not None:
                checked_compliance(change.compliance, name, semidefinite=True)
        out = copy.copy(self)  # whose names and connections are checked already
        for name, value in (("bodies", tuple(bodies)), ("joints", tuple(joints)), ("base", base), ("grip", grip)):
            _set(out, name, value)
        return out


def axes_along(
    x: ArrayLike, y: ArrayLike | None = None, name: str = "axes", keys: tuple[str, str] = ("x", "y")
) -> Array:
    """Axes (3, 3) as columns: x along ``x`` (3,), y as near to ``y`` (3,) as can be, z = x × y.

    ``y`` is by default the base axis after the one that ``x`` is nearest to.
    """
    along = _direction(x, f"{name}.{keys[0]}")
    following = np.eye(3)[(int(np.argmax(np.abs(along))) + 1) % 3]
    side = following if y is None else _direction(y, f"{name}.{keys[1]}")
    normal = np.cross(along, side)
    if np.linalg.norm(normal) < _PARALLEL:
        raise InputError(f"{name}.{keys[1]}: expected a direction other than {keys[0]}, got {side.tolist()}")
    normal = normal / np.linalg.norm(normal)
    return np.column_stack([along, np.cross(normal, along), normal])


def _added(element: Any, change: Change) -> Any:
    compliance, offset = element.compliance, element.offset
    if change.compliance is not None:
        compliance = change.compliance if compliance is None else compliance + change.compliance
    if change.offset is not None:
        offset = change.offset if offset is None else offset + change.offset
    return replace(element, compliance=compliance, offset=offset)


def _checked_elastic(elastic: Elastic, here: str) -> Elastic:
    axes = _array(elastic.axes, (3, 3), f"{here}.axes", "axes")
    if not np.allclose(axes.T @ axes, np.eye(3), rtol=0.0, atol=_ORTHONORMAL) or np.linalg.det(axes) < 0.0:
        raise InputError(f"{here}.axes: expected three orthonormal columns x, y, z, got {axes.tolist()}")
    optional: Callable[[Array | None, tuple[int, ...], str], Array | None] = lambda value, shape, what: (  # noqa: E731
        None if value is None else _array(value, shape, f"{here}.{what}", what)
    )
    return Elastic(
        checked_compliance(elastic.compliance, f"{here}.compliance", semidefinite=True),
        _vector(elastic.base, f"{here}.base", "a position in m"),
        _vector(elastic.tip, f"{here}.tip", "a position in m"),
        axes,
        optional(elastic.error, (6, 6), "error"),
        optional(elastic.offset, (6,), "offset"),
        elastic.dynamics,
    )


def _array(value: ArrayLike, shape: tuple[int, ...], here: str, what: str) -> Array:
    array = np.asarray(value, dtype=float)
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"{here}: expected {what} of finite numbers, shape {shape}, got {np.asarray(value).tolist()}")
    return array


def _vector(value: ArrayLike, here: str, what: str) -> Array:
    return _array(value, (3,), here, what)


def _direction(value: ArrayLike, here: str) -> Array:
    vector = _vector(value, here, "a direction")
    length = float(np.linalg.norm(vector))
    if not length > 0.0:
        raise InputError(f"{here}: expected a direction, got {vector.tolist()}")
    return vector / length


def _set(owner: object, key: str, value: object) -> None:
    object.__setattr__(owner, key, value)

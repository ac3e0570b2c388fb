"""Mobility of a mechanism at one configuration: what moves, what is idle, what is held more than once, by name.

Bodies are rigid. Joint rates q̇ satisfy one twist equation for each independent loop, ``A q̇ = 0``; the null space of A
is the mechanism's motions, its left null space the wrenches that joints can carry without a load: redundant
constraints. Both follow from singular values of A, lengths over the mechanism's own.

References
----------
J. Angeles, Fundamentals of Robotic Mechanical Systems, 4th ed., Springer 2014, ch. 8 (loop equations, mobility).
T. H. Davies, "Kirchhoff's circulation law applied to multi-loop kinematic chains", Mech. Mach. Theory 16 (1981) 171.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.mechanism import COORDINATES, FREE, GROUND
from stiffscope.vjm.screws import shift, skew

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stiffscope.vjm.kinematics import Configurations
    from stiffscope.vjm.mechanism import Joint, Mechanism
    from stiffscope.vjm.screws import Array

RANK = 1e-9  # relative singular value below which a direction is free
NEAR = 1e-4  # and below which it is nearly so
_AXIS = 1e-7  # component of a unit vector that is zero
_TOGETHER, _MANY = 3, 1000  # loops that are searched for what they share, and groups of them
_COUNT = {"fixed": 0, "revolute": 1, "prismatic": 1, "cylindrical": 2, "universal": 2, "spherical": 3, "planar": 3}


@dataclass(frozen=True, eq=False)
class Direction:
    """A twist or a wrench in words: ``kind`` "translation", "rotation" or "screw", along or about ``axis`` (3,).

    Of a redundant constraint: the translation or rotation that is held more than once.
    """

    kind: str
    axis: Array
    pitch: float = 0.0  # m/rad, of a screw

    def __str__(self) -> str:
        along = axis_name(self.axis)
        if self.kind == "screw":
            return f"screw about {along}, {1e3 * self.pitch:.3g} mm/rad"
        return f"{self.kind} {'along' if self.kind == 'translation' else 'about'} {along}"


@dataclass(frozen=True, eq=False)
class Redundancy:
    """Constraints that a loop, or ``loops`` of them together, hold once more than needed.

    ``bodies``: those that the loop passes, in its order; of several loops all of theirs, sets such as leg1 in short.
    ``directions`` are as many as ``count`` where a single loop has them, else empty.
    """

    loops: int
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    count: int
    directions: tuple[Direction, ...]

    def __str__(self) -> str:
        many = f"{self.count} redundant constraint{'s' * (self.count > 1)}"
        if self.loops == 1:
            return f"the loop through {joined(self.bodies)} has {many}: {', '.join(map(str, self.directions))}"
        return f"the {self.loops} loops through {joined(self.bodies)} share {many}"


@dataclass(frozen=True, eq=False)
class Idle:
    """A motion of ``bodies`` in ``joints`` that neither moves the tool nor a drive; ``count`` of them."""

    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    count: int
    direction: Direction | None
    """The motion of the bodies where it is one and they all have the same."""

    def __str__(self) -> str:
        who, where = joined(self.bodies), joined(self.joints)
        one = len(self.bodies) == 1
        if self.direction is None:
            ways = "" if self.count == 1 else f" in {self.count} independent ways"
            return f"{who} move{'s' * one} idly{ways} in {where}"
        verb = {"rotation": "spin", "translation": "slide", "screw": "screw"}[self.direction.kind]
        return f"{who} {verb}{'s' * one} {'between' if len(self.joints) == 2 else 'in'} {where}"


@dataclass(frozen=True, eq=False)
class Mobility:
    """What a mechanism can do at one configuration, every body rigid.

    Attributes
    ----------
    freedoms
        Sum of the joints' freedoms.
    loops
        Independent loops, each the bodies that it passes.
    dof
        Independent motions of the whole mechanism: ``freedoms - 6 loops + redundant``.
    tool
        Motions of the tool at M, base axes.
    coordinates
        What each of x y z rx ry rz does at M: "commanded" by ``tool.pose``, "follows" from those, is "free" besides
        them, is "held"; or "locked": commanded, though the loops hold it.
    loose
        Motions of the tool that are left with all drives held: it lacks drives.
    dependent_drives
        Drives that others, or the loops, determine; ``redundant_drives`` of them could be taken away.
    redundancies, idle
        Redundant constraints and idle motions by name.
    constraint_margin
        Smallest singular value of A that counts over the largest: 0 where it is singular.
    rounding
        Largest singular value of A that does not count, over the largest.
    conditioning
        Inverse condition number of the commanded coordinates by the drives, lengths over the mechanism's own: 0 where
        singular; None where drives and coordinates are not as many, or there is none.

    """

    freedoms: int
    loops: tuple[tuple[str, ...], ...]
    dof: int
    tool: tuple[Direction, ...]
    coordinates: Mapping[str, str]
    loose: tuple[Direction, ...]
    redundant_drives: int
    dependent_drives: tuple[str, ...]
    redundancies: tuple[Redundancy, ...]
    idle: tuple[Idle, ...]
    constraint_margin: float
    rounding: float
    conditioning: float | None

    @property
    def count(self) -> int:
        """Mobility by the formula of Chebyshev, Grübler and Kutzbach, ``freedoms - 6 loops``."""
        return self.freedoms - 6 * len(self.loops)

    @property
    def redundant(self) -> int:
        """Number of redundant constraints."""
        return sum(r.count for r in self.redundancies)

    @property
    def idle_count(self) -> int:
        """Number of idle motions."""
        return sum(i.count for i in self.idle)


def mobility(mechanism: Mechanism, configurations: Configurations | None = None, index: int = 0) -> Mobility:
    """Mobility at home, or at one of given configurations, which must be valid there."""
    return _Rates(mechanism, configurations, index).mobility()


def axis_name(axis: Array) -> str:
    """A direction as x, -y, or its components."""
    near = int(np.argmax(np.abs(axis)))
    if abs(abs(axis[near]) - 1.0) < 1e-6:
        return "xyz"[near]
    return f"({', '.join(f'{c:.3g}' for c in np.where(np.abs(axis) < 1e-6, 0.0, axis))})"


def joined(names: Sequence[str]) -> str:
    """Names as a sentence lists them."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _in_short(names: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """Names, those of a whole set ("leg1.…") by the set's."""
    out = []
    for name in names:
        leader = name.partition(".")[0]
        whole = [other for other in known if other.partition(".")[0] == leader]
        out.append(leader if len(whole) > 1 and set(whole) <= set(names) else name)
    return tuple(dict.fromkeys(out))


class _Rates:
    """Joint rates, loops and the twists that they cause, at the middle of the mechanism, lengths over its own."""

    def __init__(self, mechanism: Mechanism, configurations: Configurations | None, index: int) -> None:
        self.mechanism = mechanism
        self.joints = mechanism.joints
        self.place = {node: _placed(configurations, index, node) for node in _nodes(mechanism)}
        self.at = [self._moved(j.second, j.at) for j in self.joints]
        self.tool = self._moved(mechanism.tool.body, mechanism.tool.at)
        points = np.array([*self.at, self.tool])
        self.middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self.length = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        self.starts = np.cumsum([0, *(_COUNT[j.kind] for j in self.joints)])
        self.screws = [self._screws(j, at) for j, at in zip(self.joints, self.at, strict=True)]
        self.edges = [(mechanism.carrier(j.first), mechanism.carrier(j.second)) for j in self.joints]
        self.paths, chords = _tree(self.edges)
        self.loops = _loops(self.edges, self.paths, chords)

    def _moved(self, node: str, home: Array) -> Array:
        rotation, position = self.place[node]
        return rotation @ home + position

    def _screws(self, joint: Joint, at: Array) -> Array:
        """Unit rates of a joint's motions (6, k): twist of its second body against its first."""
        first, second = self.place[joint.first][0], self.place[joint.second][0]
        arm = (at - self.middle) / self.length
        out = []
        for word, (kind, axis) in zip(FREE[joint.kind].split(), joint.motions, strict=True):
            if kind == "S":
                out += [_rotation(arm, e) for e in np.eye(3)]
            elif kind == "P":
                out.append(np.concatenate([first @ axis, np.zeros(3)]))
            else:
                rides = second if joint.kind == "universal" and word == "R1" else first
                out.append(_rotation(arm, rides @ axis))
        return np.array(out).T if out else np.zeros((6, 0))

    def columns(self, k: int) -> slice:
        """Columns of a joint among all rates."""
        return slice(int(self.starts[k]), int(self.starts[k + 1]))

    def along(self, way: Iterable[tuple[int, float]]) -> Array:
        """Twist (6, m) of the end of a way through joints against its start."""
        out = np.zeros((6, int(self.starts[-1])))
        for k, sign in way:
            out[:, self.columns(k)] += sign * self.screws[k]
        return out

    def of_body(self, name: str) -> Array:
        """Twist (6, m) of a body against the ground."""
        return self.along(self.paths[name])

    def mobility(self) -> Mobility:
        size = int(self.starts[-1])
        equations = [self.along(loop) for loop in self.loops]
        whole = np.vstack(equations) if equations else np.zeros((0, size))
        left, values, motions = _spaces(whole)
        drives = self._drives()
        tool = shift((self.tool - self.middle) / self.length) @ self.of_body(
            self.mechanism.carrier(self.mechanism.tool.body)
        )
        held = motions @ null_space(drives @ motions)
        idle = held @ null_space(tool @ held)
        return Mobility(
            size,
            tuple(self._bodies(loop) for loop in self.loops),
            motions.shape[1],
            self._twists(tool @ motions),
            self._coordinates(tool @ motions),
            self._twists(tool @ held),
            *self._dependent(drives @ motions),
            self._redundancies(equations, left),
            self._idle(idle),
            *values,
            self._conditioning(drives, tool, motions),
        )

    def _drives(self) -> Array:
        rows = [
            np.eye(int(self.starts[-1]))[int(self.starts[k]) + (j.driven or 0)]
            for k, j in enumerate(self.joints)
            if j.drive is not None
        ]
        return np.array(rows).reshape(-1, int(self.starts[-1]))

    def _dependent(self, drives: Array) -> tuple[int, tuple[str, ...]]:
        """How many drives depend on others, and which take part in that."""
        left = null_space(drives.T)
        names = [j.name for j in self.mechanism.drives]
        taking = np.linalg.norm(left, axis=1) > _AXIS
        return left.shape[1], tuple(name for name, part in zip(names, taking, strict=True) if part)

    def _twists(self, twists: Array) -> tuple[Direction, ...]:
        """The space of twists (6, k) at M, its directions by name."""
        basis = range_space(twists)
        return tuple(_named(np.vstack([basis[3:], basis[:3]]), "rotation", "translation", self.length))

    def _coordinates(self, tool: Array) -> dict[str, str]:
        """See ``Mobility.coordinates``; ``tool`` (6, k)."""
        pose = self.mechanism.tool.pose
        out, taken = {}, np.zeros((0, tool.shape[1]))
        for name in sorted(COORDINATES, key=lambda each: (each not in pose, COORDINATES.index(each))):
            row = tool[COORDINATES.index(name)]
            more = np.vstack([taken, row])
            fresh = rank(more) > rank(taken) and np.linalg.norm(row) > RANK
            if fresh:
                taken = more
            if name in pose:
                out[name] = "commanded" if fresh else "locked"
            elif np.linalg.norm(row) <= RANK:
                out[name] = "held"
            else:
                out[name] = "free" if fresh else "follows"
        return {name: out[name] for name in COORDINATES}

    def _conditioning(self, drives: Array, tool: Array, motions: Array) -> float | None:
        """Inverse condition number of commanded coordinates by drives."""
        pose = tool[self.mechanism.tool.commanded]
        if len(drives) != len(pose):
            return None
        forward = pose @ motions @ np.linalg.pinv(drives @ motions, rcond=RANK)
        backward = drives @ motions @ np.linalg.pinv(pose @ motions, rcond=RANK)
        if rank(forward) < len(pose) or rank(backward) < len(pose):
            return 0.0
        values = np.linalg.svd(forward, compute_uv=False)
        return float(values[-1] / values[0])

    def _bodies(self, loop: Sequence[tuple[int, float]]) -> tuple[str, ...]:
        """The bodies that a loop passes, in its order."""
        return tuple(self.edges[k][0 if sign > 0.0 else 1] for k, sign in loop)

    def _redundancies(self, equations: list[Array], left: Array) -> tuple[Redundancy, ...]:
        """Left null space (6 loops, r): what each loop has by itself, then what few share, then what many do."""
        out: list[Redundancy] = []
        known = np.zeros((len(left), 0))
        for group in self._neighbours():
            if known.shape[1] == left.shape[1]:
                break
            wrenches = null_space(np.vstack([equations[k] for k in group]).T)
            block = np.zeros((len(left), wrenches.shape[1]))
            for i, k in enumerate(group):
                block[6 * k : 6 * k + 6] = wrenches[6 * i : 6 * i + 6]
            fresh = range_space(block - known @ (known.T @ block))
            if fresh.shape[1]:
                out.append(self._redundancy(group, fresh))
                known = np.hstack([known, fresh])
        rest = left @ null_space(known.T @ left)
        return (*out, *(self._redundancy(group, rest[:, :n]) for group, n in _blocks(rest, [6] * len(equations))))

    def _redundancy(self, group: Sequence[int], wrenches: Array) -> Redundancy:
        loops = [self.loops[k] for k in group]
        names = tuple(dict.fromkeys(self.joints[j].name for loop in loops for j, _ in loop))
        own = wrenches[6 * group[0] : 6 * group[0] + 6] if len(group) == 1 else np.zeros((6, 0))
        directions = tuple(_named(own, "translation", "rotation", self.length))
        bodies = tuple(dict.fromkeys(name for loop in loops for name in self._bodies(loop)))
        if len(loops) > 1:
            bodies = _in_short(bodies, [b.name for b in self.mechanism.bodies])
        return Redundancy(len(loops), bodies, names, wrenches.shape[1], directions)

    def _neighbours(self) -> Iterable[tuple[int, ...]]:
        """Each loop, then pairs and triples of loops that share joints, as far as they are few."""
        joints = [{k for k, _ in loop} for loop in self.loops]
        groups: list[tuple[int, ...]] = [(k,) for k in range(len(joints))]
        for _ in range(_TOGETHER):
            yield from groups
            larger = {
                tuple(sorted((*group, k)))
                for group in groups
                for k in range(len(joints))
                if k not in group and any(joints[k] & joints[other] for other in group)
            }
            groups = sorted(larger)
            if len(groups) > _MANY:
                return

    def _idle(self, idle: Array) -> tuple[Idle, ...]:
        """Idle motions (m, k) apart from one another: those that share no joint."""
        out = []
        for group, count in _blocks(idle, np.diff(self.starts).astype(int).tolist()):
            rates = np.zeros_like(idle)
            for j in group:
                rates[self.columns(j)] = idle[self.columns(j)]
            motion = range_space(rates)
            twists = {b.name: self.of_body(b.name) @ motion for b in self.mechanism.bodies}
            moving = {name: t for name, t in twists.items() if np.abs(t).max(initial=0.0) > _AXIS}
            together = range_space(np.hstack(list(moving.values())))
            direction = None
            if count == 1 and together.shape[1] == 1:
                direction = _named(np.vstack([together[3:], together[:3]]), "rotation", "translation", self.length)[0]
            names = tuple(self.joints[j].name for j in group)
            out.append(Idle(tuple(moving), names, count, direction))
        return tuple(out)


def _nodes(mechanism: Mechanism) -> tuple[str, ...]:
    return (GROUND, *(node for body in mechanism.bodies for node in body.nodes))


def _placed(configurations: Configurations | None, index: int, node: str) -> tuple[Array, Array]:
    """Displacement of a node since home, ``x = R x_home + p``."""
    if configurations is None:
        return np.eye(3), np.zeros(3)
    link = configurations.linkage.frame[configurations.linkage.link_of[node]]
    rotation, position = configurations.placed.rotation[link], configurations.placed.position[link]
    return rotation[index if len(rotation) > 1 else 0], position[index if len(position) > 1 else 0]


def _rotation(arm: Array, axis: Array) -> Array:
    return np.concatenate([skew(arm) @ axis, axis])


def _tree(edges: Sequence[tuple[str, str]]) -> tuple[dict[str, list[tuple[int, float]]], list[int]]:
    """Ways from the ground to every body, breadth first, and the joints outside of this tree."""
    paths: dict[str, list[tuple[int, float]]] = {GROUND: []}
    queue, used = deque([GROUND]), set[int]()
    while queue:
        here = queue.popleft()
        for k, (first, second) in enumerate(edges):
            there = second if here == first else first if here == second else None
            if there is not None and there not in paths:
                paths[there] = [*paths[here], (k, 1.0 if here == first else -1.0)]
                used.add(k)
                queue.append(there)
    return paths, [k for k in range(len(edges)) if k not in used]


def _loops(
    edges: Sequence[tuple[str, str]], paths: dict[str, list[tuple[int, float]]], chords: list[int]
) -> list[list[tuple[int, float]]]:
    """One loop for each chord, the shortest first, through the tree and chords that were taken before it."""
    open_edges = {k for path in paths.values() for k, _ in path}
    out, left = [], list(chords)
    while left:
        found = {k: [(k, 1.0), *_shortest(edges, open_edges, edges[k][1], edges[k][0])] for k in left}
        best = min(left, key=lambda k: len(found[k]))
        out.append(found[best])
        open_edges.add(best)
        left.remove(best)
    return out


def _shortest(edges: Sequence[tuple[str, str]], some: set[int], start: str, end: str) -> list[tuple[int, float]]:
    ways: dict[str, list[tuple[int, float]]] = {start: []}
    queue = deque([start])
    while end not in ways:
        here = queue.popleft()
        for k in sorted(some):
            first, second = edges[k]
            there = second if here == first else first if here == second else None
            if there is not None and there not in ways:
                ways[there] = [*ways[here], (k, 1.0 if here == first else -1.0)]
                queue.append(there)
    return ways[end]


def _spaces(matrix: Array) -> tuple[Array, tuple[float, float], Array]:
    """Left null space, smallest singular value that counts and largest that does not (relative), null space."""
    if not matrix.size:
        return np.eye(len(matrix)), (1.0, 0.0), np.eye(matrix.shape[1])
    u, values, vt = np.linalg.svd(matrix)
    r = int(np.sum(values > RANK * values[0]))
    dropped = float(values[r] / values[0]) if r < len(values) else 0.0
    return u[:, r:], (float(values[r - 1] / values[0]), dropped), vt[r:].T


def null_space(matrix: Array) -> Array:
    """Orthonormal basis (n, k) of what a matrix (m, n) of entries of order 1 takes to zero."""
    if not matrix.size:
        return np.eye(matrix.shape[1])
    _, values, vt = np.linalg.svd(matrix)
    return vt[int(np.sum(values > RANK)) :].T


def range_space(matrix: Array) -> Array:
    """Orthonormal basis (m, r) of the range of a matrix (m, n) of entries of order 1."""
    if not matrix.size:
        return np.zeros((len(matrix), 0))
    u, values, _ = np.linalg.svd(matrix, full_matrices=False)
    return u[:, values > RANK]


def rank(matrix: Array) -> int:
    """Rank of a matrix, relative to its largest singular value."""
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values > RANK * max(values[0], 1e-300))) if values.size else 0


def _blocks(basis: Array, sizes: list[int]) -> list[tuple[list[int], int]]:
    """Groups of row blocks that the space of ``basis`` (n, k) does not mix, each with its dimension.

    The orthogonal projector on the space is block diagonal exactly where the space is a direct sum.
    """
    starts = np.cumsum([0, *sizes])
    projector = basis @ basis.T
    touch = np.array(
        [
            [
                np.abs(projector[starts[i] : starts[i + 1], starts[j] : starts[j + 1]]).max(initial=0.0) > _AXIS
                for j in range(len(sizes))
            ]
            for i in range(len(sizes))
        ]
    ).reshape(len(sizes), len(sizes))
    out, seen = [], set[int]()
    for start in range(len(sizes)):
        if start in seen or not touch[start, start]:
            continue
        group, queue = {start}, [start]
        while queue:
            for j in np.flatnonzero(touch[queue.pop()]).tolist():
                if j not in group:
                    group.add(j)
                    queue.append(j)
        seen |= group
        trace = sum(float(np.trace(projector[starts[i] : starts[i + 1], starts[i] : starts[i + 1]])) for i in group)
        out.append((sorted(group), round(trace)))
    return out


def _named(basis: Array, bound: str, free: str, length: float) -> list[Direction]:
    """Directions of a space of screws (6, k): line part first (force, or angular velocity), couple part second.

    First what has no line part (a couple: ``free``), then lines (``bound``) with the least pitch that the couples
    leave.
    """
    couples = basis[3:] @ null_space(basis[:3])
    out = [Direction(free, axis) for axis in _aligned(couples)]
    lines = range_space(basis[:3])
    off = np.eye(3) - range_space(couples) @ range_space(couples).T
    for axis in _aligned(lines):
        screw = basis @ np.linalg.lstsq(basis[:3], axis, rcond=None)[0]
        pitch = float((off @ screw[3:]) @ (off @ axis)) if couples.shape[1] else float(screw[3:] @ axis)
        if couples.shape[1] and np.linalg.norm(couples.T @ axis) > _AXIS:
            pitch = 0.0  # a couple about its own axis takes the pitch away
        real = abs(pitch) > 1e-6
        out.append(Direction("screw" if real else bound, axis, pitch * length if real else 0.0))
    return out


def _aligned(space: Array) -> list[Array]:
    """Orthonormal basis of a space (3, k), along x, y, z where it can be."""
    basis = range_space(space)
    out = []
    while basis.shape[1]:
        shares = np.linalg.norm(basis, axis=1)
        axis = basis @ basis[int(np.flatnonzero(shares > shares.max() - 1e-6)[0])]
        axis = axis / np.linalg.norm(axis)
        out.append(axis)
        basis = range_space(basis - np.outer(axis, axis @ basis))
    order = sorted(range(len(out)), key=lambda k: int(np.argmax(np.abs(out[k]))))
    return [out[k] for k in order]

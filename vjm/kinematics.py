"""Kinematics of any mechanism: configurations from tool poses or from displacements of the drives.

The branch is the one that is reached from home: coordinates are followed along straight lines of the given values, in
steps that Newton's method takes without doubt, from home or from a pose that was reached before.
"""

# pyright: reportMissingTypeStubs=false, reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# (scipy declares few types)

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import KDTree

from stiffscope.errors import InputError
from stiffscope.vjm.checks import spell_name
from stiffscope.vjm.closure import CLOSED, Closure
from stiffscope.vjm.linkage import Linkage, rotation_vector
from stiffscope.vjm.mechanism import COORDINATES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import ArrayLike, NDArray

    from stiffscope.vjm.joints import Joint
    from stiffscope.vjm.linkage import Given, Placed
    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.screws import Array

CHUNK = 1024  # poses; what is at work stays within the processor's cache
_FEW = 1500  # poses, below which each is followed from home
_LANDMARKS = 1200
_SHORTEST, _SHORT = 1.0 / 1024.0, 1.0 / 4.0  # of the way from home, or from a pose near by
_CAREFUL = 1.0 / 16.0  # of the way from home, the longest step where longer ones lead to another branch
_NEIGHBOURS = 3.0  # distances between poses, within which one is reached from another
_ROUNDS = 20
_SLACK = 1e-9  # rad or m; a drive at the very end of its range is still in it
_FIT = 0.05  # rad or own lengths that a predicted start may be off
_REACHED, _OPEN, _RANGE, _BRANCH = range(4)


@dataclass(frozen=True, eq=False)
class Configurations:
    """A mechanism at n configurations.

    ``poses`` (n, k): commanded tool coordinates; ``tool`` (n, 6): x y z in m, rotation vector from home in rad;
    ``valid`` (n,): where every loop closes on the branch of home with all drives in range. Elsewhere numbers are NaN
    and ``reason`` tells why.
    """

    mechanism: Mechanism
    poses: Array
    tool: Array
    valid: NDArray[np.bool_]
    q: Array
    linkage: Linkage
    failure: NDArray[np.int8]
    culprit: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.valid)

    def __getitem__(self, some: slice | NDArray[np.intp] | NDArray[np.bool_]) -> Configurations:
        poses, tool, valid = self.poses[some], self.tool[some], self.valid[some]
        q, failure, culprit = self.q[:, some], self.failure[some], self.culprit[some]
        return Configurations(self.mechanism, poses, tool, valid, q, self.linkage, failure, culprit)

    @cached_property
    def placed(self) -> Placed:
        """Links where they are."""
        return self.linkage.placed(self.q)

    def link_frame(self, link: int) -> tuple[Array, Array]:
        """Displacement from home of a rigid link: rotation (n or 1, 3, 3) and position (n or 1, 3)."""
        rotation = np.ascontiguousarray(np.moveaxis(self.placed.rotation[link], -1, 0))
        return rotation, np.ascontiguousarray(self.placed.position[link].T)

    def frame(self, node: str) -> tuple[Array, Array]:
        """Rotation (n, 3, 3) and position (n, 3) of a node.

        Of a rigid body its displacement from home, of an elastic body's end the part axes and the end's place.
        """
        link = self.linkage.frame[self.linkage.link_of[node]]
        rotation, position = self.link_frame(link)
        body = next((b for b in self.mechanism.bodies if node in b.nodes), None)
        if body is not None and body.elastic is not None:
            end = body.elastic.places[body.nodes.index(node)]
            rotation, position = rotation @ body.elastic.axes, rotation @ end + position
        n = len(self)
        return np.broadcast_to(rotation, (n, 3, 3)), np.broadcast_to(position, (n, 3))

    def coordinates(self, joint: str) -> Array:
        """Coordinates (n, f) of a joint as displaced from home, rad and m, in the order of its free motions."""
        return self.linkage.coordinates(self.mechanism.joint(joint), self.q, self.placed)

    @property
    def drives(self) -> Array:
        """Displacements (n, d) of the drives from home, in the mechanism's order."""
        joints = self.mechanism.drives
        columns = [self.coordinates(j.name)[:, j.driven or 0] for j in joints]
        return np.stack(columns, axis=1) if columns else np.zeros((len(self), 0))

    def reason(self, index: int) -> str:
        """Why a configuration is not valid; empty where it is."""
        if self.valid[index]:
            return ""
        if int(self.failure[index]) == _RANGE:
            k = int(self.culprit[index])
            return _range_text(self.mechanism.drives[k], float(self.drives[index, k]))
        if int(self.failure[index]) == _OPEN:
            solver = solver_of(self.mechanism, self.linkage.given)
            q = np.zeros((self.linkage.size, 1))
            q[self.linkage.known] = self.q[self.linkage.known, index, None]
            found = solver.closure.solve(q, 50, patient=True)
            if not (found.error[:, 0] < CLOSED).all():
                worst = np.nan_to_num(found.error[:, 0], nan=np.inf).argmax()
                name = spell_name("joints", self.linkage.cuts[int(worst)].joint.name)
                return f"out of reach: the loop through {name} does not close"
        return "on another branch, or too close to one: no way leads there from home without passing a singular pose"

    def required(self) -> Configurations:
        """Itself, where all are valid. Raises InputError with the first that is not."""
        bad = np.flatnonzero(~self.valid)
        if bad.size:
            i = int(bad[0])
            given = ", ".join(
                f"{name} = {v:.6g}" for name, v in zip(self.mechanism.tool.pose, self.poses[i], strict=True)
            )
            raise InputError(f"pose {i} ({given}): {self.reason(i)}")
        return self


def configure(mechanism: Mechanism, poses: ArrayLike) -> Configurations:
    """Configurations at tool poses (n, k), one column for each coordinate of ``tool.pose``, m and rad.

    Raises InputError for an array of another shape, a number that is not finite, and a mechanism that cannot move as
    its poses say. A pose out of reach is not valid.
    """
    points = checked_poses(mechanism, poses)
    parts = list(configured(mechanism, points))
    return parts[0] if len(parts) == 1 else _joined(mechanism, parts)


def configured(mechanism: Mechanism, points: Array, size: int = CHUNK) -> Iterator[Configurations]:
    """Configurations at checked poses (n, k), ``size`` at a time."""
    solver = solver_of(mechanism, "tool")
    home = mechanism.tool.home
    yield from _all(solver, points - home, size)


def configure_drives(mechanism: Mechanism, displacements: ArrayLike) -> Configurations:
    """Configurations at displacements (n, d) of all drives from home, in the mechanism's order, m and rad.

    Raises InputError for an array of another shape or a number that is not finite.
    """
    names = [j.name for j in mechanism.drives]
    values = _checked(displacements, names, "drives")
    parts = list(_all(solver_of(mechanism, "drives"), values, CHUNK))
    return parts[0] if len(parts) == 1 else _joined(mechanism, parts)


def checked_poses(mechanism: Mechanism, poses: ArrayLike) -> Array:
    """Poses as a stack (n, k). Raises InputError on another shape or what is not finite."""
    return _checked(poses, list(mechanism.tool.pose), "poses")


def _checked(values: ArrayLike, names: list[str], what: str) -> Array:
    array = np.atleast_2d(np.asarray(values, dtype=float))
    if array.ndim != 2 or array.shape[1] != len(names):
        raise InputError(f"{what}: expected (n, {len(names)}) numbers {', '.join(names)}, got shape {np.shape(values)}")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if bad.size:
        raise InputError(f"{what}: row {int(bad[0])}: expected finite numbers, got {array[bad[0]].tolist()}")
    return array


def _range_text(joint: Joint, value: float) -> str:
    turns = joint.kind == "revolute"
    factor, unit = (180.0 / np.pi, "deg") if turns else (1.0, "m")
    low, high = (joint.drive.low, joint.drive.high) if joint.drive else (-np.inf, np.inf)
    here = spell_name("joints", joint.name)
    ends = f"{low * factor:.6g} to {high * factor:.6g}"
    return f"{here}: {value * factor:.6g} {unit} is outside its range {ends} {unit}"


def _joined(mechanism: Mechanism, parts: list[Configurations]) -> Configurations:
    keys = ("poses", "tool", "valid", "failure", "culprit")
    poses, tool, valid, failure, culprit = (np.concatenate([getattr(p, key) for p in parts]) for key in keys)
    q = np.concatenate([p.q for p in parts], axis=1)
    return Configurations(mechanism, poses, tool, valid, q, parts[0].linkage, failure, culprit)


@dataclass(eq=False)
class Solver:
    """The equations at home, and what was learned of them since."""

    mechanism: Mechanism
    linkage: Linkage
    closure: Closure
    home_sign: float
    """Sign of the determinant of drives by commanded coordinates at home; 0 where it tells nothing."""


_solvers: WeakKeyDictionary[Mechanism, dict[Given, Solver]] = WeakKeyDictionary()


def solver_of(mechanism: Mechanism, given: Given) -> Solver:
    """The equations of a mechanism, ranked once."""
    known = _solvers.setdefault(mechanism, {})
    if given not in known:
        linkage = Linkage(mechanism, given)
        home = np.zeros(linkage.size)
        closure = Closure(linkage, home)
        locked = set(range(len(linkage.known))) - set(closure.commanded)
        if locked and given == "tool":
            names = ", ".join(mechanism.tool.pose[k] for k in sorted(locked))
            raise InputError(
                f"tool.pose: expected coordinates that the mechanism can move in at home, got {names}, held there"
            )
        solver = Solver(mechanism, linkage, closure, 0.0)
        if given == "tool":
            placed = linkage.placed(home[:, None])
            solver.home_sign = float(drive_sign(solver, placed, closure.rates(placed, {}))[0])
        known[given] = solver
    return known[given]


def drive_sign(solver: Solver, placed: Placed, rates: Array) -> Array:
    """Sign (n,) of the determinant of the drives' rates by the commanded coordinates; zeros where it is not square."""
    drives = solver.mechanism.drives
    n = rates.shape[2]
    if len(drives) != rates.shape[1]:
        return np.zeros(n)
    rows = np.empty((n, len(drives), len(drives)))
    linkage = solver.linkage
    for k, joint in enumerate(drives):
        scale = 1.0 if joint.kind == "revolute" else linkage.length
        if joint.name in linkage.columns:
            rows[:, k] = rates[linkage.columns[joint.name][joint.driven or 0]].T / scale
            continue
        cut = next(c for c in linkage.cuts if c.joint is joint)
        across = np.einsum("cin,ckn,c->ikn", placed.twists[cut.columns], rates[cut.columns], cut.signs)
        axis = joint.axes[:, 0] @ placed.rotation[cut.first]
        if joint.kind == "revolute":
            rows[:, k] = np.einsum("in,ikn->nk", np.broadcast_to(axis, (3, n)), across[3:])
        else:
            at = np.broadcast_to(placed.point(cut.second, joint.at), (3, n))
            moved = across[:3] - np.cross(at[:, None], across[3:], axis=0)
            rows[:, k] = np.einsum("in,ikn->nk", np.broadcast_to(axis, (3, n)), moved) / scale
    rows = rows * linkage.scale[linkage.known]
    finite = np.isfinite(rows).all(axis=(1, 2))
    rows[~finite] = 0.0
    size = np.linalg.norm(rows, axis=2).prod(axis=1)
    det = np.linalg.det(rows)
    return np.where(np.abs(det) > 1e-9 * np.where(size > 0.0, size, 1.0), np.sign(det), 0.0)


def _all(solver: Solver, values: Array, size: int) -> Iterator[Configurations]:
    """Configurations at given values (n, k), displacements from home."""
    if len(values) <= _FEW:
        known = _Reached(solver)
        yield known.visit(values)
        return
    rng = np.random.default_rng(0)
    known = _Reached(solver)
    known.visit(values[rng.choice(len(values), _LANDMARKS, replace=False)])
    known.fit()
    for start in range(0, len(values), size):
        yield known.visit(values[start : start + size])


class _Reached:
    """Poses reached so far, from which others are."""

    def __init__(self, solver: Solver) -> None:
        self.solver = solver
        linkage = solver.linkage
        self.unit = linkage.scale[linkage.known]
        self.values: Array = np.zeros((1, len(linkage.known)))
        self.q: Array = np.zeros((linkage.size, 1))
        self.near = np.inf
        self.predict: Callable[[Array], Array] | None = None

    def visit(self, values: Array) -> Configurations:
        """Configurations at given values (n, k)."""
        solver, linkage = self.solver, self.solver.linkage
        n = len(values)
        failure, culprit = np.zeros(n, dtype=np.int8), np.zeros(n, dtype=np.intp)
        if self.predict is None:
            q, done = np.zeros((linkage.size, n)), np.zeros(n, dtype=bool)
            placed, factors = None, {}
        else:
            q = self.predict(values)
            q[linkage.known] = values.T
            found = solver.closure.solve(q)
            q, done, placed, factors = found.q, found.closed.copy(), found.placed, found.factors
        if placed is None or not done.all():
            self._follow(values, q, done)
            placed, factors = linkage.placed(q), {}
        failure[~done] = _OPEN
        crossed = self._crossed(placed, factors) & done
        if crossed.any() and self.predict is None:  # a step may end on another branch near by, a short one does not
            again = np.flatnonzero(crossed)
            home = np.zeros((len(again), len(linkage.known))), np.zeros((linkage.size, len(again)))
            reached, at = self._walk(*home, values[again], _SHORTEST, _CAREFUL)
            again, at = again[reached], at[:, reached]
            q[:, again], crossed[again] = at, self._crossed(linkage.placed(at), {})
            placed = linkage.placed(q)
        failure[crossed] = _BRANCH
        return self._configurations(q, placed, failure, culprit)

    def _crossed(self, placed: Placed, factors: dict[tuple[int, int], Array]) -> NDArray[np.bool_]:
        """Which configurations (n,) are beyond a pose where the drives' rates by the commanded ones are singular."""
        solver = self.solver
        if not solver.home_sign:
            return np.zeros(placed.q.shape[1], dtype=bool)
        return drive_sign(solver, placed, solver.closure.rates(placed, factors)) * solver.home_sign < 0.0

    def _follow(self, values: Array, q: Array, done: NDArray[np.bool_]) -> None:
        """Reach the values that are not yet done: from home, then those near by from what was reached before them."""
        linkage = self.solver.linkage
        if len(self.values) == 1:
            near = np.flatnonzero(~done)
            self._reach(values, q, done, near, np.zeros(len(near), dtype=int), _SHORTEST)
            unit = values / self.unit
            spacing = KDTree(unit).query(unit, k=min(2, len(unit)))[0]
            self.near = _NEIGHBOURS * float(np.median(spacing[..., -1]))
        for _ in range(_ROUNDS):
            left = np.flatnonzero(~done)
            if not left.size:
                return
            distance, start = map(np.asarray, KDTree(self.values / self.unit).query(values[left] / self.unit))
            close = distance <= self.near
            if not self._reach(values, q, done, left[close], start[close], _SHORT):
                break
        lost = np.flatnonzero(~done)
        q[:, lost] = np.nan
        q[np.array(linkage.known, dtype=int)[:, None], lost] = values[lost].T

    def _reach(
        self,
        values: Array,
        q: Array,
        done: NDArray[np.bool_],
        some: NDArray[np.intp],
        start: NDArray[np.intp],
        shortest: float,
    ) -> bool:
        """Walk to some of the values from ``start`` among what was reached; whether any new one was."""
        if not some.size:
            return False
        reached, at = self._walk(self.values[start], self.q[:, start], values[some], shortest)
        there = some[reached]
        q[:, there] = at[:, reached]
        done[there] = True
        self.values = np.concatenate([self.values, values[there]])
        self.q = np.concatenate([self.q, at[:, reached]], axis=1)
        return bool(reached.any())

    def _walk(
        self, start: Array, q: Array, end: Array, shortest: float, longest: float = 1.0
    ) -> tuple[NDArray[np.bool_], Array]:
        """Follow coordinates (m, n) from start to end values (n, k), each in steps of its own, as shares of the way."""
        linkage, closure = self.solver.linkage, self.solver.closure
        n = q.shape[1]
        way, step = np.zeros(n), np.full(n, longest)
        q = q.copy()
        some = np.arange(n)
        while some.size:
            ahead = np.minimum(way[some] + step[some], 1.0)
            trial = q[:, some]
            trial[linkage.known] = (start[some] + ahead[:, None] * (end[some] - start[some])).T
            found = closure.solve(trial)
            good = found.closed
            q[:, some[good]] = found.q[:, good]
            way[some[good]] = ahead[good]
            step[some] = np.where(good, np.minimum(2.0 * step[some], longest), 0.5 * step[some])
            some = some[(way[some] < 1.0) & (step[some] >= shortest)]
        return way >= 1.0, q

    def fit(self) -> None:
        """Predict starts by a polynomial of the given values, where one fits what was reached."""
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        middle, half = 0.5 * (low + high), np.where(high > low, 0.5 * (high - low), 1.0)
        count, k = self.values.shape
        degree = 1
        while degree < 14 and _terms(k, degree + 1) <= count // 4:
            degree += 1
        powers = [p for d in range(degree + 1) for p in combinations_with_replacement(range(k), d)]

        def features(values: Array) -> Array:
            unit = (values - middle) / half
            return _chebyshev(unit, powers, degree)

        table = features(self.values)
        train = np.arange(count) % 4 > 0
        solution = np.linalg.lstsq(table[train], self.q.T[train], rcond=None)[0]
        off = np.abs(table[~train] @ solution - self.q.T[~train]) / self.solver.linkage.scale
        if float(np.quantile(off.max(axis=1), 0.9)) < _FIT:
            self.predict = lambda values: np.ascontiguousarray((features(values) @ solution).T)
        else:
            tree = KDTree(self.values / self.unit)
            self.predict = lambda values: self.q[:, tree.query(values / self.unit)[1]]

    def _configurations(
        self, q: Array, placed: Placed, failure: NDArray[np.int8], culprit: NDArray[np.intp]
    ) -> Configurations:
        linkage, mechanism = self.solver.linkage, self.solver.mechanism
        link = linkage.frame[linkage.link_of[mechanism.tool.body]]
        tool = np.empty((q.shape[1], 6))
        tool[:, :3] = placed.point(link, mechanism.tool.at).T
        if "" in linkage.columns:
            tool[:, 3:] = q[linkage.columns[""][3:]].T
        else:
            tool[:, 3:] = rotation_vector(np.moveaxis(placed.rotation[link], -1, 0))
        poses = tool[:, mechanism.tool.commanded]
        if "" in linkage.columns:
            poses = mechanism.tool.home + q[linkage.known].T
        out = Configurations(mechanism, poses, tool, failure == 0, q, linkage, failure, culprit)
        out.__dict__["placed"] = placed
        drives = out.drives
        for k, joint in enumerate(mechanism.drives):
            if joint.drive is None or not np.isfinite([joint.drive.low, joint.drive.high]).any():
                continue
            outside = (drives[:, k] < joint.drive.low - _SLACK) | (drives[:, k] > joint.drive.high + _SLACK)
            outside &= failure == _REACHED
            failure[outside], culprit[outside] = _RANGE, k
        np.equal(failure, 0, out=out.valid)
        return out


def _terms(k: int, degree: int) -> int:
    out = 1
    for i in range(degree):
        out = out * (k + i + 1) // (i + 1)
    return out


def _chebyshev(unit: Array, powers: list[tuple[int, ...]], degree: int) -> Array:
    """Products (n, terms) of Chebyshev polynomials of the columns of ``unit`` (n, k)."""
    n, k = unit.shape
    tables = np.ones((degree + 1, k, n))
    if degree:
        tables[1] = unit.T
    for d in range(2, degree + 1):
        tables[d] = 2.0 * unit.T * tables[d - 1] - tables[d - 2]
    out = np.ones((len(powers), n))
    for row, power in enumerate(powers):
        for column in set(power):
            out[row] *= tables[power.count(column), column]
    return out.T


__all__ = ["COORDINATES", "Configurations", "checked_poses", "configure", "configure_drives", "configured"]

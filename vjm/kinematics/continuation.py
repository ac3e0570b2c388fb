"""Continuation of configurations from home along straight lines in the given values.

Steps are short enough for Newton's method, from home or from a pose reached before.
"""

# pyright: reportMissingTypeStubs=false, reportUnknownArgumentType=false
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# (scipy declares few types)

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, combinations_with_replacement
from math import comb, prod
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from scipy.linalg import lstsq
from scipy.spatial import KDTree

from stiffscope.errors import InputError, require
from stiffscope.vjm.kinematics.closure import Closure, find_locked
from stiffscope.vjm.kinematics.linkage import Linkage, rotation_vector

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from stiffscope.vjm.kinematics.closure import Factors
    from stiffscope.vjm.kinematics.linkage import Given, LinkFrames
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array

_FEW = 1500  # poses, below which each is followed from home
_LANDMARKS = 1200
_SHORTEST = 1.0 / 1024.0
_SHORT = 1.0 / 4.0  # of the path from home, or from a nearby pose
_CAREFUL = (
    1.0 / 16.0
)  # of the path from home: longest step if longer ones lead to another branch
_NEIGHBOURS = (
    3.0  # multiple of the pose spacing within which one pose is reached from another
)
_ROUNDS = 20
_FIT = 0.05  # rad or relative length: tolerance of a predicted start
_ASIDE = 0.1  # rad or relative length: displacement of drives from a singular home
_TOGETHER = 3  # largest number of drives displaced together
_STEP = 1e-4  # rad or relative length, of finite differences
_SAME = 1e-12  # rad or relative length: a pose taken as home
_DEGREE = 14  # largest degree of the polynomial that predicts starts
REACHED, OPEN, RANGE, BRANCH = range(4)


@dataclass(eq=False)
class Solver:
    """Equations at the start configuration of paths, with cached derivatives.

    ``start`` (m,): home or the nearest regular configuration; ``displaced``: drives off home there.
    """

    mechanism: Mechanism
    linkage: Linkage
    closure: Closure
    start: Array
    displaced: dict[str, float]
    rates: Array
    """Rates of the coordinates (m, k) at the start per given value."""
    bends: Array
    """Derivatives (m, k, k) of these rates by the given values."""
    home_sign: float = 0.0
    """Sign of the drives' determinant (``drive_sign``) at the start; 0 if undetermined."""

    @cached_property
    def ranges(self) -> tuple[Array, Array]:
        """See `find_ranges`."""
        return find_ranges(self.mechanism)

    @property
    def start_values(self) -> Array:
        """Given values (k,) at the start, as displacements from home."""
        return self.start[self.linkage.known]


def find_ranges(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return the least and greatest displacement (d,) of the drives from home, infinite without an end."""
    drives = [j.drive for j in mechanism.drives if j.drive is not None]
    return np.array([d.low for d in drives]), np.array([d.high for d in drives])


_solvers: WeakKeyDictionary[Mechanism, dict[Given, Solver]] = WeakKeyDictionary()


def find_solver(mechanism: Mechanism, given: Given) -> Solver:
    """Return the cached solver of a mechanism.

    Raises InputError if the tool cannot move along a commanded coordinate, at home or nearby.
    """
    known = _solvers.setdefault(mechanism, {})
    if given not in known:
        linkage = Linkage(mechanism, given)
        require(linkage.size, "joints", "one that can move", "none")
        start = np.zeros(linkage.size)
        displaced = dict[str, float]()
        if given == "tool" and (locked := find_locked(linkage, start)[0]):
            regular = _find_regular(mechanism, linkage)
            if regular is None:
                names = ", ".join(mechanism.tool.pose[k] for k in sorted(locked))
                expected = "coordinates that the mechanism can move in at home"
                raise InputError(
                    f"tool.pose: expected {expected}, got {names}, held there or by the "
                    "others; [] is the one pose of what cannot move"
                )
            start, displaced = regular
        placed = linkage.find_link_frames(start[:, None])
        closure = Closure(linkage, start)
        rates = closure.rates(placed)
        bends = _differentiate_rates(closure, start, rates)
        solver = Solver(
            mechanism, linkage, closure, start, displaced, rates[..., 0], bends
        )
        if given == "tool":
            solver.home_sign = float(drive_sign(solver, placed, rates)[0])
        known[given] = solver
    return known[given]


def _differentiate_rates(closure: Closure, start: Array, rates: Array) -> Array:
    """Return central differences (m, k, k) of the rates (m, k, 1) by known coordinates."""
    linkage = closure.linkage
    if not linkage.known:
        return np.zeros((linkage.size, 0, 0))
    step = _STEP * linkage.scale[linkage.known]
    ahead, behind = (start[:, None] + rates[..., 0] * way for way in (step, -step))
    change = closure.rates(linkage.find_link_frames(ahead)) - closure.rates(
        linkage.find_link_frames(behind)
    )
    return np.nan_to_num(0.5 * change / step)


def _find_regular(
    mechanism: Mechanism, linkage: Linkage
) -> tuple[Array, dict[str, float]] | None:
    """Return the nearest regular configuration (m,) and the displaced drives; None if not found.

    As few drives as possible are displaced: those that lead farthest from a singular configuration.
    """
    solver = find_solver(mechanism, "drives")
    drives = [j for j in mechanism.drives if j.name in solver.linkage.columns]
    steps = [_step_of(joint, linkage.length) for joint in drives]
    for count in range(1, min(_TOGETHER, len(drives)) + 1):
        best = (0.0, np.zeros(0), dict[str, float]())
        for some in combinations(range(len(drives)), count):
            values = np.array([[step * (k in some) for k, step in enumerate(steps)]])
            (followed,) = follow_paths(solver, values, 1)
            if followed.failure[0] != REACHED:
                continue
            q = _transfer(solver.linkage, linkage, followed)
            locked, margin = find_locked(linkage, q)
            if not locked and margin > best[0]:
                best = (margin, q, {drives[k].name: steps[k] for k in some})
        if best[0]:
            return best[1:]
    return None


def _step_of(joint: Joint, length: float) -> float:
    """Return the displacement of a drive towards a regular configuration, within its range."""
    step = _ASIDE * (1.0 if joint.turns else length)
    low, high = (
        (joint.drive.low, joint.drive.high) if joint.drive else (-np.inf, np.inf)
    )
    return (
        step
        if step <= high
        else -step
        if low <= -step
        else 0.5 * max(high, low, key=abs)
    )


def _transfer(source: Linkage, target: Linkage, followed: Followed) -> Array:
    """Convert a configuration of one linkage to coordinates (m,) of another's spanning tree."""
    q = np.zeros(target.size)
    tool = target.mechanism.tool
    for joint in target.mechanism.joints:
        if joint.name in target.columns:
            coordinates = source.coordinates(joint, followed.q, followed.placed)
            q[target.columns[joint.name]] = coordinates[0]
    frame = source.frame[source.link_of[tool.body]]
    moved = followed.placed.point(frame, tool.at)[:, 0] - tool.at
    turned = rotation_vector(followed.placed.rotation[frame].transpose(2, 0, 1))[0]
    q[target.columns[""]] = np.concatenate([moved, turned])
    return q


def drive_sign(solver: Solver, placed: LinkFrames, rates: Array) -> Array:
    """Return the sign (n,) of det(drive rates by commanded coordinates); 0 if not square.

    Parameters
    ----------
    solver
        Solver of the mechanism.
    placed
        Links at the configurations.
    rates
        Rates of the coordinates by the commanded coordinates.
    """
    drives = [j for j in solver.mechanism.drives if not solver.closure.holds(j)]
    n = rates.shape[2]
    if len(drives) != rates.shape[1]:
        return np.zeros(n)
    rows = np.empty((n, len(drives), len(drives)))
    linkage = solver.linkage
    for k, joint in enumerate(drives):
        scale = 1.0 if joint.turns else linkage.length
        if joint.name in linkage.columns:
            rows[:, k] = rates[linkage.columns[joint.name][joint.driven or 0]].T / scale
            continue
        cut = next(c for c in linkage.cuts if c.joint is joint)
        twists = placed.twists[cut.columns] * cut.signs[:, None, None]
        moved = across = np.einsum("cin,ckn->ikn", twists, rates[cut.columns])
        axis = np.broadcast_to(joint.axes[:, 0] @ placed.rotation[cut.first], (3, n))
        if joint.turns:
            moved = across[3:]
        else:
            at = np.broadcast_to(placed.point(cut.second, joint.at), (3, n))
            moved = across[:3] - np.cross(at[:, None], across[3:], axis=0)
        rows[:, k] = np.einsum("in,ikn->nk", axis, moved) / scale
    rows = rows * linkage.scale[linkage.known]
    rows[~np.isfinite(rows).all(axis=(1, 2))] = 0.0
    det = np.linalg.det(rows)
    largest = np.linalg.norm(rows, axis=2).prod(axis=1)
    return np.where(np.abs(det) > 1e-9 * largest, np.sign(det), 0.0)


@dataclass(frozen=True, eq=False)
class Followed:
    """Path ends ``q`` (m, n), the links there, and ``failure`` (n,): REACHED, OPEN or BRANCH."""

    q: Array
    placed: LinkFrames
    failure: NDArray[np.int8]


def follow_paths(solver: Solver, values: Array, size: int) -> Iterator[Followed]:
    """Follow paths to given values (n, k), displacements from home, in chunks.

    Parameters
    ----------
    solver
        Solver of the mechanism.
    values
        Displacements (n, k) from home.
    size
        Configurations per chunk; more take more memory.
    """
    if not values.shape[1]:  # nothing is commanded: the one pose of a structure
        for first in range(0, max(len(values), 1), size):
            count = len(values[first : first + size])
            q = np.repeat(solver.start[:, None], count, axis=1)
            placed = solver.linkage.find_link_frames(q)
            yield Followed(q, placed, np.zeros(count, dtype=np.int8))
        return
    if len(values) <= _FEW:
        yield KnownConfigurations(solver).solve(values)
        return
    known = KnownConfigurations.sample(solver, values)
    for start in range(0, len(values), size):
        yield known.solve(values[start : start + size])


class KnownConfigurations:
    """Poses reached so far, from which others are reached."""

    @classmethod
    def sample(cls, solver: Solver, values: Array) -> KnownConfigurations:
        """Sample given values (n, k) to predict starts for the others."""
        out = cls(solver)
        count = min(len(values), _LANDMARKS)
        out.solve(
            values[np.random.default_rng(0).choice(len(values), count, replace=False)]
        )
        out.fit()
        return out

    def __init__(self, solver: Solver) -> None:
        self.solver = solver
        linkage = solver.linkage
        self.unit = linkage.scale[linkage.known]
        self.values: Array = solver.start_values[None]
        self.q: Array = solver.start[:, None]
        self.near = 0.0
        self.predict: Callable[[Array], Array] | None = None

    def solve(self, values: Array) -> Followed:
        """Follow paths to given values (n, k)."""
        solver = self.solver
        linkage = self.solver.linkage
        n = len(values)
        failure = np.zeros(n, dtype=np.int8)
        home = (np.abs(values) < _SAME * self.unit).all(axis=1) & bool(solver.displaced)
        q, first = self._start(values)
        q[linkage.known] = values.T
        solution = solver.closure.solve(q, first=first)
        q = solution.q
        done = solution.closed.copy()
        placed = solution.placed
        factors = (
            None if self.predict is None and n > 1 else solution.factors
        )  # not stragglers'
        if (
            home.any()
        ):  # singular: paths start elsewhere, all coordinates are zero there
            q[:, home] = 0.0
            done[home] = True
            placed = None
        if self.predict is None:
            self._keep(values, q, done)
            if n > 1:
                spacing = KDTree(values / self.unit).query(values / self.unit, k=2)[0]
                self.near = _NEIGHBOURS * float(np.median(spacing[:, 1]))
        if placed is None or not done.all():
            self._follow(values, q, done)
            placed = linkage.find_link_frames(q)
            factors = None
        failure[~done] = OPEN
        crossed = self._find_crossed(placed, factors) & done & ~home
        if crossed.any() and self.predict is None:  # short steps stay on their branch
            again = np.flatnonzero(crossed)
            first = np.zeros(len(again), dtype=int)  # of those reached: the start
            reached, at = self._walk(first, values[again], _SHORTEST, _CAREFUL)
            again = again[reached]
            at = at[:, reached]
            crossed[again] = self._find_crossed(linkage.find_link_frames(at))
            q[:, again] = at
            placed = linkage.find_link_frames(q)
        failure[crossed] = BRANCH
        return Followed(q, placed, failure)

    def _start(self, values: Array) -> tuple[Array, Array | None]:
        """Return starts (m, n) for given values (n, k), and step sizes (n,) from the start."""
        if self.predict:
            return self.predict(values), None
        solver = self.solver
        columns = self.solver.closure.columns
        along = (values - solver.start_values).T
        step = solver.rates @ along
        size = np.abs(step[columns] / solver.linkage.scale[columns, None]).max(
            axis=0, initial=0.0
        )
        bent = ((solver.bends @ along) * along).sum(axis=1)
        return solver.start[:, None] + step + 0.5 * bent, size

    def _keep(
        self, values: Array, q: Array, index: NDArray[np.intp] | NDArray[np.bool_]
    ) -> None:
        """Remember some of values (n, k) and coordinates (m, n): those that were reached."""
        self.values = np.concatenate([self.values, values[index]])
        self.q = np.concatenate([self.q, q[:, index]], axis=1)

    def _find_crossed(
        self, placed: LinkFrames, factors: Factors | None = None
    ) -> NDArray[np.bool_]:
        """Return which configurations (n,) lie beyond a singularity of the drive rates."""
        solver = self.solver
        if not solver.home_sign:
            return np.zeros(placed.q.shape[1], dtype=bool)
        rates = solver.closure.rates(placed, factors)
        return drive_sign(solver, placed, rates) * solver.home_sign < 0.0

    def _follow(self, values: Array, q: Array, done: NDArray[np.bool_]) -> None:
        """Reach the remaining poses, from home first, then from poses reached before."""
        linkage = self.solver.linkage
        if self.predict is None:
            far = np.flatnonzero(~done)
            self._reach(
                values, q, done, far, np.zeros(len(far), dtype=int), _SHORTEST, 0.5
            )
        for _ in range(_ROUNDS):
            left = np.flatnonzero(~done)
            if not left.size:
                return
            tree = KDTree(self.values / self.unit)
            distance, start = map(np.asarray, tree.query(values[left] / self.unit))
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
        index: NDArray[np.intp],
        start: NDArray[np.intp],
        shortest: float,
        first: float = 1.0,
    ) -> bool:
        """Walk to some values from reached ones; return whether any new one was reached."""
        if not index.size:
            return False
        reached, at = self._walk(start, values[index], shortest, first=first)
        there = index[reached]
        q[:, there] = at[:, reached]
        done[there] = True
        self._keep(values, q, there)
        return bool(there.size)

    def _walk(
        self,
        origin: NDArray[np.intp],
        end: Array,
        shortest: float,
        longest: float = 1.0,
        first: float = 1.0,
    ) -> tuple[NDArray[np.bool_], Array]:
        """Go to values (n, k) from reached ones ``origin`` (n,), each with its own steps."""
        linkage = self.solver.linkage
        closure = self.solver.closure
        start = self.values[origin]
        q = self.q[:, origin]
        going = np.arange(len(origin))
        way = np.zeros(len(going))
        step = np.full(len(going), min(first, longest))
        while going.size:
            ahead = np.minimum(way[going] + step[going], 1.0)
            trial = q[:, going]
            trial[linkage.known] = (
                start[going] + ahead[:, None] * (end[going] - start[going])
            ).T
            solution = closure.solve(trial)
            good = solution.closed
            q[:, going[good]], way[going[good]] = solution.q[:, good], ahead[good]
            step[going] = np.where(
                good, np.minimum(2.0 * step[going], longest), 0.5 * step[going]
            )
            going = going[(way[going] < 1.0) & (step[going] >= shortest)]
        return way >= 1.0, q

    def fit(self) -> None:
        """Fit a polynomial that predicts starts; without a good fit use nearest neighbours."""
        low = self.values.min(axis=0)
        high = self.values.max(axis=0)
        half = np.where(high > low, 0.5 * (high - low), 1.0)
        middle = 0.5 * (low + high)
        count, k = self.values.shape
        degree = 1
        while degree < _DEGREE and comb(k + degree + 1, k) <= count // 4:
            degree += 1
        powers = [
            p
            for d in range(degree + 1)
            for p in combinations_with_replacement(range(k), d)
        ]

        def features(values: Array) -> Array:
            """Return products (n, terms) of Chebyshev polynomials of the values."""
            tables = chebvander(((values - middle) / half).T, degree)
            out = np.empty((len(powers), len(values)))
            for row, power in enumerate(powers):
                out[row] = prod(tables[c, :, power.count(c)] for c in set(power))
            return out.T

        table = features(self.values)
        train = np.arange(count) % 4 > 0
        coefficients = lstsq(
            table[train], self.q.T[train], cond=1e-12, lapack_driver="gelsy"
        )
        solution = np.asarray(coefficients[0])  # pyright: ignore[reportOptionalSubscript]
        off = (
            np.abs(table[~train] @ solution - self.q.T[~train])
            / self.solver.linkage.scale
        )
        if float(np.quantile(off.max(axis=1), 0.9)) < _FIT:
            self.predict = lambda values: np.ascontiguousarray(
                (features(values) @ solution).T
            )
        else:
            tree = KDTree(self.values / self.unit)
            self.predict = lambda values: self.q[:, tree.query(values / self.unit)[1]]

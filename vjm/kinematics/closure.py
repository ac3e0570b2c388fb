"""Loop closure by Newton's method, vectorized over poses.

The equations are ranked once, at home: columns not needed for full rank are held (idle motions,
redundant drives); rows that depend on others (overconstrained loops) are only verified. The rest is
square, sparse and factored without pivoting in an order found at home, entries vectors over poses.
"""

# pyright: reportMissingTypeStubs=false, reportUnknownArgumentType=false
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# (scipy declares few types)

from __future__ import annotations

from dataclasses import dataclass
from itertools import repeat
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.linalg import qr

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from stiffscope.vjm.kinematics.linkage import Linkage, LinkFrames
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.screws import Array

CLOSED = 1e-12  # relative lengths, and rad
_ENOUGH = 2e-13  # below which another step is useless
_RANK = 1e-9
_LOCKED = 1e-7  # of the largest derivative
_STRUCTURAL = 1e-13
_PIVOT = 0.05  # of the largest in its row or column; smaller values are sparser
_STEPS = 8
_CONTRACTION = 0.3  # largest ratio of second to first step of a start close enough
_NEAR = 1e-6  # of a first step that needs no such check
_STILL = 1e-4  # rad or relative length: first step after which the next may reuse the factors
_STRAGGLERS = 0.25  # fraction of the poses that continue separately
_FAR = 0.7  # rad or relative length, of a first step
_LATER = 1e-4  # weight of columns that others replace if there is a choice


Factors: TypeAlias = "SparseFactors | DenseFactors"


@dataclass(frozen=True, eq=False)
class Solution:
    """Coordinates (m, n), whether they close all loops, the links, and the last factors."""

    q: Array
    closed: NDArray[np.bool_]
    placed: LinkFrames
    error: Array  # (rows, n): error of every equation
    factors: Factors | None


def differentiate_closure(linkage: Linkage, q: Array) -> Array:
    """Return derivatives (rows, m, n) of all equations of cut joints at coordinates (m, n)."""
    look = linkage.table.look(q)
    whole = look.wrenches @ look.twists.mT
    signs = np.zeros(whole.shape[1:])
    for cut, start in zip(linkage.cuts, linkage.starts, strict=False):
        signs[start : start + cut.size, cut.columns] = cut.signs
    return (whole * signs).transpose(1, 2, 0) * linkage.scale[:, None]


def find_locked(linkage: Linkage, q: Array) -> tuple[list[int], float]:
    """Return the known coordinates that the loops lock at (m,), and the margin of the others.

    The margin is the smallest nonzero singular value relative to the largest.
    """
    known = linkage.known
    whole = differentiate_closure(linkage, q[:, None])[..., 0]
    if not known or not len(whole):
        return [], 1.0
    unknown = [c for c in range(linkage.size) if c not in known]
    basis, values, _ = np.linalg.svd(whole[:, unknown], full_matrices=False)
    counts = values > _RANK * values.max(initial=1e-300)
    basis = basis[:, counts]
    part = whole[:, known]
    rest = np.linalg.norm(part - basis @ (basis.T @ part), axis=0)
    locked = [k for k in range(len(known)) if rest[k] >= _LOCKED * np.abs(whole).max()]
    return locked, float(values[counts].min(initial=1.0) / values.max(initial=1e-300))


class Closure:
    """Equations of a linkage's cut joints, ranked and ordered at coordinates ``q`` (m,)."""

    def __init__(self, linkage: Linkage, q: Array) -> None:
        self.linkage = linkage
        self.starts = linkage.starts
        whole = differentiate_closure(linkage, q[:, None])[..., 0]
        unknown = [c for c in range(linkage.size) if c not in linkage.known]
        self.columns = np.array(self._independent_columns(whole, unknown), dtype=int)
        self.held = [c for c in unknown if c not in set(self.columns.tolist())]
        self.rows = np.array(_find_independent(whole[:, self.columns].T), dtype=int)
        self.redundant = int(self.starts[-1]) - len(self.rows)
        self.whole = whole
        self._order(q)

    def holds(self, joint: Joint) -> bool:
        """Return whether a joint's drive, or all motions of one without a drive, stay as at home."""
        if self.linkage.welds(joint):
            return True
        columns = self.linkage.columns.get(joint.name, [])
        columns = columns if joint.drive is None else columns[joint.driven or 0 :][:1]
        return bool(columns) and set(self.held).issuperset(columns)

    def _independent_columns(self, whole: Array, unknown: list[int]) -> list[int]:
        """Choose passive columns first, then drives; sprung ones only for what these cannot do."""
        joints = [j for j in self.linkage.mechanism.joints if j.spring is not None]
        sprung = [c for j in joints for c in self.linkage.columns.get(j.name, ())]
        free = [c for c in unknown if c not in sprung]
        chosen = _choose(whole, free, self.linkage.driven)
        return _choose(whole, [*chosen, *sprung], sprung) if sprung else chosen

    def _order(self, q: Array) -> None:
        """Choose pivots by Markowitz's rule, and find the fill of the factors."""
        rng = np.random.default_rng(0)
        spread = (
            q[:, None]
            + 0.3 * rng.normal(size=(len(q), 3)) * self.linkage.scale[:, None]
        )
        everywhere: NDArray[np.bool_] = np.any(
            np.abs(differentiate_closure(self.linkage, spread)) > _STRUCTURAL, axis=2
        )
        used = everywhere[np.ix_(self.rows, self.columns)]
        pattern = used.copy()
        matrix = self.whole[np.ix_(self.rows, self.columns)].copy()
        rows = list(range(len(self.rows)))
        columns = list(range(len(self.columns)))
        row_order: list[int] = []
        column_order: list[int] = []
        while rows:
            sub = np.abs(matrix[np.ix_(rows, columns)])
            mask = pattern[np.ix_(rows, columns)]
            good = sub >= _PIVOT * np.maximum(
                sub.max(axis=0)[None], sub.max(axis=1)[:, None]
            )
            filled = np.outer(mask.sum(axis=1) - 1, mask.sum(axis=0) - 1)
            cost = filled - 1e-3 * sub / max(sub.max(), 1e-300)
            i, j = np.unravel_index(np.argmin(np.where(good, cost, np.inf)), cost.shape)
            r = rows.pop(int(i))
            c = columns.pop(int(j))
            row_order.append(r)
            column_order.append(c)
            for other in rows:
                if pattern[other, c]:
                    pattern[other, columns] |= pattern[r, columns]
                    matrix[other, columns] -= (
                        matrix[other, c] / matrix[r, c] * matrix[r, columns]
                    )
        self.rows = np.array([self.rows[r] for r in row_order], dtype=int)
        self.columns = np.array([self.columns[c] for c in column_order], dtype=int)
        fill = pattern[np.ix_(row_order, column_order)]
        size = range(len(self.rows))
        self.below = [[i for i in size if i > k and fill[i, k]] for k in size]
        self.right = [[j for j in size if j > k and fill[k, j]] for k in size]
        self.cut_of = [
            int(k) for k in np.searchsorted(self.starts, self.rows, side="right") - 1
        ]
        self.rows_of: list[list[tuple[int, int]]] = [[] for _ in self.linkage.cuts]
        for i in np.argsort(self.rows).tolist():
            k = self.cut_of[i]
            self.rows_of[k].append((int(self.rows[i] - self.starts[k]), i))
        sparse = used[np.ix_(row_order, column_order)]
        self.entries = [[j for j in size if sparse[i, j]] for i in size]
        self.weights = np.zeros((len(self.rows), self.linkage.size))
        for i, k in enumerate(self.cut_of):
            cut = self.linkage.cuts[k]
            self.weights[i, cut.columns] = cut.signs
        self.weights[:, self.columns] *= self.linkage.scale[self.columns]

    def solve(
        self,
        q: Array,
        steps: int = _STEPS,
        *,
        patient: bool = False,
        first: Array | None = None,
    ) -> Solution:
        """Solve by Newton's method from coordinates (m, n) with their known rows fixed.

        A pose is closed if all equations hold to 1e-12 and the steps contract as near a solution: a
        start too far away may lead to another branch. ``patient`` continues with poses that do not.

        Parameters
        ----------
        q
            Coordinates (m, n) of the cut mechanism, rad and m.
        steps
            Largest number of Newton steps.
        patient
            Continue with poses whose steps do not contract.
        first
            Size (n,) of the step that led here from the start of the path; None at its start.
        """
        n = q.shape[1]
        linkage = self.linkage
        q = q.copy()
        scale = linkage.scale[self.columns, None]
        trusted = np.ones(n, dtype=bool) if first is None else first < _FAR
        factors: Factors | None = None
        checks = True
        size = np.full(n, np.nan)
        with np.errstate(all="ignore"):
            for count in range(steps + 1):
                placed = linkage.find_link_frames(q)
                errors = placed.errors
                most = np.abs(errors).max(axis=0, initial=0.0)
                going = most >= _ENOUGH if patient else (most >= _ENOUGH) & trusted
                left = np.count_nonzero(going)
                if count == steps or not len(self.rows) or not left:
                    break
                if count > 1 and left < _STRAGGLERS * n:
                    late = self.solve(q[:, going], steps - count, patient=patient)
                    q[:, going] = late.q
                    errors[:, going] = late.error
                    closed = (most < CLOSED) & trusted
                    closed[going] = late.closed & trusted[going]
                    return Solution(
                        q, closed, linkage.find_link_frames(q), errors, factors
                    )
                still = np.count_nonzero(size < _STILL) >= (1.0 - _STRAGGLERS) * n
                if factors is None or count != 1 or not still:
                    factors = self.factorize(placed)
                step = factors.solve(errors[self.rows])
                size = np.abs(step).max(axis=0)
                if first is None:
                    trusted = size < _FAR
                    first = size
                elif checks:
                    trusted &= (
                        (size < _CONTRACTION * first)
                        | (first < _NEAR)
                        | (most < CLOSED)
                    )
                    checks = False
                going &= size < 10.0
                way = step * scale
                q[self.columns] -= way if going.all() else np.where(going, way, 0.0)
        closed = (most < CLOSED) & trusted  # pyright: ignore[reportPossiblyUnboundVariable]
        return Solution(q, closed, placed, errors, factors)  # pyright: ignore[reportPossiblyUnboundVariable]

    def factorize(self, placed: LinkFrames) -> Factors:
        """Factorize the derivatives of the ranked equations."""
        look = placed.look
        if look:
            whole = (
                look.wrenches.take(self.rows, axis=1) @ look.twists.mT * self.weights
            )
            return DenseFactors.invert(
                whole[:, :, self.columns], whole[:, :, self.linkage.known]
            )
        wrenches: list[Array] = list(repeat(np.zeros(0), len(self.rows)))
        for cut, rows in zip(self.linkage.cuts, self.rows_of, strict=True):
            if rows:
                cut_wrenches = self.linkage.wrenches(
                    cut, [row for row, _ in rows], placed
                )
                for (_, i), wrench in zip(
                    rows, cut_wrenches.transpose(1, 0, 2), strict=True
                ):
                    wrenches[i] = wrench
        return SparseFactors(self, self._eliminate(self._entries(placed, wrenches)))

    def _entries(
        self, placed: LinkFrames, wrenches: list[Array]
    ) -> dict[tuple[int, int], Array]:
        """Return entries (n,) of the derivatives in elimination order, unknowns first."""
        entries: dict[tuple[int, int], Array] = {}
        for i, wrench in enumerate(wrenches):
            known = enumerate(self.linkage.known, len(self.rows))
            for j, c in [*((j, self.columns[j]) for j in self.entries[i]), *known]:
                if self.weights[i, c]:
                    rate = np.einsum("in,in->n", wrench, placed.twists[c])
                    entries[i, j] = rate * self.weights[i, c]
        return entries

    def _eliminate(
        self, a: dict[tuple[int, int], Array]
    ) -> dict[tuple[int, int], Array]:
        """Replace the entries by the factors L and U."""
        for k, (below, right) in enumerate(zip(self.below, self.right, strict=True)):
            pivot = a[k, k]
            for i in below:
                factor = a[i, k] / pivot
                a[i, k] = factor
                for j in right:
                    known = a.get((i, j))
                    a[i, j] = (
                        -factor * a[k, j] if known is None else known - factor * a[k, j]
                    )
        return a

    def rates(self, placed: LinkFrames, factors: Factors | None = None) -> Array:
        """Return rates (m, k, n) of coordinates per known one; ``factors`` may be from nearby."""
        linkage = self.linkage
        out = np.zeros((linkage.size, len(linkage.known), placed.q.shape[1]))
        with np.errstate(all="ignore"):
            if len(self.rows):
                out[self.columns] = (factors or self.factorize(placed)).rates
                out[self.columns] *= linkage.scale[self.columns][:, None, None]
            out[linkage.known, range(len(linkage.known))] = 1.0
        return out


@dataclass(frozen=True, eq=False)
class SparseFactors:
    """Factors L and U in a closure's elimination order, every entry a vector over poses."""

    closure: Closure
    entries: dict[tuple[int, int], Array]

    @property
    def rates(self) -> Array:
        """Scaled rates (columns, k, n) of unknowns for unit rates of each known one."""
        size = len(self.closure.rows)
        known = len(self.closure.linkage.known)
        nothing = np.zeros_like(self.entries[0, 0])
        find = self.entries.get
        columns = range(size, size + known)
        sides = [[find((i, k), nothing) for i in range(size)] for k in columns]
        return -np.stack([self.solve(side) for side in sides], axis=1)

    def solve(self, right: Sequence[Array] | Array) -> Array:
        """Return the solution (columns, n) for one right-hand side."""
        factors = self.entries
        y = list(right)
        for k, below in enumerate(self.closure.below):
            for i in below:
                y[i] = y[i] - factors[i, k] * y[k]
        for k in reversed(range(len(y))):
            for j in self.closure.right[k]:
                y[k] = y[k] - factors[k, j] * y[j]
            y[k] = y[k] / factors[k, k]
        return np.array(y)


@dataclass(frozen=True, eq=False)
class DenseFactors:
    """Factors for few poses: the inverse (n, columns, rows), NaN if a matrix is singular."""

    inverse: Array
    others: Array  # (n, rows, known)

    @classmethod
    def invert(cls, matrix: Array, others: Array) -> DenseFactors:
        """Invert matrices (n, rows, columns); ``others``: derivatives by the known coordinates."""
        try:
            return cls(np.linalg.inv(matrix), others)
        except np.linalg.LinAlgError:
            return cls(np.full_like(matrix, np.nan), others)

    @property
    def rates(self) -> Array:
        """As ``SparseFactors.rates``."""
        return -(self.inverse @ self.others).transpose(1, 2, 0)

    def solve(self, right: Array) -> Array:
        """Return the solution (columns, n) for one right-hand side."""
        return (self.inverse @ right.T[..., None])[..., 0].T


def _choose(whole: Array, columns: list[int], later: list[int]) -> list[int]:
    """Return independent columns; those that come ``later`` only if the others do not suffice."""
    weight = np.where(np.isin(columns, later), _LATER, 1.0)
    return [columns[k] for k in _find_independent(whole[:, columns] * weight)]


def _find_independent(matrix: Array) -> list[int]:
    """Return columns that span the range of a matrix, by QR with pivoting."""
    if not matrix.size:
        return []
    _, r, order = qr(matrix, mode="economic", pivoting=True)  # pyright: ignore[reportAssignmentType]
    pivots = np.abs(np.diagonal(r))
    rank = (
        int(np.sum(pivots > _RANK * max(pivots[0], 1e-300))) if pivots[0] > 1e-12 else 0
    )
    return sorted(int(k) for k in order[:rank])

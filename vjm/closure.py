"""Loop closure by Newton's method, vectorized over poses.

At home the equations are ranked once: columns without which the rest has full rank are held (idle motions, redundant
drives), rows that depend on others (overconstrained loops) are only verified. What is left is square and sparse; it is
factored without pivoting, in an order found at home, every entry a vector over poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import qr

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.vjm.linkage import Linkage, Placed
    from stiffscope.vjm.screws import Array

CLOSED = 1e-12  # errors over the mechanism's own length, and rad
_ENOUGH = 2e-13  # below which another step gains nothing
_RANK = 1e-9
_STRUCTURAL = 1e-13
_PIVOT = 0.05  # of the largest in its row or column, for the sake of sparsity
_STEPS = 8
_CONTRACTION = 0.3  # of the second step over the first: beyond, the start was too far
_NEAR = 1e-6  # of a first step that needs no such check
_FAR = 0.7  # rad or own lengths, of a first step
_PASSIVE_FIRST = 1e-4  # weight of driven columns: passive ones carry the motion where there is a choice


@dataclass(frozen=True, eq=False)
class Solution:
    """Coordinates (n, m), where they close every loop, the links there, and the sign of the equations' determinant."""

    q: Array
    closed: NDArray[np.bool_]
    placed: Placed
    sign: Array
    error: Array  # (n, cuts): largest error of each cut joint


class Closure:
    """The equations of a linkage's cut joints, ranked and ordered at coordinates ``q`` (m,)."""

    def __init__(self, linkage: Linkage, q: Array) -> None:
        self.linkage = linkage
        self.starts = np.cumsum([0, *(c.size for c in linkage.cuts)])
        whole = self._whole(q[None])[0]
        unknown = [c for c in range(linkage.size) if c not in linkage.known]
        self.columns = self._independent_columns(whole, unknown)
        self.held = [c for c in unknown if c not in set(self.columns)]
        self.rows = _independent(whole[:, self.columns].T)
        self.redundant = int(self.starts[-1]) - len(self.rows)
        self.whole = whole
        self._order(q)

    @property
    def commanded(self) -> list[int]:
        """Which of the known coordinates can be given any value; the others are locked by the loops."""
        known = self.linkage.known
        if not known or not len(self.whole):
            return list(range(len(known)))
        basis = np.linalg.qr(self.whole[:, [*self.columns]])[0] if self.columns else np.zeros((len(self.whole), 0))
        part = self.whole[:, known]
        rest = part - basis @ (basis.T @ part)
        size = np.abs(self.whole).max()
        return [k for k in range(len(known)) if np.linalg.norm(rest[:, k]) < 1e-7 * size]

    def _whole(self, q: Array) -> Array:
        """All equations' derivatives (n, rows, m)."""
        linkage = self.linkage
        placed = linkage.placed(q)
        out = np.zeros((len(q), int(self.starts[-1]), linkage.size))
        for k, cut in enumerate(linkage.cuts):
            _, wrenches = linkage.closure(cut, placed)
            out[:, self.starts[k] : self.starts[k + 1], cut.columns] = wrenches @ linkage.rate(cut, placed)
        return out * linkage.scale

    def _independent_columns(self, whole: Array, unknown: list[int]) -> list[int]:
        driven = {
            linkage_column
            for j in self.linkage.mechanism.drives
            if j.name in self.linkage.columns and j.driven is not None
            for linkage_column in [self.linkage.columns[j.name][j.driven]]
        }
        weight = np.array([_PASSIVE_FIRST if c in driven else 1.0 for c in unknown])
        return [unknown[k] for k in _independent(whole[:, unknown] * weight)]

    def _order(self, q: Array) -> None:
        """Pivots by Markowitz's rule, and the fill of the factors."""
        rng = np.random.default_rng(0)
        spread = q + 0.3 * rng.normal(size=(3, len(q))) * self.linkage.scale
        pattern = (np.abs(self._whole(spread)) > _STRUCTURAL).any(axis=0)[np.ix_(self.rows, self.columns)]
        matrix = self.whole[np.ix_(self.rows, self.columns)].copy()
        rows, columns = list(range(len(self.rows))), list(range(len(self.columns)))
        row_order: list[int] = []
        column_order: list[int] = []
        while rows:
            sub = np.abs(matrix[np.ix_(rows, columns)])
            mask = pattern[np.ix_(rows, columns)]
            good = sub >= _PIVOT * np.maximum(sub.max(axis=0)[None], sub.max(axis=1)[:, None])
            cost = np.outer(mask.sum(axis=1) - 1, mask.sum(axis=0) - 1) - 1e-3 * sub / max(sub.max(), 1e-300)
            i, j = np.unravel_index(np.argmin(np.where(good, cost, np.inf)), cost.shape)
            r, c = rows.pop(int(i)), columns.pop(int(j))
            row_order.append(r)
            column_order.append(c)
            for other in rows:
                if pattern[other, c]:
                    pattern[other, columns] |= pattern[r, columns]
                    matrix[other, columns] -= matrix[other, c] / matrix[r, c] * matrix[r, columns]
        self.rows = [self.rows[r] for r in row_order]
        self.columns = [self.columns[c] for c in column_order]
        fill = pattern[np.ix_(row_order, column_order)]
        size = range(len(self.rows))
        self.below = [[i for i in size if i > k and fill[i, k]] for k in size]
        self.right = [[j for j in size if j > k and fill[k, j]] for k in size]
        position = {c: k for k, c in enumerate(self.columns)}
        self.entries: list[tuple[int, Array, Array, list[tuple[int, int, int, int]]]] = []
        for k, cut in enumerate(self.linkage.cuts):
            mine = [(i, r - self.starts[k]) for i, r in enumerate(self.rows) if 0 <= r - self.starts[k] < cut.size]
            theirs = [(position[c], a) for a, c in enumerate(cut.columns) if c in position]
            pairs = [
                (i, j, a, b)
                for a, (i, _) in enumerate(mine)
                for b, (j, _) in enumerate(theirs)
                if fill[i, j]
            ]
            self.entries.append((k, np.array([r for _, r in mine], int), np.array([a for _, a in theirs], int), pairs))

    def solve(self, q: Array, steps: int = _STEPS) -> Solution:
        """Newton's method from coordinates (n, m), whose known columns are as given.

        A pose is closed where all equations hold to 1e-12 and the steps contract as they do near a solution: a start
        too far away may lead to another branch.
        """
        n = len(q)
        q = q.copy()
        scale = self.linkage.scale[self.columns]
        first, trusted = np.full(n, np.nan), np.ones(n, dtype=bool)
        sign = np.ones(n)
        with np.errstate(all="ignore"):
            for count in range(steps + 1):
                placed = self.linkage.placed(q)
                errors = [self.linkage.closure(cut, placed) for cut in self.linkage.cuts]
                worst = np.zeros((n, len(errors)))
                for k, (e, _) in enumerate(errors):
                    worst[:, k] = np.abs(e).max(axis=1)
                most = worst.max(axis=1, initial=0.0)
                going = most > _ENOUGH
                if count == steps or not self.rows or not going.any():
                    break
                matrix = self.matrix(placed, errors)
                factors, sign = self.factored(matrix)
                step = self.substituted(factors, self._right(errors)).T  # (n, columns)
                size = np.abs(step).max(axis=1)
                if count == 0:
                    first = size
                    trusted &= size < _FAR
                elif count == 1:
                    trusted &= (size < _CONTRACTION * first) | (first < _NEAR) | (most < CLOSED)
                going &= np.isfinite(size) & (size < 10.0)
                q[:, self.columns] -= np.where(going[:, None], step * scale, 0.0)
        return Solution(q, (most < CLOSED) & trusted, placed, sign, worst)

    def matrix(self, placed: Placed, errors: list[tuple[Array, Array]]) -> dict[tuple[int, int], Array]:
        """Entries (n,) of the ranked equations' derivatives, in the order of elimination."""
        entries: dict[tuple[int, int], Array] = {}
        scale = self.linkage.scale
        for k, rows, columns, pairs in self.entries:
            if not pairs:
                continue
            cut = self.linkage.cuts[k]
            chosen = cut.columns[columns]
            rate = placed.twists[:, :, chosen] * (cut.signs[columns] * scale[chosen])
            block = np.ascontiguousarray((errors[k][1][:, rows] @ rate).transpose(1, 2, 0))
            for i, j, a, b in pairs:
                entries[i, j] = block[a, b]
        return entries

    def _right(self, errors: list[tuple[Array, Array]]) -> list[Array]:
        out: list[Array] = [np.zeros(0)] * len(self.rows)
        cut_of = np.searchsorted(self.starts, self.rows, side="right") - 1
        for i, (row, k) in enumerate(zip(self.rows, cut_of, strict=True)):
            out[i] = errors[k][0][:, row - self.starts[k]].copy()
        return out

    def factored(self, entries: dict[tuple[int, int], Array]) -> tuple[dict[tuple[int, int], Array], Array]:
        """Factors L and U in place of the entries, and the sign (n,) of the determinant."""
        a = dict(entries)
        sign: Array = np.ones(1)
        for k, (below, right) in enumerate(zip(self.below, self.right, strict=True)):
            pivot = a[k, k]
            sign = sign * np.sign(pivot)
            for i in below:
                factor = a[i, k] / pivot
                a[i, k] = factor
                for j in right:
                    known = a.get((i, j))
                    a[i, j] = -factor * a[k, j] if known is None else known - factor * a[k, j]
        return a, sign

    def substituted(self, factors: dict[tuple[int, int], Array], right: list[Array]) -> Array:
        """Solution (columns, n) for one right-hand side."""
        y = list(right)
        for k, below in enumerate(self.below):
            for i in below:
                y[i] = y[i] - factors[i, k] * y[k]
        for k in reversed(range(len(y))):
            for j in self.right[k]:
                y[k] = y[k] - factors[k, j] * y[j]
            y[k] = y[k] / factors[k, k]
        return np.array(y)

    def rates(self, placed: Placed) -> Array:
        """Rates (n, m, k) of all coordinates for unit rates of each known one."""
        linkage = self.linkage
        errors = [linkage.closure(cut, placed) for cut in linkage.cuts]
        n = len(placed.twists)
        out = np.zeros((n, linkage.size, len(linkage.known)))
        cut_of = np.searchsorted(self.starts, self.rows, side="right") - 1
        with np.errstate(all="ignore"):
            factors, _ = self.factored(self.matrix(placed, errors))
            for k, column in enumerate(linkage.known):
                right: list[Array] = []
                for row, c in zip(self.rows, cut_of, strict=True):
                    cut = linkage.cuts[c]
                    at = np.flatnonzero(cut.columns == column)
                    if not at.size:
                        right.append(np.zeros(n))
                        continue
                    wrench = errors[c][1][:, row - self.starts[c]]
                    right.append(np.einsum("ni,ni->n", wrench, placed.twists[:, :, column]) * cut.signs[at[0]])
                if right:
                    out[:, self.columns, k] = -self.substituted(factors, right).T * linkage.scale[self.columns]
                out[:, column, k] = 1.0
        return out


def _independent(matrix: Array) -> list[int]:
    """Columns that span the range of a matrix, by QR with pivoting."""
    if not matrix.size:
        return []
    _, r, order = qr(matrix, mode="economic", pivoting=True)
    pivots = np.abs(np.diagonal(r))
    rank = int(np.sum(pivots > _RANK * max(pivots[0], 1e-300))) if pivots[0] > 1e-12 else 0
    return sorted(int(k) for k in order[:rank])

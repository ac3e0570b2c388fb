"""Solvers of the supported stiffness: factorization and conjugate gradients."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import splu

from stiffscope.fea.mesh import Floats
from stiffscope.runtime.processors import processors

if TYPE_CHECKING:
    from collections.abc import Iterable

Solve = Callable[[Floats], Floats]
LEFT = 0.3  # of a tolerance: safety margin of the stopping criterion
PORTION = 150_000_000  # bytes of columns in use at a time


@dataclass(frozen=True)
class Solver:
    """Maps from forces (c, loads) to coordinates: ``solve`` exact, ``precondition`` approximate."""

    solve: Solve
    precondition: Solve


@cache
def _threads(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count, thread_name_prefix="fea")


def on_all_cores(work: Callable[..., Any], *items: Iterable[Any]) -> list[Any]:
    """Run independent NumPy or SciPy work in threads; their loops release the interpreter lock."""
    count = processors()
    return list(_threads(count).map(work, *items) if count > 1 else map(work, *items))


def product(matrix: csr_array) -> Solve:
    """Return ``x -> matrix @ x`` of a square matrix, with its rows distributed over the cores."""
    cores = processors()
    parts = matrix.data, matrix.indices, matrix.indptr
    data, columns, starts = map(np.asarray, parts)
    size = len(starts) - 1
    ends = [
        0,
        *np.searchsorted(starts, np.linspace(0, starts[-1], cores + 1)[1:-1]).tolist(),
        size,
    ]
    blocks = []
    for first, last in pairwise(ends):
        held = slice(starts[first], starts[last])
        rows = (data[held], columns[held], starts[first : last + 1] - starts[first])
        blocks.append(csr_array(rows, shape=(last - first, size)))
    return lambda x: np.concatenate(on_all_cores(lambda block: block @ x, blocks))


def factorize_matrix(matrix: csr_array) -> Solve:
    """Factorize a symmetric positive definite matrix: symmetric ordering, diagonal pivots."""
    how = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0}
    return splu(matrix.tocsc(), **how, options={"SymmetricMode": True}).solve


def in_portions(work: Callable[..., Floats]) -> Callable[..., Floats]:
    """Return a function of columns (n, c), (m, c), … that works on a few at a time if they are large."""

    def work_on(*columns: Floats) -> Floats:
        count = min(-(-columns[0].nbytes // PORTION), columns[0].shape[1])
        if count < 2:
            return work(*columns)
        portions = [np.array_split(column, count, axis=1) for column in columns]
        return np.hstack([work(*some) for some in zip(*portions, strict=True)])

    return work_on


def conjugate_gradients(
    apply: Solve,
    precondition: Solve,
    force: Floats,
    motion: Floats,
    tolerance: float,
    limit: int,
) -> tuple[Floats, bool]:
    """Solve for all columns at once until further steps would add little to the energy gained.

    The last step adds less than ``tolerance`` / 10; or it, and all following ones if they decrease
    at the rate of the last two, less than ``LEFT`` · ``tolerance``.

    Parameters
    ----------
    apply, precondition
        Products of the matrix, and of an approximate inverse, with columns (n, c).
    force, motion : (n, c)
        Right-hand sides, and initial solution.
    tolerance
        Fraction of each column's energy that may be missing.
    limit
        Largest number of steps.

    Returns
    -------
    tuple
        The solution (n, c), and whether it converged within ``limit`` steps.
    """
    motion = motion.copy()
    residual = force - apply(motion) if motion.any() else force.copy()
    step = precondition(residual)
    fall = np.einsum("ij,ij->j", residual, step)
    direction = step
    gained = np.full(force.shape[1], np.finfo(float).tiny)
    gain = np.zeros(force.shape[1])
    for _ in range(limit):  # in place: these are the problem's largest arrays
        pushed = apply(direction)
        length = fall / np.maximum(
            np.einsum("ij,ij->j", direction, pushed), np.finfo(float).tiny
        )
        motion += length * direction
        pushed *= length
        residual -= pushed
        former = gain
        gain = length * fall  # contribution of the step to each compliance
        gained += gain
        small = LEFT * tolerance * gained
        falling = (gain < small) & (gain**2 < small * (former - gain))
        if (falling | (gain < 0.1 * tolerance * gained)).all():
            return motion, True
        step = precondition(residual)
        before = fall
        fall = np.einsum("ij,ij->j", residual, step)
        direction *= fall / np.maximum(before, np.finfo(float).tiny)
        direction += step
    return motion, False

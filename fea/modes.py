"""Lowest natural modes of a supported part, by LOBPCG.

References
----------
A. V. Knyazev, Toward the optimal preconditioned eigensolver: locally optimal block preconditioned
conjugate gradient method, SIAM J. Sci. Comput. 23 (2001) 517. SciPy's ``lobpcg`` stops at an absolute
residual of all vectors of its block, in a norm that adds forces to moments.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

from stiffscope.fea.mesh import Floats, MeshError

if TYPE_CHECKING:
    from stiffscope.fea.solvers import Solve

    Block = tuple[
        Floats, Floats, Floats
    ]  # vectors (c, b), and their products with stiffness and mass

LIMIT = 200  # steps
DEPENDENT = 1e-10  # relative squared length below which a direction is dependent
# Relative gap of squares below which neighbours count as equal. Meshes split the pairs of a round
# part by less, and which of equal modes comes first is left to rounding.
GAP = 0.01
BEYOND = 3  # modes beyond those wanted among which a gap is sought


def lowest_modes(
    stiffness: Solve,
    mass: Solve,
    precondition: Solve,
    start: Floats,
    count: int,
    tolerance: float = 1e-8,
    *,
    exact: bool = False,
) -> tuple[Floats, Floats, Floats]:
    """Return ascending squared frequencies (b,), rad²/s², and mass-normalized modes (c, b).

    Also return the products (c, b) of the stiffness with these modes.

    Parameters
    ----------
    stiffness, mass : products with the two matrices.
    precondition : approximate inverse of the stiffness; if ``exact``, the inverse itself: products
        with the stiffness are then known, which for slender parts would be pure rounding if formed.
    start : (c, b) initial vectors, more than ``count``; the last results are less accurate.
    count : number of modes with squares accurate to ``tolerance``, relative.

    Raises
    ------
    MeshError : if the iteration does not converge.
    """
    pushed = mass(start) if exact else stiffness(start)
    modes = precondition(pushed) if exact else start
    blocks = [(modes, pushed, mass(modes))]
    for _ in range(LIMIT):
        squares, turn = ritz(_inner(blocks, 1), _inner(blocks, 2), start.shape[1])
        sizes = np.cumsum([block[0].shape[1] for block in blocks])
        rotations, *others = np.split(turn, sizes[:-1])
        former = [
            sum((b[k] @ t for b, t in zip(blocks[1:], others, strict=True)), start=0.0)
            for k in range(3)
        ]
        modes, pushed, moved = (blocks[0][k] @ rotations + former[k] for k in range(3))
        residual = pushed - moved * squares
        step = precondition(residual)
        left = np.einsum("ij,ij->j", residual, step) > tolerance * squares
        if not left[:count].any():
            return squares, modes, pushed
        residual = residual[:, left]
        step = step[:, left]  # converged ones would only add rounding
        along = moved.T @ step
        step -= modes @ along
        new = step, residual - pushed @ along if exact else stiffness(step), mass(step)
        blocks = [(modes, pushed, moved), new, *([tuple(former)] if others else [])]
    late = f"the natural frequencies did not converge in {LIMIT} steps"
    raise MeshError(f"solve: {late}: the part is too thin for solid elements")


def _inner(blocks: list[Block], with_part: int) -> Floats:
    """Return inner products (k, k) of all blocks' vectors with their products with a matrix."""
    return np.block(
        [[one[0].T @ other[with_part] for other in blocks] for one in blocks]
    )


def ritz(stiffness: Floats, mass: Floats, count: int) -> tuple[Floats, Floats]:
    """Return ascending Rayleigh-Ritz squares (count,) and combinations (k, count) of k vectors.

    Dependent directions are omitted.

    Parameters
    ----------
    stiffness
        Stiffness matrix (k, k).
    mass
        Mass matrix (k, k).
    count
        Number of modes, the lowest first.
    """
    scale = 1 / np.sqrt(mass.diagonal())
    lengths, directions = np.linalg.eigh(mass * np.outer(scale, scale))
    independent = lengths > DEPENDENT * lengths[-1]
    basis = scale[:, None] * directions[:, independent] / np.sqrt(lengths[independent])
    held = basis.T @ stiffness @ basis
    squares, turn = eigh(
        (held + held.T) / 2, subset_by_index=(0, min(count, independent.sum()) - 1)
    )
    return squares, basis @ turn


def count_whole(squares: Floats, count: int) -> int:
    """Return the least number of modes, at least ``count``, that keeps equal modes together.

    Where spectra are so dense that no gap follows, the widest of the next few is taken.

    Parameters
    ----------
    squares
        Ascending squared frequencies (b,), rad²/s², ``BEYOND`` or more beyond ``count``.
    count
        Number of modes wanted.
    """
    if count == 0:
        return 0
    near = squares[count - 1 : count + BEYOND + 1]
    gaps = near[1:] / near[:-1] - 1
    if not gaps.size:
        return count
    wide = gaps > GAP
    return count + int(wide.argmax() if wide.any() else gaps.argmax())

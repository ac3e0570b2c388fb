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

LIMIT = 200  # steps
DEPENDENT = 1e-10  # relative squared length below which a direction is dependent


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
    basis = modes, pushed, mass(modes)
    squares, turn = ritz(basis[0].T @ basis[1], basis[0].T @ basis[2], start.shape[1])
    modes, pushed, moved = (part @ turn for part in basis)
    former: tuple[tuple[Floats, ...], ...] = ()
    for _ in range(LIMIT):
        residual = pushed - moved * squares
        step = precondition(residual)
        left = np.einsum("ij,ij->j", residual, step) > tolerance * squares
        if not left[:count].any():
            return squares, modes, pushed
        residual, step = residual[:, left], step[:, left]  # converged ones would only add rounding
        along = moved.T @ step
        step -= modes @ along
        new = step, residual - pushed @ along if exact else stiffness(step), mass(step)
        basis = [np.hstack(part) for part in zip((modes, pushed, moved), new, *former, strict=True)]
        squares, turn = ritz(basis[0].T @ basis[1], basis[0].T @ basis[2], modes.shape[1])
        old = modes.shape[1]
        former = (tuple(part[:, old:] @ turn[old:] for part in basis),)
        modes, pushed, moved = (part @ turn for part in basis)
    late = f"the natural frequencies did not converge in {LIMIT} steps"
    raise MeshError(f"solve: {late}: the part is too thin for solid elements")


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
    kept = lengths > DEPENDENT * lengths[-1]
    basis = scale[:, None] * directions[:, kept] / np.sqrt(lengths[kept])
    held = basis.T @ stiffness @ basis
    squares, turn = eigh((held + held.T) / 2, subset_by_index=(0, min(count, kept.sum()) - 1))
    return squares, basis @ turn

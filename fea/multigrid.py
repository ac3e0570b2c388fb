"""Two-level multigrid: quadratic tetrahedra, with linear ones of the same mesh as coarse level.

A cycle smooths all nodes by Chebyshev steps on the 3 x 3 diagonal blocks (Adams et al., J. Comput.
Phys. 188, 2003), corrects by the linear problem with an eighth of the unknowns, and smooths again.
Twists of rigid interfaces belong to both levels. No factors of the quadratic stiffness are stored.
"""

# pyright: reportOptionalMemberAccess=false
# (scikit-fem declares its types loosely)

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import bsr_array, coo_array, csr_array, eye_array, kron, vstack
from scipy.sparse.linalg import LinearOperator, eigsh

from stiffscope.fea.couplings import Supports, factorize
from stiffscope.fea.settings import check_solver
from stiffscope.fea.solvers import (
    Solve,
    Solver,
    conjugate_gradients,
    in_portions,
    product,
)

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats, TetMesh

logger = logging.getLogger(__name__)

FACTORIZED_TO = 25_000  # degrees of freedom up to which a factorization is faster
STEPS = 2  # smoothing steps before and after the correction
SMOOTHED = (
    8.0  # ratio of the largest eigenvalue to the smallest one that the smoother reduces
)
TOLERANCE = 1e-11
LIMIT = 200


def prepare(
    mesh: TetMesh, stiffness: csr_array, supports: Supports, name: str = "auto"
) -> Solver:
    """Return a solver of the supported stiffness (3n, 3n).

    Parameters
    ----------
    mesh
        Mesh of n nodes.
    stiffness : (3n, 3n)
        Stiffness without supports, N/m.
    supports
        Constraints of the clamp and of rigid faces.
    name
        "direct", "multigrid", or "auto", which chooses the faster by the number of unknowns.

    Raises
    ------
    InputError : if the name is unknown.
    """
    check_solver(name)
    if name == "multigrid" or (
        name == "auto" and 3 * len(supports.free) > FACTORIZED_TO
    ):
        return two_levels(mesh, stiffness, supports)
    solve = factorize(stiffness, supports)
    return Solver(solve, solve)


def two_levels(mesh: TetMesh, stiffness: csr_array, supports: Supports) -> Solver:
    """Return the multigrid solver of a supported stiffness (3n, 3n); linear level factorized."""
    correct = _linear_level(mesh, stiffness, supports)
    width = supports.tie.shape[1]
    root, multiply = _root_of_inverse_blocks(stiffness, supports), product(stiffness)
    inverse = root @ root.T

    def apply(coordinates: Floats) -> Floats:
        return supports.restrict(multiply(supports.expand(coordinates)))

    def scale_twists(
        residual: Floats,
    ) -> Floats:  # the linear level corrects the twists
        split = len(residual) - width
        return np.vstack([inverse @ residual[:split], np.zeros_like(residual[split:])])

    def symmetric(motion: Floats) -> Floats:
        return (
            root.T
            @ apply(np.vstack([root @ motion[:, None], np.zeros((width, 1))]))[
                : len(motion)
            ]
        )

    smooth = _chebyshev(
        apply, scale_twists, largest_eigenvalue(symmetric, 3 * len(supports.free))
    )

    def cycle(force: Floats) -> Floats:
        motion = smooth(force)
        motion += correct(force - apply(motion))
        motion += smooth(force - apply(motion))
        return motion

    def solve(force: Floats) -> Floats:
        motion, converged = conjugate_gradients(
            apply=apply,
            precondition=cycle,
            force=force,
            motion=np.zeros_like(force),
            tolerance=TOLERANCE,
            limit=LIMIT,
        )
        if converged:
            return motion
        logger.warning("multigrid: not converged after %d steps; factorizing", LIMIT)
        return factorize(stiffness, supports)(force)

    return Solver(in_portions(solve), in_portions(cycle))


def _linear_level(mesh: TetMesh, stiffness: csr_array, supports: Supports) -> Solve:
    """Return the coarse correction by linear displacements between vertices."""
    count = int(mesh.grid.nvertices)
    edges = mesh.grid.edges
    halves = coo_array(
        (
            np.full(edges.size, 0.5),
            (np.tile(np.arange(edges.shape[1]), 2), edges.ravel()),
        )
    )
    between = vstack([eye_array(count), halves])  # nodes are numbered vertices first
    spread = csr_array(kron(between, eye_array(3), format="csr"))
    linear = csr_array(spread.T @ (stiffness @ spread))

    held = replace(
        supports,
        nodes=count,
        free=supports.free[supports.free < count],
        tied=supports.tied[supports.tied < count],
        clamped=supports.clamped[supports.clamped < count],
        tie=supports.tie[np.repeat(supports.tied < count, 3)],
    )
    solve = factorize(linear, held)
    down = spread[
        supports.free_dofs
    ]  # restriction to the vertices of forces on free nodes
    split = down.shape[0]
    twists = supports.tie.shape[1]

    def correct(residual: Floats) -> Floats:
        force = held.restrict(down.T @ residual[:split])
        force[len(force) - twists :] += residual[split:]
        answer = solve(force)
        return np.vstack([down @ held.expand(answer), answer[len(answer) - twists :]])

    return correct


def _root_of_inverse_blocks(stiffness: csr_array, supports: Supports) -> csr_array:
    """Return sparse L with L Lᵀ the inverses of the free nodes' 3 x 3 diagonal blocks."""
    free = supports.free_dofs.reshape(-1, 3)
    blocks = np.empty((len(free), 3, 3))
    for i in range(3):
        for j in range(3):
            blocks[:, i, j] = stiffness[free[:, i], free[:, j]]
    steps = np.arange(len(free) + 1)
    return bsr_array(
        (np.linalg.cholesky(np.linalg.inv(blocks)), steps[:-1], steps)
    ).tocsr()


def largest_eigenvalue(symmetric: Solve, size: int) -> float:
    """Return the largest eigenvalue of a symmetric operator on vectors (size,), to 1 %.

    By Lanczos' method: nearly flat elements have an isolated largest eigenvalue, which power
    iteration finds slowly; with one an eighth too small the smoother is indefinite.
    """
    start = np.random.default_rng(0).normal(size=size)
    operator = LinearOperator((size, size), matvec=symmetric, dtype=float)  # type: ignore[call-arg]
    options = {"v0": start, "ncv": min(20, size), "tol": 0.01}
    return float(
        eigsh(operator, 1, which="LA", return_eigenvectors=False, **options)[0]
    )


def _chebyshev(apply: Solve, scaled: Solve, largest: float) -> Solve:
    """Return ``STEPS`` Chebyshev steps from zero for the upper part of the spectrum."""
    bottom = largest / SMOOTHED
    middle = (largest + bottom) / 2
    half = (largest - bottom) / 2

    def smooth(force: Floats) -> Floats:
        change = scaled(force) / middle
        motion = change.copy()
        residual = force
        ratio = half / middle
        for _ in range(STEPS - 1):
            residual = residual - apply(change)
            following = 1 / (2 * middle / half - ratio)
            change = following * ratio * change + 2 * following / half * scaled(
                residual
            )
            ratio = following
            motion += change
        return motion

    return smooth

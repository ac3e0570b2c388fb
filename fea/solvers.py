"""Solvers of the supported stiffness: each is a function that factorizes and returns a function that solves."""

from __future__ import annotations

import logging
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from stiffscope import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from scipy.sparse import csr_array

    from fea.mesh import Floats

    Solve = Callable[[Floats], Floats]
    Solver = Callable[[csr_array, Floats], Solve]

logger = logging.getLogger(__name__)

PARDISO_FROM = 40_000  # degrees of freedom below which loading MKL costs more than it saves
ITERATIVE_FROM = 600_000  # degrees of freedom above which a factorization no longer fits a laptop
RELATIVE_RESIDUAL = 1e-10


def choose(name: str, dofs: int) -> Solver:
    """Return the solver called ``name``: auto, pardiso, splu or amg.

    ``auto`` takes SciPy's SuperLU, beyond ``PARDISO_FROM`` degrees of freedom MKL's PARDISO when the ``fast`` extra
    is installed, and beyond ``ITERATIVE_FROM`` conjugate gradients with algebraic multigrid when pyamg is there.
    """
    solvers = {"pardiso": pardiso, "splu": splu, "amg": amg}
    if name == "auto":
        if dofs > ITERATIVE_FROM and find_spec("pyamg"):
            return amg
        return pardiso if dofs > PARDISO_FROM and find_spec("pypardiso") else splu
    if name not in solvers:
        raise InputError(f"solver: {name!r} is unknown; choose auto, {', '.join(solvers)}")
    return solvers[name]


def pardiso(matrix: csr_array, points: Floats) -> Solve:
    """Factorize with MKL's PARDISO (Cholesky); ``points`` are not needed."""
    del points
    from pypardiso import PyPardisoSolver
    from scipy.sparse import csr_matrix, triu

    solver = PyPardisoSolver(mtype=2)
    upper = csr_matrix(triu(matrix, format="csr"))
    solver.factorize(upper)

    def solve(loads: Floats) -> Floats:
        return np.asarray(solver.solve(upper, np.asfortranarray(loads)))

    return solve


def splu(matrix: csr_array, points: Floats) -> Solve:
    """Factorize with SciPy's SuperLU, symmetric ordering, diagonal pivots; ``points`` are not needed."""
    del points
    from scipy.sparse.linalg import splu as factorize

    factors = factorize(
        matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return factors.solve


def amg(matrix: csr_array, points: Floats) -> Solve:
    """Prepare conjugate gradients preconditioned by smoothed aggregation with the six rigid-body modes.

    Parameters
    ----------
    matrix : supported stiffness in blocks of three degrees of freedom.
    points : (n, 3) the nodes of those blocks, metres.
    """
    import pyamg  # pyright: ignore[reportMissingImports, reportMissingTypeStubs]
    from scipy.sparse.linalg import cg

    from fea.interfaces import rigid_modes

    modes = rigid_modes(points, points.mean(axis=0)).reshape(-1, 6)
    hierarchy = pyamg.smoothed_aggregation_solver(
        matrix.tobsr((3, 3)),
        B=modes / np.abs(modes).max(axis=0),
        strength=("symmetric", {"theta": 0.0}),  # pyright: ignore[reportArgumentType] (pyamg's hint is too narrow)
        max_coarse=2000,
        coarse_solver="splu",
    )
    preconditioner = hierarchy.aspreconditioner()

    def solve(loads: Floats) -> Floats:
        columns = []
        for load in loads.T:
            column, flag = cg(matrix, load, rtol=RELATIVE_RESIDUAL, maxiter=2000, M=preconditioner)
            if flag:
                logger.warning("conjugate gradients stopped after %d steps without converging", flag)
            columns.append(column)
        return np.stack(columns, axis=1)

    return solve

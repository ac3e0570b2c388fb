"""Cubic solution on the same mesh, preconditioned by the quadratic solver.

Hierarchical cubics (``spaces.ElementTetCubic``) enrich the quadratic space. Conjugate gradients,
preconditioned by the quadratic solver and 3 x 3 block Jacobi on the cubics, need no second
factorization. If the quadratic problem is factorized they run on the cubics alone, with eliminated
nodes, in two thirds of the steps. Both are Galerkin solutions: both compliances are lower bounds of
the exact one on the same geometry.

The stiffness product is an element-by-element kernel. Assembly by scikit-fem's forms took 1.8 times
the processor time and 1.7 times the memory on the default slider, 1.4 and 2.1 times on the ribbed
one; ``tests/fea`` compares the two.
"""

# pyright: reportOptionalSubscript=false
# (scikit-fem declares its types loosely)

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.couplings import Coupling, Supports, traction_work
from stiffscope.fea.cubic_products import (
    apply_by_blocks,
    apply_by_elements,
    element_forces,
    expand,
    invert_blocks,
)
from stiffscope.fea.mesh import Floats, Ints, MeshError, TetMesh
from stiffscope.fea.solvers import Solve, Solver, conjugate_gradients, in_portions
from stiffscope.fea.spaces import ElementTetCubic

if TYPE_CHECKING:
    from collections.abc import Iterator

    from scipy.sparse import bsr_array, csr_array

    from stiffscope.fea.cubic_space import Cubic


@dataclass(frozen=True)
class CubicProblem:
    """Cubic problem of a supported mesh.

    Attributes
    ----------
    free : (w,) unconstrained cubics. Coordinates (c + 3w): those of ``supports``, then of these.
    apply, precondition : product with the stiffness, and with an approximate inverse.
    balance : the quadratic solver's approximate inverse.
    jacobi : (3w, 3w) inverses of the cubics' own 3 x 3 blocks.
    eliminated : product with the cubics' stiffness, nodes eliminated; None without factorization.
    """

    space: Cubic
    supports: Supports
    free: Ints
    apply: Solve
    precondition: Solve
    balance: Solve
    jacobi: bsr_array
    eliminated: Solve | None


def cubic_problem(
    mesh: TetMesh,
    space: Cubic,
    supports: Supports,
    solver: Solver,
    stiffness: csr_array,
    springs: csr_array | None = None,
) -> CubicProblem:
    """Set up the cubic problem, preconditioned by the quadratic solver.

    Parameters
    ----------
    stiffness : (3n, 3n) of the quadratic problem, N/m.
    springs : (count, count) elastic foundation, one direction; see ``stiffscope.fea.foundation``.
    """
    free = _free_cubics(mesh, space, supports)
    jacobi = invert_blocks(space, free, springs)

    def precondition(residual: Floats) -> Floats:
        split = len(residual) - jacobi.shape[0]
        return np.vstack(
            [solver.precondition(residual[:split]), jacobi @ residual[split:]]
        )

    if solver.precondition is solver.solve:
        apply, eliminated = apply_by_blocks(
            space=space,
            supports=supports,
            free=free,
            stiffness=stiffness,
            springs=springs,
            solve=solver.solve,
        )
    else:
        apply = apply_by_elements(space, supports, free, springs)
        eliminated = None
    return CubicProblem(
        space=space,
        supports=supports,
        free=free,
        apply=apply,
        precondition=precondition,
        balance=solver.precondition,
        jacobi=jacobi,
        eliminated=eliminated,
    )


def solve_cubic(
    problem: CubicProblem,
    force: Floats,
    start: Floats,
    tolerance: float = 1e-2,
    limit: int = 500,
) -> Floats:
    """Return the coordinates (c + 3w, loads) of the cubic solution.

    The first c are coordinates of the supports with exact nodal values: cubics vanish at all nodes.

    Parameters
    ----------
    force, start : (c + 3w, loads) generalized forces, and (c, loads) the quadratic solution.
    tolerance : relative error of the compliance difference at which to stop.

    Raises
    ------
    MeshError : if the iteration does not converge.
    """
    split = len(start)
    enough = (tolerance, limit)

    def solve(force: Floats, start: Floats) -> Floats:
        motion = np.vstack([start, np.zeros((len(force) - split, force.shape[1]))])
        if problem.eliminated is None:
            operators = problem.apply, problem.precondition
            motion, converged = conjugate_gradients(*operators, force, motion, *enough)
        else:
            operators = problem.eliminated, lambda x: problem.jacobi @ x
            rest = (force - problem.apply(motion))[split:]
            motion[split:], converged = conjugate_gradients(
                *operators, rest, np.zeros_like(rest), *enough
            )
        if not converged:
            why = "flat elements or a material like rubber"
            raise MeshError(
                f"solve: the cubic solution did not converge in {limit} steps: {why}"
            )
        # nodal equilibrium, independent of errors in the cubics
        motion[:split] += problem.balance((force - problem.apply(motion))[:split])
        return motion

    return in_portions(solve)(force, start)


def work(apply: Solve, force: Floats, motion: Floats) -> Floats:
    """Return Fᵀu + uᵀF − uᵀAu (loads, loads): the compliance with an error of second order.

    Parameters
    ----------
    apply
        Product with the stiffness.
    force
        Loads.
    motion
        Approximate solution.
    """
    energies = in_portions(lambda some, moved: motion.T @ (2 * some - apply(moved)))(
        force, motion
    )
    return (energies + energies.T) / 2


def element_energies(problem: CubicProblem, motion: Floats) -> Floats:
    """Return twice the energy (m, loads) of coordinates (c + 3w, loads) in each element."""
    energies = np.empty((len(problem.space.cells), motion.shape[1]))
    for columns, elements, moved, forces in _move_elements(problem, motion):
        energies[elements, columns] = np.einsum(
            "cail,cail->cl", forces, moved[..., columns]
        )
    return energies


def weigh_energies(problem: CubicProblem, motion: Floats, weights: Floats) -> Floats:
    """Return the weighted sum (loads, loads) of element energies, mutual ones off the diagonal."""
    total = np.zeros((motion.shape[1], motion.shape[1]))
    for columns, elements, moved, forces in _move_elements(
        problem, motion, weights > 0
    ):
        weighted = forces * weights[elements, None, None, None]
        total[columns] += np.tensordot(weighted, moved, axes=((0, 1, 2), (0, 1, 2)))
    return (total + total.T) / 2


def _move_elements(
    problem: CubicProblem, motion: Floats, chosen: np.ndarray | None = None
) -> Iterator[tuple[slice, Ints, Floats, Floats]]:
    """Yield a slice of six loads, elements (c,), motion (c, 20, 3, loads), forces (c, 20, 3, 6)."""
    space = problem.space
    loads = motion.shape[1]
    moved = expand(space, problem.supports, problem.free, motion).reshape(
        space.count, 3, loads
    )
    for batch in space.batches(chosen):
        elements = np.concatenate([chunk.elements for chunk in batch])
        for columns in (slice(start, start + 6) for start in range(0, loads, 6)):
            yield (
                columns,
                elements,
                moved[space.cells[elements]],
                element_forces(space, batch, moved[..., columns]),
            )


def _free_cubics(mesh: TetMesh, space: Cubic, supports: Supports) -> Ints:
    """Return the cubics (w,) that are on no clamped face and no rigid coupling."""
    fixed = np.zeros(space.base, dtype=bool)
    fixed[supports.clamped] = fixed[supports.tied] = True
    outer = mesh.grid.boundary_facets()
    nodes = np.vstack(
        [
            mesh.grid.facets[:, outer],
            mesh.grid.dofs.edge_dofs[0, mesh.grid.f2e[:, outer]],
        ]
    )
    held = space.dofs.get_facet_dofs(outer[fixed[nodes].all(axis=0)]).flatten()
    return space.base + np.setdiff1d(np.arange(space.dofs.N), held)


def cubic_loads(mesh: TetMesh, space: Cubic, couplings: tuple[Coupling, ...]) -> Floats:
    """Return the work (count, 3, 6n) of distributed unit tractions on cubics; 0 on nodes.

    Parameters
    ----------
    mesh, space
        Mesh, and its space of cubic functions.
    couplings
        The n loaded interfaces; rigid ones do no work on cubics.
    """
    loads = np.zeros((space.count, 3, 6 * len(couplings)))
    for k, coupling in enumerate(couplings):
        if coupling.kind == "distributed":
            work = traction_work(mesh, coupling, ElementTetCubic())
            loads[space.base :, :, 6 * k : 6 * k + 6] = work.reshape(-1, 3, 6)
    return loads

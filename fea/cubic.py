"""The cubic solution on the same mesh, preconditioned by the quadratic solver.

The quadratic space is enriched by hierarchical cubics (``spaces.ElementTetCubic``). Conjugate gradients, preconditioned
by the solver of the quadratic problem and a 3 x 3 block Jacobi step on the cubics, need no second factorization. Both
solutions are Galerkin ones: both compliances are lower bounds of the exact one on the same geometry.

The product with the stiffness is a kernel of ours, element by element. Assembled by scikit-fem's forms instead, the
solution took 1.8 times the processor time and 1.7 times the memory on the default slider, 1.4 and 2.1 times on the
ribbed one; ``tests/fea`` compares the two.
"""

# pyright: reportOptionalSubscript=false
# (scikit-fem declares its types loosely)

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import bsr_array, csr_array
from skfem import Dofs, ElementTetP2
from skfem.mapping import MappingAffine
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from stiffscope.fea.couplings import traction_work
from stiffscope.fea.elasticity import tensor
from stiffscope.fea.mesh import MeshError
from stiffscope.fea.solvers import conjugate_gradients, on_all_cores
from stiffscope.fea.spaces import ElementTetCubic

if TYPE_CHECKING:
    from stiffscope.fea.couplings import Coupling, Supports
    from stiffscope.fea.mesh import Floats, Ints, TetMesh
    from stiffscope.fea.solvers import Solve, Solver

CURVED_ORDER = 6
CHUNK, BATCH = 512, 128  # elements of one task of a core; tasks whose results are in memory at once


@dataclass(frozen=True)
class Cubic:
    """The enriched space: the mesh's nodes, then the cubics of ``dofs``; and its stiffness, unassembled.

    Attributes
    ----------
    dofs : scikit-fem's numbering of the cubics.
    cells, signs : (m, 20) functions of each element and their orientation.
    groups : elements by quadrature, each with its table of reference gradients and its pulled-back elasticity.
    base : number of the mesh's nodes, the first functions.
    """

    dofs: Dofs
    cells: Ints
    signs: Ints
    groups: tuple[_Group, ...]
    base: int

    @property
    def count(self) -> int:
        """Number of functions, three degrees of freedom each."""
        return self.base + self.dofs.N

    def batches(self) -> list[list[_Group]]:
        """Return the elements in chunks, in batches that bound the memory of one product."""
        chunks = [
            _Group(group.elements[k : k + CHUNK], group.table, group.elasticity[k : k + CHUNK])
            for group in self.groups
            for k in range(0, len(group.elements), CHUNK)
        ]
        return [chunks[k : k + BATCH] for k in range(0, len(chunks), BATCH)]


@dataclass(frozen=True)
class _Group:
    """Elements (c,) with one table (3, p, 20) of reference gradients; elasticity (c, 1 or p, 9, 9) in N/m.

    With the elasticity pulled back to the reference element, [(r, i), (s, j)], the stiffness is
    Σ_p table[r, p, a] elasticity[(r, i), (s, j)] table[s, p, b].
    """

    elements: Ints
    table: Floats
    elasticity: Floats


def enrich(mesh: TetMesh, elasticity: Floats) -> Cubic:
    """Return the enriched space of a mesh; elasticity (6, 6) in Pa."""
    grid, element, base = mesh.grid, ElementTetCubic(), len(mesh.points)
    dofs = Dofs(grid, element)
    cells = np.vstack([grid.dofs.element_dofs, base + dofs.element_dofs]).T
    signs = np.stack([np.ones(len(cells), dtype=int)] * 10 + [element.orient(grid.mapping(), i) for i in range(10)], 1)
    groups = []
    for mask, mapping, rule in (
        (~mesh.is_curved, MappingAffine(grid), _straight_rule()),
        (mesh.is_curved, grid.mapping(), _curved_rule()),
    ):
        elements, (table, at, weights) = np.flatnonzero(mask), rule
        if len(elements):
            inverse = mapping.invDF(at, tind=elements)  # ∂ξ_r/∂x_k
            pulled = np.einsum("rkcq,ikjl,slcq->cqrisj", inverse, tensor(elasticity), inverse, optimize=True)
            pulled *= (np.abs(mapping.detDF(at, tind=elements)) * weights)[:, :, None, None, None, None]
            groups.append(_Group(elements, table, pulled.reshape(*pulled.shape[:2], 9, 9)))
    return Cubic(dofs, cells, signs, tuple(groups), base)


def _gradients(at: Floats) -> Floats:
    elements = ElementTetP2(), ElementTetCubic()
    return np.stack([element.lbasis(at, i)[1] for element in elements for i in range(10)], axis=2)  # (3, p, 20)


def _straight_rule() -> tuple[Floats, Floats, Floats]:
    """Return the table of a straight-sided element, and the one point and weight of its constant elasticity.

    Gradients are then quadratic: ten orthonormal modes hold them, and their integral is a dot product.
    """
    at, weights = get_quadrature(RefTet, 4)
    values = np.stack([ElementTetP2().lbasis(at, i)[0] for i in range(10)])
    mass = (values * weights) @ values.T
    return np.linalg.cholesky(mass).T @ _gradients(ElementTetP2.doflocs.T), np.full((3, 1), 0.25), np.ones(1)


def _curved_rule() -> tuple[Floats, Floats, Floats]:
    at, weights = get_quadrature(RefTet, CURVED_ORDER)
    return _gradients(at), at, weights


@dataclass(frozen=True)
class CubicProblem:
    """The cubic problem of a supported mesh.

    Attributes
    ----------
    free : (w,) cubics without constraints. Coordinates (c + 3w) are those of ``supports``, then theirs.
    apply, precondition : the product with the stiffness, and an approximation of its inverse.
    balance : the solver of the quadratic problem's approximation of its own inverse.
    """

    space: Cubic
    supports: Supports
    free: Ints
    apply: Solve
    precondition: Solve
    balance: Solve


def cubic_problem(
    mesh: TetMesh, space: Cubic, supports: Supports, solver: Solver, springs: csr_array | None = None
) -> CubicProblem:
    """Return the cubic problem, preconditioned by the solver of the quadratic one.

    Parameters
    ----------
    springs : (count, count) elastic foundation, one direction; see ``stiffscope.fea.foundation``.
    """
    free = _free_cubics(mesh, space, supports)
    apply, diagonal = _operator(space, supports, free, springs)

    def precondition(residual: Floats) -> Floats:
        split = len(residual) - diagonal.shape[0]
        return np.vstack([solver.precondition(residual[:split]), diagonal @ residual[split:]])

    return CubicProblem(space, supports, free, apply, precondition, solver.precondition)


def solve_cubic(
    problem: CubicProblem, force: Floats, start: Floats, tolerance: float = 1e-2, limit: int = 500
) -> Floats:
    """Return (c + 3w, loads) the coordinates of the cubic solution.

    The first c are the coordinates of the supports, with the exact nodal values: the cubics vanish at all nodes.

    Parameters
    ----------
    force, start : (c + 3w, loads) generalized forces, and (c, loads) the quadratic problem's solution for its own.
    tolerance : relative error of the difference between the two compliances at which to stop.

    Raises
    ------
    MeshError : no convergence.
    """
    split = len(start)
    whole = np.vstack([start, np.zeros((len(force) - split, force.shape[1]))])
    motion, converged = conjugate_gradients(problem.apply, problem.precondition, force, whole, tolerance, limit)
    if not converged:
        raise MeshError(
            f"solve: the cubic solution did not converge in {limit} steps: flat elements or a material like rubber"
        )
    motion[:split] += problem.balance(
        (force - problem.apply(motion))[:split]
    )  # equilibrium of the nodal forces, whatever the error of the cubics
    return motion


def work(apply: Solve, force: Floats, motion: Floats) -> Floats:
    """Return (loads, loads) Fᵀu + uᵀF − uᵀAu: the compliance, with an error of second order in that of ``motion``.

    Parameters
    ----------
    apply
        Product with the stiffness.
    force
        Loads.
    motion
        Approximate solution.

    """
    found = motion.T @ (2 * force - apply(motion))
    return (found + found.T) / 2


def _operator(space: Cubic, supports: Supports, free: Ints, springs: csr_array | None) -> tuple[Solve, bsr_array]:
    """Return the product with the enlarged stiffness, element by element, and the inverse of its 3 x 3 blocks."""
    batches, scatters, diagonal = space.batches(), [], np.zeros((space.count, 9))
    for batch in batches:
        cells = space.cells[np.concatenate([chunk.elements for chunk in batch])].reshape(-1)
        spread = (np.ones(len(cells)), (cells, np.arange(len(cells))))
        scatters.append(csr_array(spread, shape=(space.count, len(cells))))
        diagonal += scatters[-1] @ np.concatenate([_own(chunk) for chunk in batch]).reshape(-1, 9)
    base, high = 3 * space.base, (3 * free[:, None] + np.arange(3)).reshape(-1)

    def apply(coordinates: Floats) -> Floats:
        loads = coordinates.shape[1]
        motion = expand(space, supports, free, coordinates)
        forces = np.zeros((space.count, 3 * loads))
        for batch, scatter in zip(batches, scatters, strict=True):
            forces += scatter @ element_forces(space, batch, motion.reshape(-1, 3, loads)).reshape(-1, 3 * loads)
        if springs is not None:
            forces += springs @ motion.reshape(-1, 3 * loads)
        forces = forces.reshape(-1, loads)
        return np.vstack([supports.restrict(forces[:base]), forces[high]])

    diagonal = diagonal[free].reshape(-1, 3, 3)
    if springs is not None:
        diagonal += springs.diagonal()[free][:, None, None] * np.eye(3)
    steps = np.arange(len(free) + 1)
    return apply, bsr_array((np.linalg.inv(diagonal), steps[:-1], steps))


def _own(chunk: _Group) -> Floats:
    """Return (c, 20, 9) the 3 x 3 stiffness of each function on itself."""
    pairs = np.einsum("rpa,spa->prsa", chunk.table, chunk.table)
    if chunk.elasticity.shape[1] == 1:
        pairs = pairs.sum(axis=0, keepdims=True)
    tensor = chunk.elasticity.reshape(*chunk.elasticity.shape[:2], 3, 3, 3, 3)
    return np.einsum("prsa,cprisj->caij", pairs, tensor, optimize=True).reshape(-1, 20, 9)


def expand(space: Cubic, supports: Supports, free: Ints, coordinates: Floats) -> Floats:
    """Return (3 count, loads) coefficients of all functions from the unconstrained coordinates (c + 3w, loads).

    Parameters
    ----------
    space
        Cubic functions on the mesh.
    supports
        Clamped nodes and rigid couplings.
    free
        Functions that are not constrained, by number.
    coordinates
        Unconstrained coordinates (c + 3w, loads).

    """
    split = 3 * len(supports.free) + supports.tie.shape[1]
    motion = np.zeros((3 * space.count, coordinates.shape[1]))
    motion[: 3 * space.base] = supports.expand(coordinates[:split])
    motion[(3 * free[:, None] + np.arange(3)).reshape(-1)] = coordinates[split:]
    return motion


def element_energies(problem: CubicProblem, gained: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Return (m, loads) twice the energy of ``gained`` in each element, and (loads, loads) its weighted sum.

    Parameters
    ----------
    gained : (c + 3w, loads) coordinates of the cubic minus the quadratic solution; the gains in compliance are
        the sums over all elements (and over the springs of a foundation).
    weights : (m,) of the elements in the weighted sum, whose off-diagonal terms are mutual energies of two loads.
    """
    space, loads = problem.space, gained.shape[1]
    energies, weighted = np.empty((len(space.cells), loads)), np.zeros((loads, loads))
    motion = expand(space, problem.supports, problem.free, gained).reshape(space.count, 3, loads)
    for start in range(0, loads, 6):
        columns = slice(start, start + 6)
        for batch in space.batches():
            elements = np.concatenate([chunk.elements for chunk in batch])
            forces, cells = element_forces(space, batch, motion[..., columns]), space.cells[elements]
            energies[elements, columns] = np.einsum("cail,cail->cl", forces, motion[..., columns][cells])
            heavy = np.flatnonzero(weights[elements])
            forces = forces[heavy] * weights[elements[heavy], None, None, None]
            weighted[columns] += np.tensordot(forces, motion[cells[heavy]], axes=((0, 1, 2), (0, 1, 2)))
    return energies, (weighted + weighted.T) / 2


def element_forces(space: Cubic, batch: list[_Group], motion: Floats) -> Floats:
    """Return (m, 20, 3, loads) the forces of a batch's m elements on their functions, for (count, 3, loads) motions.

    Parameters
    ----------
    space
        Cubic functions on the mesh.
    batch
        Groups of elements.
    motion
        Displacements of the loads.

    """
    loads = motion.shape[2]
    starts = np.cumsum([0, *(len(chunk.elements) for chunk in batch)])
    local = np.empty((starts[-1], 20, 3, loads))

    def fill(chunk: _Group, start: int) -> None:
        points = chunk.table.shape[1]
        table = chunk.table.reshape(3 * points, 20)
        c, sign = len(chunk.elements), space.signs[chunk.elements].T[:, :, None, None]
        given = (motion[space.cells[chunk.elements].T] * sign).reshape(20, -1)  # (20, c 3 loads)
        slope = (table @ given).reshape(3, points, c, 3, loads).transpose(2, 1, 0, 3, 4)  # (c, p, r, i, loads)
        stress = chunk.elasticity @ slope.reshape(c, points, 9, loads)
        stress = stress.reshape(c, points, 3, 3, loads).transpose(2, 1, 0, 3, 4).reshape(3 * points, -1)
        local[start : start + c] = ((table.T @ stress).reshape(20, c, 3, loads) * sign).transpose(1, 0, 2, 3)

    on_all_cores(fill, batch, starts[:-1])
    return local


def _free_cubics(mesh: TetMesh, space: Cubic, supports: Supports) -> Ints:
    """Return the (w,) cubics that are not on a clamped face or on a rigid coupling."""
    fixed = np.zeros(space.base, dtype=bool)
    fixed[supports.clamped] = fixed[supports.tied] = True
    outer = mesh.grid.boundary_facets()
    nodes = np.vstack([mesh.grid.facets[:, outer], mesh.grid.dofs.edge_dofs[0, mesh.grid.f2e[:, outer]]])
    held = space.dofs.get_facet_dofs(outer[fixed[nodes].all(axis=0)]).flatten()
    return space.base + np.setdiff1d(np.arange(space.dofs.N), held)


def cubic_loads(mesh: TetMesh, space: Cubic, couplings: tuple[Coupling, ...]) -> Floats:
    """Return (count, 3, 6n) the work of the distributed couplings' unit tractions on the cubics, 0 on the nodes."""
    loads = np.zeros((space.count, 3, 6 * len(couplings)))
    for k, coupling in enumerate(couplings):
        if coupling.kind == "distributed":
            work = traction_work(mesh, coupling, ElementTetCubic())
            loads[space.base :, :, 6 * k : 6 * k + 6] = work.reshape(-1, 3, 6)
    return loads

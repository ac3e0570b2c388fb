"""The cubic solution on the same mesh, from the quadratic factorization: how far the quadratic one is off.

The quadratic space is enlarged by the hierarchical cubics λaλb(λa − λb) of each edge and λaλbλc of each face
(Szabó and Babuška, Finite Element Analysis, 1991). Conjugate gradients, preconditioned by the solver of the
quadratic problem and a 3 x 3 block Jacobi step on the cubics, need no second factorization. Both solutions are Galerkin
ones, so both compliances are below the exact one on the same geometry (in the sense of energy).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.elasticity import VOIGT
from stiffscope.fea.interfaces import tractions
from stiffscope.fea.mesh import EDGES, FACES, MeshError
from stiffscope.fea.shape import NODES, curved, determinants, inverses, jacobians, quadrature, shape_values
from stiffscope.fea.solvers import conjugate_gradients, on_all_cores

if TYPE_CHECKING:
    from scipy.sparse import bsr_array, csr_array

    from stiffscope.fea.interfaces import Port, Supports
    from stiffscope.fea.mesh import Floats, Ints, TetMesh
    from stiffscope.fea.solvers import Solve, Solver

CURVED_ORDER = 6
CHUNK, BATCH = 512, 128  # elements that a core works on at once; chunks whose results are held at once
TRIPLES = np.sort(FACES, axis=1)


@dataclass(frozen=True)
class Cubic:
    """The enlarged space: the mesh's nodes, then one function an edge, one a face; and its stiffness, unassembled.

    Attributes
    ----------
    cells : (m, 20) functions of each element.
    signs : (m, 20) orientation of each edge function in each element.
    groups : elements by quadrature, each with its table of reference gradients and its pulled-back elasticity.
    mids, faces : sorted names of the edges (their mid nodes) and of the faces (their corners in one number).
    base : number of the mesh's nodes, the first functions.
    """

    cells: Ints
    signs: Floats
    groups: tuple[_Group, ...]
    mids: Ints
    faces: Ints
    base: int

    @property
    def count(self) -> int:
        """Number of functions, three degrees of freedom each."""
        return self.base + len(self.mids) + len(self.faces)

    def batches(self) -> list[list[_Group]]:
        """Return the elements in chunks, so many at a time that what they give fits beside the rest."""
        chunks = [
            _Group(group.elements[k : k + CHUNK], group.table, group.elasticity[k : k + CHUNK])
            for group in self.groups
            for k in range(0, len(group.elements), CHUNK)
        ]
        return [chunks[k : k + BATCH] for k in range(0, len(chunks), BATCH)]

    def of_mids(self, mids: Ints) -> Ints:
        """Return the edge functions of the edges with the given mid nodes."""
        return self.base + np.searchsorted(self.mids, mids)

    def of_faces(self, corners: Ints) -> Ints:
        """Return the face functions of the faces with the given (..., 3) corners."""
        return self.base + len(self.mids) + np.searchsorted(self.faces, face_names(corners, self.base))


@dataclass(frozen=True)
class _Group:
    """Elements (c,) with one table (3, p, 20) of reference gradients; elasticity (c, 1 or p, 9, 9) in N/m.

    With the elasticity pulled back to the reference element, [(r, i), (s, j)], the stiffness is
    Σ_p table[r, p, a] elasticity[(r, i), (s, j)] table[s, p, b].
    """

    elements: Ints
    table: Floats
    elasticity: Floats


def face_names(corners: Ints, base: int) -> Ints:
    """Return one number for each triple of corners (..., 3), whatever their order."""
    a, b, c = np.moveaxis(np.sort(corners, axis=-1), -1, 0)
    return (a * base + b) * base + c


def cubic_values(points: Floats) -> tuple[Floats, Floats]:
    """Return (q, 10) values and (q, 10, 3) reference gradients of the six edge and four face cubics."""
    b = np.column_stack([1 - points.sum(axis=1), points])
    db = np.vstack([-np.ones(3), np.eye(3)])
    values, slopes = [], []
    for i, j in EDGES:
        x, y = b[:, i], b[:, j]
        values.append(x * y * (x - y))
        slopes.append(np.outer(y * (2 * x - y), db[i]) + np.outer(x * (x - 2 * y), db[j]))
    for i, j, k in TRIPLES:
        x, y, z = b[:, i], b[:, j], b[:, k]
        values.append(x * y * z)
        slopes.append(np.outer(y * z, db[i]) + np.outer(x * z, db[j]) + np.outer(x * y, db[k]))
    return np.stack(values, axis=1), np.stack(slopes, axis=1)


def enlarge(mesh: TetMesh, elasticity: Floats) -> Cubic:
    """Number the cubics of the mesh and pull the elasticity back to the reference element."""
    base = len(mesh.points)
    corners = mesh.cells[:, :4]
    mids, edge_of = np.unique(mesh.cells[:, 4:], return_inverse=True)
    faces, face_of = np.unique(face_names(corners[:, TRIPLES], base), return_inverse=True)
    cells = np.hstack([mesh.cells, base + edge_of.reshape(-1, 6), base + len(mids) + face_of.reshape(-1, 4)])
    signs = np.ones((len(cells), 20))
    signs[:, 10:16] = np.where(corners[:, EDGES[:, 0]] < corners[:, EDGES[:, 1]], 1.0, -1.0)
    tensor = elasticity[VOIGT[:, :, None, None], VOIGT[None, None]]  # [i, k, j, l]
    bent = curved(mesh.points[mesh.cells])
    groups = []
    for mask, table, at, weights in ((~bent, *_affine_rule()), (bent, *_curved_rule())):
        elements = np.flatnonzero(mask)
        jacobian = jacobians(mesh.points[mesh.cells[elements]], shape_values(at)[1])
        size = determinants(jacobian)
        inverse = inverses(jacobian, size)  # [r, k]: dξ_r/dx_k
        pulled = np.einsum("cqrk,ikjl,cqsl->cqrisj", inverse, tensor, inverse, optimize=True)
        pulled *= (size * weights)[:, :, None, None, None, None]
        groups.append(_Group(elements, table, pulled.reshape(*size.shape, 9, 9)))
    return Cubic(cells, signs, tuple(groups), mids, faces, base)


def _slopes(at: Floats) -> Floats:
    return np.concatenate([shape_values(at)[1], cubic_values(at)[1]], axis=1).transpose(2, 0, 1)  # (3, p, 20)


def _affine_rule() -> tuple[Floats, Floats, Floats]:
    """Return the table of a straight-sided element, and the one point and weight of its constant elasticity.

    Gradients are then quadratic: ten orthonormal modes hold them, and their integral is a dot product.
    """
    at, weights = quadrature(4)
    values = shape_values(at)[0]
    mass = np.einsum("q,qa,qb->ab", weights, values, values)
    table = np.linalg.cholesky(mass).T @ _slopes(NODES)
    return table, np.full((1, 3), 0.25), np.ones(1)


def _curved_rule() -> tuple[Floats, Floats, Floats]:
    at, weights = quadrature(CURVED_ORDER)
    return _slopes(at), at, weights


def cubic_compliance(
    mesh: TetMesh,
    space: Cubic,
    supports: Supports,
    ports: tuple[Port, ...],
    solver: Solver,
    loads: Floats,
    start: Floats,
    tolerance: float = 1e-2,
    limit: int = 500,
    springs: csr_array | None = None,
) -> tuple[Floats, Floats]:
    """Return (6n, 6n) the compliance of the cubic solution and (c + 3w, 6n) its coordinates; MeshError without one.

    The first c are the coordinates of ``supports``, with the exact nodal values: the cubics vanish at all nodes.

    Parameters
    ----------
    solver, loads, start : the solver of the quadratic problem, its (c, 6n) unit loads and their solution.
    tolerance : relative error of the difference between the two compliances at which to stop.
    springs : (count, count) elastic foundation, one direction; see ``stiffscope.fea.foundation``.
    """
    free = free_cubics(mesh, space, supports)
    apply, diagonal = _operator(space, supports, free, springs)
    extra = _cubic_loads(mesh.points, space, ports)[free].reshape(-1, loads.shape[1])
    force = np.vstack([loads, extra])
    split = len(loads)

    def precondition(residual: Floats) -> Floats:
        return np.vstack([solver.precondition(residual[:split]), diagonal @ residual[split:]])

    motion, converged = conjugate_gradients(
        apply, precondition, force, np.vstack([start, np.zeros_like(extra)]), tolerance, limit
    )
    if not converged:
        raise MeshError(
            f"solve: the cubic solution did not converge in {limit} steps: flat elements or a material like rubber"
        )
    motion[:split] += solver.precondition(
        (force - apply(motion))[:split]
    )  # the nodes balance, whatever the cubics lack
    compliance = motion.T @ (2 * force - apply(motion))  # Fᵀu + uᵀF − uᵀAu: second order in the error of u
    return (compliance + compliance.T) / 2, motion


def _operator(space: Cubic, supports: Supports, free: Ints, springs: csr_array | None) -> tuple[Solve, bsr_array]:
    """Return the product with the enlarged stiffness, element by element, and the inverse of its 3 x 3 blocks."""
    from scipy.sparse import bsr_array, csr_array

    batches, scatters, diagonal = space.batches(), [], np.zeros((space.count, 9))
    for batch in batches:
        cells = space.cells[np.concatenate([chunk.elements for chunk in batch])].reshape(-1)
        spread = (np.ones(len(cells)), (cells, np.arange(len(cells))))
        scatters.append(csr_array(spread, shape=(space.count, len(cells))))
        diagonal += scatters[-1] @ np.concatenate([_own(chunk) for chunk in batch]).reshape(-1, 9)
    base, high = 3 * space.base, (3 * free[:, None] + np.arange(3)).reshape(-1)

    def apply(coordinates: Floats) -> Floats:
        loads = coordinates.shape[1]
        motion = unfolded(space, supports, free, coordinates)
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


def unfolded(space: Cubic, supports: Supports, free: Ints, coordinates: Floats) -> Floats:
    """Return (3 count, loads) coefficients of all functions from the coordinates (c + 3w, loads) left free."""
    split = 3 * len(supports.free) + supports.tie.shape[1]
    motion = np.zeros((3 * space.count, coordinates.shape[1]))
    motion[: 3 * space.base] = supports.expand(coordinates[:split])
    motion[(3 * free[:, None] + np.arange(3)).reshape(-1)] = coordinates[split:]
    return motion


def element_energies(
    mesh: TetMesh, space: Cubic, supports: Supports, gained: Floats, weights: Floats
) -> tuple[Floats, Floats]:
    """Return (m, loads) twice the energy of ``gained`` in each element, and (loads, loads) its weighted sum.

    Parameters
    ----------
    gained : (c + 3w, loads) coordinates of the cubic solution less the quadratic one; the loads' compliance
        gains are the sums over all elements (and over the springs of a foundation).
    weights : (m,) of the elements in the weighted sum, which has the energies of each two loads together.
    """
    free = free_cubics(mesh, space, supports)
    loads = gained.shape[1]
    energies, weighted = np.empty((len(space.cells), loads)), np.zeros((loads, loads))
    motion = unfolded(space, supports, free, gained).reshape(space.count, 3, loads)
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
    """Return (m, 20, 3, loads) the forces of a batch's m elements on their functions, for (count, 3, loads) motions."""
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


def free_cubics(mesh: TetMesh, space: Cubic, supports: Supports) -> Ints:
    """Return the cubics that are not on a clamped or rigid face."""
    fixed = np.zeros(space.base, dtype=bool)
    fixed[supports.clamped] = fixed[supports.tied] = True
    facets = mesh.facets[fixed[mesh.facets].all(axis=1)]  # triangles all of whose nodes are held
    held = np.zeros(space.count, dtype=bool)
    held[space.of_mids(facets[:, 3:])] = True
    held[space.of_faces(facets[:, :3])] = True
    return np.flatnonzero(~held[space.base :]) + space.base


def _cubic_loads(points: Floats, space: Cubic, ports: tuple[Port, ...]) -> Floats:
    """Return (count, 3, 6n) the work of the distributed ports' unit tractions on the cubics."""
    loads = np.zeros((space.count, 3, 6 * len(ports)))
    for k, port in enumerate(ports):
        if port.kind == "rigid":
            continue
        traction, at = tractions(points, port)
        functions, values = facet_cubics(space, port.facets, at)
        work = np.einsum("kqf,kqia->kfia", values, traction)
        np.add.at(loads[..., 6 * k : 6 * k + 6], functions.reshape(-1), work.reshape(-1, 3, 6))
    return loads


def facet_cubics(space: Cubic, facets: Ints, at: Floats) -> tuple[Ints, Floats]:
    """Return (k, 4) the three edge and one face cubics of triangles (k, 6) and their (k, q, 4) values at (q, 2)."""
    b = np.column_stack([1 - at.sum(axis=1), at])
    corners = facets[:, :3]
    functions, values = [], []
    for side in range(3):
        i, j = side, (side + 1) % 3
        sign = np.where(corners[:, i] < corners[:, j], 1.0, -1.0)
        functions.append(space.of_mids(facets[:, 3 + side]))
        values.append(np.outer(sign, b[:, i] * b[:, j] * (b[:, i] - b[:, j])))
    functions.append(space.of_faces(corners))
    values.append(np.broadcast_to(b.prod(axis=1), values[0].shape))
    return np.stack(functions, axis=1), np.stack(values, axis=2)

"""The cubic solution on the same mesh, from the quadratic factorization: how far the quadratic one is off.

The quadratic space is enlarged by the hierarchical cubics λaλb(λa − λb) of each edge and λaλbλc of each face
(Szabó and Babuška, Finite Element Analysis, 1991). Conjugate gradients, preconditioned by the factorized
quadratic problem and a 3 x 3 block Jacobi step on the cubics, need no second factorization. Both solutions are Galerkin
ones, so both compliances are below the exact one on the same geometry (in the sense of energy).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fea.elasticity import VOIGT
from fea.interfaces import tractions
from fea.mesh import EDGES, FACES
from fea.shape import curved, determinants, inverses, jacobians, quadrature, shape_values

if TYPE_CHECKING:
    from collections.abc import Callable

    from scipy.sparse import bsr_array

    from fea.interfaces import Port, Supports
    from fea.mesh import Floats, Ints, TetMesh
    from fea.solvers import Solve

logger = logging.getLogger(__name__)

AFFINE_ORDER, CURVED_ORDER = 4, 6
CHUNK = 512
TRIPLES = np.sort(FACES, axis=1)


@dataclass(frozen=True)
class Cubic:
    """Numbering of the enlarged space: the mesh's nodes, then one function an edge, one a face.

    Attributes
    ----------
    cells : (m, 20) functions of each element.
    blocks : (m, 60, 60) stiffness of each element, N/m, edge functions oriented by node number.
    mids, faces : sorted names of the edges (their mid nodes) and of the faces (their corners in one number).
    base : number of the mesh's nodes, the first functions.
    """

    cells: Ints
    blocks: Floats
    mids: Ints
    faces: Ints
    base: int

    @property
    def count(self) -> int:
        """Number of functions, three degrees of freedom each."""
        return self.base + len(self.mids) + len(self.faces)

    def of_mids(self, mids: Ints) -> Ints:
        """Return the edge functions of the edges with the given mid nodes."""
        return self.base + np.searchsorted(self.mids, mids)

    def of_faces(self, corners: Ints) -> Ints:
        """Return the face functions of the faces with the given (..., 3) corners."""
        return self.base + len(self.mids) + np.searchsorted(self.faces, face_names(corners, self.base))


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
    """Number the cubics of the mesh and integrate the elements' stiffness over the enlarged space."""
    base = len(mesh.points)
    corners = mesh.cells[:, :4]
    mids, edge_of = np.unique(mesh.cells[:, 4:], return_inverse=True)
    faces, face_of = np.unique(face_names(corners[:, TRIPLES], base), return_inverse=True)
    cells = np.hstack([mesh.cells, base + edge_of.reshape(-1, 6), base + len(mids) + face_of.reshape(-1, 4)])
    signs = np.ones((len(cells), 20))
    signs[:, 10:16] = np.where(corners[:, EDGES[:, 0]] < corners[:, EDGES[:, 1]], 1.0, -1.0)
    blocks = np.empty((len(cells), 60, 60))
    bent = curved(mesh.points[mesh.cells])
    for mask, order in ((~bent, AFFINE_ORDER), (bent, CURVED_ORDER)):
        chosen = np.flatnonzero(mask)
        for start in range(0, len(chosen), CHUNK):
            some = chosen[start : start + CHUNK]
            blocks[some] = _stiffness(mesh.points[mesh.cells[some]], signs[some], elasticity, order)
    return Cubic(cells, blocks, mids, faces, base)


def _stiffness(corners: Floats, signs: Floats, elasticity: Floats, order: int) -> Floats:
    at, weights = quadrature(order)
    lower = shape_values(at)[1]
    slopes = np.concatenate([lower, cubic_values(at)[1]], axis=1)  # (q, 20, 3)
    jacobian = jacobians(corners, lower)
    size = determinants(jacobian)
    m, q = size.shape
    slope = slopes[None] @ inverses(jacobian, size) * signs[:, None, :, None]
    strain = np.zeros((m, q, 6, 20, 3))
    for i in range(3):
        for k in range(3):
            strain[:, :, VOIGT[i, k], :, i] += slope[..., k]
    strain = strain.reshape(m, q * 6, 60)
    stress = (elasticity @ strain.reshape(m, q, 6, 60)) * (size * weights)[..., None, None]
    return strain.transpose(0, 2, 1) @ stress.reshape(m, q * 6, 60)


def cubic_compliance(
    mesh: TetMesh,
    space: Cubic,
    supports: Supports,
    ports: tuple[Port, ...],
    solve: Solve,
    loads: Floats,
    start: Floats,
    tolerance: float = 3e-3,
    limit: int = 60,
) -> tuple[Floats, Floats]:
    """Return (6n, 6n) the compliance of the cubic solution and (c + 3w, 6n) its coordinates.

    The first c are the coordinates of ``supports``, with the exact nodal values: the cubics vanish at all nodes.

    Parameters
    ----------
    solve, loads, start : the factorized quadratic problem, its (c, 6n) unit loads and their solution.
    tolerance : relative error of the difference between the two compliances at which to stop.
    """
    free = _free_cubics(mesh, space, supports)
    apply, diagonal = _operator(space, supports, free)
    extra = _cubic_loads(mesh.points, space, ports)[free].reshape(-1, loads.shape[1])
    force = np.vstack([loads, extra])
    split = len(loads)

    def precondition(residual: Floats) -> Floats:
        return np.vstack([solve(residual[:split]), diagonal @ residual[split:]])

    motion = _conjugate_gradients(
        apply, precondition, force, np.vstack([start, np.zeros_like(extra)]), tolerance, limit
    )
    motion[:split] += solve((force - apply(motion))[:split])  # the nodes balance to rounding, whatever the cubics lack
    compliance = motion.T @ (2 * force - apply(motion))  # Fᵀu + uᵀF − uᵀAu: second order in the error of u
    return (compliance + compliance.T) / 2, motion


def _conjugate_gradients(
    apply: Callable[[Floats], Floats],
    precondition: Callable[[Floats], Floats],
    force: Floats,
    motion: Floats,
    tolerance: float,
    limit: int,
) -> Floats:
    """Solve for all columns at once, until a step adds less than a tenth of ``tolerance`` of the energy gained."""
    residual = force - apply(motion)
    step = precondition(residual)
    fall = np.einsum("ij,ij->j", residual, step)
    direction = step
    gained = np.full(force.shape[1], np.finfo(float).tiny)
    for _ in range(limit):
        pushed = apply(direction)
        length = fall / np.maximum(np.einsum("ij,ij->j", direction, pushed), np.finfo(float).tiny)
        motion = motion + length * direction
        residual = residual - length * pushed
        gain = length * fall  # what this step adds to each compliance
        gained += gain
        if (gain < 0.1 * tolerance * gained).all():
            break
        step = precondition(residual)
        before, fall = fall, np.einsum("ij,ij->j", residual, step)
        direction = step + fall / np.maximum(before, np.finfo(float).tiny) * direction
    return motion


def _operator(space: Cubic, supports: Supports, free: Ints) -> tuple[Callable[[Floats], Floats], bsr_array]:
    """Return the product with the enlarged stiffness, element by element, and the inverse of its 3 x 3 blocks."""
    from scipy.sparse import bsr_array, csr_array

    m = len(space.cells)
    flat = space.cells.reshape(-1)
    scatter = csr_array((np.ones(20 * m), (flat, np.arange(20 * m))), shape=(space.count, 20 * m))
    split, base = 3 * len(supports.free) + supports.tie.shape[1], 3 * space.base
    high = 3 * free[:, None] + np.arange(3)

    def apply(coordinates: Floats) -> Floats:
        loads = coordinates.shape[1]
        motion = np.zeros((3 * space.count, loads))
        motion[:base] = supports.expand(coordinates[:split])
        motion[high.reshape(-1)] = coordinates[split:]
        local = motion.reshape(-1, 3 * loads)[flat].reshape(m, 60, loads)
        forces = (scatter @ (space.blocks @ local).reshape(20 * m, 3 * loads)).reshape(-1, loads)
        return np.vstack([supports.restrict(forces[:base]), forces[high.reshape(-1)]])

    own = space.blocks.reshape(m, 20, 3, 20, 3)[:, range(20), :, range(20)]  # (20, m, 3, 3)
    diagonal = (scatter @ own.transpose(1, 0, 2, 3).reshape(20 * m, 9))[free].reshape(-1, 3, 3)
    steps = np.arange(len(free) + 1)
    return apply, bsr_array((np.linalg.inv(diagonal), steps[:-1], steps))


def _free_cubics(mesh: TetMesh, space: Cubic, supports: Supports) -> Ints:
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
        b = np.column_stack([1 - at.sum(axis=1), at])
        corners = port.facets[:, :3]
        columns = slice(6 * k, 6 * k + 6)
        for side in range(3):
            i, j = side, (side + 1) % 3
            values = b[:, i] * b[:, j] * (b[:, i] - b[:, j])
            sign = np.where(corners[:, i] < corners[:, j], 1.0, -1.0)
            work = np.einsum("q,k,kqia->kia", values, sign, traction)
            np.add.at(loads[..., columns], space.of_mids(port.facets[:, 3 + side]), work)
        work = np.einsum("q,kqia->kia", b.prod(axis=1), traction)
        np.add.at(loads[..., columns], space.of_faces(corners), work)
    return loads

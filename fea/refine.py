"""Local refinement by edge bisection: grading towards singular edges, and adaptive refinement.

Children keep the parent's quadratic map (a straight-sided part of the reference element is again a
quadratic element), so refinement neither moves the boundary nor inverts elements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from stiffscope.fea.geometry import shapes
from stiffscope.fea.mesh import (
    EDGES,
    FACE_MIDS,
    FACES,
    Floats,
    Ints,
    TetMesh,
    boundary_facets,
    compact,
    unique_edges,
)

OPPOSITE = [3, 2, 0, 1]  # vertex opposite to each of FACES
CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


@dataclass
class _Pieces:
    """Tetrahedra being split: vertices (m, 4), root (m,), reference corners in it (m, 4, 3)."""

    vertices: Ints
    root: Ints
    corners: Floats


def bisect(mesh: TetMesh, marked: Ints, at: Floats) -> TetMesh:
    """Return the mesh with each marked edge, and all tetrahedra around it, bisected.

    Parameters
    ----------
    marked : (e, 2) vertex pairs.
    at : (e,) position of the cut, as a fraction of the edge from its first vertex.
    """
    count = len(mesh.points)
    flip = marked[:, 0] > marked[:, 1]
    low = marked.min(axis=1)
    high = marked.max(axis=1)
    keys, first = np.unique(low * count + high, return_index=True)
    at = np.where(flip, 1 - at, at)[first]
    length = np.linalg.norm(mesh.points[low] - mesh.points[high], axis=1)[first]
    rank = np.empty(
        len(keys), dtype=np.int64
    )  # the longest edge of a tetrahedron is cut first
    rank[np.argsort(length, kind="stable")] = np.arange(len(keys))
    cells = len(mesh.cells)
    pieces = _Pieces(
        mesh.cells[:, :4].copy(), np.arange(cells), np.tile(CORNERS, (cells, 1, 1))
    )
    pending = np.ones(len(keys), dtype=bool)
    while pending.any():
        pieces = _cut_round(
            pieces=pieces, count=count, keys=keys, rank=rank, at=at, pending=pending
        )
    return _rebuilt(mesh, pieces, count + len(keys))


def _cut_round(
    pieces: _Pieces, count: int, keys: Ints, rank: Ints, at: Floats, pending: np.ndarray
) -> _Pieces:
    """Cut pending edges that rank highest in all tetrahedra around them: an independent set."""
    ends = np.sort(pieces.vertices[:, EDGES], axis=2)  # (m, 6, 2)
    old = ends[:, :, 1] < count
    wanted = np.where(old, ends[:, :, 0] * count + ends[:, :, 1], -1)
    slot = np.searchsorted(keys, wanted).clip(max=len(keys) - 1)
    hit = (keys[slot] == wanted) & pending[slot]
    score = np.where(hit, rank[slot], -1)
    top = score.max(axis=1)
    beaten = np.zeros(len(keys), dtype=bool)
    beaten[slot[hit & (score < top[:, None])]] = True
    present = np.zeros(len(keys), dtype=bool)
    present[slot[hit]] = True
    pending &= present
    local = score.argmax(axis=1)
    edge = slot[np.arange(len(slot)), local]
    cut = np.flatnonzero((top >= 0) & ~beaten[edge])
    if not len(cut):
        return pieces
    edge = edge[cut]
    local = local[cut]
    pending[edge] = False
    a, b = EDGES[local].T
    swap = pieces.vertices[cut, a] > pieces.vertices[cut, b]
    a, b = np.where(swap, b, a), np.where(swap, a, b)
    t = at[edge][:, None]
    middle = (1 - t) * pieces.corners[cut, a] + t * pieces.corners[cut, b]
    return _with_halves(
        pieces=pieces, cut=cut, a=a, b=b, new=count + edge, middle=middle
    )


def _with_halves(
    pieces: _Pieces, cut: Ints, a: Ints, b: Ints, new: Ints, middle: Floats
) -> _Pieces:
    whole = pieces.vertices, pieces.root, pieces.corners
    halves = [tuple(np.delete(part, cut, axis=0) for part in whole)]
    for replaced in (a, b):
        vertices = pieces.vertices[cut]
        corners = pieces.corners[cut]
        vertices[np.arange(len(cut)), replaced] = new
        corners[np.arange(len(cut)), replaced] = middle
        halves.append((vertices, pieces.root[cut], corners))
    return _Pieces(*(np.concatenate(parts) for parts in zip(*halves, strict=True)))


def _rebuilt(mesh: TetMesh, pieces: _Pieces, vertex_count: int) -> TetMesh:
    """Return the quadratic mesh of the pieces, with nodes on the roots' quadratic maps."""
    edges, edge_of = unique_edges(pieces.vertices)
    cells = np.hstack([pieces.vertices, edge_of + vertex_count])
    reference = np.concatenate(
        [pieces.corners, pieces.corners[:, EDGES].mean(axis=2)], axis=1
    )  # (m, 10, 3)
    points = np.zeros((vertex_count + len(edges), 3))
    _, first = np.unique(cells, return_index=True)
    roots = mesh.points[mesh.cells[pieces.root[first // 10]]]
    values = shapes(reference.reshape(-1, 3)[first].T)[0]
    points[cells.reshape(-1)[first]] = np.einsum("nk,kni->ki", values, roots)
    facets, faces = _inherited_facets(mesh, pieces, cells)
    return compact(TetMesh(points, cells, facets, faces, mesh.pulled_back))


def _inherited_facets(mesh: TetMesh, pieces: _Pieces, cells: Ints) -> tuple[Ints, Ints]:
    """Return boundary triangles (k, 6) and CAD faces (k,), inherited from the parents."""
    outer, owner, local = boundary_facets(mesh.cells[:, :4])
    face = np.empty((len(mesh.cells), 4), dtype=np.int64)
    both = outer, mesh.facets[:, :3]
    order, known = (np.lexsort(np.sort(triangles, axis=1).T) for triangles in both)
    face[owner[order], local[order]] = mesh.facet_face[known]
    facets, owner, local = boundary_facets(cells[:, :4])
    corners = pieces.corners[owner[:, None], FACES[local]]  # (k, 3, 3)
    barycentric = np.concatenate(
        [1 - corners.sum(axis=2, keepdims=True), corners], axis=2
    )
    off = np.abs(barycentric).max(axis=1)
    side = np.argmin(off[:, OPPOSITE], axis=1)  # parent face: one coordinate is zero
    mids = cells[owner[:, None], FACE_MIDS[local]]
    return np.hstack([facets, mids]), face[pieces.root[owner], side]


def grade(mesh: TetMesh, edges: Ints, layers: int, ratio: float) -> TetMesh:
    """Return the mesh with thin layers around edge chains, each ``ratio`` times the last.

    Edges that leave the chains are cut near them; edges along them keep their length: the solution
    varies slowly along a singular edge and fast across it.

    Parameters
    ----------
    edges : (e, 2) vertex pairs along the chains.
    layers, ratio : number of cuts, and their fraction of the distance from the chain.
    """
    if not len(edges) or not layers:
        return mesh
    position = mesh.points[np.unique(edges)]
    tree = KDTree(position)
    reach = 1e-9 * float(np.linalg.norm(np.ptp(position, axis=0)))
    key = np.array([len(mesh.points), 1])
    sides, _ = unique_edges(mesh.cells[:, :4])
    both = np.isin(sides, edges).all(axis=1) & ~np.isin(
        sides @ key, np.sort(edges, axis=1) @ key
    )
    if both.any():
        mesh = bisect(mesh, sides[both], np.full(both.sum(), 0.5))
    for _ in range(layers):
        on_chain = tree.query(mesh.points, distance_upper_bound=reach)[0] < np.inf
        sides, _ = unique_edges(mesh.cells[:, :4])
        leaving = on_chain[sides].sum(axis=1) == 1
        away = sides[leaving]
        away = np.where(on_chain[away[:, :1]], away, away[:, ::-1])
        mesh = bisect(mesh, away, np.full(len(away), ratio))
    return mesh

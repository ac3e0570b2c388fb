"""Put boundary nodes on the exact CAD surface: fTetWild then only has to get the topology right."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import numpy as np

from fea.mesh import EDGES, FACE_MIDS, TetMesh, boundary_facets, unique_edges
from fea.shape import facet_rule, facet_values, jacobian_range
from fea.tags import smooth_tags, tag_facets

if TYPE_CHECKING:
    from cad.part import Surface
    from fea.mesh import Floats, Ints, Project

logger = logging.getLogger(__name__)

ROUNDS = 60
FLATTEST = 0.02  # least Jacobian of a curved element over its mean, below which it is pulled back


def snap(points: Floats, cells: Ints, surface: Surface, project: Project, size: float) -> TetMesh:
    """Return the quadratic mesh whose boundary corners and mids lie on the CAD faces.

    Parameters
    ----------
    points, cells : linear tetrahedra, metres.
    surface : the CAD surface they fill.
    project : ``project(face, points)`` gives the closest points on the face's underlying surface.
    size : wanted edge length (m), the scale of what counts as near.
    """
    facets, owner, local = boundary_facets(cells)
    tags = smooth_tags(facets, tag_facets(surface, points[facets], size / 2))
    cells, facets, owner, local, tags = _drop_flat(points, cells, facets, owner, local, tags)
    corners = _on_faces(points, facets, tags, project, size)
    edges, edge_of = unique_edges(cells)
    nodes = np.vstack([corners, corners[edges].mean(axis=1)])
    full = np.hstack([cells, edge_of + len(points)])
    full_facets = np.hstack([facets, full[owner[:, None], FACE_MIDS[local]]])
    nodes = _on_faces(nodes, full_facets[:, 3:], tags, project, size)
    nodes = _balance(nodes, full_facets, tags, project, size)
    nodes, pulled = _pull_back(nodes, full, points, edges)
    return _compact(TetMesh(nodes, full, full_facets, tags, pulled))


def _drop_flat(
    points: Floats, cells: Ints, facets: Ints, owner: Ints, local: Ints, tags: Ints
) -> tuple[Ints, Ints, Ints, Ints, Ints]:
    """Remove tetrahedra with two boundary triangles on one plane: snapping would make them flat."""
    for _ in range(3):
        normals = np.cross(points[facets[:, 1]] - points[facets[:, 0]], points[facets[:, 2]] - points[facets[:, 0]])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        order = np.lexsort((tags, owner))
        first, second = order[:-1], order[1:]
        twins = (owner[first] == owner[second]) & (tags[first] == tags[second])
        cosine = np.einsum("ij,ij->i", normals[first], normals[second])
        doomed = np.unique(owner[first[twins & (cosine > 0.5)]])
        if not len(doomed):
            break
        known = {tuple(sorted(facet)): tag for facet, tag in zip(facets.tolist(), tags.tolist(), strict=True)}
        heir = dict(zip(owner.tolist(), tags.tolist(), strict=True))
        uncovered = {
            tuple(sorted(cells[cell, list(side)].tolist())): heir[cell]
            for cell in doomed.tolist()
            for side in ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3))
        }
        cells = np.delete(cells, doomed, axis=0)
        facets, owner, local = boundary_facets(cells)
        names = [tuple(sorted(facet)) for facet in facets.tolist()]
        tags = np.array([known[name] if name in known else uncovered[name] for name in names])
        logger.debug("dropped %d flat tetrahedra", len(doomed))
    return cells, facets, owner, local, tags


def _on_faces(points: Floats, nodes: Ints, tags: Ints, project: Project, size: float) -> Floats:
    """Return points with ``nodes`` (k, 3) of each boundary triangle moved on all CAD faces they touch.

    Alternating projections; a node whose faces do not meet nearby (a wrong tag) keeps the nearest one.
    """
    count = int(tags.max()) + 1
    incidence = np.unique(nodes.reshape(-1) * count + np.repeat(tags, 3))
    node, face = incidence // count, incidence % count
    moved = points.copy()
    crowd = np.bincount(node, minlength=len(points))
    for sharing in range(1, int(crowd.max()) + 1):
        mine = crowd[node] == sharing
        _alternate(moved, node[mine], face[mine], project, 1 if sharing == 1 else ROUNDS, 1e-9 * size)
    far = np.linalg.norm(moved - points, axis=1) > size
    if far.any():
        logger.warning("%d boundary nodes have faces that do not meet near them; left in place", far.sum())
        moved[far] = points[far]
    return moved


def _balance(nodes: Floats, facets: Ints, tags: Ints, project: Project, size: float) -> Floats:
    """Return nodes with the mids of curved sides moved so that the mean gap to the CAD vanishes.

    A parabola through three points of an arc of angle θ lies inside it: the area is θ⁴/480 too small.
    First the mean gap of each side (two Gauss points) is taken to zero, then that of each triangle.
    """
    nodes = _balance_sides(nodes, facets, tags, project, size)
    at, weights = facet_rule()
    gaps = np.zeros((len(facets), 3))
    for values, weight in zip(facet_values(at), weights, strict=True):
        on_facet = np.einsum("n,knj->kj", values, nodes[facets])
        triples = np.repeat(np.arange(len(facets))[:, None], 3, axis=1)
        gaps += 2 * weight * (_on_faces(on_facet, triples, tags, project, size) - on_facet)
    mids = facets[:, 3:].reshape(-1)
    inner = np.repeat(tags, 3)
    lowest, highest = np.full(len(nodes), tags.max() + 1), np.full(len(nodes), -1)
    np.minimum.at(lowest, mids, inner)
    np.maximum.at(highest, mids, inner)
    shift = np.stack([np.bincount(mids, np.repeat(gaps[:, k], 3), len(nodes)) for k in range(3)], axis=1)
    one_face = (lowest == highest)[:, None]
    return nodes + np.where(one_face, shift / np.maximum(np.bincount(mids, minlength=len(nodes)), 1)[:, None], 0)


def _balance_sides(nodes: Floats, facets: Ints, tags: Ints, project: Project, size: float) -> Floats:
    ends = facets[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    mids = facets[:, 3:]
    node, first = np.unique(mids, return_index=True)
    start, stop, middle = nodes[ends[first, 0]], nodes[ends[first, 1]], nodes[node]
    new = np.searchsorted(node, mids)
    gap = np.zeros_like(middle)
    for s in (0.5 - 12**-0.5, 0.5 + 12**-0.5):
        on_side = (1 - s) * (1 - 2 * s) * start + s * (2 * s - 1) * stop + 4 * s * (1 - s) * middle
        gap += (_on_faces(on_side, new, tags, project, size) - on_side) / 2
    balanced = nodes.copy()
    balanced[node] += 1.5 * gap
    return balanced


def _alternate(points: Floats, node: Ints, face: Ints, project: Project, rounds: int, enough: float) -> None:
    for _ in range(rounds):
        largest = 0.0
        for each in np.unique(face):
            here = node[face == each]
            target = project(int(each), points[here])
            step = np.linalg.norm(target - points[here], axis=1)
            points[here] = target
            largest = max(largest, float(step.max(initial=0.0)))
        if largest < enough:
            break


def _pull_back(nodes: Floats, cells: Ints, original: Floats, edges: Ints) -> tuple[Floats, int]:
    """Straighten, then return towards the mesher's positions, the elements that snapping inverted."""
    nodes = nodes.copy()
    corners = len(original)
    least = jacobian_range(nodes[cells])
    pulled = np.zeros(len(cells), dtype=bool)
    for attempt in range(8):
        bad = least < FLATTEST
        if not bad.any():
            break
        pulled |= bad
        if attempt:  # the corners go half of the way back
            touched = np.unique(cells[bad, :4])
            nodes[touched] = (nodes[touched] + original[touched]) / 2
        mids = np.unique(cells[bad, 4:])
        if attempt:
            mids = np.unique(cells[np.isin(cells[:, :4], touched).any(axis=1), 4:])
        nodes[mids] = _straighter(nodes, mids, edges[mids - corners], attempt)
        least = jacobian_range(nodes[cells])
    if (least <= 0).any():
        logger.warning("%d elements stay inverted after snapping", (least <= 0).sum())
    return nodes, int(pulled.sum())


def _straighter(nodes: Floats, mids: Ints, ends: Ints, attempt: int) -> Floats:
    middle = nodes[ends].mean(axis=1)
    return middle if attempt else (nodes[mids] + middle) / 2


def _compact(mesh: TetMesh) -> TetMesh:
    """Return the mesh without nodes that no element uses."""
    used, cells = np.unique(mesh.cells, return_inverse=True)
    new = np.full(len(mesh.points), -1, dtype=np.int64)
    new[used] = np.arange(len(used))
    return TetMesh(
        mesh.points[used], cells.reshape(-1, len(EDGES) + 4), new[mesh.facets], mesh.facet_face, mesh.pulled_back
    )

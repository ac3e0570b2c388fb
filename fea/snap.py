"""Projection of boundary nodes on the exact CAD surface; fTetWild only finds the topology."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.geometry import jacobian_range, quadrature, shapes
from stiffscope.fea.mesh import (
    FACE_MIDS,
    FACES,
    SIDES,
    Floats,
    Ints,
    Project,
    TetMesh,
    boundary_facets,
    compact,
    unique_edges,
)
from stiffscope.fea.tags import smooth_tags, tag_facets

if TYPE_CHECKING:
    from stiffscope.cad.part import Surface

logger = logging.getLogger(__name__)

ROUNDS = 60
FLATTEST = 0.003  # least relative Jacobian of a curved element; below, it is removed or moved back


def snap(
    points: Floats,
    cells: Ints,
    surface: Surface,
    project: Project,
    size: float,
    tags: Ints | None = None,
) -> TetMesh:
    """Return the quadratic mesh with boundary corners and midpoints on the CAD faces.

    Parameters
    ----------
    points, cells : linear tetrahedra, metres.
    surface : CAD surface of the solid.
    project : ``project(face, points)`` returns the closest points on the face's surface or, for
        numbers beyond the last face's, on the surface's seams.
    size : target edge length (m); nodes farther from a face stay in place.
    tags : (k,) CAD face of each of ``boundary_facets`` if known; by default the nearest.
    """
    facets, owner, local = boundary_facets(cells)
    if tags is None:
        tags = smooth_tags(facets, tag_facets(surface, points[facets], size / 2))
    skin = _Skin(cells, facets, owner, local, tags)
    target = Target(project, size, len(surface.faces), surface.seams)
    left = 3
    while True:
        nodes, full, full_facets, edges = _curve_mesh(points, skin, target)
        inverted = jacobian_range(nodes[full]) < FLATTEST
        slivers = np.intersect1d(np.flatnonzero(inverted), _sliver_candidates(skin))
        if not left or not len(slivers):
            break
        skin = _without(skin, slivers)
        left = left - 1
    nodes, pulled = _pull_back(nodes, full, points, edges)
    return compact(TetMesh(nodes, full, full_facets, skin.tags, pulled))


@dataclass(frozen=True)
class Target:
    """Projection on faces and seams, with element size (m) and number of faces."""

    project: Project
    size: float
    faces: int
    seams: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class _Skin:
    """Tetrahedra (m, 4); boundary triangles (k, 3) with tetrahedron, local face and CAD face."""

    cells: Ints
    facets: Ints
    owner: Ints
    local: Ints
    tags: Ints


def _curve_mesh(
    points: Floats, skin: _Skin, target: Target
) -> tuple[Floats, Ints, Ints, Ints]:
    """Return nodes, cells (m, 10), boundary triangles (k, 6) on the CAD faces, edges (e, 2)."""
    corners = _on_faces(points, skin.facets, skin.tags, target)
    edges, edge_of = unique_edges(skin.cells)
    nodes = np.vstack([corners, corners[edges].mean(axis=1)])
    cells = np.hstack([skin.cells, edge_of + len(points)])
    facets = np.hstack([skin.facets, cells[skin.owner[:, None], FACE_MIDS[skin.local]]])
    nodes = _on_faces(nodes, facets[:, 3:], skin.tags, target)
    return _balance(nodes, facets, skin.tags, target), cells, facets, edges


def _sliver_candidates(skin: _Skin) -> Ints:
    """Return sliver candidates: tetrahedra with two boundary triangles on one CAD face."""
    order = np.lexsort((skin.tags, skin.owner))
    first = order[:-1]
    second = order[1:]
    same = (skin.owner[first] == skin.owner[second]) & (
        skin.tags[first] == skin.tags[second]
    )
    return np.unique(skin.owner[first[same]])


def _without(skin: _Skin, slivers: Ints) -> _Skin:
    """Remove tetrahedra; new boundary triangles inherit the CAD face of the removed ones."""
    sides = map(tuple, np.sort(skin.facets, axis=1).tolist())
    known = dict(zip(sides, skin.tags.tolist(), strict=True))
    inherited = dict(zip(skin.owner.tolist(), skin.tags.tolist(), strict=True))
    for cell in slivers.tolist():
        for side in FACES:
            known.setdefault(
                tuple(sorted(skin.cells[cell, side].tolist())), inherited[cell]
            )
    cells = np.delete(skin.cells, slivers, axis=0)
    facets, owner, local = boundary_facets(cells)
    tags = np.array([known[tuple(sorted(facet))] for facet in facets.tolist()])
    logger.debug("dropped %d flat tetrahedra", len(slivers))
    return _Skin(cells, facets, owner, local, tags)


def _on_faces(points: Floats, nodes: Ints, tags: Ints, target: Target) -> Floats:
    """Move ``nodes`` (k, 3) of boundary triangles onto all CAD faces (and seams) they touch.

    By alternating projections; nodes whose faces do not meet nearby (wrong tags) stay in place.
    """
    node, place = places_of(nodes, tags, target)
    moved = points.copy()
    places = np.bincount(node, minlength=len(points))
    for sharing in range(1, int(places.max()) + 1):
        of_group = places[node] == sharing
        alternate(
            moved,
            node[of_group],
            place[of_group],
            target,
            1 if sharing == 1 else ROUNDS,
        )
    far = np.linalg.norm(moved - points, axis=1) > target.size
    if far.any():
        what = "%d boundary nodes have faces that do not meet near them; left in place"
        logger.warning(what, far.sum())
        moved[far] = points[far]
    return moved


def places_of(nodes: Ints, tags: Ints, target: Target) -> tuple[Ints, Ints]:
    """Return unique (node, place) pairs of facets (k, j); a seam replaces its nodes' two faces."""
    count = target.faces + len(target.seams)
    pairs = np.unique(nodes.reshape(-1) * count + np.repeat(tags, nodes.shape[1]))
    node = pairs // count
    place = pairs % count
    gone = np.zeros(len(pairs), dtype=bool)
    seamed = [pairs]
    for k, seam in enumerate(target.seams):
        on_both = np.intersect1d(node[place == seam[0]], node[place == seam[1]])
        gone |= np.isin(place, seam) & np.isin(node, on_both)
        seamed.append(on_both * count + target.faces + k)
    seamed[0] = pairs[~gone]
    pairs = np.concatenate(seamed)
    return pairs // count, pairs % count


def _balance(nodes: Floats, facets: Ints, tags: Ints, target: Target) -> Floats:
    """Shift the midpoints of curved sides so that the mean gap to the CAD surface vanishes.

    A parabola through three points of an arc of angle θ lies inside it, with an area θ⁴/480 too
    small. The mean gap of each side is set to zero first, then that of each triangle.
    """
    nodes = _balance_sides(nodes, facets, tags, target)
    at, weights = quadrature(4, triangle=True)
    gaps = np.zeros((len(facets), 3))
    for values, weight in zip(shapes(at)[0].T, weights, strict=True):
        on_facet = np.einsum("n,knj->kj", values, nodes[facets])
        triples = np.repeat(np.arange(len(facets))[:, None], 3, axis=1)
        gaps += 2 * weight * (_on_faces(on_facet, triples, tags, target) - on_facet)
    mids = facets[:, 3:].reshape(-1)
    per_mid = np.repeat(gaps, 3, axis=0)
    pairs = np.unique(mids * (tags.max() + 1) + np.repeat(tags, 3)) // (tags.max() + 1)
    one_face = (np.bincount(pairs, minlength=len(nodes)) == 1)[:, None]
    shift = np.stack([np.bincount(mids, gap, len(nodes)) for gap in per_mid.T], axis=1)
    sharing = np.bincount(mids, minlength=len(nodes)).clip(min=1)[:, None]
    return nodes + np.where(one_face, shift / sharing, 0)


def _balance_sides(nodes: Floats, facets: Ints, tags: Ints, target: Target) -> Floats:
    ends = facets[:, SIDES].reshape(-1, 2)
    mids = facets[:, 3:]
    node, first = np.unique(mids, return_index=True)
    start = nodes[ends[first, 0]]
    stop = nodes[ends[first, 1]]
    middle = nodes[node]
    new = np.searchsorted(node, mids)
    gap = np.zeros_like(middle)
    for s in (
        0.5 - 0.15**0.5,
        0.5 + 0.15**0.5,
    ):  # three Gauss points; the middle gap is zero
        on_side = (
            (1 - s) * (1 - 2 * s) * start
            + s * (2 * s - 1) * stop
            + 4 * s * (1 - s) * middle
        )
        gap += (_on_faces(on_side, new, tags, target) - on_side) * 5 / 18
    balanced = nodes.copy()
    balanced[node] += 1.5 * gap
    return balanced


def alternate(
    points: Floats, node: Ints, place: Ints, target: Target, rounds: int
) -> None:
    """Project nodes on each of their places in turn, until they stop moving.

    Parameters
    ----------
    points
        Nodes (n, 3), m, moved in place.
    node, place
        Pairs (k,) of a node and a face or edge on which it lies.
    target
        Surface to project on.
    rounds
        Largest number of rounds; more converge closer to the faces' intersection.
    """
    for _ in range(rounds):
        steps = np.zeros(len(node))
        for number in np.unique(place):
            here = place == number
            closest = target.project(int(number), points[node[here]])
            steps[here] = np.linalg.norm(closest - points[node[here]], axis=1)
            points[node[here]] = closest
        moving = np.isin(node, node[steps >= 1e-9 * target.size])
        node = node[moving]
        place = place[moving]
        if not len(node):
            break


def _pull_back(
    nodes: Floats, cells: Ints, original: Floats, edges: Ints
) -> tuple[Floats, int]:
    """Straighten elements inverted by snapping, then move them towards the mesher's positions."""
    nodes = nodes.copy()
    corners = len(original)
    least = jacobian_range(nodes[cells])
    pulled = np.zeros(len(cells), dtype=bool)
    for attempt in range(8):
        inverted = least < FLATTEST
        if not inverted.any():
            break
        pulled |= inverted
        if attempt > 1:  # straight sides did not suffice: move corners halfway back
            touched = np.unique(cells[inverted, :4])
            nodes[touched] = (nodes[touched] + original[touched]) / 2
            inverted = np.isin(cells[:, :4], touched).any(axis=1)
        mids = np.unique(cells[inverted, 4:])
        middle = nodes[edges[mids - corners]].mean(axis=1)
        nodes[mids] = middle if attempt else (nodes[mids] + middle) / 2
        least = jacobian_range(nodes[cells])
    if (least <= 0).any():
        logger.warning("%d elements stay inverted after snapping", (least <= 0).sum())
    return nodes, int(pulled.sum())

"""CAD face of each boundary triangle: the nearest one, as the mesher keeps no tags."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.mesh import SIDES, Floats, Ints

if TYPE_CHECKING:
    from stiffscope.cad.part import Surface


def tag_facets(surface: Surface, corners: Floats, reach: float) -> Ints:
    """Return the CAD face (k,) of each boundary triangle.

    The face with the smallest ``distance + reach (1 - cos angle)`` is chosen, so that a triangle at
    a sharp edge belongs to the parallel face.

    Parameters
    ----------
    surface : CAD surface with a face number for each of its triangles.
    corners : (k, 3, 3) corner positions of the boundary triangles, outward, metres.
    reach : length (m) equivalent to a right angle between the normals; about half an element.
    """
    centres = corners.mean(axis=1)
    normals = _unit_normals(corners)
    best = np.full(len(centres), np.inf)
    tags = np.zeros(len(centres), dtype=np.int64)
    for face in np.unique(surface.face_of_triangle):
        triangles = surface.vertices[
            surface.triangles[surface.face_of_triangle == face]
        ]
        low = triangles.min(axis=(0, 1)) - 2 * reach
        high = triangles.max(axis=(0, 1)) + 2 * reach
        near = np.flatnonzero(((centres >= low) & (centres <= high)).all(axis=1))
        if not len(near):
            continue
        distance, nearest = _nearest_triangle(centres[near], triangles)
        cosine = np.einsum("ij,ij->i", normals[near], _unit_normals(triangles)[nearest])
        score = distance + reach * (1 - cosine)
        better = score < best[near]
        best[near[better]] = score[better]
        tags[near[better]] = face
    return tags


def _unit_normals(triangles: Floats) -> Floats:
    normals = np.cross(
        triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    )
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


def _nearest_triangle(points: Floats, triangles: Floats) -> tuple[Floats, Ints]:
    """Return distance (n,) and index (n,) of the nearest triangle, in chunks of bounded memory."""
    distance = np.empty(len(points))
    nearest = np.empty(len(points), dtype=np.int64)
    step = max(1, 200_000 // len(triangles))
    for start in range(0, len(points), step):
        squared = _squared_distances(points[start : start + step], triangles)
        least = squared.argmin(axis=1)
        nearest[start : start + step] = least
        distance[start : start + step] = np.sqrt(squared[np.arange(len(least)), least])
    return distance, nearest


def _squared_distances(points: Floats, triangles: Floats) -> Floats:
    """Return squared distances (n, t) to three sides, or to the plane if the foot is inside."""
    result = np.full((len(points), len(triangles)), np.inf)
    normals = _unit_normals(triangles)
    inside = np.ones(result.shape, dtype=bool)
    for k in range(3):
        start = triangles[:, k]
        side = triangles[:, (k + 1) % 3] - start
        offset = points[:, None, :] - start  # (n, t, 3)
        along = np.einsum("ntj,tj->nt", offset, side) / np.maximum(
            np.einsum("tj,tj->t", side, side), 1e-300
        )
        gap = offset - np.clip(along, 0, 1)[..., None] * side
        np.minimum(result, np.einsum("ntj,ntj->nt", gap, gap), out=result)
        inside &= np.einsum("ntj,tj->nt", offset, np.cross(normals, side)) >= 0
    height = np.einsum("ntj,tj->nt", points[:, None, :] - triangles[:, 0], normals)
    return np.where(inside, np.minimum(result, height**2), result)


def smooth_tags(facets: Ints, tags: Ints) -> Ints:
    """Remove islands of tags: a triangle takes the tag that two of its neighbours share."""
    order = np.lexsort(np.sort(facets[:, SIDES].reshape(-1, 2), axis=1).T[::-1])
    neighbours = np.empty(
        len(order), dtype=np.int64
    )  # each side of a closed surface occurs twice
    neighbours[order[0::2]], neighbours[order[1::2]] = (
        order[1::2] // 3,
        order[0::2] // 3,
    )
    neighbours = neighbours.reshape(-1, 3)
    for _ in range(3):
        around = tags[neighbours]
        for a, b in ((0, 1), (1, 2), (0, 2)):
            lonely = (around[:, a] == around[:, b]) & ~(around == tags[:, None]).any(
                axis=1
            )
            tags = np.where(lonely, around[:, a], tags)
    return tags

"""Surfaces and lines of a quadratic mesh for pyvista."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv

if TYPE_CHECKING:
    from stiffscope.fea.mesh import TetMesh
    from stiffscope.runtime.types import Array

SPLIT = np.array(
    [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]
)  # 6-node triangle as 4 flat ones
SHARP = 35.0  # degrees; edges above this angle are drawn


def sharp_edges(shape: pv.PolyData) -> pv.PolyData:
    """Return the edges above `SHARP`."""
    others: Any = dict.fromkeys(
        ("boundary_edges", "manifold_edges", "non_manifold_edges"), False
    )
    return shape.extract_feature_edges(SHARP, **others)


def surface(
    mesh: TetMesh, points: Array, chosen: Any = slice(None), *, split: bool = True
) -> pv.PolyData:
    """Return the boundary or chosen triangles, each as four flat ones, or one without mid nodes."""
    facets = mesh.facets[chosen]
    triangles = facets[:, SPLIT].reshape(-1, 3) if split else facets[:, :3]
    return pv.PolyData.from_regular_faces(points, triangles)


def bulge(mesh: TetMesh) -> float:
    """Return the largest distance of a boundary mid node from the middle of its side, m."""
    ends = mesh.points[mesh.facets[:, [[0, 1], [1, 2], [2, 0]]]].mean(axis=2)
    return float(np.linalg.norm(mesh.points[mesh.facets[:, 3:]] - ends, axis=2).max())


def sides(mesh: TetMesh, points: Array) -> pv.PolyData:
    """Return the curved sides of the boundary's triangles."""
    halves = mesh.facets[:, [[0, 3], [3, 1], [1, 4], [4, 2], [2, 5], [5, 0]]].reshape(
        -1, 2
    )
    halves = np.unique(np.sort(halves, axis=1), axis=0)
    return pv.PolyData(points, lines=np.insert(halves, 0, 2, axis=1).ravel())


def outline(mesh: TetMesh, points: Array) -> pv.PolyData:
    """Return the sharp edges between CAD faces, displaced with the points."""
    halves = mesh.facets[:, [[0, 3], [3, 1], [1, 4], [4, 2], [2, 5], [5, 0]]].reshape(
        -1, 2
    )
    owner = np.repeat(np.arange(len(mesh.facets)), 6)
    order = np.lexsort(np.sort(halves, axis=1).T)
    first = order[0::2]
    second = order[1::2]  # in a closed surface every half side occurs twice
    corners = mesh.points[mesh.facets[:, :3]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", normals[owner[first]], normals[owner[second]])
    between = mesh.facet_face[owner[first]] != mesh.facet_face[owner[second]]
    sharp = halves[first[between & (cosine < np.cos(np.radians(30)))]]
    return pv.PolyData(points, lines=np.insert(sharp, 0, 2, axis=1).ravel())

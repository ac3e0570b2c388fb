"""Shape functions of the quadratic tetrahedron, from scikit-fem's element and quadrature rules."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats, Ints


# The ten nodes on the reference tetrahedron.
NODES = np.array(
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0], [0, 0, 0.5],
     [0.5, 0, 0.5], [0, 0.5, 0.5]]
)  # fmt: skip


@lru_cache(maxsize=8)
def quadrature(order: int) -> tuple[Floats, Floats]:
    """Return (q, 3) points and (q,) weights on the reference tetrahedron (volume 1/6)."""
    from skfem.quadrature import get_quadrature
    from skfem.refdom import RefTet

    points, weights = get_quadrature(RefTet, order)
    return points.T.copy(), weights


def shape_values(points: Floats) -> tuple[Floats, Floats]:
    """Return (q, 10) values and (q, 10, 3) reference gradients of the shape functions at (q, 3) points."""
    from skfem import ElementTetP2

    element = ElementTetP2()
    pairs = [element.lbasis(points.T, node) for node in range(10)]
    return np.stack([value for value, _ in pairs], axis=1), np.stack([slope.T for _, slope in pairs], axis=1)


@lru_cache(maxsize=2)
def facet_rule(order: int = 4) -> tuple[Floats, Floats]:
    """Return (q, 2) points and (q,) weights on the reference triangle (area 1/2)."""
    from skfem.quadrature import get_quadrature
    from skfem.refdom import RefTri

    points, weights = get_quadrature(RefTri, order)
    return points.T.copy(), weights


def facet_values(points: Floats) -> Floats:
    """Return (q, 6) shape functions of the quadratic triangle (3 corners, then mids 01, 12, 20) at (q, 2)."""
    b = np.column_stack([1 - points.sum(axis=1), points])
    return np.hstack([b * (2 * b - 1), 4 * b * b[:, [1, 2, 0]]])


def facet_slopes(points: Floats) -> Floats:
    """Return (q, 6, 2) reference gradients of the shape functions of the quadratic triangle."""
    b = np.column_stack([1 - points.sum(axis=1), points])
    db = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    nxt = [1, 2, 0]
    corner = (4 * b - 1)[:, :, None] * db
    mid = 4 * (b[:, :, None] * db[nxt] + b[:, nxt, None] * db)
    return np.concatenate([corner, mid], axis=1)


def jacobians(corners: Floats, slopes: Floats) -> Floats:
    """Return (m, q, 3, 3) dx_i/dξ_j of elements with nodes (m, 10, 3) at points with slopes (q, 10, 3)."""
    m, q = len(corners), len(slopes)
    table = slopes.transpose(1, 0, 2).reshape(10, q * 3)  # (10, 3q)
    return (corners.transpose(0, 2, 1).reshape(-1, 10) @ table).reshape(m, 3, q, 3).transpose(0, 2, 1, 3)


def determinants(matrices: Floats) -> Floats:
    """Return the determinants of (..., 3, 3) matrices (much faster than LAPACK's on many small ones)."""
    a, b, c = (matrices[..., 0, :], matrices[..., 1, :], matrices[..., 2, :])
    return np.einsum("...i,...i->...", a, np.cross(b, c))


def inverses(matrices: Floats, determinant: Floats) -> Floats:
    """Return the inverses of (..., 3, 3) matrices with known determinants."""
    a, b, c = (matrices[..., :, k] for k in range(3))
    rows = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-2)
    return rows / determinant[..., None, None]


def jacobian_range(corners: Floats) -> Floats:
    """Return (m,) the least Jacobian of each quadratic element over its mean size; negative is inverted."""
    sample = np.vstack([NODES, quadrature(4)[0]])
    values = determinants(jacobians(corners, shape_values(sample)[1]))
    edges = corners[:, 1:4] - corners[:, :1]
    mean = np.abs(values).mean(axis=1) + 1e-6 * np.linalg.norm(edges, axis=2).prod(axis=1)
    return values.min(axis=1) / mean


def curved(corners: Floats) -> np.ndarray:
    """Return (m,) whether the sides of elements with nodes (m, 10, 3) are curved."""
    from stiffscope.fea.mesh import EDGES

    ends = corners[:, EDGES]  # (m, 6, 2, 3)
    offset = np.linalg.norm(corners[:, 4:] - ends.mean(axis=2), axis=2)
    length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    return (offset > 1e-8 * length).any(axis=1)


def evaluate(corners: Floats, points: Floats) -> Floats:
    """Return (m, 3) the positions of one reference point (m, 3) in each element with nodes (m, 10, 3)."""
    rest = 1 - points.sum(axis=1, keepdims=True)
    bary = np.hstack([rest, points])  # (m, 4)
    pairs = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
    weights = np.hstack([bary * (2 * bary - 1), 4 * bary[:, pairs[:, 0]] * bary[:, pairs[:, 1]]])
    return np.einsum("mn,mni->mi", weights, corners)


def area_elements(corners: Floats, order: int = 4) -> Floats:
    """Return (k, q) the area (m²) that each point of ``facet_rule`` stands for in curved triangles (k, 6, 3)."""
    at, weights = facet_rule(order)
    tangents = np.einsum("qnd,kni->kqdi", facet_slopes(at), corners)
    return np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=2) * weights


def centroid(corners: Floats) -> Floats:
    """Return (3,) the centre (m) of the area of curved triangles (k, 6, 3)."""
    area = area_elements(corners)
    return np.einsum("kq,qn,kni->i", area, facet_values(facet_rule()[0]), corners) / area.sum()


def volume(points: Floats, cells: Ints) -> float:
    """Return the volume (m³) of the curved mesh, exactly."""
    at, weights = quadrature(3)
    return float((determinants(jacobians(points[cells], shape_values(at)[1])) @ weights).sum())

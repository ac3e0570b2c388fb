"""Volumes, areas and Jacobians of curved elements from their nodes, during meshing.

With scikit-fem's shape functions and quadrature; finished meshes use its bases (``spaces``).
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from skfem import ElementTetP2, ElementTriP2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet, RefTri

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats, Ints


@lru_cache(maxsize=8)
def quadrature(order: int, *, triangle: bool = False) -> tuple[Floats, Floats]:
    """Return points (3, q) or (2, q) and weights (q,) on the reference tetrahedron or triangle."""
    return get_quadrature(RefTri if triangle else RefTet, order)


def shapes(points: Floats) -> tuple[Floats, Floats]:
    """Return values (n, q) and gradients (n, d, q) of a quadratic tetrahedron or triangle.

    Parameters
    ----------
    points : (d, q) reference coordinates; d = 3: tetrahedron (n = 10), d = 2: triangle (n = 6).
    """
    element, count = (ElementTetP2(), 10) if len(points) == 3 else (ElementTriP2(), 6)
    values, gradients = zip(
        *(element.lbasis(points, node) for node in range(count)), strict=True
    )
    return np.stack(values), np.stack(gradients)


def jacobian_determinants(corners: Floats, at: Floats) -> Floats:
    """Return Jacobian determinants (m, q), m³, of elements (m, 10, 3) at points (3, q)."""
    a, b, c = np.einsum("mni,ndq->dmqi", corners, shapes(at)[1], optimize=True)
    return np.einsum("mqi,mqi->mq", a, np.cross(b, c))


def jacobian_range(corners: Floats) -> Floats:
    """Return the least Jacobian (m,) of elements (m, 10, 3) over its mean; negative: inverted."""
    values = jacobian_determinants(
        corners, np.hstack([ElementTetP2.doflocs.T, quadrature(4)[0]])
    )
    edges = corners[:, 1:4] - corners[:, :1]
    mean = np.abs(values).mean(axis=1) + 1e-6 * np.linalg.norm(edges, axis=2).prod(
        axis=1
    )
    return values.min(axis=1) / mean


def volume(points: Floats, cells: Ints) -> float:
    """Return the exact volume (m³) of a curved mesh."""
    at, weights = quadrature(3)
    return float((jacobian_determinants(points[cells], at) @ weights).sum())


def area_elements(corners: Floats) -> Floats:
    """Return the area (k, q), m², per quadrature point of curved triangles (k, 6, 3)."""
    at, weights = quadrature(4, triangle=True)
    a, b = np.einsum("kni,ndq->dkqi", corners, shapes(at)[1], optimize=True)
    return np.linalg.norm(np.cross(a, b), axis=2) * weights


def centroid(corners: Floats) -> Floats:
    """Return the area centroid (3,), m, of curved triangles (k, 6, 3)."""
    area = area_elements(corners)
    values = shapes(quadrature(4, triangle=True)[0])[0]
    return np.einsum("kq,nq,kni->i", area, values, corners) / area.sum()

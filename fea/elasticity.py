"""Linear elasticity on quadratic tetrahedra: K = ∫ Bᵀ D B, any anisotropy, in batches.

Reference element and quadrature are scikit-fem's; the contraction over all elements at once is numpy's, because
the same form written as a scikit-fem bilinear form over 30 x 30 components takes about ten times as long.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.shape import curved, determinants, inverses, jacobians, quadrature, shape_values

if TYPE_CHECKING:
    from collections.abc import Iterator

    from scipy.sparse import csr_array

    from stiffscope.fea.mesh import Floats, Ints, TetMesh

# Voigt index of the strain component (i, j), in the order xx, yy, zz, yz, xz, xy.
VOIGT = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
AFFINE_ORDER, CURVED_ORDER = 2, 4
CHUNK = 4096


def isotropic(youngs_modulus: float, shear_modulus: float) -> Floats:
    """Return the (6, 6) elasticity (Pa) of an isotropic solid, Voigt order, engineering shear strains."""
    lame = shear_modulus * (youngs_modulus - 2 * shear_modulus) / (3 * shear_modulus - youngs_modulus)
    stiffness = np.zeros((6, 6))
    stiffness[:3, :3] = lame
    stiffness[range(6), range(6)] += [2 * shear_modulus] * 3 + [shear_modulus] * 3
    return stiffness


def element_groups(points: Floats, cells: Ints) -> Iterator[tuple[Ints, int]]:
    """Yield (elements, quadrature order) in chunks; only elements with curved sides need the higher order."""
    bent = curved(points[cells])
    for mask, order in ((~bent, AFFINE_ORDER), (bent, CURVED_ORDER)):
        chosen = np.flatnonzero(mask)
        for start in range(0, len(chosen), CHUNK):
            yield chosen[start : start + CHUNK], order


def gradients(corners: Floats, at: Floats) -> tuple[Floats, Floats]:
    """Return (m, q, 10, 3) gradients of the shape functions (1/m) and (m, q) Jacobians (m³)."""
    slopes = shape_values(at)[1]  # (q, 10, 3)
    jacobian = jacobians(corners, slopes)
    size = determinants(jacobian)
    return slopes[None] @ inverses(jacobian, size), size


def element_stiffness(corners: Floats, elasticity: Floats, order: int) -> Floats:
    """Return (m, 10, 3, 10, 3) the stiffness of each element with nodes (m, 10, 3), N/m."""
    at, weights = quadrature(order)
    slope, size = gradients(corners, at)
    m, q = size.shape
    slope = slope.reshape(m, q, 30)
    weighted = slope * (size * weights)[..., None]
    pairs = weighted.transpose(0, 2, 1) @ slope  # (m, 30, 30): ∫ ∂_k N_a ∂_l N_b
    pairs = pairs.reshape(m, 10, 3, 10, 3).transpose(0, 1, 3, 2, 4).reshape(m, 100, 9)
    # C[i, k, j, l] with strain components (i, k) and (j, l): rows (k, l), columns (i, j)
    tensor = elasticity[VOIGT[:, :, None, None], VOIGT[None, None]]
    blocks = pairs @ tensor.transpose(1, 3, 0, 2).reshape(9, 9)
    return blocks.reshape(m, 10, 10, 3, 3).transpose(0, 1, 3, 2, 4)


def assemble(mesh: TetMesh, elasticity: Floats) -> csr_array:
    """Return the (3n, 3n) stiffness (N/m), symmetric, unsupported; dof 3k + i is node k along axis i.

    The pattern is found once per pair of nodes, not per pair of degrees of freedom.
    """
    from scipy.sparse import bsr_array

    cells, count = mesh.cells, len(mesh.points)
    keys = (cells[:, :, None] * count + cells[:, None, :]).reshape(-1)
    unique, slot = np.unique(keys, return_inverse=True)
    slot = slot.reshape(-1, 100)
    blocks = np.zeros((9, len(unique)))
    for chosen, order in element_groups(mesh.points, cells):
        stiffness = element_stiffness(mesh.points[cells[chosen]], elasticity, order)
        local = stiffness.transpose(2, 4, 0, 1, 3).reshape(9, -1)
        target = slot[chosen].reshape(-1)
        for component in range(9):
            np.add.at(blocks[component], target, local[component])
    index = np.int32 if 9 * len(unique) < np.iinfo(np.int32).max else np.int64
    rows = np.searchsorted(unique // count, np.arange(count + 1)).astype(index)
    data = np.ascontiguousarray(blocks.T).reshape(-1, 3, 3)
    return bsr_array((data, (unique % count).astype(index), rows), shape=(3 * count, 3 * count)).tocsr()


def strains(corners: Floats, displacement: Floats, at: Floats) -> Floats:
    """Return (m, q, loads, 6) Voigt strains (engineering shears) of nodal displacements (m, 10, 3, loads)."""
    slope, _ = gradients(corners, at)
    m, q = slope.shape[:2]
    loads = displacement.shape[-1]
    slope = slope.transpose(0, 1, 3, 2).reshape(m, q * 3, 10)
    gradient = (slope @ displacement.reshape(m, 10, 3 * loads)).reshape(m, q, 3, 3, loads)  # [k, i]
    g = gradient.transpose(0, 1, 4, 2, 3)
    parts = [g[..., 0, 0], g[..., 1, 1], g[..., 2, 2]]
    parts += [g[..., 1, 2] + g[..., 2, 1], g[..., 0, 2] + g[..., 2, 0], g[..., 0, 1] + g[..., 1, 0]]
    return np.stack(parts, axis=-1)


def von_mises(stress: Floats) -> Floats:
    """Return (...,) the von Mises stress (Pa) of (..., 6) Voigt stresses."""
    x, y, z, yz, xz, xy = np.moveaxis(stress, -1, 0)
    return np.sqrt(((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) / 2 + 3 * (yz**2 + xz**2 + xy**2))

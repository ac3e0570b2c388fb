"""Anisotropic linear elasticity on quadratic tetrahedra: stiffness K = ∫ Bᵀ D B, nodal stresses."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# (scikit-fem declares its types loosely)

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import bsr_array, csr_array
from skfem import ElementTetP2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from stiffscope.fea.spaces import integrate_cells, sum_matrix, tabulate

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.fea.mesh import Floats, Ints, TetMesh

# Voigt index of the strain component (i, j), in the order xx, yy, zz, yz, xz, xy.
VOIGT = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
STRAIGHT_ORDER = 2
CURVED_ORDER = 4  # quadrature; exact on straight sides
CHUNK = 2048  # elements per chunk


def tensor(elasticity: Floats) -> Floats:
    """Return the (3, 3, 3, 3) elasticity tensor C_ikjl (Pa) of a (6, 6) matrix in Voigt order."""
    return elasticity[VOIGT[:, :, None, None], VOIGT[None, None]]


def assemble(mesh: TetMesh, elasticity: Floats) -> csr_array:
    """Return the stiffness matrix of a mesh without supports.

    Element matrices A_kl = ∫ ∂_k v ∂_l u give the blocks K_ij = C_ikjl A_kl: the matrix of
    scikit-fem's vector form, in a third of the time of six scalar forms.

    Parameters
    ----------
    mesh : quadratic tetrahedra with n nodes.
    elasticity : (6, 6) Pa, Voigt order xx, yy, zz, yz, xz, xy.

    Returns
    -------
    (3n, 3n) N/m, symmetric; degree of freedom 3k + i is node k along axis i.
    """
    count = len(mesh.points)
    law = tensor(elasticity).transpose(0, 2, 1, 3).reshape(9, 9)  # [(i, j), (k, l)]
    pairs, place = np.unique(
        mesh.cells[:, :, None] * count + mesh.cells[:, None, :], return_inverse=True
    )
    place = place.reshape(len(mesh.cells), 100)
    blocks = np.zeros((len(pairs), 9))
    for elements, slopes, weights in _slopes(mesh, CURVED_ORDER):
        c, q = weights.shape
        flat = slopes.reshape(c, q, 30)
        products = np.swapaxes(flat, 1, 2) @ (
            flat * weights[:, :, None]
        )  # (c, 30, 30), [(k, a), (l, b)]
        products = (
            products.reshape(c, 3, 10, 3, 10)
            .transpose(0, 2, 4, 1, 3)
            .reshape(c * 100, 9)
        )
        mine, at = np.unique(place[elements], return_inverse=True)
        blocks[mine] += sum_matrix(at, len(mine)) @ products
    starts = np.searchsorted(pairs, np.arange(count + 1) * count)
    rows = (blocks @ law.T).reshape(-1, 3, 3), pairs % count, starts
    return bsr_array(rows, shape=(3 * count, 3 * count)).tocsr()


def _slopes(mesh: TetMesh, curved: int) -> Iterator[tuple[Ints, Floats, Floats]]:
    """Yield elements (c,), gradients (c, q, 3, 10) in 1/m and weights (c, q) in m³, in chunks."""
    rules = tuple(get_quadrature(RefTet, order) for order in (STRAIGHT_ORDER, curved))
    tables = [tabulate(at)[1][..., :10] for at, _ in rules]
    for some, rule, inverse, weights in integrate_cells(mesh, rules, CHUNK):
        yield (
            some,
            np.einsum("rkcq,rqa->cqka", inverse, tables[rule], optimize=True),
            weights,
        )


def nodal_stresses(mesh: TetMesh, motion: Floats, elasticity: Floats) -> Floats:
    """Return stresses (nodes, loads, 6), Pa, extrapolated from four Gauss points and averaged.

    Evaluated at Gauss points, as curved elements may be degenerate at a node.

    Parameters
    ----------
    motion : (3 nodes, loads) displacements, m.
    """
    count = len(mesh.points)
    loads = motion.shape[1]
    law = elasticity[:, VOIGT].reshape(6, 9)  # shear strains are ∂_k u_i + ∂_i u_k
    total = np.zeros((count, 6 * loads))
    points = get_quadrature(RefTet, STRAIGHT_ORDER)[0], ElementTetP2.doflocs.T
    extrapolation = np.linalg.solve(
        *(np.vstack([1 - x.sum(axis=0), x]) for x in points)
    )  # (4, 10)
    for elements, slopes, _ in _slopes(mesh, STRAIGHT_ORDER):
        cells = mesh.cells[elements]
        gradient = (
            slopes @ motion.reshape(count, 3 * loads)[cells][:, None]
        )  # (c, 4, 3, 3 loads)
        gradient = extrapolation.T @ gradient.reshape(len(cells), 4, -1)
        stress = (law @ gradient.reshape(-1, 9, loads)).reshape(cells.size, 6 * loads)
        total += sum_matrix(cells, count) @ stress
    mean = total / np.bincount(mesh.cells.reshape(-1), minlength=count)[:, None]
    return mean.reshape(count, 6, loads).swapaxes(1, 2)


def von_mises(stress: Floats) -> Floats:
    """Return the von Mises stress (...,), Pa, of Voigt stresses (..., 6)."""
    x, y, z, yz, xz, xy = np.moveaxis(stress, -1, 0)
    return np.sqrt(
        ((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) / 2 + 3 * (yz**2 + xz**2 + xy**2)
    )

"""Linear elasticity on quadratic tetrahedra: stiffness K = ∫ Bᵀ D B for any anisotropy, and stresses at the nodes."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# (scikit-fem declares its types loosely)

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import bsr_array, coo_array
from skfem import BilinearForm, ElementTetP2, asm

from stiffscope.fea.spaces import cell_bases

if TYPE_CHECKING:
    from collections.abc import Iterable

    from scipy.sparse import csr_array
    from skfem.assembly.form.coo_data import COOData

    from stiffscope.fea.mesh import Floats, TetMesh

# Voigt index of the strain component (i, j), in the order xx, yy, zz, yz, xz, xy.
VOIGT = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
STRAIGHT_ORDER, CURVED_ORDER = 2, 4  # of quadrature; exact where sides are straight


def isotropic(youngs_modulus: float, shear_modulus: float) -> Floats:
    """Return the (6, 6) elasticity matrix (Pa) of an isotropic solid, Voigt order, engineering shear strains."""
    lame = shear_modulus * (youngs_modulus - 2 * shear_modulus) / (3 * shear_modulus - youngs_modulus)
    stiffness = np.zeros((6, 6))
    stiffness[:3, :3] = lame
    stiffness[range(6), range(6)] += [2 * shear_modulus] * 3 + [shear_modulus] * 3
    return stiffness


def tensor(elasticity: Floats) -> Floats:
    """Return the (3, 3, 3, 3) elasticity tensor C_ikjl (Pa) of a (6, 6) matrix in Voigt order."""
    return elasticity[VOIGT[:, :, None, None], VOIGT[None, None]]


def assemble(mesh: TetMesh, elasticity: Floats) -> csr_array:
    """Return the stiffness matrix of a mesh without supports.

    Six scalar forms A_kl = ∫ ∂_k v ∂_l u are combined into the blocks K_ij = C_ikjl A_kl: the vector form's matrix in a
    quarter of its time.

    Parameters
    ----------
    mesh : quadratic tetrahedra with n nodes.
    elasticity : (6, 6) Pa, Voigt order xx, yy, zz, yz, xz, xy.

    Returns
    -------
    (3n, 3n) N/m, symmetric; degree of freedom 3k + i is node k along axis i.
    """
    bases = cell_bases(mesh, ElementTetP2(), STRAIGHT_ORDER, CURVED_ORDER)
    law, blocks = tensor(elasticity), np.zeros(())
    for k in range(3):
        for l in range(k, 3):
            form = BilinearForm(lambda u, v, _, k=k, l=l: v.grad[k] * u.grad[l])
            scalar = asm(form, bases, to=_with_zeros)  # A_kl; its transpose is A_lk
            blocks = blocks if blocks.ndim else np.zeros((scalar.nnz, 3, 3))
            for a, b, values in ((k, l, scalar.data), (l, k, scalar.T.tocsr().data))[: 1 + (k != l)]:
                for i, j in np.argwhere(law[:, a, :, b]):
                    blocks[:, i, j] += law[i, a, j, b] * values
    count = 3 * len(mesh.points)
    last = scalar  # pyright: ignore[reportPossiblyUnboundVariable]
    return bsr_array((blocks, last.indices, last.indptr), shape=(count, count)).tocsr()


def _with_zeros(parts: Iterable[COOData]) -> csr_array:
    """Return the sum as a matrix that stores all pairs of nodes of an element, so that all forms have one pattern."""
    total = sum(parts)
    return coo_array((total.data, tuple(total.indices)), shape=total.shape).tocsr()


def nodal_stresses(mesh: TetMesh, motion: Floats, elasticity: Floats) -> Floats:
    """Return (nodes, loads, 6) stresses (Pa): extrapolated from four Gauss points of each element, then averaged.

    A curved element may be flat at a node itself, and its stress there all error.

    Parameters
    ----------
    motion : (3 nodes, loads) displacements, m.
    """
    count, loads = len(mesh.points), motion.shape[1]
    total, law = np.zeros((count, 6 * loads)), elasticity[:, VOIGT]  # shear strains are ∂_k u_i + ∂_i u_k
    for basis in cell_bases(mesh, ElementTetP2(), 2, 2):
        at_points, at_nodes = (np.vstack([1 - x.sum(axis=0), x]) for x in (basis.X, ElementTetP2.doflocs.T))
        extrapolation = np.linalg.solve(at_points, at_nodes)  # (4, 10)
        cells = basis.element_dofs
        for load in range(loads):
            gradient = [basis.interpolate(motion[axis::3, load]).grad for axis in range(3)]
            stress = np.einsum("sik,ikmq,qn->snm", law, gradient, extrapolation, optimize=True)
            for component in range(6):
                weights = stress[component].reshape(-1)
                total[:, 6 * load + component] += np.bincount(cells.reshape(-1), weights, count)
    mean = total / np.bincount(mesh.cells.reshape(-1), minlength=count)[:, None]
    return mean.reshape(count, loads, 6)


def von_mises(stress: Floats) -> Floats:
    """Return (...,) the von Mises stress (Pa) of (..., 6) Voigt stresses."""
    x, y, z, yz, xz, xy = np.moveaxis(stress, -1, 0)
    return np.sqrt(((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) / 2 + 3 * (yz**2 + xz**2 + xy**2))

"""Round parts by other means: a half section in quadrilaterals of order p, graded to all corners."""

import itertools

import numpy as np
from scipy.sparse.linalg import spsolve
from skfem import Basis, BilinearForm, ElementQuadP, ElementVector, MeshQuad
from skfem.helpers import grad


def stretch(
    length,
    radius,
    flange_radius,
    flange_length,
    youngs_modulus,
    shear_modulus,
    order=3,
    cuts=8,
):
    """C11 (m/N) between two rigid ends, to 2e-5; the flanges are inside of the length; m, Pa."""
    ends = [0, flange_length, length - flange_length, length]
    along = np.unique(
        np.concatenate([graded(a, b, cuts) for a, b in itertools.pairwise(ends)])
    )
    across = np.concatenate(
        [graded(0, radius, cuts), graded(radius, flange_radius, cuts)]
    )
    whole = MeshQuad.init_tensor(along, np.unique(across))
    x, r = whole.p[:, whole.t].mean(axis=1)
    flange = (x < ends[1]) | (x > ends[2])
    basis = Basis(
        whole.remove_elements(np.flatnonzero((r > radius) & ~flange)),
        ElementVector(ElementQuadP(order)),
        intorder=2 * order + 2,
    )
    held = basis.get_dofs(lambda x: x[0] < 1e-12).all()
    axis = basis.get_dofs(lambda x: x[1] < 1e-12).all(["u^2"])
    moved = basis.get_dofs(lambda x: x[0] > length - 1e-12)
    return pull(basis, [held, axis], moved, youngs_modulus, shear_modulus)


def press(
    thickness, bore, washer, radius, youngs_modulus, shear_modulus, order=5, cuts=6
):
    """C33 (m/N) of a disc held at its rim, under a rigid washer around its bore, all by their radii; m, Pa."""
    across = np.unique(
        np.concatenate([graded(bore, washer, cuts), graded(washer, radius, cuts)])
    )
    mesh = MeshQuad.init_tensor(graded(0, thickness, cuts), across)
    basis = Basis(mesh, ElementVector(ElementQuadP(order)), intorder=2 * order + 2)
    held = basis.get_dofs(lambda x: x[1] > radius - 1e-12).all()
    moved = basis.get_dofs(
        lambda x: (x[0] > thickness - 1e-12) & (x[1] < washer + 1e-12)
    )
    return pull(basis, [held], moved, youngs_modulus, shear_modulus)


def pull(basis, held, moved, youngs_modulus, shear_modulus):
    """Compliance (m/N) of a side that moves along the axis as one; ``held``: coordinates that do not move."""
    lame = (
        shear_modulus
        * (youngs_modulus - 2 * shear_modulus)
        / (3 * shear_modulus - youngs_modulus)
    )

    @BilinearForm
    def energy(u, v, w):
        r = w.x[1]
        e = grad(u)
        f = grad(v)
        hoop = u[1] / r
        hoop_v = v[1] / r
        traces = (e[0, 0] + e[1, 1] + hoop) * (f[0, 0] + f[1, 1] + hoop_v)
        normal = e[0, 0] * f[0, 0] + e[1, 1] * f[1, 1] + hoop * hoop_v
        shear = (e[0, 1] + e[1, 0]) * (f[0, 1] + f[1, 0])
        return 2 * np.pi * r * (lame * traces + shear_modulus * (2 * normal + shear))

    stiffness = energy.assemble(basis)
    motion = np.zeros(basis.N)
    motion[moved.nodal["u^1"]] = (
        1.0  # the other functions of the order p vanish on a side that moves as one
    )
    free = np.setdiff1d(np.arange(basis.N), np.concatenate([*held, moved.all()]))
    motion[free] = spsolve(
        stiffness[free][:, free].tocsc(), -(stiffness @ motion)[free]
    )
    return 1 / (motion @ (stiffness @ motion))


def graded(a, b, cuts, ratio=0.25):
    """Points from a to b, towards which they crowd."""
    half = np.append(0.0, 0.5 * ratio ** np.arange(cuts, -1, -1.0))
    return a + (b - a) * np.concatenate([half, 1 - half[-2::-1]])

"""Consistent mass of a mesh: ∫ ρ NᵀN dV, the same in all three directions."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportOptionalSubscript=false, reportReturnType=false
# (scikit-fem declares its types loosely)

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array
from skfem import BilinearForm, ElementTetP2

from stiffscope.fea.rigid import rigid_modes
from stiffscope.fea.spaces import ElementTetCubic, cell_bases

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats, TetMesh

STRAIGHT_ORDER = 4
CURVED_ORDER = 7  # quadrature: exact for quadratic functions, if curved too
HIGHER = 1  # additional order for products with cubic functions
_MASS = BilinearForm(lambda u, v, _: u * v)


@dataclass(frozen=True, eq=False)
class Mass:
    """Consistent mass of a mesh in one direction, kg; density in kg/m³."""

    mesh: TetMesh
    density: float

    @cached_property
    def nodes(self) -> csr_array:
        """Mass (n, n) of the quadratic functions."""
        bases = cell_bases(self.mesh, ElementTetP2(), STRAIGHT_ORDER, CURVED_ORDER)
        return csr_array(self.density * sum(_MASS.assemble(basis) for basis in bases))

    @cached_property
    def cubics(self) -> csr_array:
        """Mass (w, n) between the cubic and the quadratic functions."""
        orders = STRAIGHT_ORDER + HIGHER, CURVED_ORDER + HIGHER
        pairs = (
            cell_bases(self.mesh, element, *orders)
            for element in (ElementTetP2(), ElementTetCubic())
        )
        return csr_array(
            self.density
            * sum(_MASS.assemble(u, v) for u, v in zip(*pairs, strict=True))
        )


def times(mass: csr_array, motion: Floats) -> Floats:
    """Multiply displacements (3n, loads) by a one-direction mass (m, n); return (3m, loads)."""
    loads = motion.shape[1]
    return (mass @ motion.reshape(mass.shape[1], 3 * loads)).reshape(-1, loads)


@dataclass(frozen=True)
class RigidMass:
    """Mass (kg), centre of mass (3,) in m, inertia (3, 3) about it in kg m²."""

    mass: float
    centre: Floats
    inertia: Floats


def rigid_mass(points: Floats, mass: csr_array) -> RigidMass:
    """Return the rigid mass properties RᵀMR of nodes (n, 3) with a consistent mass (n, n).

    At the nodes' middle RᵀMR is [[m I, -m S(c)], [m S(c), J]] with the centre of mass c relative to
    it and the inertia J about it.
    """
    middle = points.mean(axis=0)
    modes = rigid_modes(points, middle).reshape(-1, 6)
    matrix = modes.T @ times(mass, modes)
    total = float(np.trace(matrix[:3, :3])) / 3
    skew = matrix[3:, :3] - matrix[3:, :3].T  # 2 m S(c)
    lever = np.array([skew[2, 1], skew[0, 2], skew[1, 0]]) / (2 * total)
    inertia = matrix[3:, 3:] - total * (
        lever @ lever * np.eye(3) - np.outer(lever, lever)
    )
    return RigidMass(total, middle + lever, (inertia + inertia.T) / 2)

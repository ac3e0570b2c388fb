"""Integrals of a solved part's fields that give its derivatives, for any number of parameters.

A mesh velocity V changes the strain energy of two fields, coefficients fixed, by ∫ Σ_cb ∂_b V_c
with Eshelby's tensor Σ_cb = (σ_i : ∇u_j) δ_cb − σ_i,ab ∂_c u_j,a − σ_j,ab ∂_c u_i,a.

References
----------
J. D. Eshelby, The elastic energy-momentum tensor, J. Elasticity 5 (1975) 321.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from stiffscope.fea.elasticity import tensor
from stiffscope.fea.spaces import integrate_cells, sum_matrix, tabulate

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.fea.cubic_space import Cubic
    from stiffscope.fea.mesh import Floats, Ints, TetMesh

STRAIGHT_ORDER = 4
CURVED_ORDER = 6  # quadrature: exact for the energy of cubics on straight sides
CHUNK = 256  # elements per chunk


@dataclass(frozen=True)
class Integrals:
    """Integrals of k displacement fields over a mesh of n nodes with p design velocities.

    Attributes
    ----------
    motion : (count, 3, k) coefficients of all functions, m.
    energy : (p, k, k) derivatives of ∫ σ_i : ∇u_j dV with fixed coefficients.
    gradients : (9, k, 9, k) ∫ ∇u_i ⊗ ∇u_j dV; ∂_b u_a is component 3b + a of the nine.
    forces : (n, 3, k) nodal forces of the stresses.
    displacement : (p, 3, k) derivatives of ∫ u dV with fixed coefficients.
    """

    motion: Floats
    energy: Floats
    gradients: Floats
    forces: Floats
    displacement: Floats


@dataclass(frozen=True)
class _Chunk:
    """Functions of c elements: values (q, 20), slopes (c, q, 3, 20), weights (c, q) in m³."""

    elements: Ints
    nodes: Ints
    values: Floats
    slopes: Floats
    weights: Floats

    def move_integrals(self, velocity: Floats, density: Floats) -> Floats:
        """Return changes (p, m) of the integrals of densities (c, q, m), ∫ s div V, V (n, 3, p)."""
        c, q = self.weights.shape
        flat = (
            velocity[self.nodes]
            .reshape(c, 10, 3, -1)
            .transpose(0, 2, 1, 3)
            .reshape(c, 30, -1)
        )
        weighted = self.slopes[..., :10] * self.weights[:, :, None, None]
        divergence = weighted.reshape(c, q, 30) @ flat  # (c, q, p)
        return divergence.reshape(c * q, -1).T @ density.reshape(c * q, -1)


def _chunks(mesh: TetMesh, space: Cubic) -> Iterator[_Chunk]:
    rules = tuple(
        get_quadrature(RefTet, order) for order in (STRAIGHT_ORDER, CURVED_ORDER)
    )
    tables = [tabulate(at) for at, _ in rules]
    for some, rule, inverse, weights in integrate_cells(mesh, rules, CHUNK):
        values, table = tables[rule]
        slopes = np.einsum("rkcq,rqa->cqka", inverse, table, optimize=True)
        yield _Chunk(some, space.cells[some, :10], values, slopes, weights)


def integrals(
    mesh: TetMesh, space: Cubic, elasticity: Floats, motion: Floats, velocity: Floats
) -> Integrals:
    """Integrate fields over a mesh.

    Parameters
    ----------
    elasticity : (6, 6) Pa.
    motion : (count, 3, k) coefficients of the functions of ``space``.
    velocity : (n, 3, p) design velocities.
    """
    n = len(mesh.points)
    k = motion.shape[2]
    p = velocity.shape[2]
    law = tensor(elasticity).transpose(1, 0, 3, 2).reshape(9, 9)
    energy = np.zeros((p, k, k))
    forces = np.zeros((n, 3, k))
    displacement = np.zeros((p, 3 * k))
    gradients = np.zeros((9 * k, 9 * k))
    for chunk in _chunks(mesh, space):
        c, q = chunk.weights.shape
        signs = space.signs[chunk.elements][:, :, None, None]
        flat = (motion[space.cells[chunk.elements]] * signs).reshape(c, 20, 3 * k)
        slope = (chunk.slopes.reshape(c, 3 * q, 20) @ flat).reshape(
            c, q, 9, k
        )  # ∂_b u_a at 3b + a
        stress = law @ slope
        weighted = stress * chunk.weights[:, :, None, None]
        measured = slope * chunk.weights[:, :, None, None]
        gradients += measured.reshape(c * q, -1).T @ slope.reshape(c * q, -1)
        # work of the stresses on each node's function, point by point
        weighted = weighted.reshape(c, q, 3, 3, k)
        pulls = np.einsum(
            "cqbn,cqbai->cqani", chunk.slopes[..., :10], weighted, optimize=True
        )
        on_nodes = pulls.sum(axis=1).transpose(0, 2, 1, 3).reshape(10 * c, 3 * k)
        forces += (sum_matrix(chunk.nodes, n) @ on_nodes).reshape(n, 3, k)
        if p:
            turned = (
                slope.reshape(c, q, 3, 3, k)
                .transpose(0, 2, 4, 1, 3)
                .reshape(c, 3 * k, 3 * q)
            )
            tilt = (turned @ pulls.reshape(c, 3 * q, 10 * k)).reshape(
                c, 3, k, 10, k
            )  # [.., j, .., i]
            tilt = np.einsum(
                "cxjni,cnxp->pij", tilt, velocity[chunk.nodes], optimize=True
            )
            energy -= tilt + np.swapaxes(tilt, 1, 2)
            work = np.swapaxes(stress, 2, 3) @ slope
            motions = chunk.values @ flat
            energy += chunk.move_integrals(velocity, work).reshape(p, k, k)
            displacement += chunk.move_integrals(velocity, motions.reshape(c, q, 3 * k))
    gradients = gradients.reshape(9, k, 9, k)
    displacement = displacement.reshape(p, 3, k)
    return Integrals(motion, energy, gradients, forces, displacement)


def products(mesh: TetMesh, space: Cubic, fields: Floats, velocity: Floats) -> Floats:
    """Return derivatives (p, b, b) of ∫ u_i · u_j dV, fields (n, 3, b), by velocities (n, 3, p)."""
    b = fields.shape[2]
    p = velocity.shape[2]
    out = np.zeros((p, b, b))
    for chunk in _chunks(mesh, space):
        c, q = chunk.weights.shape
        values = chunk.values[:, :10] @ fields[chunk.nodes].reshape(c, 10, 3 * b)
        values = values.reshape(c, q, 3, b)
        out += chunk.move_integrals(
            velocity, np.swapaxes(values, 2, 3) @ values
        ).reshape(p, b, b)
    return out

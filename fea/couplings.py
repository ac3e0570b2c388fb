"""Supports and loads of a part: rigid (kinematic) and distributed couplings of a face to a point.

Rigid: the face moves as one body, u = R(x) t with the twist t = (v, ω) at the reference point.
Distributed: the wrench w enters as the traction R(x) (RᵀMR)⁻¹ w, with M the face's mass matrix; its
work-conjugate twist is the mean motion (RᵀMR)⁻¹ RᵀM u.
In both cases the compliance is C = Fᵀ A⁻¹ F, with A the stiffness of the unconstrained coordinates.
"""

# pyright: reportReturnType=false
# (scikit-fem declares its types loosely)

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from skfem import ElementTetP2, ElementVector, LinearForm
from skfem.helpers import dot

from stiffscope.errors import InputError
from stiffscope.fea.rigid import rigid_modes
from stiffscope.fea.solvers import Solve, factorize_matrix
from stiffscope.fea.spaces import face_basis

if TYPE_CHECKING:
    from scipy.sparse import csr_array
    from skfem.element import ElementH1

    from stiffscope.fea.mesh import Floats, Ints, TetMesh

ORDER = 4  # of quadrature on faces
_WORK = LinearForm(lambda v, w: dot(w["mode"], v))


@dataclass(frozen=True)
class Coupling:
    """A loaded interface: its CAD faces, its reference point (m), and "rigid" or "distributed"."""

    faces: frozenset[int]
    reference_point: Floats
    kind: str


@dataclass(frozen=True)
class Supports:
    """Nodal displacements from unconstrained coordinates: free nodes and rigid-coupling twists.

    Attributes
    ----------
    free : (f,) unconstrained nodes.
    tied, clamped : (t,) nodes on rigid couplings, and clamped nodes.
    tie : (3t, 6r) displacements of tied nodes per twist component of the r rigid couplings.
    """

    nodes: int
    free: Ints
    tied: Ints
    clamped: Ints
    tie: Floats

    @property
    def free_dofs(self) -> Ints:
        """Degrees of freedom of the free nodes."""
        return dofs_of(self.free)

    def expand(self, coordinates: Floats) -> Floats:
        """Return (3n, loads) nodal displacements from (3f + 6r, loads) coordinates."""
        split = 3 * len(self.free)
        motion = np.zeros((3 * self.nodes, coordinates.shape[1]))
        motion[self.free_dofs] = coordinates[:split]
        motion[dofs_of(self.tied)] = self.tie @ coordinates[split:]
        return motion

    def restrict(self, forces: Floats) -> Floats:
        """Return (3f + 6r, loads) generalized from (3n, loads) nodal forces; expand's transpose."""
        return np.vstack(
            [forces[self.free_dofs], self.tie.T @ forces[dofs_of(self.tied)]]
        )


def dofs_of(nodes: Ints) -> Ints:
    """Return the three degrees of freedom of each node, in order."""
    return (3 * nodes[:, None] + np.arange(3)).reshape(-1)


def support(mesh: TetMesh, clamped: Ints, couplings: tuple[Coupling, ...]) -> Supports:
    """Return the constraints of clamped nodes and rigid couplings.

    Parameters
    ----------
    mesh
        Mesh with n nodes.
    clamped
        Indices of the clamped nodes.
    couplings
        Loaded interfaces; distributed ones constrain nothing.

    Raises
    ------
    InputError : if a rigid face shares nodes with the clamp or with another rigid face.
    """
    count = len(mesh.points)
    rigid = [coupling for coupling in couplings if coupling.kind == "rigid"]
    tie = np.zeros((count, 3, 6 * len(rigid)))
    is_tied = np.zeros(count, dtype=bool)
    is_free = np.ones(count, dtype=bool)
    for slot, coupling in enumerate(rigid):
        nodes = mesh.nodes_of(coupling.faces)
        if is_tied[nodes].any() or np.isin(nodes, clamped).any():
            raise InputError(
                "interfaces: a rigid face touches the clamp or another rigid face; choose them apart"
            )
        is_tied[nodes] = True
        tie[nodes, :, 6 * slot : 6 * slot + 6] = rigid_modes(
            mesh.points[nodes], coupling.reference_point
        )
    is_free[clamped] = False
    free = np.flatnonzero(is_free & ~is_tied)
    tied = np.flatnonzero(is_tied)
    return Supports(
        count, free, tied, clamped, tie[tied].reshape(3 * len(tied), tie.shape[2])
    )


def factorize(stiffness: csr_array, supports: Supports) -> Solve:
    """Return a solver for the coordinates of ``supports``; twists by a Schur complement."""
    free = supports.free_dofs
    rows = stiffness[free]
    solve = factorize_matrix(rows[:, free])
    if not supports.tie.shape[1]:
        return solve
    tied = dofs_of(supports.tied)
    coupling = rows[:, tied] @ supports.tie
    inner = solve(coupling)
    condensed = (
        supports.tie.T @ (stiffness[tied][:, tied] @ supports.tie) - coupling.T @ inner
    )
    condensed = (condensed + condensed.T) / 2

    def solve_all(forces: Floats) -> Floats:
        given = forces[: len(free)]
        wrenches = forces[len(free) :]
        first = solve(given) if given.any() else np.zeros_like(given)
        twists = np.linalg.solve(condensed, wrenches - coupling.T @ first)
        return np.vstack([first - inner @ twists, twists])

    return solve_all


def traction_work(mesh: TetMesh, coupling: Coupling, element: ElementH1) -> Floats:
    """Return the work B = M R (RᵀMR)⁻¹ (3w, 6) of a distributed coupling's unit wrenches.

    M is the face's mass matrix between the element's w functions and the quadratic nodal ones, R
    the nodes' rigid motion; for the quadratic element w is the number of nodes.

    Parameters
    ----------
    mesh
        Quadratic tetrahedra of the solid.
    coupling
        Loaded face with its reference point.
    element
        Element with the functions that carry the traction.
    """
    modes = rigid_modes(mesh.points, coupling.reference_point).reshape(-1, 6)
    nodal = face_basis(mesh, ElementVector(ElementTetP2()), coupling.faces, ORDER)
    fields = [nodal.interpolate(mode) for mode in modes.T]
    gram = np.column_stack([_WORK.assemble(nodal, mode=field) for field in fields])
    tested = face_basis(mesh, ElementVector(element), coupling.faces, ORDER)
    work = np.column_stack([_WORK.assemble(tested, mode=field) for field in fields])
    return work @ np.linalg.inv(modes.T @ gram)


def unit_loads(
    mesh: TetMesh, supports: Supports, couplings: tuple[Coupling, ...]
) -> Floats:
    """Return generalized forces (3f + 6r, 6n) of unit wrenches (f, m) at n reference points.

    Parameters
    ----------
    mesh, supports
        Mesh, and its constraints with f free nodes and r rigid couplings.
    couplings
        The n loaded interfaces.
    """
    slot = 3 * len(supports.free)
    loads = np.zeros((slot + supports.tie.shape[1], len(couplings), 6))
    for k, coupling in enumerate(couplings):
        if coupling.kind == "rigid":
            loads[slot : slot + 6, k] = np.eye(6)
            slot += 6
        else:
            loads[:, k] = supports.restrict(
                traction_work(mesh, coupling, ElementTetP2())
            )
    return loads.reshape(len(loads), -1)


def imbalance(
    points: Floats,
    stiffness: csr_array,
    motion: Floats,
    clamped: Ints,
    couplings: tuple[Coupling, ...],
) -> float:
    """Return the largest residual of equilibrium between the clamp reactions and the unit wrenches.

    Relative to the wrench, with moments over the distance from reference point to clamp. Loads on
    clamped nodes are ignored, so it is not reliable if load and clamp share nodes.

    Parameters
    ----------
    points
        Nodes (n, 3), m.
    stiffness
        Stiffness matrix.
    motion
        Displacements under the loads.
    clamped
        Indices of the clamped nodes.
    couplings
        Loaded faces with their reference points.
    """
    reaction = stiffness[dofs_of(clamped)] @ motion  # (3c, 6n)
    residuals = []
    for k, coupling in enumerate(couplings):
        modes = rigid_modes(points[clamped], coupling.reference_point).reshape(-1, 6)
        lever = np.linalg.norm(points[clamped] - coupling.reference_point, axis=1).max()
        units = np.array([1.0] * 3 + [lever] * 3)  # weight of each wrench component
        wrench = modes.T @ reaction[:, 6 * k : 6 * k + 6] + np.eye(6)
        residuals.append((np.abs(wrench) / units[:, None] * units).max())
    return float(max(residuals))

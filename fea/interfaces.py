"""How a part is held and loaded: few coordinates for rigid faces, nodal forces for distributed ones.

Rigid: the face moves as one body, u = R(x) t with the twist t = (v, ω) at the reference point.
Distributed: the wrench enters as the traction R(x) (RᵀMR)⁻¹ w, with M the face's mass matrix; its work-conjugate
twist is the mean motion (RᵀMR)⁻¹ RᵀM u.
Either way the response to unit wrenches is C = Fᵀ A⁻¹ F, with A the stiffness of the coordinates left free.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.fea.shape import area_elements, facet_rule, facet_values
from stiffscope.fea.solvers import factorized

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from stiffscope.fea.mesh import Floats, Ints, TetMesh
    from stiffscope.fea.solvers import Solve

KINDS = ("rigid", "distributed")


@dataclass(frozen=True)
class Port:
    """A loaded interface on a mesh: its boundary triangles (k, 6), its reference point (m), its kind."""

    facets: Ints
    reference_point: Floats
    kind: str


@dataclass(frozen=True)
class Supports:
    """The motion of all nodes by the coordinates left free: u = [free nodes, twists of rigid ports].

    Attributes
    ----------
    free : (f,) nodes that move on their own.
    tied, clamped : nodes on rigid ports, and nodes that do not move.
    tie : (3 t, 6 r) motion of the tied nodes for each coordinate of the r rigid ports.
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
        """Return (3f + 6r, loads) generalized forces from (3n, loads) nodal forces; transpose of expand."""
        return np.vstack([forces[self.free_dofs], self.tie.T @ forces[dofs_of(self.tied)]])


def dofs_of(nodes: Ints) -> Ints:
    """Return the three degrees of freedom of each node, in order."""
    return (3 * nodes[:, None] + np.arange(3)).reshape(-1)


def rigid_modes(points: Floats, reference: Floats) -> Floats:
    """Return (n, 3, 6) the displacement of each point for each unit twist component at the reference point."""
    r = points - reference
    modes = np.zeros((len(points), 3, 6))
    modes[:, :, :3] = np.eye(3)
    modes[:, 0, 4], modes[:, 0, 5] = r[:, 2], -r[:, 1]
    modes[:, 1, 5], modes[:, 1, 3] = r[:, 0], -r[:, 2]
    modes[:, 2, 3], modes[:, 2, 4] = r[:, 1], -r[:, 0]
    return modes


def support(mesh: TetMesh, clamped: Ints, ports: tuple[Port, ...]) -> Supports:
    """Return the coordinates that clamped nodes and rigid ports leave free.

    Raises
    ------
    InputError : a rigid face shares nodes with the clamp or with another rigid face.
    """
    count = len(mesh.points)
    rigid = [port for port in ports if port.kind == "rigid"]
    tie = np.zeros((count, 3, 6 * len(rigid)))
    is_tied, is_free = np.zeros(count, dtype=bool), np.ones(count, dtype=bool)
    for slot, port in enumerate(rigid):
        nodes = np.unique(port.facets)
        if is_tied[nodes].any() or np.isin(nodes, clamped).any():
            raise InputError("interfaces: a rigid face touches the clamp or another rigid face; choose them apart")
        is_tied[nodes] = True
        tie[nodes, :, 6 * slot : 6 * slot + 6] = rigid_modes(mesh.points[nodes], port.reference_point)
    is_free[clamped] = False
    tied = np.flatnonzero(is_tied)
    return Supports(
        count, np.flatnonzero(is_free & ~is_tied), tied, clamped, tie[tied].reshape(3 * len(tied), tie.shape[2])
    )


def factorize(stiffness: csr_array, supports: Supports) -> Solve:
    """Return a function that solves for the coordinates of ``supports``; the twists by a Schur complement."""
    free = supports.free_dofs
    rows = stiffness[free]
    solve = factorized(rows[:, free])
    if not supports.tie.shape[1]:
        return solve
    tied = dofs_of(supports.tied)
    coupling = rows[:, tied] @ supports.tie
    inner = solve(coupling)
    condensed = supports.tie.T @ (stiffness[tied][:, tied] @ supports.tie) - coupling.T @ inner
    condensed = (condensed + condensed.T) / 2

    def solve_all(forces: Floats) -> Floats:
        given, wrenches = forces[: len(free)], forces[len(free) :]
        first = solve(given) if given.any() else np.zeros_like(given)
        twists = np.linalg.solve(condensed, wrenches - coupling.T @ first)
        return np.vstack([first - inner @ twists, twists])

    return solve_all


def tractions(points: Floats, port: Port, order: int = 4) -> tuple[Floats, Floats]:
    """Return (k, q, 3, 6) tractions times area of unit wrenches at the facets' quadrature points, and (q, 2)."""
    at, _ = facet_rule(order)
    corners = points[port.facets]  # (k, 6, 3)
    area = area_elements(corners, order)
    where = np.einsum("qn,kni->kqi", facet_values(at), corners)
    modes = rigid_modes(where.reshape(-1, 3), port.reference_point).reshape(*where.shape, 6)
    gram = np.einsum("kq,kqia,kqib->ab", area, modes, modes)
    return area[..., None, None] * (modes @ np.linalg.inv(gram)), at


def unit_loads(points: Floats, supports: Supports, ports: tuple[Port, ...]) -> Floats:
    """Return (3f + 6r, 6n) generalized forces of the unit wrenches on n ports, (f, m) at each reference point."""
    columns = []
    slot = 3 * len(supports.free)
    for port in ports:
        if port.kind == "rigid":
            forces = np.zeros((3 * len(supports.free) + supports.tie.shape[1], 6))
            forces[slot : slot + 6] = np.eye(6)
            slot += 6
        else:
            traction, at = tractions(points, port)
            nodal = np.einsum("qn,kqia->knia", facet_values(at), traction)
            loads = np.zeros((len(points), 3, 6))
            np.add.at(loads, port.facets.reshape(-1), nodal.reshape(-1, 3, 6))
            forces = supports.restrict(loads.reshape(-1, 6))
        columns.append(forces)
    return np.hstack(columns)


def imbalance(points: Floats, stiffness: csr_array, motion: Floats, clamped: Ints, ports: tuple[Port, ...]) -> float:
    """Return how far the clamp's reactions are from balancing the unit wrenches.

    Relative to the wrench, a force at the lever between clamp and reference point counting as its moment. What a
    load puts on the clamp's own nodes is left out: where both share nodes this says less.
    """
    reaction = stiffness[dofs_of(clamped)] @ motion  # (3c, 6n)
    worst = 0.0
    for k, port in enumerate(ports):
        modes = rigid_modes(points[clamped], port.reference_point).reshape(-1, 6)
        lever = float(np.linalg.norm(points[clamped] - port.reference_point, axis=1).max())
        units = np.array([1.0] * 3 + [lever] * 3)  # what a unit of each component of the wrench weighs
        wrench = modes.T @ reaction[:, 6 * k : 6 * k + 6] + np.eye(6)
        worst = max(worst, float((np.abs(wrench) / units[:, None] * units).max()))
    return worst

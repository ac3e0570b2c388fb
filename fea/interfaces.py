"""How a part is held and loaded, and its condensation to six coordinates for each loaded interface.

Rigid: the face moves as one body, u = R(x) t with the twist t = (v, ω) at the reference point.
Distributed: the wrench enters as the traction R(x) (RᵀMR)⁻¹ w, with M the face's mass matrix; its work-conjugate
twist is the mean motion (RᵀMR)⁻¹ RᵀM u.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fea.shape import facet_rule, facet_slopes, facet_values
from stiffscope import InputError

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from fea.mesh import Floats, Ints, TetMesh
    from fea.solvers import Solver

KINDS = ("rigid", "distributed")


@dataclass(frozen=True)
class Port:
    """A loaded interface on a mesh: its boundary triangles (k, 6), its reference point (m), its kind."""

    facets: Ints
    reference_point: Floats
    kind: str


@dataclass(frozen=True)
class Response:
    """What unit wrenches do: n ports give 6n columns, six a port, (f, m) at the port's reference point.

    Attributes
    ----------
    compliance : (6n, 6n) twist component i for a unit of wrench component j, symmetric.
    asymmetry : largest |C - Cᵀ| before it was symmetrized, over the size of its diagonal.
    displacement : (6n, nodes, 3) m per unit of wrench.
    imbalance : largest part of a wrench that the reactions at the clamp do not balance, relative.
    """

    compliance: Floats
    asymmetry: float
    displacement: Floats
    imbalance: float


def rigid_modes(points: Floats, reference: Floats) -> Floats:
    """Return (n, 3, 6) the displacement of each point for each unit twist component at the reference point."""
    r = points - reference
    modes = np.zeros((len(points), 3, 6))
    modes[:, :, :3] = np.eye(3)
    modes[:, 0, 4], modes[:, 0, 5] = r[:, 2], -r[:, 1]
    modes[:, 1, 5], modes[:, 1, 3] = r[:, 0], -r[:, 2]
    modes[:, 2, 3], modes[:, 2, 4] = r[:, 1], -r[:, 0]
    return modes


def distributed_loads(points: Floats, port: Port) -> Floats:
    """Return (nodes, 3, 6) nodal forces of the traction whose resultant is each unit wrench."""
    at, weights = facet_rule()
    values, slopes = facet_values(at), facet_slopes(at)  # (q, 6), (q, 6, 2)
    corners = points[port.facets]  # (k, 6, 3)
    tangents = np.einsum("qnd,kni->kqdi", slopes, corners)
    area = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=2) * weights  # (k, q)
    where = np.einsum("qn,kni->kqi", values, corners)
    modes = rigid_modes(where.reshape(-1, 3), port.reference_point).reshape(*where.shape, 6)
    gram = np.einsum("kq,kqia,kqib->ab", area, modes, modes)
    traction = modes @ np.linalg.inv(gram)
    nodal = np.einsum("kq,qn,kqia->knia", area, values, traction)
    loads = np.zeros((len(points), 3, 6))
    np.add.at(loads, port.facets.reshape(-1), nodal.reshape(-1, 3, 6))
    return loads


def respond(
    mesh: TetMesh, stiffness: csr_array, clamped: Ints, ports: tuple[Port, ...], solver: Solver
) -> Response:
    """Condense the supported stiffness on the ports: one factorization for all wrenches.

    Parameters
    ----------
    mesh, stiffness : the mesh and its (3n, 3n) stiffness, N/m.
    clamped : nodes that do not move.
    ports : the loaded interfaces.
    solver : see ``fea.solvers``.
    """
    count, width = len(mesh.points), 6 * len(ports)
    tie, is_tied = _rigid_ties(mesh, clamped, ports)
    free_node = ~is_tied
    free_node[clamped] = False
    free, tied = np.flatnonzero(np.repeat(free_node, 3)), np.flatnonzero(np.repeat(is_tied, 3))
    tie = tie.reshape(3 * count, -1)  # (3n, 6r)
    loads = np.zeros((3 * count, width))
    direct = np.zeros((tie.shape[1], width))
    rigid = [k for k, port in enumerate(ports) if port.kind == "rigid"]
    for slot, k in enumerate(rigid):
        direct[6 * slot : 6 * slot + 6, 6 * k : 6 * k + 6] = np.eye(6)
    for k, port in enumerate(ports):
        if port.kind != "rigid":
            loads[:, 6 * k : 6 * k + 6] = distributed_loads(mesh.points, port).reshape(-1, 6)
    motion, forces = _solve(stiffness, free, tied, tie, loads, direct, solver, mesh.points[free_node])
    conjugate = loads.T @ motion
    for slot, k in enumerate(rigid):
        conjugate[6 * k : 6 * k + 6] += forces[6 * slot : 6 * slot + 6]
    scale = np.sqrt(np.outer(conjugate.diagonal(), conjugate.diagonal()))
    return Response(
        compliance=(conjugate + conjugate.T) / 2,
        asymmetry=float((np.abs(conjugate - conjugate.T) / scale).max()),
        displacement=motion.T.reshape(width, count, 3),
        imbalance=_imbalance(mesh.points, stiffness, motion, clamped, ports),
    )


def _rigid_ties(mesh: TetMesh, clamped: Ints, ports: tuple[Port, ...]) -> tuple[Floats, np.ndarray]:
    """Return (nodes, 3, 6r) the rigid motion of tied nodes for r rigid ports, and (nodes,) which are tied."""
    count = len(mesh.points)
    rigid = [port for port in ports if port.kind == "rigid"]
    tie = np.zeros((count, 3, 6 * len(rigid)))
    is_tied = np.zeros(count, dtype=bool)
    for slot, port in enumerate(rigid):
        nodes = np.unique(port.facets)
        if is_tied[nodes].any() or np.isin(nodes, clamped).any():
            raise InputError("interfaces: a rigid face touches the clamped face or another rigid face; choose apart")
        is_tied[nodes] = True
        tie[nodes, :, 6 * slot : 6 * slot + 6] = rigid_modes(mesh.points[nodes], port.reference_point)
    return tie, is_tied


def _solve(
    stiffness: csr_array,
    free: Ints,
    tied: Ints,
    tie: Floats,
    loads: Floats,
    direct: Floats,
    solver: Solver,
    points: Floats,
) -> tuple[Floats, Floats]:
    """Return (3n, 6n) displacements and (6r, 6n) twists of the rigid ports, by the Schur complement on them."""
    rows = stiffness[free]
    solve = solver(rows[:, free], points)
    coupling = rows[:, tied] @ tie[tied]
    inner = solve(np.hstack([coupling, loads[free]]))
    from_twist, from_load = inner[:, : tie.shape[1]], inner[:, tie.shape[1] :]
    condensed = tie[tied].T @ (stiffness[tied][:, tied] @ tie[tied]) - coupling.T @ from_twist
    twists = direct + tie.T @ loads - coupling.T @ from_load
    if len(condensed):
        twists = np.linalg.solve((condensed + condensed.T) / 2, twists)
    motion = tie @ twists
    motion[free] = from_load - from_twist @ twists
    return motion, twists


def _imbalance(
    points: Floats, stiffness: csr_array, motion: Floats, clamped: Ints, ports: tuple[Port, ...]
) -> float:
    """Return how far the clamp's reactions are from balancing the unit wrenches, relative to their own size."""
    dofs = (3 * clamped[:, None] + np.arange(3)).reshape(-1)
    reaction = stiffness[dofs] @ motion  # (3c, 6n)
    worst = 0.0
    for k, port in enumerate(ports):
        modes = rigid_modes(points[clamped], port.reference_point).reshape(-1, 6)
        lever = float(np.linalg.norm(points[clamped] - port.reference_point, axis=1).max())
        wanted = np.diag([1.0, 1, 1, 1, 1, 1])
        wrench = modes.T @ reaction[:, 6 * k : 6 * k + 6] + wanted
        units = np.array([1.0] * 3 + [lever] * 3)
        worst = max(worst, float((np.abs(wrench) / units[:, None] * units).max()))
    return worst

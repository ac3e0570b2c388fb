"""Solve a meshed specimen: compliance from the cubic solution, its error bar, displacements and stresses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fea.cubic import cubic_compliance, enlarge
from fea.elasticity import assemble, strains, von_mises
from fea.interfaces import Port, factorize, imbalance, support, unit_loads
from fea.mesh import MeshError
from fea.solvers import choose
from fea.specimen import shape_error

if TYPE_CHECKING:
    from fea.mesh import Floats, TetMesh
    from fea.specimen import Specimen

# What the cubic solution still lacks, in parts of what it gained on the quadratic one; measured against much finer
# solutions: next to nothing where the solution is smooth, up to 0.3 where it is singular at the edge of a clamp.
STILL_MISSING = 0.1
MISSING_AT_MOST = 0.25
CROSS_TERMS = 0.02  # of the energies' geometric mean, for entries whose own gain happens to be small
SOLVER = 1e-8


@dataclass(frozen=True)
class Solution:
    """(6n, 6n) flexibility and its error, fields of the 6n unit wrenches, the clamp's imbalance."""

    flexibility: Floats
    error: Floats
    displacement: Floats
    von_mises: Floats
    imbalance: float
    unknowns: int


def solve_specimen(specimen: Specimen, mesh: TetMesh, interface: str, solver: str) -> Solution:
    """Return the specimen's response to the unit wrenches on its loaded interfaces.

    One factorization of the quadratic problem serves all wrenches and both orders. The flexibility is that of the
    cubic solution plus the part of its gain on the quadratic one that is usually still missing.

    Raises
    ------
    InputError : interfaces overlap.
    MeshError : the compliance is not positive definite or does not balance.
    """
    ports = tuple(Port(mesh.facets_of(faces), point, interface) for faces, point in specimen.loaded)
    supports = support(mesh, mesh.nodes_of(specimen.clamped), ports)
    stiffness = assemble(mesh, specimen.elasticity)
    solve = factorize(stiffness, supports, mesh.points, choose(solver, 3 * len(supports.free)))
    loads = unit_loads(mesh.points, supports, ports)
    quadratic = solve(loads)
    space = enlarge(mesh, specimen.elasticity)
    cubic, motion = cubic_compliance(mesh, space, supports, ports, solve, loads, quadratic)
    lower = loads.T @ quadratic
    gain = cubic - (lower + lower.T) / 2
    flexibility = cubic + STILL_MISSING * gain
    if not (np.linalg.eigvalsh(cubic) > 0).all() or not (gain.diagonal() > -SOLVER * cubic.diagonal()).all():
        raise MeshError(f"solve: the compliance of {specimen.name} is not positive definite; the mesh is broken")
    nodal = supports.expand(motion[: len(loads)])
    return Solution(
        flexibility=flexibility,
        error=_bound(flexibility, gain) + _geometry_bound(specimen, mesh, flexibility),
        displacement=nodal.T.reshape(len(cubic), -1, 3),
        von_mises=nodal_von_mises(mesh, nodal, specimen.elasticity),
        imbalance=imbalance(mesh.points, stiffness, supports.expand(quadratic), supports.clamped, ports),
        unknowns=3 * space.count,
    )


def _bound(flexibility: Floats, gain: Floats) -> Floats:
    """Return (6n, 6n) what the discretization and the solver may still hide."""
    energies = np.sqrt(np.maximum(gain.diagonal(), 0))
    scale = np.sqrt(flexibility.diagonal())
    return MISSING_AT_MOST * np.abs(gain) + CROSS_TERMS * np.outer(energies, energies) + SOLVER * np.outer(scale, scale)


def _geometry_bound(specimen: Specimen, mesh: TetMesh, flexibility: Floats) -> Floats:
    """Return (6n, 6n) what the mesh's shape costs: bending feels a section's area three times over."""
    scale = np.sqrt(flexibility.diagonal())
    return 3 * shape_error(specimen, mesh) * np.maximum(np.abs(flexibility), 1e-3 * np.outer(scale, scale))


def nodal_von_mises(mesh: TetMesh, motion: Floats, elasticity: Floats) -> Floats:
    """Return (loads, nodes) von Mises stress (Pa): stresses at the nodes, averaged over their elements.

    Parameters
    ----------
    motion : (3 nodes, loads) displacements, m.
    """
    from fea.shape import NODES

    count, loads = len(mesh.points), motion.shape[1]
    total = np.zeros((count, loads * 6))
    for start in range(0, len(mesh.cells), 2048):
        cells = mesh.cells[start : start + 2048]
        local = motion.reshape(count, 3, loads)[cells]
        stress = strains(mesh.points[cells], local, NODES) @ elasticity.T  # (m, 10, loads, 6)
        flat = stress.reshape(-1, loads * 6)
        for column in range(loads * 6):
            total[:, column] += np.bincount(cells.reshape(-1), flat[:, column], count)
    mean = total / np.bincount(mesh.cells.reshape(-1), minlength=count)[:, None]
    return von_mises(mean.reshape(count, loads, 6)).T

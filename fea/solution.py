"""Solve a meshed specimen: compliance from the cubic solution, its error bar, displacements and stresses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from stiffscope.errors import InputError
from stiffscope.fea.cubic import cubic_compliance, element_energies, enlarge
from stiffscope.fea.elasticity import assemble, strains, von_mises
from stiffscope.fea.foundation import bed, on_nodes
from stiffscope.fea.interfaces import Port, imbalance, support, unit_loads
from stiffscope.fea.mesh import MeshError
from stiffscope.fea.multigrid import prepare
from stiffscope.fea.singular import missing_at_edges
from stiffscope.fea.specimen import interface_error, shape_error

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats, TetMesh
    from stiffscope.fea.specimen import Specimen

# What the cubic solution still lacks, and how much of that is unsure; fitted to 49 parts refined to an eighth of the
# error. At singular edges in parts of what theory says of the elements that touch them (their neighbours lack too),
# between two loads in parts of the geometric mean of what they lack, elsewhere in parts of the gain on quadratics:
# from nothing on, as the cubic solution is a lower limit, and is exact but for its shape where a round bar is twisted.
AT_EDGES, UNSURE_AT_EDGES = 1.6, 0.5
ELSEWHERE, UNSURE_ELSEWHERE = 0.1, 0.1
CROSS_TERMS = 0.12
SOLVER = 1e-8
SOFTEST = 1e-4  # foundation, in parts of the part's modulus over its size


@dataclass(frozen=True)
class Solution:
    """What unit wrenches do to a meshed specimen.

    Attributes
    ----------
    flexibility, error : (6n, 6n) and its 95 % bound, of which ``geometry`` (6n, 6n) is the mesh's shape alone.
    displacement, von_mises : (6n, nodes, 3) m and (6n, nodes) Pa.
    imbalance : how far the clamp's reactions are from balancing the wrenches, relative.
    unknowns : of the cubic solution.
    indicator : (m,) what each element adds to the bounds of the loads' own compliances, relative to them.
    """

    flexibility: Floats
    error: Floats
    geometry: Floats
    displacement: Floats
    von_mises: Floats
    imbalance: float
    unknowns: int
    indicator: Floats


def solve_specimen(
    specimen: Specimen, mesh: TetMesh, interface: str, solver: str, foundation: float | None = None
) -> Solution:
    """Return the specimen's response to the unit wrenches on its loaded interfaces.

    One factorization of the quadratic problem serves all wrenches and both orders. The flexibility is that of the
    cubic solution plus what it usually still lacks, told from its gain on the quadratic one. With a
    ``foundation`` (N/m³) the clamped faces rest on springs.

    Raises
    ------
    InputError : interfaces overlap, or the foundation is too soft to hold the part.
    MeshError : the compliance is not positive definite, or the cubic solution does not converge.
    """
    with threadpool_limits(1):  # the cores are shared out here; BLAS's own threads on small matrices only wait
        return _solve(specimen, mesh, interface, solver, foundation)


def _solve(specimen: Specimen, mesh: TetMesh, interface: str, solver: str, foundation: float | None) -> Solution:
    ports = tuple(Port(mesh.facets_of(faces), point, interface) for faces, point in specimen.loaded)
    clamped = mesh.nodes_of(specimen.clamped)
    if foundation is not None:
        _check_foundation(specimen, foundation)
    supports = support(mesh, clamped if foundation is None else clamped[:0], ports)
    bare = stiffness = assemble(mesh, specimen.elasticity)
    space, springs = enlarge(mesh, specimen.elasticity), None
    if foundation is not None:
        springs = bed(mesh.points, mesh.facets_of(specimen.clamped), space, foundation)
        stiffness = bare + on_nodes(springs, space.base)
    prepared = prepare(mesh, stiffness, supports, solver)
    loads = unit_loads(mesh.points, supports, ports)
    quadratic = prepared.solve(loads)
    cubic, motion = cubic_compliance(mesh, space, supports, ports, prepared, loads, quadratic, springs=springs)
    before = supports.expand(quadratic)
    work = loads.T @ quadratic
    lower = work + work.T - before.T @ (stiffness @ before)  # second order in the error of the solver
    gain = cubic - (lower + lower.T) / 2
    if not (np.linalg.eigvalsh(cubic) > 0).all() or not (gain.diagonal() > -SOLVER * cubic.diagonal()).all():
        raise MeshError(f"solve: the compliance of {specimen.name} is not positive definite; the mesh is broken")
    nodal = supports.expand(motion[: len(loads)])
    motion[: len(loads)] -= quadratic
    sharp = _sharpness(specimen, mesh, interface, foundation)
    energies, at_edges = element_energies(mesh, space, supports, motion, sharp)
    missing = AT_EDGES * at_edges + ELSEWHERE * gain
    flexibility = cubic + missing
    unsure = UNSURE_AT_EDGES * np.abs(at_edges) + UNSURE_ELSEWHERE * np.abs(gain)
    geometry = _geometry_bound(specimen, mesh, flexibility)
    return Solution(
        flexibility=flexibility,
        error=unsure + _mixed(missing) + SOLVER * np.sqrt(np.outer(cubic.diagonal(), cubic.diagonal())) + geometry,
        geometry=geometry,
        displacement=nodal.T.reshape(len(cubic), -1, 3),
        von_mises=nodal_von_mises(mesh, nodal, specimen.elasticity),
        imbalance=imbalance(mesh.points, bare, before, clamped, ports),
        unknowns=3 * space.count,
        indicator=(energies / cubic.diagonal()).sum(axis=1) * (UNSURE_AT_EDGES * sharp + UNSURE_ELSEWHERE),
    )


def _check_foundation(specimen: Specimen, foundation: float) -> None:
    """Raise InputError for springs beside which the part's own deformation would be lost to rounding."""
    least = SOFTEST * float(specimen.elasticity[0, 0]) / specimen.volume ** (1 / 3)
    if foundation < least:
        raise InputError(
            f"foundation: {foundation:g} N/m³ is too soft to hold {specimen.name}; expected at least {least:.2g} N/m³"
            " (a bolted contact has some 1e12; a number without a unit is N/m³)"
        )


def _sharpness(specimen: Specimen, mesh: TetMesh, interface: str, foundation: float | None) -> Floats:
    """Return (m,) what elements at singular edges lack; a clamp on springs softer than the part bears a traction."""
    fixed = specimen.fixed(rigid=interface == "rigid")
    if foundation is not None and foundation * specimen.volume ** (1 / 3) < specimen.elasticity[0, 0]:
        fixed = fixed[1:]
    return missing_at_edges(mesh, fixed, [faces for faces in specimen.interfaces if faces not in fixed])


def _mixed(missing: Floats) -> Floats:
    """Return (6n, 6n) what may be missing between each two loads, though their sum of it is small."""
    energies = np.sqrt(np.maximum(missing.diagonal(), 0))
    return CROSS_TERMS * (np.outer(energies, energies) - np.diag(energies**2))


def _geometry_bound(specimen: Specimen, mesh: TetMesh, flexibility: Floats) -> Floats:
    """Return (6n, 6n) what the mesh's shape costs: bending feels a section's area three times over.

    A mesh whose interfaces are out of place couples what symmetry keeps apart, far more than one of another volume.
    """
    size, scale = np.abs(flexibility), np.sqrt(np.outer(flexibility.diagonal(), flexibility.diagonal()))
    area, shift = interface_error(specimen, mesh)
    body = (shape_error(specimen, mesh) + area) * np.maximum(size, 1e-3 * scale)
    return 3 * (body + shift * np.maximum(size, 0.3 * scale))


def nodal_von_mises(mesh: TetMesh, motion: Floats, elasticity: Floats) -> Floats:
    """Return (loads, nodes) von Mises stress (Pa): stresses carried on from four points inside each element, averaged.

    At the nodes themselves a curved element may be flat, and its stress there all error.

    Parameters
    ----------
    motion : (3 nodes, loads) displacements, m.
    """
    from stiffscope.fea.shape import NODES, quadrature

    count, loads = len(mesh.points), motion.shape[1]
    total, (inside, _) = np.zeros((count, loads * 6)), quadrature(2)
    linear, at_nodes = (np.column_stack([1 - points.sum(axis=1), points]) for points in (inside, NODES))
    onward = at_nodes @ np.linalg.inv(linear)  # (10, 4)
    for start in range(0, len(mesh.cells), 2048):
        cells = mesh.cells[start : start + 2048]
        local = motion.reshape(count, 3, loads)[cells]
        stress = strains(mesh.points[cells], local, inside) @ elasticity.T  # (m, 4, loads, 6)
        flat = (onward @ stress.reshape(len(cells), 4, -1)).reshape(-1, loads * 6)
        for column in range(loads * 6):
            total[:, column] += np.bincount(cells.reshape(-1), flat[:, column], count)
    mean = total / np.bincount(mesh.cells.reshape(-1), minlength=count)[:, None]
    return von_mises(mean.reshape(count, loads, 6)).T

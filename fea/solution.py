"""Solution of a meshed specimen: extrapolated compliance, error bound, displacements, stresses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from stiffscope.errors import InputError
from stiffscope.fea.couplings import (
    Coupling,
    Supports,
    dofs_of,
    imbalance,
    support,
    unit_loads,
)
from stiffscope.fea.cubic import (
    CubicProblem,
    cubic_loads,
    cubic_problem,
    element_energies,
    solve_cubic,
    weigh_energies,
    work,
)
from stiffscope.fea.cubic_space import enrich
from stiffscope.fea.elasticity import assemble, nodal_stresses, von_mises
from stiffscope.fea.foundation import on_nodes, springs
from stiffscope.fea.mass import Mass, times
from stiffscope.fea.mesh import Floats, Ints, MeshError, TetMesh
from stiffscope.fea.multigrid import prepare
from stiffscope.fea.singular import remaining_at_edges
from stiffscope.fea.specimen import Specimen, geometric_error, interface_error

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from stiffscope.fea.solvers import Solver

# Calibrated extrapolation factors and their 95 % spread, fitted and printed by
# tests/benchmarks/fit_error_bounds.py. The remaining error of the cubic solution is AT_EDGES times
# the theoretical estimate for elements that touch singular edges, and ELSEWHERE times the
# quadratic-to-cubic difference otherwise; CROSS_TERMS bounds that between two loads over the
# geometric mean of theirs. Its lower limit elsewhere is zero: the cubic compliance is a lower
# bound, and exact except for geometry for a twisted round bar.
AT_EDGES = 1.6
SPREAD_AT_EDGES = 0.5
ELSEWHERE = 0.1
SPREAD_ELSEWHERE = 0.1
CROSS_TERMS = 0.12
SOLVER = 1e-8
ROUNDING = 5e-14
INERTIA = 3e-2  # relative error of the quadratic-to-cubic difference for inertia forces
SOFTEST = 1e-4  # foundation stiffness over the part's modulus per size


@dataclass(frozen=True)
class Extrapolated:
    """Compliance and 95 % bound, of which ``geometry`` is due to the mesh's shape; (k, k) each."""

    compliance: Floats
    error: Floats
    geometry: Floats


@dataclass(frozen=True)
class System:
    """A supported mesh with the solvers of its quadratic and cubic problem, of one factorization.

    Attributes
    ----------
    bare, stiffness : (3n, 3n) N/m, without and with the elastic foundation.
    edge_weights : (m,) factors of gained element energy in ``Solution.at_edges``; 0 off edges.
    """

    specimen: Specimen
    mesh: TetMesh
    couplings: tuple[Coupling, ...]
    supports: Supports
    bare: csr_array
    stiffness: csr_array
    solver: Solver
    cubic: CubicProblem
    edge_weights: Floats

    @cached_property
    def mass(self) -> Mass:
        """Consistent mass of the mesh."""
        return Mass(self.mesh, self.specimen.density)

    def apply(self, motion: Floats) -> Floats:
        """Return generalized forces (c, k) of the quadratic stiffness for coordinates (c, k)."""
        return self.supports.restrict(self.stiffness @ self.supports.expand(motion))

    @property
    def cubic_rows(self) -> Ints:
        """Degrees of freedom (3w,) of the unconstrained cubics among all cubics'."""
        return dofs_of(self.cubic.free - self.cubic.space.base)


@dataclass(frozen=True)
class Solution:
    """Quadratic and cubic solution of a system for k loads, in the c + 3w cubic coordinates.

    Attributes
    ----------
    force, motion : (c + 3w, k) generalized forces, and cubic solution.
    quadratic : (c, k) quadratic solution.
    cubic, gain : (k, k) cubic compliance, and its difference from the quadratic one.
    at_edges : (k, k) theoretical error of the cubic compliance at singular edges.
    """

    system: System
    force: Floats
    motion: Floats
    quadratic: Floats
    cubic: Floats
    gain: Floats
    at_edges: Floats

    @cached_property
    def extrapolated(self) -> Extrapolated:
        """Compliance, 95 % bound, and the bound's part due to the mesh's shape."""
        return self.extrapolate()

    @property
    def compliance(self) -> Floats:
        """Extrapolated compliance (k, k)."""
        return self.extrapolated.compliance

    @property
    def error(self) -> Floats:
        """95 % bound (k, k) of ``compliance``."""
        return self.extrapolated.error

    def stiffness_error(self, free: Floats) -> Floats:
        """Return 95 % bounds (m, m) of the stiffness ``freeᵀ C⁻¹ free``, with free (k, m)."""
        loads = np.asarray(np.linalg.solve(self.compliance, free), dtype=np.float64)
        return self.extrapolate(loads=loads).error

    @property
    def unknowns(self) -> int:
        """Degrees of freedom of the cubic solution."""
        return int(3 * self.system.cubic.space.count)

    @property
    def indicator(self) -> Floats:
        """Contribution (m,) of each element to the relative bounds of the diagonal entries."""
        energies = element_energies(
            self.system.cubic, _gained(self.motion, self.quadratic)
        )
        weights = SPREAD_AT_EDGES * self.system.edge_weights + SPREAD_ELSEWHERE
        return (energies / self.cubic.diagonal()).sum(axis=1) * weights

    @property
    def displacement(self) -> Floats:
        """Displacements (3 nodes, k), m, of the cubic solution."""
        return self.system.supports.expand(self.motion[: len(self.quadratic)])

    @property
    def von_mises(self) -> Floats:
        """Von Mises stresses (nodes, k), Pa."""
        elasticity = self.system.specimen.elasticity
        return von_mises(
            nodal_stresses(self.system.mesh, self.displacement, elasticity)
        )

    @property
    def imbalance(self) -> float:
        """Relative residual of the equilibrium between clamp and unit wrenches."""
        system = self.system
        nodal = system.supports.expand(self.quadratic)
        clamped = system.mesh.nodes_of(system.specimen.clamped)
        return imbalance(
            system.mesh.points, system.bare, nodal, clamped, system.couplings
        )

    def extrapolate(
        self, other: float = ELSEWHERE, loads: Floats | None = None
    ) -> Extrapolated:
        """Return the compliance with the remaining discretization error extrapolated; bounds.

        Parameters
        ----------
        other : error of the cubic solution over the gain, away from singular edges.
        loads : (k, m) combinations that replace the loads.
        """
        combine = np.eye(len(self.cubic)) if loads is None else loads
        matrices = self.cubic, self.gain, self.at_edges
        cubic, gain, at_edges = (combine.T @ matrix @ combine for matrix in matrices)
        specimen = self.system.specimen
        mesh = self.system.mesh
        remaining = AT_EDGES * at_edges + other * gain
        spread = SPREAD_AT_EDGES * np.abs(at_edges) + SPREAD_ELSEWHERE * np.abs(gain)
        spread *= specimen.flatness_on(mesh)  # fitted to elements no larger than walls
        energies = np.sqrt(np.maximum(remaining.diagonal(), 0))
        cross = CROSS_TERMS * (np.outer(energies, energies) - np.diag(energies**2))
        compliance = cubic + remaining
        geometry = _geometry_bound(specimen, mesh, compliance)
        scale = np.abs(combine).T @ np.sqrt(self.cubic.diagonal())
        rounding = rounding_of(specimen) * np.outer(scale, scale)
        return Extrapolated(compliance, spread + cross + rounding + geometry, geometry)


def _gained(motion: Floats, quadratic: Floats) -> Floats:
    """Return the difference (c + 3w, k) of the cubic and the quadratic solution."""
    gained = motion.copy()
    gained[: len(quadratic)] -= quadratic
    return gained


@threadpool_limits.wrap(
    limits=1
)  # BLAS threads are slower on small matrices; see ``on_all_cores``
def solve_specimen(
    specimen: Specimen,
    mesh: TetMesh,
    interface: str,
    solver: str,
    foundation: float | None = None,
) -> Solution:
    """Return the specimen's response to unit wrenches on its loaded interfaces.

    The remaining discretization error is extrapolated from the quadratic-to-cubic difference.

    Parameters
    ----------
    interface, solver, foundation : see ``Settings``.

    Raises
    ------
    InputError : if interfaces overlap, the foundation is too soft, or the solver is unknown.
    MeshError : if the compliance is not positive definite or the cubic solution does not converge.
    """
    kinds = specimen.list_couplings(interface)
    loaded = zip(specimen.loaded, kinds, strict=True)
    couplings = tuple(Coupling(*each, kind) for each, kind in loaded)
    clamped = mesh.nodes_of(specimen.clamped)
    bedding = None
    if foundation is not None:
        _check_foundation(specimen, foundation)
        clamped = clamped[:0]
    supports = support(mesh, clamped, couplings)
    bare = stiffness = assemble(mesh, specimen.elasticity)
    space = enrich(mesh, specimen.elasticity)
    if foundation is not None:
        bedding = springs(mesh, specimen.clamped, foundation)
        stiffness = bare + on_nodes(bedding, space.base)
    prepared = prepare(mesh, stiffness, supports, solver)
    cubic = cubic_problem(
        mesh=mesh,
        space=space,
        supports=supports,
        solver=prepared,
        stiffness=stiffness,
        springs=bedding,
    )
    weights = _edge_weights(specimen, mesh, interface, foundation)
    system = System(
        specimen, mesh, couplings, supports, bare, stiffness, prepared, cubic, weights
    )
    loads = unit_loads(mesh, supports, couplings)
    tractions = cubic_loads(mesh, space, couplings)[cubic.free].reshape(
        -1, loads.shape[1]
    )
    return respond(system, np.vstack([loads, tractions]), prepared.solve(loads))


def respond(
    system: System,
    force: Floats,
    quadratic: Floats,
    solved: Solution | None = None,
    tolerance: float = 1e-2,
) -> Solution:
    """Return both solutions for additional loads, after those of the loads already solved.

    Parameters
    ----------
    force, quadratic : (c + 3w, k) generalized forces, and (c, k) the quadratic solution.
    tolerance : see ``stiffscope.fea.cubic.solve_cubic``.

    Raises
    ------
    MeshError : if the compliance is not positive definite or the cubic solution does not converge.
    """
    motion = solve_cubic(system.cubic, force, quadratic, tolerance)
    if solved is not None:
        former = solved.force, solved.motion, solved.quadratic
        new = force, motion, quadratic
        force, motion, quadratic = (
            np.hstack(pair) for pair in zip(former, new, strict=True)
        )
    split = len(quadratic)
    cubic = work(system.cubic.apply, force, motion)
    gain = cubic - work(system.apply, force[:split], quadratic)
    scale = np.sqrt(np.outer(cubic.diagonal(), cubic.diagonal()))
    rounding = rounding_of(system.specimen)
    broken = not (gain.diagonal() > -rounding * cubic.diagonal()).all()
    if solved is None:  # added loads may nearly depend on it, within the tolerance
        broken = broken or not (np.linalg.eigvalsh(cubic / scale) > -rounding).all()
    if broken:
        what = f"the compliance of {system.specimen.name} is not positive definite"
        raise MeshError(f"solve: {what}; the mesh is broken")
    gained = _gained(motion, quadratic)
    at_edges = weigh_energies(system.cubic, gained, system.edge_weights)
    return Solution(system, force, motion, quadratic, cubic, gain, at_edges)


def accelerate(levels: Solution, motion: Floats) -> Solution:
    """Return the solution with additional loads: inertia forces of accelerations (3n, k), m/s²."""
    system = levels.system
    mass = levels.system.mass
    nodal = system.supports.restrict(times(mass.nodes, motion))
    force = np.vstack([nodal, times(mass.cubics, motion)[system.cubic_rows]])
    return respond(system, force, system.solver.solve(nodal), levels, tolerance=INERTIA)


def rounding_of(specimen: Specimen) -> float:
    """Return the relative rounding error of a compliance: in slender parts as slenderness³."""
    return (
        max(SOLVER, ROUNDING * specimen.slenderness**3) if specimen.slender else SOLVER
    )


def _check_foundation(specimen: Specimen, foundation: float) -> None:
    """Raise InputError for springs so soft that the part's deformation is lost to rounding."""
    least = SOFTEST * float(specimen.elasticity[0, 0]) / specimen.volume ** (1 / 3)
    if foundation < least:
        raise InputError(
            f"foundation: {foundation:g} N/m³ is too soft to hold {specimen.name}; expected at "
            f"least {least:.2g} N/m³ (bolted contacts have some 1e12 to 1e13; "
            "a number without a unit is N/m³)"
        )


def _edge_weights(
    specimen: Specimen, mesh: TetMesh, interface: str, foundation: float | None
) -> Floats:
    """Return ``remaining_at_edges`` (m,); a foundation softer than the part acts as traction."""
    fixed = specimen.list_fixed(rigid=interface == "rigid")
    size = specimen.volume ** (1 / 3)
    if foundation is not None and foundation * size < specimen.elasticity[0, 0]:
        fixed = fixed[1:]
    loaded = [faces for faces in specimen.interfaces if faces not in fixed]
    return remaining_at_edges(mesh, fixed, loaded)


def _geometry_bound(specimen: Specimen, mesh: TetMesh, compliance: Floats) -> Floats:
    """Return bounds (6n, 6n) due to the mesh's shape: bending varies as the section height cubed.

    Misplaced interfaces couple entries that symmetry decouples, far more than a wrong volume.
    """
    diagonal = compliance.diagonal()
    size = np.abs(compliance)
    scale = np.sqrt(np.outer(diagonal, diagonal))
    area, shift = interface_error(specimen, mesh)
    body = (geometric_error(specimen, mesh) + area) * np.maximum(size, 1e-3 * scale)
    return 3 * (body + shift * np.maximum(size, 0.3 * scale))

"""Derivatives of a part's compliance, own weight and mass by its dimensions, material constants and foundation.

With the solutions x held in the unconstrained coordinates the compliance C = Fᵀ A⁻¹ F has the derivative
dC_ij = dF_iᵀ x_j + x_iᵀ dF_j − x_iᵀ dA x_j: no equation is solved for a parameter. For a dimension, dA is that of the
mesh moved with the design velocity (``stiffscope.fea.configurational``), integrated once for all parameters. The
derivatives are those of the discrete compliance, exactly; both levels of the solution (``stiffscope.fea.solution``) are
differentiated, and extrapolated as the compliance itself is.

References
----------
K. K. Choi and N. H. Kim, Structural Sensitivity Analysis and Optimization 1: Linear Systems, Springer, 2005, chapter 6.
"""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from stiffscope.errors import InputError
from stiffscope.fea.configurational import integrals, products
from stiffscope.fea.couplings import carried, rigid_modes, unit_loads
from stiffscope.fea.cubic import cubic_loads, expand
from stiffscope.fea.design_velocity import DesignVelocity
from stiffscope.fea.elasticity import tensor
from stiffscope.fea.foundation import springs
from stiffscope.fea.mass import times
from stiffscope.fea.run import specimen_of
from stiffscope.fea.solution import respond, solve_two_levels

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from scipy.sparse import csr_array

    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.cad.part import Part
    from stiffscope.fea.configurational import Integrals
    from stiffscope.fea.experiment import Experiment
    from stiffscope.fea.mesh import Floats, TetMesh
    from stiffscope.fea.settings import Settings
    from stiffscope.fea.solution import TwoLevel

    Build = Callable[[float], Part]

STEP = 3e-4  # of a dimension: its difference in CAD, whose own precision is some 1e-4 of the step or better
SURFACE_STEP = 1e-4  # of the part's size per unit of velocity: central difference of integrals over faces
MATERIAL_STEP = 1e-5  # of a constant (of one for a ratio): central difference of the elasticity matrix
STILL = 1e-9  # velocity of nodes that do not move relative to their reference point
CUBIC = 3e-2  # relative error of the difference between quadratic and cubic solution for the own weight
# 95 % bounds: in parts of the correction that is extrapolated and of the quadratic-to-cubic difference of a derivative;
# in parts of the geometric mean of two loads' derivatives off the diagonal, where entries may cancel; and relative, for
# the step in CAD and the shape of the mesh.
SPREAD_REMAINING, SPREAD_GAIN, CROSS_TERMS, GEOMETRY = 0.5, 0.15, 2e-3, 5e-4
RATIOS = ("axial_poisson", "transverse_poisson")
CONSTANTS = {"youngs_modulus", "shear_modulus", "axial_modulus", "transverse_modulus", "axial_shear_modulus", *RATIOS}


@dataclass(frozen=True, eq=False)
class Derivative:
    """Derivatives of a part by one parameter; SI, per SI unit of the parameter.

    Attributes
    ----------
    value, unit : of the parameter.
    full_compliance, full_error : (6n, 6n) of the compliance of all n loaded interfaces together, each at its
        reference point, which moves with the part; and its 95 % bounds.
    self_weight, self_weight_error : (3, 6) of the twist of the first interface for 1 m/s² along x, y, z; its bounds.
    mass, centre : kg; (3,) of the centre of mass, m.
    condensed_mass : (6(1+n), 6(1+n)) of the mass on the twists of clamp and interfaces.
    reference_points, clamp_point : (n, 3) and (3,) of these points, m.
    """

    value: float
    unit: str
    full_compliance: Floats
    full_error: Floats
    self_weight: Floats
    self_weight_error: Floats
    mass: float
    centre: Floats
    condensed_mass: Floats
    reference_points: Floats
    clamp_point: Floats

    @property
    def compliance(self) -> Floats:
        """(6, 6) of the compliance of the first interface."""
        return self.full_compliance[:6, :6]

    @property
    def error(self) -> Floats:
        """(6, 6) 95 % bounds of ``compliance``."""
        return self.full_error[:6, :6]


@dataclass(frozen=True, eq=False)
class PartSensitivity:
    """Derivatives of a part by name of parameter; why some parameters have none (``notes``); seconds of the stages."""

    part: str
    derivatives: dict[str, Derivative]
    notes: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)


def part_sensitivity(
    experiment: Experiment, part: Part, settings: Settings, dimensions: Mapping[str, tuple[float, Build]]
) -> PartSensitivity:
    """Return the derivatives of a part by its dimensions, the constants of its material, and its foundation.

    Parameters
    ----------
    experiment : on this part with these settings; its mesh is taken, and solved anew for the fields.
    dimensions : by name, the value in m and the function that builds the part with another one.

    Raises
    ------
    MeshError : see ``stiffscope.fea.solution.solve_specimen``.
    """
    began = time.perf_counter()
    with threadpool_limits(1):
        levels = _solved(experiment, part, settings)
        solved = time.perf_counter()
        moves, notes = _moves(experiment.mesh, part, dimensions)
        moved = time.perf_counter()
        forms = _Forms(levels, experiment, settings, tuple(moves.values()))
        found = {name: forms.of_dimension(number, dimensions[name][0]) for number, name in enumerate(moves)}
        found |= _of_material(forms, part.material)
        if settings.foundation is not None:
            found["foundation"] = forms.of_foundation()
    seconds = {"solve": solved - began, "velocities": moved - solved, "derivatives": time.perf_counter() - moved}
    return PartSensitivity(part.name, found, notes, seconds)


def _solved(experiment: Experiment, part: Part, settings: Settings) -> TwoLevel:
    """Return the two levels of the experiment for its unit wrenches, then for its own weight along x, y, z."""
    specimen, mesh = specimen_of(part, settings), experiment.mesh
    levels = solve_two_levels(specimen, mesh, settings.interface, settings.solver, settings.foundation)
    system, mass = levels.system, levels.system.mass
    accelerated = np.tile(np.eye(3), (system.cubic.space.base, 1))
    force = np.vstack([
        system.supports.restrict(times(mass.nodes, accelerated)),
        times(mass.cubics, accelerated)[system.cubic_rows],
    ])  # fmt: skip
    quadratic = system.solver.solve(force[: len(levels.quadratic)])
    return respond(system, force, quadratic, levels, tolerance=CUBIC)


@dataclass(frozen=True, eq=False)
class _Move:
    """How a part moves with a dimension: velocities of nodes (n, 3), reference points (m, 3) and clamp point (3,)."""

    nodes: Floats
    reference_points: Floats
    clamp_point: Floats


def _moves(
    mesh: TetMesh, part: Part, dimensions: Mapping[str, tuple[float, Build]]
) -> tuple[dict[str, _Move], dict[str, str]]:
    """Return how the part moves with each dimension, and why it does not with the others."""
    moves, notes = {}, {}
    if not dimensions:
        return moves, notes
    velocities = DesignVelocity(mesh, part)
    for name, (value, build) in dimensions.items():
        try:
            changed, step = _changed(build, value)
            moves[name] = _Move(velocities.of(changed, step), *_points(part, changed, step))
        except InputError as error:
            notes[name] = str(error)
    return moves, notes


def _changed(build: Build, value: float) -> tuple[Part, float]:
    """Return the part with a dimension a step larger, or smaller at the end of its range, and that step."""
    try:
        return build(value * (1 + STEP)), value * STEP
    except InputError:
        return build(value * (1 - STEP)), -value * STEP


def _points(part: Part, changed: Part, step: float) -> tuple[Floats, Floats]:
    """Return (n, 3) the velocities of the reference points and (3,) that of the clamped area's centre."""

    def of(one: Part) -> tuple[Floats, Floats]:
        held = [one.faces[index] for index in sorted(one.clamped)]
        centre = np.average([face.centroid for face in held], axis=0, weights=[face.area for face in held])
        return np.array([face.reference_point for face in one.loaded]), centre

    (points, centre), (moved, other) = of(part), of(changed)
    return (moved - points) / step, (other - centre) / step


def _of_material(forms: _Forms, material: AnyMaterial) -> dict[str, Derivative]:
    """Derivatives by each elastic constant of the material, and by its density."""
    found = {}
    for constant in dataclasses.fields(material):
        name = constant.name
        if name not in CONSTANTS:
            continue
        value = getattr(material, name)
        step = MATERIAL_STEP * (1.0 if name in RATIOS else value)
        above, below = (dataclasses.replace(material, **{name: value + sign * step}) for sign in (1, -1))
        change = (above.elasticity() - below.elasticity()) / (2 * step)
        found[name] = forms.of_elasticity(change, value, "1" if name in RATIOS else "Pa")
    return {**found, "density": forms.of_density(material.density)}


@dataclass(frozen=True, eq=False)
class _Forms:
    """The derivatives of a solved part's quantities; loads are w unit wrenches and 3 accelerations, k in all."""

    levels: TwoLevel
    experiment: Experiment
    settings: Settings
    moves: tuple[_Move, ...]

    @cached_property
    def velocity(self) -> Floats:
        """(n, 3, p) the design velocities."""
        nodes = len(self.levels.system.mesh.points)
        return np.array([move.nodes for move in self.moves]).reshape(-1, nodes, 3).transpose(1, 2, 0)

    @property
    def wrenches(self) -> int:
        return len(self.experiment.full_compliance)

    @cached_property
    def lumped(self) -> Floats:
        """(n,) ∫ ρ N of each node's function, kg."""
        return np.asarray(self.levels.system.mass.nodes.sum(axis=1)).reshape(-1)

    @cached_property
    def fields(self) -> tuple[Integrals, Integrals]:
        """Integrals of the cubic and of the quadratic solution."""
        system, k = self.levels.system, self.levels.force.shape[1]
        space = system.cubic.space
        cubic = expand(space, system.supports, system.cubic.free, self.levels.motion)
        quadratic = np.zeros_like(cubic)
        quadratic[: 3 * space.base] = system.supports.expand(self.levels.quadratic)
        return self._integrals(cubic.reshape(-1, 3, k)), self._integrals(quadratic.reshape(-1, 3, k))

    def _integrals(self, motion: Floats) -> Integrals:
        system = self.levels.system
        return integrals(system.mesh, system.cubic.space, system.specimen.elasticity, motion, self.velocity)

    @cached_property
    def ratio(self) -> Floats:
        """(k, k) the extrapolated correction in parts of the quadratic-to-cubic difference."""
        gain = self.levels.gain.diagonal()
        remaining = (self.levels.extrapolated().compliance - self.levels.cubic).diagonal()
        parts = np.clip(remaining / np.maximum(gain, 1e-12 * self.levels.cubic.diagonal()), 0, 2)
        return np.sqrt(np.outer(parts, parts))

    @cached_property
    def shapes(self) -> _Shapes:
        """The static fields of unit twists of clamp and interfaces, in the quadratic solution."""
        w, system, experiment = self.wrenches, self.levels.system, self.experiment
        space, supports = system.cubic.space, system.supports
        loads, unit = self.levels.force[: len(self.levels.quadratic), :w], self.levels.quadratic[:, :w]
        coordinates = unit @ np.linalg.inv(loads.T @ unit)
        loaded = supports.expand(coordinates)
        moved = carried(experiment.reference_points, experiment.clamp_point)
        whole = rigid_modes(system.mesh.points, experiment.clamp_point).reshape(-1, 6)
        fields = np.hstack([whole - loaded @ moved, loaded])
        inertia = supports.restrict(times(self.levels.system.mass.nodes, fields))
        quasistatic = system.solver.solve(inertia)
        quasistatic -= coordinates @ (loads.T @ quasistatic)
        both = np.zeros((3 * space.count, 6 + 2 * w))
        both[: 3 * space.base] = np.hstack([loaded, supports.expand(quasistatic)])
        kinetic = system.specimen.density * products(system.mesh, space, fields.reshape(-1, 3, 6 + w), self.velocity)
        return _Shapes(fields, coordinates, moved, self._integrals(both.reshape(-1, 3, 6 + 2 * w)), kinetic)

    def of_elasticity(self, change: Floats, value: float, unit: str) -> Derivative:
        """Derivative by a material constant that changes the elasticity matrix by (6, 6) per unit."""
        law = tensor(change).transpose(1, 0, 3, 2).reshape(9, 9)
        cubic, quadratic = (-np.einsum("ab,aibj->ij", law, level.gradients) for level in self.fields)
        energy = np.einsum("ab,aibj->ij", law, self.shapes.integrals.gradients)
        made = self._derivative(value, unit, cubic, quadratic)
        return dataclasses.replace(made, condensed_mass=self.shapes.followed(energy))

    def of_foundation(self) -> Derivative:
        """Derivative by the stiffness per area of the foundation under the clamp."""
        unit = springs(self.levels.system.mesh, self.levels.system.specimen.clamped, 1.0)
        cubic, quadratic = (-_squared(level.motion, unit) for level in self.fields)
        return self._derivative(self.settings.foundation or 0.0, "N/m^3", cubic, quadratic)

    def of_density(self, density: float) -> Derivative:
        """Derivative by the density: mass and weight are in proportion to it."""
        w, size = self.wrenches, 6 + self.wrenches
        share = np.zeros_like(self.ratio)
        share[:w, w:] = share[w:, :w] = 1 / density
        share[w:, w:] = 2 / density
        cubic, quadratic = share * self.levels.cubic, share * (self.levels.cubic - self.levels.gain)
        condensed = self.experiment.condensed_mass[:size, :size] / density
        made = self._derivative(density, "kg/m^3", cubic, quadratic)
        return dataclasses.replace(made, mass=self.experiment.mass / density, condensed_mass=condensed)

    def of_dimension(self, number: int, value: float) -> Derivative:
        """Derivative by the dimension of a move."""
        move = self.moves[number]
        slide = self._slide(move)
        motions = self.levels.motion, self.levels.quadratic
        found = [
            self._compliance(level, number, self._turned(slide, motion))
            for level, motion in zip(self.fields, motions, strict=True)
        ]
        for level, on_faces in enumerate(self._on_faces(move)):
            found[level] = found[level] + on_faces
        made = self._derivative(value, "m", found[0], found[1])
        rate, moment = self.mass_rates[number, 0], self.mass_rates[number, 1:] + self.lumped @ move.nodes
        return dataclasses.replace(
            made,
            mass=float(rate),
            centre=(moment - rate * self.experiment.centre) / self.experiment.mass,
            condensed_mass=self._condensed_mass(number, slide),
            reference_points=move.reference_points,
            clamp_point=move.clamp_point,
        )

    def _derivative(self, value: float, unit: str, cubic: Floats, quadratic: Floats) -> Derivative:
        """Extrapolate the derivatives (k, k) of both levels' compliance; of the masses there is none yet."""
        w, gain = self.wrenches, cubic - quadratic
        whole = cubic + self.ratio * gain
        size = np.sqrt(np.abs(np.outer(whole.diagonal(), whole.diagonal())))
        error = (SPREAD_REMAINING * self.ratio + SPREAD_GAIN) * np.abs(gain) + GEOMETRY * np.abs(whole)
        error += CROSS_TERMS * (size - np.diag(size.diagonal()))
        return Derivative(
            value=value,
            unit=unit,
            full_compliance=whole[:w, :w],
            full_error=error[:w, :w],
            self_weight=whole[:6, w:].T,
            self_weight_error=error[:6, w:].T,
            mass=0.0,
            centre=np.zeros(3),
            condensed_mass=np.zeros((6 + w, 6 + w)),
            reference_points=np.zeros((w // 6, 3)),
            clamp_point=np.zeros(3),
        )

    def _compliance(self, level: Integrals, number: int, turned: Floats) -> Floats:
        """Return (k, k) the derivative of one level's compliance, less what integrals over faces add.

        Parameters
        ----------
        turned : (t, 3, k) change of the tied nodes' displacements, the interfaces' twists held.
        """
        tied, w = self.levels.system.supports.tied, self.wrenches
        at_ties = np.einsum("nai,naj->ij", level.forces[tied], turned)
        out = -level.energy[number] - at_ties - at_ties.T
        weight = self.levels.system.specimen.density * level.displacement[number].T
        weight += np.einsum("n,nyi->iy", self.lumped[tied], turned)
        out[:, w:] += weight
        out[w:, :] += weight.T
        return out

    def _slide(self, move: _Move) -> Floats:
        """Return (3t, 6r) the derivative of the tie: its nodes' velocity relative to their reference points."""
        system = self.levels.system
        supports, out = system.supports, np.zeros((len(move.nodes), 3, system.supports.tie.shape[1]))
        couplings = zip(system.couplings, move.reference_points, strict=True)
        for slot, (coupling, at) in enumerate(each for each in couplings if each[0].kind == "rigid"):
            nodes = system.mesh.nodes_of(coupling.faces)
            out[nodes, :, 6 * slot + 3 : 6 * slot + 6] = rigid_modes(move.nodes[nodes], at)[:, :, 3:]
        return out[supports.tied].reshape(3 * len(supports.tied), out.shape[2])

    def _turned(self, slide: Floats, motion: Floats) -> Floats:
        """Return (t, 3, k) change of the tied nodes' displacements for coordinates of k loads."""
        split = 3 * len(self.levels.system.supports.free)
        return (slide @ motion[split : split + slide.shape[1]]).reshape(len(slide) // 3, 3, motion.shape[1])

    def _on_faces(self, move: _Move) -> Iterator[Floats]:
        """Yield (k, k) for either level what foundation and distributed couplings add, where their faces deform.

        By central differences of the integrals over the faces, displacements held.
        """
        system, specimen = self.levels.system, self.levels.system.specimen
        mesh, modulus = system.mesh, self.settings.foundation
        velocity, reference = move.nodes, move.reference_points
        loaded = [
            np.abs(velocity[mesh.nodes_of(coupling.faces)] - at).max()
            for coupling, at in zip(system.couplings, reference, strict=True)
            if coupling.kind == "distributed"
        ]
        bedded = modulus is not None and np.ptp(velocity[mesh.nodes_of(specimen.clamped)], axis=0).max() > STILL
        if not bedded and not any(slip > STILL for slip in loaded):
            return
        split, above = len(self.levels.quadratic), system.cubic.free
        found = [np.zeros_like(self.ratio), np.zeros_like(self.ratio)]
        step = SURFACE_STEP * specimen.volume ** (1 / 3)
        for sign in (step, -step):
            moved = dataclasses.replace(mesh, points=mesh.points + sign * velocity)
            if bedded and modulus is not None:
                bedding = springs(moved, specimen.clamped, modulus)
                for number, level in enumerate(self.fields):
                    found[number] -= _squared(level.motion, bedding) / (2 * sign)
            if loaded:
                couplings = tuple(
                    dataclasses.replace(coupling, reference_point=coupling.reference_point + sign * at)
                    for coupling, at in zip(system.couplings, reference, strict=True)
                )
                nodal = unit_loads(moved, system.supports, couplings)
                cubic = cubic_loads(moved, system.cubic.space, couplings)[above].reshape(-1, nodal.shape[1])
                first = nodal.T @ self.levels.motion[:split] + cubic.T @ self.levels.motion[split:]
                for each, work in zip(found, (first, nodal.T @ self.levels.quadratic), strict=True):
                    each[: self.wrenches] += work / (2 * sign)
                    each[:, : self.wrenches] += work.T / (2 * sign)
        yield from found

    @cached_property
    def mass_rates(self) -> Floats:
        """(p, 4) derivatives of the mass, and of ∫ ρ x dV with x held."""
        system, velocity = self.levels.system, self.velocity
        unit = np.zeros((len(velocity), 3, 4))
        unit[:, 0, 0], unit[:, range(3), range(1, 4)] = 1.0, 1.0
        position = np.zeros_like(unit)
        position[:, 0, 0], position[:, range(3), range(1, 4)] = 1.0, system.mesh.points
        both = np.concatenate([unit, position], axis=2)
        found = system.specimen.density * products(system.mesh, system.cubic.space, both, velocity)
        return np.einsum("pii->pi", found[:, :4, 4:])

    def _condensed_mass(self, number: int, slide: Floats) -> Floats:
        """Return (6 + w, 6 + w) the derivative of the condensed mass."""
        move, shapes, w = self.moves[number], self.shapes, self.wrenches
        tied = self.levels.system.supports.tied
        turned = np.zeros((len(move.nodes), 3, w))
        turned[tied] = self._turned(slide, shapes.coordinates)
        energy = shapes.integrals.energy[number].copy()
        energy[:w, w:] += np.einsum("nai,naj->ij", turned[tied], shapes.integrals.forces[tied][..., w:])
        turned = turned.reshape(-1, w)
        whole = rigid_modes(move.nodes, move.clamp_point)
        farther = carried(move.reference_points, move.clamp_point).reshape(-1, 6, 6)
        whole[:, :, :3] = 0.0
        farther[:, :, :3], farther[:, 3:, 3:] = 0.0, 0.0
        back = shapes.fields[:, 6:] @ farther.reshape(-1, 6) + turned @ shapes.moved
        rates = np.hstack([whole.reshape(-1, 6) - back, turned])
        cross = rates.T @ times(self.levels.system.mass.nodes, shapes.fields)
        return shapes.kinetic[number] + cross + cross.T + shapes.followed(energy)


@dataclass(frozen=True, eq=False)
class _Shapes:
    """Static fields of unit twists of clamp (6) and interfaces (w), and what their change does to the condensed mass.

    Attributes
    ----------
    fields : (3n, 6 + w).
    coordinates : (c, w) of those of the interfaces.
    moved : (w, 6) twists of the interfaces when the part moves with the clamp as a rigid body.
    integrals : of the fields of the interfaces, then of the (6 + w) that the inertia forces of all fields cause with
        the interfaces held.
    kinetic : (p, 6 + w, 6 + w) derivatives of the condensed mass, the nodes' displacements held.
    """

    fields: Floats
    coordinates: Floats
    moved: Floats
    integrals: Integrals
    kinetic: Floats

    def followed(self, energy: Floats) -> Floats:
        """(6 + w, 6 + w) change of the condensed mass as the fields follow a change of energy (6 + 2w, 6 + 2w).

        The fields of the interfaces change by −A⁻¹ dA, the interfaces held; those of the clamp by −``moved`` of that.
        """
        w = len(self.moved)
        change = np.hstack([-self.moved, np.eye(w)]).T @ -energy[:w, w:]
        return change + change.T


def _squared(motion: Floats, matrix: csr_array) -> Floats:
    """Return (k, k) Σ u_iᵀ S u_j of coefficients (count, 3, k) and a matrix (count, count) of one direction."""
    count, _, k = motion.shape
    flat = motion.reshape(3 * count, k)
    return flat.T @ (matrix @ motion.reshape(count, 3 * k)).reshape(3 * count, k)

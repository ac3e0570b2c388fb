"""Derivatives of a solved part's compliance, self-weight deflection and condensed mass.

See ``stiffscope.fea.sensitivity`` for the theory.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.configurational import Integrals, integrals, products
from stiffscope.fea.couplings import unit_loads
from stiffscope.fea.cubic import cubic_loads
from stiffscope.fea.cubic_products import expand
from stiffscope.fea.derivatives import Derivative
from stiffscope.fea.elasticity import tensor
from stiffscope.fea.foundation import springs
from stiffscope.fea.mass import times
from stiffscope.fea.rigid import rigid_modes, rigid_twists

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from stiffscope.fea.experiment import Experiment
    from stiffscope.fea.mesh import Floats
    from stiffscope.fea.settings import Settings
    from stiffscope.fea.solution import Solution

STILL = 1e-9  # velocity of nodes taken as fixed relative to their reference point
SURFACE_STEP = (
    1e-4  # of the part's size per unit velocity: central differences of face integrals
)
# 95 % bounds: as fractions of the extrapolated correction and of the quadratic-to-cubic difference
# of a derivative; off the diagonal, where entries may cancel, of the geometric mean of two loads'
# derivatives; and relative, for the CAD step and the mesh's shape.
SPREAD_REMAINING = 0.5
SPREAD_GAIN = 0.15
CROSS_TERMS = 2e-3
GEOMETRY = 5e-4


@dataclass(frozen=True, eq=False)
class Move:
    """Velocities by one dimension: nodes (n, 3), reference points (m, 3), clamp point (3,)."""

    nodes: Floats
    reference_points: Floats
    clamp_point: Floats


@dataclass(frozen=True, eq=False)
class Forms:
    """Derivatives of a solved part; its loads are w unit wrenches and 3 accelerations, k in all."""

    levels: Solution
    experiment: Experiment
    settings: Settings
    moves: tuple[Move, ...]

    @cached_property
    def velocity(self) -> Floats:
        """Design velocities (n, 3, p)."""
        shape = -1, len(self.levels.system.mesh.points), 3
        return (
            np.array([move.nodes for move in self.moves])
            .reshape(shape)
            .transpose(1, 2, 0)
        )

    @property
    def wrenches(self) -> int:
        """Number of unit wrenches."""
        return len(self.experiment.full_compliance)

    @cached_property
    def lumped_mass(self) -> Floats:
        """∫ ρ N (n,) of each node's function, kg."""
        return np.asarray(self.levels.system.mass.nodes.sum(axis=1)).reshape(-1)

    @cached_property
    def fields(self) -> tuple[Integrals, Integrals]:
        """Integrals of the cubic and the quadratic solution."""
        system = self.levels.system
        cubic = expand(
            system.cubic.space, system.supports, system.cubic.free, self.levels.motion
        )
        quadratic = system.supports.expand(self.levels.quadratic)
        return self._integrals(cubic), self._integrals(quadratic)

    def _integrals(self, motion: Floats) -> Integrals:
        """Integrate fields of nodes (3n, k), or of all functions (3 count, k)."""
        system = self.levels.system
        k = motion.shape[1]
        space = system.cubic.space
        law = system.specimen.elasticity
        coefficients = np.zeros((3 * space.count, k))
        coefficients[: len(motion)] = motion
        coefficients = coefficients.reshape(-1, 3, k)
        return integrals(system.mesh, space, law, coefficients, self.velocity)

    @cached_property
    def ratio(self) -> Floats:
        """Extrapolated correction over the quadratic-to-cubic difference, (k, k)."""
        gain = self.levels.gain.diagonal()
        remaining = (
            self.levels.extrapolate().compliance - self.levels.cubic
        ).diagonal()
        parts = np.clip(
            remaining / np.maximum(gain, 1e-12 * self.levels.cubic.diagonal()), 0, 2
        )
        return np.sqrt(np.outer(parts, parts))

    @cached_property
    def shapes(self) -> _Shapes:
        """Static fields of unit twists of clamp and interfaces, from the quadratic solution."""
        w = self.wrenches
        system = self.levels.system
        experiment = self.experiment
        space = system.cubic.space
        supports = system.supports
        loads = self.levels.force[: len(self.levels.quadratic), :w]
        unit = self.levels.quadratic[:, :w]
        coordinates = unit @ np.linalg.inv(loads.T @ unit)
        loaded = supports.expand(coordinates)
        moved = rigid_twists(experiment.reference_points, experiment.clamp_point)
        whole = rigid_modes(system.mesh.points, experiment.clamp_point).reshape(-1, 6)
        fields = np.hstack([whole - loaded @ moved, loaded])
        inertia = supports.restrict(times(system.mass.nodes, fields))
        quasistatic = system.solver.solve(inertia)
        quasistatic -= coordinates @ (loads.T @ quasistatic)
        found = self._integrals(np.hstack([loaded, supports.expand(quasistatic)]))
        kinetic = products(
            system.mesh, space, fields.reshape(-1, 3, 6 + w), self.velocity
        )
        return _Shapes(
            fields, coordinates, moved, found, system.specimen.density * kinetic
        )

    def of_elasticity(self, change: Floats, value: float, unit: str) -> Derivative:
        """Return the derivative by a constant, given its elasticity derivative (6, 6)."""
        law = tensor(change).transpose(1, 0, 3, 2).reshape(9, 9)
        cubic, quadratic = (
            -np.einsum("ab,aibj->ij", law, level.gradients) for level in self.fields
        )
        energy = np.einsum("ab,aibj->ij", law, self.shapes.integrals.gradients)
        derivative = self._derivative(value, unit, cubic, quadratic)
        return replace(derivative, condensed_mass=self.shapes.follow_fields(energy))

    def of_foundation(self) -> Derivative:
        """Return the derivative by the foundation stiffness per area under the clamp."""
        unit = springs(
            self.levels.system.mesh, self.levels.system.specimen.clamped, 1.0
        )
        cubic, quadratic = (
            -_contract_squares(level.motion, unit) for level in self.fields
        )
        return self._derivative(
            self.settings.foundation or 0.0, "N/m^3", cubic, quadratic
        )

    def of_density(self, density: float) -> Derivative:
        """Return the derivative by the density: mass and weight are proportional to it."""
        w = self.wrenches
        size = 6 + self.wrenches
        share = np.zeros_like(self.ratio)
        share[:w, w:] = share[w:, :w] = 1 / density
        share[w:, w:] = 2 / density
        cubic = share * self.levels.cubic
        quadratic = share * (self.levels.cubic - self.levels.gain)
        condensed = self.experiment.condensed_mass[:size, :size] / density
        derivative = self._derivative(density, "kg/m^3", cubic, quadratic)
        return replace(
            derivative, mass=self.experiment.mass / density, condensed_mass=condensed
        )

    def of_dimension(self, number: int, value: float) -> Derivative:
        """Return the derivative by a move's dimension."""
        move = self.moves[number]
        slide = self._slide(move)
        motions = self.levels.motion, self.levels.quadratic
        moved = self._on_faces(move)
        for k, (level, motion) in enumerate(zip(self.fields, motions, strict=True)):
            moved[k] += self._compliance(level, number, self._turn_tied(slide, motion))
        derivative = self._derivative(value, "m", *moved)
        rate = self.mass_rates[number, 0]
        moment = self.mass_rates[number, 1:] + self.lumped_mass @ move.nodes
        return replace(
            derivative,
            mass=float(rate),
            centre=(moment - rate * self.experiment.centre) / self.experiment.mass,
            condensed_mass=self._condensed_mass(number, slide),
            reference_points=move.reference_points,
            clamp_point=move.clamp_point,
        )

    def _derivative(
        self, value: float, unit: str, cubic: Floats, quadratic: Floats
    ) -> Derivative:
        """Extrapolate both levels' compliance derivatives (k, k); mass derivatives stay zero."""
        w = self.wrenches
        gain = cubic - quadratic
        whole = cubic + self.ratio * gain
        size = np.sqrt(np.abs(np.outer(whole.diagonal(), whole.diagonal())))
        error = (SPREAD_REMAINING * self.ratio + SPREAD_GAIN) * np.abs(
            gain
        ) + GEOMETRY * np.abs(whole)
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
        """Return the derivative (k, k) of one level's compliance, without face integrals.

        Parameters
        ----------
        turned : (t, 3, k) change of tied displacements with fixed interface twists.
        """
        tied = self.levels.system.supports.tied
        w = self.wrenches
        at_ties = np.einsum("nai,naj->ij", level.forces[tied], turned)
        out = -level.energy[number] - at_ties - at_ties.T
        weight = self.levels.system.specimen.density * level.displacement[number].T
        weight += np.einsum("n,nyi->iy", self.lumped_mass[tied], turned)
        out[:, w:] += weight
        out[w:, :] += weight.T
        return out

    def _slide(self, move: Move) -> Floats:
        """Return the tie's derivative (3t, 6r): node velocities relative to reference points."""
        system = self.levels.system
        supports = system.supports
        out = np.zeros((len(move.nodes), 3, system.supports.tie.shape[1]))
        couplings = zip(system.couplings, move.reference_points, strict=True)
        for slot, (coupling, at) in enumerate(
            pair for pair in couplings if pair[0].kind == "rigid"
        ):
            nodes = system.mesh.nodes_of(coupling.faces)
            out[nodes, :, 6 * slot + 3 : 6 * slot + 6] = rigid_modes(
                move.nodes[nodes], at
            )[:, :, 3:]
        return out[supports.tied].reshape(3 * len(supports.tied), out.shape[2])

    def _turn_tied(self, slide: Floats, motion: Floats) -> Floats:
        """Return the change (t, 3, k) of tied displacements for coordinates of k loads."""
        split = 3 * len(self.levels.system.supports.free)
        return (slide @ motion[split : split + slide.shape[1]]).reshape(
            len(slide) // 3, 3, motion.shape[1]
        )

    def _on_faces(self, move: Move) -> list[Floats]:
        """Return contributions (k, k) of deforming foundation and loaded faces, for each level.

        By central differences of the face integrals with fixed displacements.
        """
        system = self.levels.system
        specimen = self.levels.system.specimen
        mesh = system.mesh
        modulus = self.settings.foundation
        velocity = move.nodes
        reference = move.reference_points
        loaded = [
            np.abs(velocity[mesh.nodes_of(coupling.faces)] - at).max()
            for coupling, at in zip(system.couplings, reference, strict=True)
            if coupling.kind == "distributed"
        ]
        forms = [np.zeros_like(self.ratio), np.zeros_like(self.ratio)]
        slip = np.ptp(velocity[mesh.nodes_of(specimen.clamped)], axis=0).max()
        bedded = modulus is not None and slip > STILL
        if not bedded and not any(slip > STILL for slip in loaded):
            return forms
        split = len(self.levels.quadratic)
        above = system.cubic.free
        step = SURFACE_STEP * specimen.volume ** (1 / 3)
        for sign in (step, -step):
            moved = replace(mesh, points=mesh.points + sign * velocity)
            if bedded and modulus is not None:
                bedding = springs(moved, specimen.clamped, modulus)
                for k, level in enumerate(self.fields):
                    forms[k] -= _contract_squares(level.motion, bedding) / (2 * sign)
            if loaded:
                couplings = tuple(
                    replace(
                        coupling, reference_point=coupling.reference_point + sign * at
                    )
                    for coupling, at in zip(system.couplings, reference, strict=True)
                )
                nodal = unit_loads(moved, system.supports, couplings)
                cubic = cubic_loads(moved, system.cubic.space, couplings)[
                    above
                ].reshape(-1, nodal.shape[1])
                first = (
                    nodal.T @ self.levels.motion[:split]
                    + cubic.T @ self.levels.motion[split:]
                )
                for each, work in zip(
                    forms, (first, nodal.T @ self.levels.quadratic), strict=True
                ):
                    each[: self.wrenches] += work / (2 * sign)
                    each[:, : self.wrenches] += work.T / (2 * sign)
        return forms

    @cached_property
    def mass_rates(self) -> Floats:
        """Derivatives (p, 4) of the mass, and of ∫ ρ x dV with fixed x."""
        system = self.levels.system
        velocity = self.velocity
        both = np.zeros(
            (len(velocity), 3, 8)
        )  # 1 and 1 along x, then 1 and the position per axis
        both[:, 0, [0, 4]] = 1.0
        both[:, range(3), range(1, 4)] = 1.0
        both[:, range(3), range(5, 8)] = system.mesh.points
        rates = products(system.mesh, system.cubic.space, both, velocity)
        return system.specimen.density * np.einsum("pii->pi", rates[:, :4, 4:])

    def _condensed_mass(self, number: int, slide: Floats) -> Floats:
        """Return the derivative (6 + w, 6 + w) of the condensed mass."""
        move = self.moves[number]
        shapes = self.shapes
        w = self.wrenches
        tied = self.levels.system.supports.tied
        turned = np.zeros((len(move.nodes), 3, w))
        turned[tied] = self._turn_tied(slide, shapes.coordinates)
        energy = shapes.integrals.energy[number].copy()
        energy[:w, w:] += np.einsum(
            "nai,naj->ij", turned[tied], shapes.integrals.forces[tied][..., w:]
        )
        turned = turned.reshape(-1, w)
        origin = np.zeros(
            (1, 3)
        )  # the rates of the levers alone: less the modes without levers
        whole = rigid_modes(move.nodes, move.clamp_point) - rigid_modes(origin, origin)
        farther = rigid_twists(move.reference_points, move.clamp_point).reshape(
            -1, 6, 6
        ) - np.eye(6)
        back = shapes.fields[:, 6:] @ farther.reshape(-1, 6) + turned @ shapes.moved
        rates = np.hstack([whole.reshape(-1, 6) - back, turned])
        cross = rates.T @ times(self.levels.system.mass.nodes, shapes.fields)
        return shapes.kinetic[number] + cross + cross.T + shapes.follow_fields(energy)


@dataclass(frozen=True, eq=False)
class _Shapes:
    """Static fields of unit twists of clamp (6) and interfaces (w), for the condensed mass.

    Attributes
    ----------
    fields : (3n, 6 + w) nodal displacements.
    coordinates : (c, w) of the interface fields.
    moved : (w, 6) interface twists if the part moves with the clamp as a rigid body.
    integrals : of the interface fields, then of the (6 + w) responses to all fields' inertia forces
        with fixed interfaces.
    kinetic : (p, 6 + w, 6 + w) derivatives of the condensed mass with fixed nodal displacements.
    """

    fields: Floats
    coordinates: Floats
    moved: Floats
    integrals: Integrals
    kinetic: Floats

    def follow_fields(self, energy: Floats) -> Floats:
        """Return the condensed-mass change (6 + w, 6 + w) from an energy change (6 + 2w, 6 + 2w).

        With fixed interfaces, interface fields change by −A⁻¹ dA; clamp fields by −``moved`` of it.
        """
        w = len(self.moved)
        change = np.hstack([-self.moved, np.eye(w)]).T @ -energy[:w, w:]
        return change + change.T


def _contract_squares(motion: Floats, matrix: csr_array) -> Floats:
    """Return Σ u_iᵀ S u_j (k, k) for coefficients (count, 3, k) and a one-direction matrix S."""
    flat = motion.reshape(-1, motion.shape[2])
    return flat.T @ times(matrix, flat)

"""Dynamics of a solved part: frequencies, self-weight deflection, mass condensed on interfaces.

Self-weight along three axes and the lowest modes' inertia forces are further loads of the static
experiment: their compliance entries are extrapolated and bounded as all others.
"""

# pyright: reportOptionalSubscript=false
# (scipy declares its types loosely)

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh
from threadpoolctl import threadpool_limits

from stiffscope.errors import InputError
from stiffscope.fea.geometry import centroid
from stiffscope.fea.mass import times
from stiffscope.fea.mesh import Floats
from stiffscope.fea.modes import BEYOND, count_whole, lowest_modes, ritz
from stiffscope.fea.rigid import rigid_modes, rigid_twists
from stiffscope.fea.settings import MOST_MODES, Settings
from stiffscope.fea.solution import Solution, System, accelerate
from stiffscope.fea.solvers import in_portions

if TYPE_CHECKING:
    from collections.abc import Callable


FREQUENCIES = 6  # of the clamped part
GUARD = 6  # additional vectors in a block, for faster convergence
FIXED = 6  # default number of fixed-interface modes, completed by clamped modes
MODE = 1e-5
EXACT = 1e-8  # relative errors of squared fixed-interface and clamped frequencies
# Remaining error of the cubic solution away from singular edges, over the quadratic-to-cubic
# difference. Half of that in statics: modes are smooth, and cubic functions represent them well.
ELSEWHERE = 0.04

Modes = tuple[Floats, Floats, Floats]  # squares, modes, and their forces


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Dynamic results; the fields are those of ``stiffscope.fea.experiment.Experiment``."""

    condensed_mass: Floats
    mode_squares: Floats
    mode_squares_error: Floats
    self_weight: Floats
    self_weight_error: Floats
    frequencies: Floats
    frequency_error: Floats


@dataclass(frozen=True)
class _Vibration:
    """Eigenproblem of a clamped system on unconstrained coordinates, interfaces free or fixed.

    Attributes
    ----------
    constraint : (c, 6n) static motion per unit twist component of an interface, others fixed.
    """

    system: System
    loads: Floats
    constraint: Floats

    def stiffness(self, motion: Floats) -> Floats:
        return self.system.apply(motion)

    def inertia(self, motion: Floats) -> Floats:
        supports = self.system.supports
        return supports.restrict(times(self.system.mass.nodes, supports.expand(motion)))

    def precondition(self, force: Floats) -> Floats:
        """Return the preconditioner's motion for forces, with zero twist of all interfaces."""
        motion = self.system.solver.precondition(
            force - self.loads @ (self.constraint.T @ force)
        )
        return motion - self.constraint @ (self.loads.T @ motion)

    @property
    def exact(self) -> bool:
        """Whether the preconditioner is the exact inverse of the stiffness."""
        return self.system.solver.precondition is self.system.solver.solve

    def fixed_modes(self, start: Floats, count: int, tolerance: float) -> Modes:
        """Return fixed-interface squares (b,), modes (c, b) and their forces without reactions."""
        operators = self.stiffness, self.inertia, self.precondition
        return lowest_modes(*operators, start, count, tolerance, exact=self.exact)

    def orthogonal(self, basis: Floats, forces: Floats) -> tuple[Floats, Floats]:
        """Return squares (k,) and mass-normalized combinations (c, k) that the stiffness decouples.

        Parameters
        ----------
        basis, forces : (c, m) motions with fixed interfaces, and their forces without reactions.
        """
        squares = np.zeros(0)
        for _ in range(2 if basis.shape[1] else 0):  # twice, against rounding
            energy = basis.T @ forces
            squares, turn = ritz(
                (energy + energy.T) / 2, basis.T @ self.inertia(basis), basis.shape[1]
            )
            basis = basis @ turn
            forces = forces @ turn
        return squares, basis

    def clamped_modes(self, near: Floats) -> Modes:
        """Return squares (k,), clamped modes (c, k) and forces; start from ``near``.

        At least six; equal ones stay together.
        """
        basis = np.hstack([self.constraint, near])
        operators = self.stiffness, self.inertia, self.system.solver.precondition
        energy, kinetic = (basis.T @ operator(basis) for operator in operators[:2])
        start = basis @ ritz(energy, kinetic, FREQUENCIES + GUARD)[1]
        squares, modes, forces = lowest_modes(
            *operators, start, FREQUENCIES + BEYOND, EXACT, exact=self.exact
        )
        count = count_whole(squares, FREQUENCIES)
        return squares[:count], modes[:, :count], forces[:, :count]


def vibration_of(levels: Solution) -> _Vibration:
    """Return the eigenproblem of a system solved for its unit wrenches."""
    loads = levels.force[: len(levels.quadratic)]
    constraint = levels.quadratic @ np.linalg.inv(loads.T @ levels.quadratic)
    return _Vibration(levels.system, loads, constraint)


def compute_dynamics(levels: Solution, settings: Settings) -> Dynamics:
    """Compute modes, self-weight deflection and the mass condensed on interfaces and modes.

    Parameters
    ----------
    levels : solution of the part for its unit wrenches.

    Raises
    ------
    InputError : if more than ``MOST_MODES`` modes lie below the settings' highest frequency.
    MeshError : if the iteration does not converge.
    """
    with threadpool_limits(1):
        vibration = vibration_of(levels)
        squares, fixed, clamped_squares, clamped = _modes(vibration, settings)
        weight, weight_error, frequencies, frequency_error = _extrapolate_modes(
            levels, clamped
        )
        every = np.append(squares, clamped_squares), np.hstack([fixed, clamped])
        both = _gain_on_cubics(vibration, *every)
        gain = both[: len(squares)]
        known = both[len(squares) :]
        softer = (
            clamped_squares / (2 * np.pi * frequencies) ** 2 - 1
        ).mean() / known.mean()
        wide = (
            2 * frequency_error / frequencies
        ).max() / known.mean()  # relative to the gain
        return Dynamics(
            condensed_mass=condense_mass(levels, fixed),
            mode_squares=squares / (1 + softer * gain),
            mode_squares_error=squares * wide * gain,
            self_weight=weight,
            self_weight_error=weight_error,
            frequencies=frequencies,
            frequency_error=frequency_error,
        )


def _modes(
    vibration: _Vibration, settings: Settings
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return fixed-interface squares (k,) and modes (c, k), clamped squares (6,) and modes (c, 6).

    By default the ``FIXED`` lowest fixed-interface modes, completed by the clamped modes' motions
    relative to the constraint modes and made orthogonal in mass and stiffness: the condensed model
    then contains the clamped modes exactly. Both are cut where squares have a gap: half of a round
    part's pair would stiffen the part in one direction of its cross-section.
    """
    rng = np.random.default_rng(0)

    def some(count: int) -> Floats:
        return vibration.precondition(rng.normal(size=(len(vibration.loads), count)))

    if settings.highest_frequency is not None:
        highest = (2 * np.pi * settings.highest_frequency) ** 2
        count, near, forces = _up_to(vibration, some, highest)
    else:
        count = FIXED if settings.modes is None else settings.modes
        start = some(count + GUARD)
        squares, near, forces = vibration.fixed_modes(start, count + BEYOND, MODE)
        count = count_whole(squares, count)
    clamped_squares, clamped, pulling = vibration.clamped_modes(near)
    basis = near[:, :count]
    forces = forces[:, :count]
    if settings.modes is None and settings.highest_frequency is None:
        relative = clamped - vibration.constraint @ (vibration.loads.T @ clamped)
        basis = np.hstack([basis, relative])
        forces = np.hstack([forces, pulling])
    six = slice(FREQUENCIES)
    return *vibration.orthogonal(basis, forces), clamped_squares[six], clamped[:, six]


def _up_to(
    vibration: _Vibration, some: Callable[[int], Floats], highest: float
) -> tuple[int, Floats, Floats]:
    """Return the number of modes below a square (rad²/s²), and a block beyond it with its forces.

    Equal modes that the square divides count as below.
    """
    count = 8
    near = some(count + GUARD)
    while True:
        squares, near, forces = vibration.fixed_modes(near, count, MODE)
        below = count_whole(squares[:count], int(np.searchsorted(squares, highest)))
        if below < count:
            return below, near, forces
        if count >= MOST_MODES:
            reached, wanted = np.sqrt([squares[count - 1], highest]) / (2 * np.pi)
            most = f"at most {MOST_MODES} modes below it, that is less than {reached:.4g} Hz"
            got = f"for {vibration.system.specimen.name}, got {wanted:.4g} Hz"
            raise InputError(f"mesh.highest_frequency: expected {most} {got}")
        near = np.hstack([near, some(min(count, MOST_MODES - count))])
        count = min(2 * count, MOST_MODES)


def _gain_on_cubics(vibration: _Vibration, squares: Floats, modes: Floats) -> Floats:
    """Estimate the relative softening (k,) of modes (c, k) by cubic functions: one Jacobi step."""
    system = vibration.system

    def soften(modes: Floats, squares: Floats) -> Floats:
        inertia = (
            times(system.mass.cubics, system.supports.expand(modes))[system.cubic_rows]
            * squares
        )
        stresses = system.cubic.apply(np.vstack([modes, np.zeros_like(inertia)]))[
            len(modes) :
        ]
        residual = np.vstack([np.zeros_like(modes), inertia - stresses])
        return (
            np.sum(
                residual * system.cubic.precondition(residual), axis=0, keepdims=True
            )
            / squares
        )

    return in_portions(soften)(modes, squares[None])[0]


def clamp_point(system: System) -> Floats:
    """Return the centroid (3,), m, of the clamped area on a system's mesh."""
    return centroid(system.mesh.points[system.mesh.facets_of(system.specimen.clamped)])


def condense_mass(levels: Solution, fixed: Floats | None = None) -> Floats:
    """Return the mass (6(1+n)+k, 6(1+n)+k) on clamp and interface twists, and on modes (c, k)."""
    system = levels.system
    clamp = clamp_point(system)
    whole = rigid_modes(system.mesh.points, clamp).reshape(-1, 6)
    moved = rigid_twists(
        np.array([point for _, point in system.specimen.loaded]), clamp
    )
    twists = levels.force.T @ levels.motion
    loaded = levels.displacement @ np.linalg.inv(twists)
    modes = [] if fixed is None else [system.supports.expand(fixed)]
    basis = np.hstack([whole - loaded @ moved, loaded, *modes])
    condensed = basis.T @ times(system.mass.nodes, basis)
    return (condensed + condensed.T) / 2


def _extrapolate_modes(
    levels: Solution, modes: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return ``self_weight`` and ``frequencies``, each with errors, from clamped modes (c, 6)."""
    system = levels.system
    mass = levels.system.mass
    split = len(levels.quadratic)
    wrenches = levels.force.shape[1]
    gravity = np.tile(np.eye(3), (system.cubic.space.base, 1))
    both = accelerate(levels, np.hstack([gravity, system.supports.expand(modes)]))
    estimate = both.extrapolate()
    vibration = both.extrapolate(ELSEWHERE)
    weights = slice(wrenches, wrenches + 3)
    vibrating = slice(wrenches + 3, None)

    motion = both.motion[:, vibrating]
    nodal = system.supports.expand(motion[:split])
    above = motion[split:]
    cross = above.T @ times(mass.cubics, nodal)[system.cubic_rows]
    kinetic = (
        nodal.T @ times(mass.nodes, nodal) + cross + cross.T
    )  # cubics' own is fourth order
    cubic, compliance, error = (
        matrix[vibrating, vibrating]
        for matrix in (both.cubic, vibration.compliance, vibration.error)
    )
    squares, turn = eigh(cubic, kinetic)  # one further inverse iteration
    static = np.diagonal(turn.T @ cubic @ turn)
    exact = np.diagonal(turn.T @ compliance @ turn) / static
    bound = np.abs(turn).T @ error @ np.abs(turn) / np.sqrt(np.outer(static, static))
    frequencies = np.sqrt(squares / exact) / (2 * np.pi)
    weight, weight_error = (
        matrix[:6, weights].T for matrix in (estimate.compliance, estimate.error)
    )
    return (
        weight,
        weight_error,
        frequencies,
        frequencies * _shift(1 / squares, bound) / 2,
    )


def _shift(values: Floats, error: Floats) -> Floats:
    """Return relative eigenvalue bounds (k,) from relative errors (k, k) in the eigenvectors.

    First order for close eigenvalues; for distant ones second order in the coupling error.
    """
    gap = np.abs(values[:, None] - values) / np.sqrt(np.outer(values, values))
    coupled = np.minimum(error, error**2 / np.maximum(gap, 1e-300))
    return error.diagonal() + coupled.sum(axis=1) - coupled.diagonal()

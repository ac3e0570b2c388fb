"""What a solved part's mass does: natural frequencies, deflection under its own weight, mass condensed on interfaces.

The own weight along three axes and the inertia forces of the lowest modes are further loads of the static experiment:
the entries that they add to its compliance are extrapolated, and bounded, as all others are.
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
from stiffscope.fea.modes import lowest_modes, ritz
from stiffscope.fea.rigid import rigid_modes, rigid_twists
from stiffscope.fea.settings import MOST_MODES
from stiffscope.fea.solution import accelerate

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.fea.mesh import Floats
    from stiffscope.fea.settings import Settings
    from stiffscope.fea.solution import System, TwoLevel
    from stiffscope.fea.solvers import Solve

FREQUENCIES = 6  # of the clamped part
GUARD = 6  # vectors of a block beyond the wanted modes: those converge the faster
FIXED = 6  # fixed-interface modes by default, which the motions of the clamped modes complete
MODE, EXACT = 1e-5, 1e-8  # relative errors of the squared frequencies of fixed-interface and of clamped modes
# Remaining error of the cubic solution away from singular edges, in parts of the quadratic-to-cubic difference. Half of
# that in statics: a mode's waves are smooth, and cubic functions lack little that quadratic ones lack.
ELSEWHERE = 0.04


@dataclass(frozen=True, eq=False)
class Dynamics:
    """See the fields of the same names of ``stiffscope.fea.experiment.Experiment``."""

    condensed_mass: Floats
    mode_squares: Floats
    mode_squares_error: Floats
    self_weight: Floats
    self_weight_error: Floats
    frequencies: Floats
    frequency_error: Floats


@dataclass(frozen=True)
class _Vibration:
    """The eigenproblem of a system on its unconstrained coordinates, clamped; and with its interfaces held besides.

    Attributes
    ----------
    constraint : (c, 6n) static motion for each unit twist component of an interface, the others held.
    """

    system: System
    loads: Floats
    constraint: Floats

    def stiffness(self, motion: Floats) -> Floats:
        supports = self.system.supports
        return supports.restrict(self.system.stiffness @ supports.expand(motion))

    def inertia(self, motion: Floats) -> Floats:
        supports = self.system.supports
        return supports.restrict(times(self.system.mass.nodes, supports.expand(motion)))

    def precondition(self, force: Floats) -> Floats:
        """Return the preconditioner's motion for forces, with no twist of any interface."""
        motion = self.system.solver.precondition(force - self.loads @ (self.constraint.T @ force))
        return motion - self.constraint @ (self.loads.T @ motion)

    @property
    def exact(self) -> bool:
        """Whether the preconditioner is the inverse of the stiffness."""
        return self.system.solver.precondition is self.system.solver.solve

    def fixed_modes(self, start: Floats, count: int, tolerance: float) -> tuple[Floats, Floats, Floats]:
        """Return (b,) squares, (c, b) modes with the interfaces held, and the forces of these but for the reactions."""
        return lowest_modes(self.stiffness, self.inertia, self.precondition, start, count, tolerance, exact=self.exact)

    def orthogonal(self, basis: Floats, forces: Floats) -> tuple[Floats, Floats]:
        """Return (k,) squares and (c, k) mass-normalized combinations of motions that stiffness decouples.

        Parameters
        ----------
        basis, forces : (c, m) motions with the interfaces held, and the forces of these but for the reactions.
        """
        squares = np.zeros(0)
        for _ in range(2 if basis.shape[1] else 0):  # once more: rounding of the first
            energy = basis.T @ forces
            squares, turn = ritz((energy + energy.T) / 2, basis.T @ self.inertia(basis), basis.shape[1])
            basis, forces = basis @ turn, forces @ turn
        return squares, basis

    def clamped_modes(self, near: Floats) -> tuple[Floats, Floats, Floats]:
        """Return (6 + g,) squares, (c, 6 + g) modes and their forces, from fixed-interface modes to start near."""
        basis = np.hstack([self.constraint, near])
        _, turn = ritz(basis.T @ self.stiffness(basis), basis.T @ self.inertia(basis), FREQUENCIES + GUARD)
        precondition: Solve = self.system.solver.precondition
        start = basis @ turn
        return lowest_modes(self.stiffness, self.inertia, precondition, start, FREQUENCIES, EXACT, exact=self.exact)


def vibration_of(levels: TwoLevel) -> _Vibration:
    """Return the eigenproblem of a system that is solved for its unit wrenches."""
    loads = levels.force[: len(levels.quadratic)]
    return _Vibration(levels.system, loads, levels.quadratic @ np.linalg.inv(loads.T @ levels.quadratic))


def compute_dynamics(levels: TwoLevel, settings: Settings) -> Dynamics:
    """Return what the mass of a part does: modes, own weight, and the mass condensed on interfaces and modes.

    Parameters
    ----------
    levels : the part's two solutions for its unit wrenches.

    Raises
    ------
    InputError : more modes below the highest frequency of the settings than ``MOST_MODES``.
    MeshError : no convergence.
    """
    with threadpool_limits(1):
        vibration = vibration_of(levels)
        squares, fixed, clamped_squares, clamped = _modes(vibration, settings)
        weight, weight_error, frequencies, frequency_error = _extrapolate_modes(levels, clamped)
        both = _gain_on_cubics(vibration, np.append(squares, clamped_squares), np.hstack([fixed, clamped]))
        gain, known = both[: len(squares)], both[len(squares) :]
        softer = (clamped_squares / (2 * np.pi * frequencies) ** 2 - 1).mean() / known.mean()
        wide = (2 * frequency_error / frequencies).max() / known.mean()  # bounds of squares, too, in parts of the gain
        return Dynamics(
            condensed_mass=condense_mass(levels, fixed),
            mode_squares=squares / (1 + softer * gain),
            mode_squares_error=squares * wide * gain,
            self_weight=weight,
            self_weight_error=weight_error,
            frequencies=frequencies,
            frequency_error=frequency_error,
        )


def _modes(vibration: _Vibration, settings: Settings) -> tuple[Floats, Floats, Floats, Floats]:
    """Return (k,) squares and (c, k) modes with the interfaces held, (6,) squares and (c, 6) clamped modes.

    By default they are the ``FIXED`` lowest fixed-interface modes, and those combinations of them and of the clamped
    modes' motions relative to the constraint modes that are orthogonal in mass and stiffness: so the condensed model
    has the clamped modes themselves.
    """
    rng = np.random.default_rng(0)

    def some(count: int) -> Floats:
        return vibration.precondition(rng.normal(size=(len(vibration.loads), count)))

    if settings.highest_frequency is not None:
        highest = (2 * np.pi * settings.highest_frequency) ** 2
        squares, near, forces = _up_to(vibration, some, highest)
        count = int(np.searchsorted(squares, highest))
    else:
        count = FIXED if settings.modes is None else settings.modes
        _, near, forces = vibration.fixed_modes(some(count + GUARD), count, MODE)
    clamped_squares, clamped, pulling = (part[..., :FREQUENCIES] for part in vibration.clamped_modes(near))
    basis, forces = near[:, :count], forces[:, :count]
    if settings.modes is None and settings.highest_frequency is None:
        relative = clamped - vibration.constraint @ (vibration.loads.T @ clamped)
        basis, forces = np.hstack([basis, relative]), np.hstack([forces, pulling])
    return *vibration.orthogonal(basis, forces), clamped_squares, clamped


def _up_to(vibration: _Vibration, some: Callable[[int], Floats], highest: float) -> tuple[Floats, Floats, Floats]:
    """Return squares, fixed-interface modes and their forces of a block that goes beyond a square (rad²/s²)."""
    count = 8
    near = some(count + GUARD)
    while True:
        squares, near, forces = vibration.fixed_modes(near, count, MODE)
        if squares[count - 1] > highest:
            return squares, near, forces
        if count >= MOST_MODES:
            reached = np.sqrt(squares[count - 1]) / (2 * np.pi)
            raise InputError(
                f"mesh.highest_frequency: expected at most {MOST_MODES} modes below it, that is less than "
                f"{reached:.4g} Hz for {vibration.system.specimen.name}, got {np.sqrt(highest) / (2 * np.pi):.4g} Hz"
            )
        near, count = np.hstack([near, some(min(count, MOST_MODES - count))]), min(2 * count, MOST_MODES)


def _gain_on_cubics(vibration: _Vibration, squares: Floats, modes: Floats) -> Floats:
    """Return (k,) estimates of how much cubic functions soften modes (c, k), relative: one step of Jacobi's method."""
    cubic, mass = vibration.system.cubic, vibration.system.mass
    free = vibration.system.cubic_rows
    force = np.zeros((len(modes) + len(free), modes.shape[1]))
    start = np.vstack([modes, force[len(modes) :]])
    force[len(modes) :] = times(mass.cubics, vibration.system.supports.expand(modes))[free] * squares
    residual = force - cubic.apply(start)
    residual[: len(modes)] = 0
    return np.einsum("ij,ij->j", residual, cubic.precondition(residual)) / squares


def condense_mass(levels: TwoLevel, fixed: Floats | None = None) -> Floats:
    """Return (6(1+n)+k, 6(1+n)+k) the mass on the clamp's twist, the interfaces' twists, and modes (c, k) if given."""
    system = levels.system
    mesh, specimen = system.mesh, system.specimen
    clamp = centroid(mesh.points[mesh.facets_of(specimen.clamped)])
    whole = rigid_modes(mesh.points, clamp).reshape(-1, 6)
    moved = rigid_twists(np.array([point for _, point in specimen.loaded]), clamp)
    twists = levels.force.T @ levels.motion
    loaded = levels.displacement @ np.linalg.inv(twists)
    modes = [] if fixed is None else [system.supports.expand(fixed)]
    basis = np.hstack([whole - loaded @ moved, loaded, *modes])
    condensed = basis.T @ times(system.mass.nodes, basis)
    return (condensed + condensed.T) / 2


def _extrapolate_modes(levels: TwoLevel, modes: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return ``self_weight`` and ``frequencies``, each with its error, from clamped modes (c, 6)."""
    system, mass = levels.system, levels.system.mass
    nodes, count = system.cubic.space.base, modes.shape[1]
    rows, split = system.cubic_rows, len(levels.quadratic)
    both = accelerate(levels, np.hstack([np.tile(np.eye(3), (nodes, 1)), system.supports.expand(modes)]))
    found, vibration, wrenches = both.extrapolate(), both.extrapolate(ELSEWHERE), levels.force.shape[1]
    weights, vibrating = slice(wrenches, wrenches + 3), slice(wrenches + 3, None)

    motion = both.motion[:, vibrating]
    nodal, above = system.supports.expand(motion[:split]), np.zeros((mass.cubics.shape[0] * 3, count))
    above[rows] = motion[split:]
    cross = above.T @ times(mass.cubics, nodal)
    kinetic = nodal.T @ times(mass.nodes, nodal) + cross + cross.T  # less the cubics' own, which is of fourth order
    squares, turn = eigh(both.cubic[vibrating, vibrating], kinetic)  # the modes' motions are one inverse iteration on
    static = turn.T @ both.cubic[vibrating, vibrating] @ turn
    exact = np.diagonal(turn.T @ vibration.compliance[vibrating, vibrating] @ turn) / static.diagonal()
    bound = np.abs(turn).T @ vibration.error[vibrating, vibrating] @ np.abs(turn)
    bound /= np.sqrt(np.outer(static.diagonal(), static.diagonal()))
    frequencies = np.sqrt(squares / exact) / (2 * np.pi)
    return (
        found.compliance[:6, weights].T,
        found.error[:6, weights].T,
        frequencies,
        frequencies * _shift(1 / squares, bound) / 2,
    )


def _shift(values: Floats, error: Floats) -> Floats:
    """Return (k,) relative bounds of eigenvalues (k,) of a matrix with relative errors (k, k) in its eigenvectors.

    To first order where two are close, to second order in the error that couples them where they are apart.
    """
    gap = np.abs(values[:, None] - values) / np.sqrt(np.outer(values, values))
    coupled = np.minimum(error, error**2 / np.maximum(gap, 1e-300))
    return error.diagonal() + coupled.sum(axis=1) - coupled.diagonal()

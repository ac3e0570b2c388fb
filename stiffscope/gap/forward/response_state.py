"""A robot with effects as it was hit: lines of one block of responses, and their derivatives.

Between ports i and j the receptance is ``H = Σ φ_i φ_j g`` with ``g = 1/(k + s² m + 2 ζ s √(k m))``
of each mode. A change δC of an element's compliance, δM of a mass at a node or δK of a joint's
spring changes it by

    δH = W_i · δC W_j - u_i · (s² δM + δK) u_j,

with the wrench W in the element and the motion u of the node under unit forces at the ports
(docs/theory.md, section 11.8). W is that of the static response to the port's force and to the
inertial loads of all modes that do not follow statically.

Damping by mode, gain and phase of each channel and its small rotation are fitted with every
prediction, and no cause: readings and derivatives are without what these can follow.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from stiffscope.gap.campaign.response_lines import stack_parts
from stiffscope.responses.model import DERIVATIVES
from stiffscope.vjm.network.network import place_nodes
from stiffscope.vjm.vibration.modal_model import SolvedModes, solve_all_modes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.gap.campaign.response_lines import ResponseBlock
    from stiffscope.gap.effects.effect import Payload
    from stiffscope.responses.model import Direction
    from stiffscope.runtime.types import Array, Complex, Flags, Indices
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.network.network import Places
    from stiffscope.vjm.vibration.changed_modes import ChangedModes
    from stiffscope.vjm.vibration.coordinates import PointMass


@dataclass(frozen=True)
class NuisanceSettings:
    """Prior standard deviations of what is the instruments', and how damping is fitted.

    Attributes
    ----------
    gain
        Of the gain of every response, relative, and of its phase, rad.
    turn
        Of every direction of force or motion, rad.
    damping
        Of the logarithm of a mode's damping ratio.
    coupling
        Of the coupling of the damping of two close modes, relative to their own.
    coupled
        Largest coupling.
    close
        Distance of close modes, relative to frequency, over their damping ratio: twice the
        half-power width.
    heard
        Change of a line by twice the damping of a mode, over the noise of all responses, from which
        it is fitted.
    rounds
        Most steps of the fit of damping.
    marquardt
        Relative increase of the diagonal with which they start.
    easier, stiffer
        Factors by which it falls after a step that gains, and rises after one that does not.
    step
        Largest change of that logarithm in one.
    settled
        Change at which the fit ends.
    gained, share
        Change of χ² at which it ends, and more of what is beyond the noise.
    least, most
        Range of damping ratios.
    beside
        Modes whose damping is fitted, where heard: from the lowest line over, to the highest times
        this.
    static
        Frequency of modes over the highest line from which inertial loads are left out of
        derivatives.
    distant
        χ² per reading from which the fitted damping is none of the modes'.
    far
        The same from which modes have no damping, and no more than their inertia.
    """

    gain: float = 0.015
    turn: float = 0.015
    damping: float = 1.0
    coupling: float = 0.3
    coupled: float = 0.95
    close: float = 4.0
    heard: float = 0.3
    rounds: int = 20
    marquardt: float = 0.01
    easier: float = 5.0
    stiffer: float = 5.0
    step: float = 1.0
    settled: float = 0.01
    gained: float = 0.1
    share: float = 0.01
    least: float = 1e-5
    most: float = 0.3
    beside: float = 4.0
    static: float = 4.0
    distant: float = 4.0
    far: float = 10.0


SETTINGS = NuisanceSettings()


@dataclass(frozen=True, eq=False)
class _Step:
    """Change of nuisances (q,) by which a residual becomes least, of which h act nonlinearly.

    Attributes
    ----------
    precision, pull
        Of ``precision · step = pull`` (q, q) and (q,).
    held
        Number h; these come first.
    cost
        χ² of residual and priors, the others fitted.
    square
        χ² after the step, to first order.
    """

    precision: Array
    pull: Array
    held: int
    cost: float
    square: float

    def find(self, damping: float) -> Array:
        """Return the step (q,), damped as by Marquardt in what acts nonlinearly."""
        more = np.zeros(len(self.pull))
        more[: self.held] = damping * np.diagonal(self.precision)[: self.held]
        return np.linalg.solve(self.precision + np.diag(more), self.pull)


@dataclass(frozen=True, eq=False)
class _Nuisance:
    """What damping and the channels can follow, over the noise, in prior standard deviations.

    Damping is seen in all responses, a turned direction in few: each response has columns of its
    own, of some of all q nuisances.

    Attributes
    ----------
    gain
        Lines (r, m) times the prior of their gain, and of their phase, which is the same.
    columns
        Derivatives (r, 2m, l) by l others, as gains leave them.
    index
        Which of all nuisances (r, l) these are.
    count
        Number q of nuisances.
    """

    gain: Complex
    columns: Array
    index: Indices
    count: int

    @classmethod
    def find(
        cls, gain: Complex, columns: Complex, index: Indices, count: int
    ) -> _Nuisance:
        """Return the nuisances of gains (r, m) and other derivatives (r, m, l)."""
        left = _split_parts(_leave_gain(gain, columns))
        return cls(gain, left, index, count)

    @cached_property
    def gram(self) -> Array:
        """Inner products (q, q)."""
        own = self.columns.mT @ self.columns
        at = self.index[:, :, None] * self.count + self.index[:, None]
        whole = np.zeros(self.count**2)
        np.add.at(whole, at.ravel(), own.ravel())
        return whole.reshape(self.count, self.count)

    @cached_property
    def _spectrum(self) -> tuple[Array, Array]:
        """Eigenvalues (q,) and vectors (q, q) of the gram."""
        squares, vectors = np.linalg.eigh(self.gram)
        return squares.clip(min=0.0), vectors

    def _project(self, left: Array) -> Array:
        """Return inner products (q, k) with parts (r, 2m, k)."""
        own = self.columns.mT @ left
        out = np.zeros((self.count, own.shape[2]))
        np.add.at(out, self.index, own)
        return out

    def fit(self, change: Complex, at: Array, held: int) -> _Step:
        """Return what the nuisances gain of a change (r, m).

        Parameters
        ----------
        change
            Residual over the noise.
        at
            Nuisances (q,) about which the columns are, in prior sizes.
        held
            Number of those that act nonlinearly, which come first.
        """
        left = _split_parts(_leave_gain(self.gain, change)[..., None])
        pull = self._project(left)[:, 0] - at
        precision = self.gram + np.eye(self.count)
        square = float(np.sum(left**2) + at @ at)
        linear = np.linalg.solve(precision[held:, held:], pull[held:])
        cost = square - float(pull[held:] @ linear)
        least = square - float(pull @ np.linalg.solve(precision, pull))
        return _Step(precision, pull, held, cost, least)

    def leave(self, change: Complex) -> Array:
        """Return what is left (n, ...) of changes (r, m, ...)."""
        flat = change.reshape(*self.gain.shape, -1)
        left = self._leave(_split_parts(_leave_gain(self.gain, flat)))
        return left.reshape(len(left), *change.shape[2:])

    def leave_residual(self, change: Complex, at: Array) -> Array:
        """Return what is left (n,) of a residual (r, m) at nuisances (q,) other than usual."""
        left = _split_parts(_leave_gain(self.gain, change)[..., None])
        return self._leave(left + self.columns @ at[self.index][..., None])[:, 0]

    def _leave(self, left: Array) -> Array:
        """Return readings (n, k) of what is left of parts (r, 2m, k)."""
        squares, vectors = self._spectrum
        part = _take_share(squares)[:, None]
        follow = vectors @ (part * (vectors.T @ self._project(left)))
        rest = left - self.columns @ follow[self.index]
        count = len(left), 2, left.shape[1] // 2, left.shape[2]
        return np.moveaxis(rest.reshape(count), 1, 0).reshape(-1, left.shape[2])


def _split_parts(values: Complex) -> Array:
    """Return real, then imaginary parts (r, 2m, k) of complex values (r, m, k)."""
    return np.concatenate([values.real, values.imag], axis=1)


def _take_share(squares: Array) -> Array:
    """Return ``(1 - 1/√(1 + s²)) / s²`` of eigenvalues s²: what a nuisance follows, over s²."""
    root = np.sqrt(1.0 + squares)
    return 1.0 / (root * (root + 1.0))


def _leave_gain(gain: Complex, change: Complex) -> Complex:
    """Return changes (r, m, ...) without what gain and phase of each response can follow."""
    part = _take_share(np.sum(np.abs(gain) ** 2, axis=1))
    flat = change.reshape(*gain.shape, -1)
    follow = part[:, None, None] * (gain.conj()[:, None] @ flat)
    return (flat - gain[..., None] * follow).reshape(change.shape)


@dataclass(frozen=True, eq=False)
class MassRate:
    """Derivative of a body's inertia by a parameter, about the home point ``at`` (3,).

    Attributes
    ----------
    mass, moments, inertia
        Rates of mass, first moments (3,) and moments of inertia (3, 3), home axes.
    """

    body: str
    at: Array
    mass: float
    moments: Array
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @classmethod
    def between(cls, more: Payload, less: Payload, width: float) -> MassRate:
        """Return the rate between the payloads of two values that are ``width`` apart."""
        return cls(
            body=more.body,
            at=more.at,
            mass=(more.mass - less.mass) / width,
            moments=(more.moments - less.moments) / width,
            inertia=(_find_inertia(more) - _find_inertia(less)) / width,
        )


def _find_inertia(payload: Payload) -> Array:
    """Return the inertia (3, 3) of a payload about its point: ``J + (|h|² 1 - h hᵀ) / m``."""
    h = payload.moments
    if not payload.mass:
        return payload.inertia
    return payload.inertia + (h @ h * np.eye(3) - np.outer(h, h)) / payload.mass


@dataclass(frozen=True, eq=False)
class _Damping:
    """Damping of modes: ratios (d,), and couplings of close ones, relative to those of the pair.

    Modes closer than their half-power widths share their damping: its matrix is not diagonal.

    Attributes
    ----------
    ratios
        Damping ratios (d,).
    fitted
        Modes (a,) whose ratio is fitted.
    pairs
        Coupled modes (b, 2).
    coupling
        Couplings (b,), within ±1.
    usual
        Damping ratio where lines tell none.
    """

    ratios: Array
    fitted: Indices
    pairs: Indices
    coupling: Array
    usual: float

    def find_distance(self, count: int, limits: NuisanceSettings) -> Array:
        """Return all nuisances (count,), damping first, from the usual ones in prior sizes."""
        out = np.zeros(count)
        log_ratios = np.log(self.ratios[self.fitted] / self.usual) / limits.damping
        both = np.concatenate([log_ratios, self.coupling / limits.coupling])
        out[: len(both)] = both
        return out

    def move(self, change: Array, limits: NuisanceSettings) -> tuple[_Damping, float]:
        """Return the damping after a change (a + b, ...) in prior sizes, and the largest change."""
        count = len(self.fitted)
        step = np.clip(change[:count] * limits.damping, -limits.step, limits.step)
        ratios = self.ratios.copy()
        now = ratios[self.fitted] * np.exp(step)
        ratios[self.fitted] = np.clip(now, limits.least, limits.most)
        most = limits.coupled
        both = change[count : count + len(self.coupling)]
        coupling = np.clip(self.coupling + both * limits.coupling, -most, most)
        moved = np.abs(np.concatenate([step, coupling - self.coupling]))
        out = replace(self, ratios=ratios, coupling=coupling)
        return out, float(moved.max(initial=0.0))

    def scale_pairs(self, critical: Array) -> Array:
        """Return the damping (b,) of a coupling of one, for critical damping (d,)."""
        first, second = self.pairs.T
        whole = self.ratios * critical
        return np.sqrt(whole[first] * whole[second])

    def find_clusters(self) -> list[Indices]:
        """Return modes that are coupled, cluster by cluster."""
        joined: dict[int, set[int]] = {}
        for (i, j), size in zip(self.pairs.tolist(), self.coupling, strict=True):
            if size:
                both = joined.get(i, {i}) | joined.get(j, {j})
                joined.update(dict.fromkeys(both, both))
        distinct = {min(block): block for block in joined.values()}
        return [np.array(sorted(block)) for block in distinct.values()]

    def couple(self, cluster: Indices, critical: Array) -> Array:
        """Return the damping matrix (n, n) between the modes of a cluster, without its diagonal."""
        first, second = self.pairs.T
        out = np.zeros((len(self.ratios), len(self.ratios)))
        out[first, second] = self.coupling * self.scale_pairs(critical)
        out = out + out.T
        return out[np.ix_(cluster, cluster)]


@dataclass(frozen=True, eq=False)
class _Swept:
    """Amplitudes (a, p, f) of near modes under unit forces at the ports, at s (f,)."""

    amplitudes: Complex
    s: Complex


@dataclass(frozen=True, eq=False)
class _FittedDamping:
    """A damping with what follows from it.

    Attributes
    ----------
    amplitudes
        Of near modes (a, p, f) under unit forces at the ports.
    lines
        Predicted (r, f).
    left
        Residual (r, m) over the noise.
    distance
        Nuisances (q,) from the usual ones, in prior sizes.
    step
        Their step that fits the residual best, and what it gains.
    """

    damping: _Damping
    amplitudes: Complex
    lines: Complex
    nuisance: _Nuisance
    left: Complex
    distance: Array
    step: _Step

    @cached_property
    def rest(self) -> Array:
        """What the nuisances leave (n,) of the residual."""
        return self.nuisance.leave_residual(self.left, self.distance)


def spread_inertia(payload: Payload | MassRate, where: Places) -> Array:
    """Return inertia (6, 6) of a payload, or its rate, about its point in base axes, as displaced."""
    turn = np.asarray(where.rotation[payload.body]).reshape(-1, 3, 3)[0]
    arm = turn @ payload.moments
    inertia = (
        payload.inertia if isinstance(payload, MassRate) else _find_inertia(payload)
    )
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = payload.mass * np.eye(3)
    lever = np.cross(np.eye(3), arm).T  # v · (ω × a)
    matrix[:3, 3:] = lever
    matrix[3:, :3] = lever.T
    matrix[3:, 3:] = turn @ inertia @ turn.T
    return matrix


class Modes(Protocol):
    """Modes of a robot: a static part of flexibilities (k,), and d modes with mass."""

    @property
    def mass(self) -> Array:
        """Modal masses (d,)."""
        ...

    @property
    def stiffness(self) -> Array:
        """Modal stiffnesses (d,)."""
        ...

    @property
    def static(self) -> Array:
        """Flexibilities (k,) of the static part."""
        ...

    def displace(self, node: str, at: Array) -> tuple[Array, Array]:
        """Return twists (6, k) and (6, d) of a node's home point in base axes."""
        ...

    def find_wrenches(
        self, name: str, points: Sequence[tuple[str, Array, Array]]
    ) -> tuple[Array, Array]:
        """Return wrenches (6m, p) in an element under forces, and (6m, d) by inertial loads."""
        ...


@dataclass(frozen=True, eq=False)
class ResponseState:
    """One block of responses of a robot with changed elements and masses; all lazy and cached.

    Attributes
    ----------
    block
        What was measured.
    mechanism
        The robot with its changes.
    masses
        On it, besides the sensors' stated masses.
    changed
        Its modes in terms of those of the robot without changes; None: they are solved.
    gains
        Of the channels (r,); None: ones.
    """

    block: ResponseBlock
    mechanism: Mechanism
    masses: tuple[PointMass, ...] = ()
    settings: NuisanceSettings = SETTINGS
    changed: ChangedModes | None = None
    gains: Array | None = None
    _twists: dict[Any, Any] = field(default_factory=dict[Any, Any])
    _fields: dict[Any, Any] = field(default_factory=dict[Any, Any])

    @cached_property
    def solved(self) -> SolvedModes:
        """All modes of the robot with its changes, solved anew."""
        measured = self.block.measured
        return SolvedModes(
            solve_all_modes(
                self.mechanism,
                measured.configuration,
                drives=measured.setup.drives,
                masses=self.masses,
            )
        )

    @property
    def modes(self) -> Modes:
        """All modes."""
        return self.solved if self.changed is None else self.changed

    @cached_property
    def frequencies(self) -> Array:
        """Natural frequencies (d,), Hz, of the modes with mass."""
        return np.sqrt(self.modes.stiffness / self.modes.mass) / (2.0 * np.pi)

    @cached_property
    def ends(self) -> list[Direction]:
        """Distinct directions (p,) of forces and motions: the ports."""
        each = [
            end
            for response in self.block.measured.responses
            for end in (response.force, response.motion)
        ]
        return list(dict.fromkeys(each))

    @cached_property
    def pairs(self) -> Indices:
        """Ports (r, 2) of force and motion of the responses."""
        index = {end: k for k, end in enumerate(self.ends)}
        return np.array(
            [
                [index[response.force], index[response.motion]]
                for response in self.block.measured.responses
            ]
        )

    def displace(self, node: str, at: Array) -> tuple[Array, Array]:
        """Return the twists of a node's home point: (6, k) in the static part, (6, d) in modes."""
        key = node, tuple(np.asarray(at, dtype=float).tolist())
        if key not in self._twists:
            self._twists[key] = self.modes.displace(node, at)
        return self._twists[key]

    @cached_property
    def directions(self) -> Array:
        """Directions (p, 6) of the ports in {O}."""
        return np.array([self.block.measured.find_direction(end) for end in self.ends])

    @cached_property
    def _both_ports(self) -> tuple[Array, Array]:
        return self._project(self.directions)

    @property
    def ports(self) -> Array:
        """Displacements (p, d) of the ports in every mode."""
        return self._both_ports[1]

    def _project(self, directions: Array) -> tuple[Array, Array]:
        """Return displacements (p, k) and (p, d) along directions (p, 6) at the ports' points."""
        measured = self.block.measured
        static: list[Array] = []
        moving: list[Array] = []
        for end, along in zip(self.ends, directions, strict=True):
            body = measured.point(end.point).body
            still, moved = self.displace(body, measured.places[end.point])
            static.append(along @ still)
            moving.append(along @ moved)
        return np.array(static), np.array(moving)

    @cached_property
    def _crossing(self) -> list[tuple[Array, Array]]:
        """Displacements along two directions square to each port's."""
        sums = self.directions[:, :3] + self.directions[:, 3:]
        least = np.eye(3)[np.argmin(np.abs(sums), axis=1)]
        second = np.cross(sums, least)
        second = second / np.linalg.norm(second, axis=1, keepdims=True)
        third = np.cross(sums, second)
        turns: Flags = np.any(self.directions[:, 3:] != 0.0, axis=1, keepdims=True)
        return [
            self._project(
                np.hstack([np.where(turns, 0.0, order), np.where(turns, order, 0.0)])
            )
            for order in (second, third)
        ]

    @cached_property
    def s(self) -> Complex:
        """Laplace variable (f,) of the lines, with the window's decay, 1/s."""
        block = self.block
        return block.measured.decay + 2j * np.pi * block.frequency

    @cached_property
    def window(self) -> Complex:
        """Factor (r, f) by which window and gains change the lines of measured motions."""
        line = 2j * np.pi * self.block.frequency
        return self._gains * (self.s / line) ** self._orders

    @cached_property
    def _gains(self) -> Array:
        """Gains of the channels (r, 1)."""
        count = len(self.block.measured.responses)
        return (np.ones(count) if self.gains is None else self.gains)[:, None]

    @cached_property
    def _orders(self) -> Array:
        """Orders (r, 1) of the derivatives by time that were measured."""
        orders = [
            DERIVATIVES[response.quantity] for response in self.block.measured.responses
        ]
        return np.array(orders, dtype=float)[:, None]

    @cached_property
    def _near(self) -> Indices:
        """Modes (a,) whose resonance lines show; those far above follow, but for their inertia."""
        limit = self.settings.far * self.block.frequency[-1]
        return np.flatnonzero(self.frequencies < limit)

    @cached_property
    def _functionals(self) -> tuple[Array, Array]:
        """Displacements of the ports, then across them (3p, k) and (3p, d)."""
        static, moving = zip(self._both_ports, *self._crossing, strict=True)
        return np.vstack(static), np.vstack(moving)

    @cached_property
    def _rest(self) -> tuple[Array, Array]:
        """Flexibility (3p, p) of all that has no resonance here, and what is multiplied by s²."""
        still, moved = self._functionals
        p = len(self.ends)
        far = np.setdiff1d(np.arange(len(self.modes.mass)), self._near)
        flexible = 1.0 / self.modes.stiffness[far]
        static = (still * self.modes.static) @ still[:p].T
        static = static + (moved[:, far] * flexible) @ moved[:p, far].T
        inertia = self.modes.mass[far] * flexible**2
        return static, -(moved[:, far] * inertia) @ moved[:p, far].T

    @cached_property
    def _nominal_damping(self) -> _Damping:
        """Usual damping of the near modes; fitted are those that are heard in or beside the band."""
        lines = self.block.frequency
        limits = self.settings
        hertz = self.frequencies[self._near]
        ratio = self.block.damping
        beside = (hertz > lines[0] / limits.beside) & (
            hertz < lines[-1] * limits.beside
        )
        modes = np.flatnonzero(beside)
        # of g = 1/(k - ω² m + 2 i ζ ω √(k m)), by the logarithm of ζ, at the line nearest to the mode
        at = np.abs(np.log(hertz[modes, None] / lines)).argmin(axis=1)
        x = lines[at] / hertz[modes]
        slope = 2.0 * ratio * x / ((1.0 - x**2) ** 2 + (2.0 * ratio * x) ** 2)
        force, motion = self.pairs.T
        nearest = self._near[modes]
        part = self.ports[force][:, nearest] * self.ports[motion][:, nearest]
        change = part * slope / self.modes.stiffness[nearest]
        told = np.linalg.norm(change / self.block.noise[:, at], axis=0)
        heard = told > limits.heard
        fitted = modes[heard]
        apart = np.abs(np.log(hertz[fitted, None] / hertz[fitted]))
        close = np.argwhere(np.triu(apart < limits.close * ratio, 1))
        ratios = np.full(len(hertz), ratio)
        return _Damping(ratios, fitted, fitted[close], np.zeros(len(close)), ratio)

    @cached_property
    def _fitted(self) -> _FittedDamping:
        """Damping that fits best, by steps of Levenberg and Marquardt."""
        limits = self.settings
        best = self._fit_at(self._nominal_damping)
        if self.block.mean is not None or not len(best.damping.fitted):
            return best  # local means hardly show damping
        stiff = limits.marquardt
        noise = 2.0 * best.left.size
        for _ in range(limits.rounds):
            # far from the lines, a model is none, whatever its damping
            enough = limits.gained + limits.share * max(best.step.square - noise, 0.0)
            if best.step.cost - best.step.square < enough:
                break
            damping, moved = best.damping.move(best.step.find(stiff), limits)
            now = self._fit_at(damping)
            gained = best.step.cost - now.step.cost
            if gained > 0.0:
                best = now
                stiff = stiff / limits.easier
            else:
                stiff = stiff * limits.stiffer
            if moved < limits.settled or 0.0 < gained < enough:
                break
        return best

    def _fit_at(self, damping: _Damping) -> _FittedDamping:
        """Return lines and nuisances with a damping."""
        amplitudes = self._respond(damping, self.s)
        received, turned = self._receive_all(_Swept(amplitudes, self.s))
        lines = received * self.window
        nuisance = self._find_nuisance(damping, amplitudes, lines, turned)
        left = (self.block.value - self.block.read(lines)) * self.block.weight
        distance = damping.find_distance(nuisance.count, self.settings)
        held = len(damping.fitted) + len(damping.pairs)
        step = nuisance.fit(left, distance, held)
        return _FittedDamping(
            damping, amplitudes, lines, nuisance, left, distance, step
        )

    @property
    def damping(self) -> Array:
        """Fitted damping ratios (d,) of all modes; those out of the band have the usual one."""
        out = np.full(len(self.frequencies), self.block.damping)
        out[self._near] = self._fitted.damping.ratios
        return out

    @property
    def lines(self) -> Complex:
        """Predicted lines (r, f), m/N, without errors of channels."""
        return self._fitted.lines

    @cached_property
    def amplitudes(self) -> Complex:
        """Amplitudes (d, p, f) of the modes under unit forces at the ports."""
        mass = self.modes.mass[:, None]
        stiffness = self.modes.stiffness[:, None]
        modal_response = 1.0 / (stiffness + self.s**2 * mass)
        out = modal_response[:, None] * self.ports.T[..., None]
        out[self._near] = self._fitted.amplitudes
        return out

    @cached_property
    def _loss(self) -> Array:
        """Critical damping (a,) of the near modes, ``2 √(k m)``."""
        near = self._near
        return 2.0 * np.sqrt(self.modes.stiffness[near] * self.modes.mass[near])

    @property
    def is_far(self) -> bool:
        """Whether the lines are so far off that the damping fitted to them is none."""
        fitted = self._fitted
        return fitted.step.cost > self.settings.distant * 2.0 * fitted.left.size

    def predict_lines(self, hertz: Array, *, usual: bool = False) -> Complex:
        """Return the lines (r, f) at other frequencies (f,), with the fitted or the usual damping."""
        line = 2j * np.pi * hertz
        s = self.block.measured.decay + line
        damping = self._nominal_damping if usual else self._fitted.damping
        swept = _Swept(self._respond(damping, s), s)
        received = self._receive_lines(swept)
        return self._gains * received * (s / line) ** self._orders

    def _respond(self, damping: _Damping, s: Complex) -> Complex:
        """Return the amplitudes (a, p, f) of near modes under unit forces at the ports."""
        near = self._near
        mass = self.modes.mass[near, None]
        stiffness = self.modes.stiffness[near, None]
        loss = (damping.ratios * self._loss)[:, None]
        modal_response = 1.0 / (stiffness + s * (loss + s * mass))
        ports = self.ports[:, near]
        out = modal_response[:, None] * ports.T[..., None]
        for cluster in damping.find_clusters():
            whole = damping.couple(cluster, self._loss)
            dynamic = s[:, None, None] * whole
            at = np.arange(len(cluster))
            dynamic[:, at, at] = 1.0 / modal_response[cluster].T
            forces = np.broadcast_to(
                ports.T[cluster].astype(complex),
                (len(s), len(cluster), len(ports)),
            )
            out[cluster] = np.moveaxis(np.linalg.solve(dynamic, forces), 0, -1)
        return out

    @cached_property
    def _sides(self) -> list[tuple[Indices, Indices]]:
        """Of forces and motions: their distinct ports, and which of them (r,) each response has."""
        sides: list[tuple[Indices, Indices]] = []
        for side in self.pairs.T:
            known, which = np.unique(side, return_inverse=True)
            sides.append((known, which))
        return sides

    def _receive(self, functionals: Indices, ports: Indices, swept: _Swept) -> Complex:
        """Return what functionals (m,) have (m, n, f) under unit forces at some ports (n,)."""
        moved = self._functionals[1][np.ix_(functionals, self._near)]
        static, inertial = (part[np.ix_(functionals, ports)] for part in self._rest)
        own = swept.amplitudes[:, ports]
        flat = own.reshape(len(own), len(ports) * len(swept.s))
        # real products take half the work
        out = (moved @ flat.view(np.float64)).view(np.complex128)
        out = out.reshape(len(moved), len(ports), len(swept.s))
        return out + static[..., None] + inertial[..., None] * swept.s**2

    def _receive_lines(self, swept: _Swept) -> Complex:
        """Return the receptances (r, f) of all responses."""
        (forces, force), (motions, motion) = self._sides
        return self._receive(motions, forces, swept)[motion, force]

    def _receive_all(self, swept: _Swept) -> tuple[Complex, list[Complex]]:
        """Return the receptances (r, f) of all responses, and their changes (r, f, 2) by turns.

        A direction of force, then one of motion, turns towards two directions square to it.
        """
        (forces, force), (motions, motion) = self._sides
        p = len(self.ends)
        km = len(motions)
        kf = len(forces)
        along = np.concatenate([motions, p + motions, 2 * p + motions])
        moved = self._receive(along, forces, swept)
        pushed = self._receive(
            np.concatenate([p + forces, 2 * p + forces]), motions, swept
        )
        by_force = [pushed[k * kf + force, motion] for k in (0, 1)]
        by_motion = [moved[(k + 1) * km + motion, force] for k in (0, 1)]
        turned = [np.stack(each, axis=2) for each in (by_force, by_motion)]
        return moved[motion, force], turned

    def _find_nuisance(
        self,
        damping: _Damping,
        amplitudes: Complex,
        lines: Complex,
        turned: Sequence[Complex],
    ) -> _Nuisance:
        """Return the nuisances about predicted lines (r, f): damping first, then directions.

        turned: changes (r, f, 2) by turned directions of force, and of motion.
        """
        force, motion = self.pairs.T
        limits = self.settings
        d = damping.fitted
        weight = self.block.weight[..., None]
        window = self.window[..., None]
        count = len(d) + len(damping.pairs)
        slopes = np.empty((count, *lines.shape), dtype=complex)
        size = limits.damping * damping.ratios * self._loss
        for k, i in enumerate(d):
            heard = amplitudes[i]
            slopes[k] = -(size[i] * self.s) * (heard[force] * heard[motion])
        sizes = limits.coupling * damping.scale_pairs(self._loss)
        for k, (i, j) in enumerate(damping.pairs, start=len(d)):
            one = amplitudes[i]
            other = amplitudes[j]
            both = one[force] * other[motion] + other[force] * one[motion]
            slopes[k] = -(sizes[k - len(d)] * self.s) * both
        columns = [np.moveaxis(slopes * self.window, 0, 2)]
        index = [np.tile(np.arange(count), (len(lines), 1))]
        for (known, which), crossed in zip(self._sides, turned, strict=True):
            columns.append(limits.turn * crossed * window)
            index.append(count + 2 * which[:, None] + np.arange(2))
            count += 2 * len(known)
        whole = self.block.read(np.concatenate(columns, axis=2)) * weight
        gain = limits.gain * self.block.read(lines) * self.block.weight
        return _Nuisance.find(gain, whole, np.concatenate(index, axis=1), count)

    def share(self, change: Complex) -> Array:
        """Return weighted changes (r, m, ...) as readings (n, ...), without what nuisances follow.

        Their squares are those of errors with the nuisances marginalized.
        """
        return self._fitted.nuisance.leave(change)

    @cached_property
    def _spread(self) -> Array:
        """Standard deviations (n,) of the readings."""
        return np.tile(self.block.sigma.ravel(), 2)

    @cached_property
    def values(self) -> Array:
        """Predicted readings (n,), with the nuisances that fit best."""
        return stack_parts(self.block.value) - self._spread * self._fitted.rest

    def derive(self, columns: Complex) -> Array:
        """Return derivatives of the readings (n, k) of those of lines (r, f, k)."""
        shown = self.block.read(columns * self.window[..., None])
        return self._spread[:, None] * self.share(shown * self.block.weight[..., None])

    def amplify(self, rates: Array) -> Array:
        """Return derivatives of the readings (n, k) by relative changes (r, k) of the gains."""
        shown = self.block.read(self.lines[..., None] * rates[:, None])
        return self._spread[:, None] * self.share(shown * self.block.weight[..., None])

    def move(self, node: str, at: Array) -> Complex:
        """Return the motion (6, p, f) of a node's point under unit forces at the ports."""
        key = "move", node, tuple(np.asarray(at, dtype=float).tolist())
        if key not in self._fields:
            still, moved = self.displace(node, at)
            static = (still * self.modes.static) @ self._both_ports[0].T
            out = np.tensordot(moved, self.amplitudes, axes=(1, 0))
            self._fields[key] = out + static[..., None]
        return self._fields[key]

    @cached_property
    def _forces(self) -> list[tuple[str, Array, Array]]:
        """Node, home point (3,) and unit wrench (6,) of each port."""
        measured = self.block.measured
        return [
            (measured.point(end.point).body, measured.places[end.point], along)
            for end, along in zip(self.ends, self.directions, strict=True)
        ]

    def _carry(self, static: Array, inertial: Array) -> Complex:
        """Return what acts (m, p, f) under unit forces at the ports, and inertial loads (m, d)."""
        limit = self.settings.static * self.block.frequency[-1]
        moving = np.flatnonzero(self.frequencies < limit)
        loads = -(self.s**2) * self.amplitudes[moving]
        return static[..., None] + np.tensordot(inertial[:, moving], loads, axes=(1, 0))

    def find_wrench(self, name: str) -> Complex:
        """Return wrenches (6m, p, f) in an element, own axes, under unit forces at the ports."""
        key = "wrench", name
        if key not in self._fields:
            wrenches = self.modes.find_wrenches(name, self._forces)
            self._fields[key] = self._carry(*wrenches)
        return self._fields[key]

    def find_motion(self, name: str) -> Complex:
        """Return motions (k, p, f) in a joint's free directions under unit forces at the ports."""
        key = "motion", name
        if key not in self._fields:
            alone = self if self.changed is None else replace(self, changed=None)
            motions = alone.solved.find_motions(name, alone._forces)  # noqa: SLF001
            self._fields[key] = alone._carry(*motions)  # noqa: SLF001
        return self._fields[key]

    def _pair(self, acts: Complex, rates: Array) -> Complex:
        """Return ``a_i · D b_j`` (r, f, k) of what acts (m, p, f) for matrices D (k, m, m)."""
        force, motion = self.pairs.T
        p, f = acts.shape[1:]
        out = np.zeros((len(force), f, len(rates)), dtype=complex)
        for k, matrix in enumerate(rates):
            used = np.flatnonzero(matrix.any(axis=0))  # few, mostly
            turned = matrix[np.ix_(used, used)] @ acts[used].reshape(len(used), p * f)
            turned = turned.reshape(len(used), p, f)
            for i, part in zip(used, turned, strict=True):
                out[..., k] += acts[i][motion] * part[force]
        return out

    def soften(self, compliances: Mapping[str, Array], count: int) -> Complex:
        """Return derivatives (r, f, k) by changes (k, 6m, 6m) of elements' compliances."""
        return self._sum(
            (
                self._pair(self.find_wrench(name), rates)
                for name, rates in compliances.items()
            ),
            count,
        )

    def stiffen(self, springs: Mapping[str, Array], count: int) -> Complex:
        """Return derivatives (r, f, k) by changes (k,) of the stiffness of joints' springs."""
        return self._sum(
            (
                -self._pair(motion, rates[:, None, None] * np.eye(len(motion)))
                for name, rates in springs.items()
                for motion in [self.find_motion(name)]
            ),
            count,
        )

    def load(self, rates: Sequence[MassRate | None], count: int) -> Complex:
        """Return derivatives (r, f, k) by masses, one for each of k parameters or None."""
        out = self._sum((), count)
        where = place_nodes(self.block.measured.configuration[:1])
        for k, rate in enumerate(rates):
            if rate is None:
                continue
            moved = self.move(rate.body, rate.at)
            matrix = spread_inertia(rate, where)
            out[..., k] = -(self.s**2) * self._pair(moved, matrix[None])[..., 0]
        return out

    def _sum(self, parts: Any, count: int) -> Complex:
        out = np.zeros((len(self.pairs), len(self.s), count), dtype=complex)
        for part in parts:
            out += part
        return out

"""A robot with effects as it was hit: lines of one block of responses, and their derivatives.

Between ports i and j the receptance is ``H = Σ φ_i φ_j g`` with ``g = 1/(k + s² m + 2 ζ s √(k m))``
of each mode. A change δC of an element's compliance, δM of a mass at a node or δK of a joint's
spring changes it by

    δH = W_i · δC W_j - u_i · (s² δM + δK) u_j,

with the wrench W in the element and the motion u of the node under unit forces at the ports
(docs/theory.md, section 10.5). W is that of the static response to the port's force and to the
inertial loads of all modes that do not follow statically.

Damping by mode, gain and phase of each channel and its small rotation are fitted with every
prediction, and no cause: readings and derivatives are without what these can follow.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.campaign.response_lines import stack_parts
from stiffscope.responses.model import DERIVATIVES
from stiffscope.vjm.vibration.modal_model import solve_all_modes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.gap.campaign.response_lines import ResponseBlock
    from stiffscope.gap.effects.effect import Payload
    from stiffscope.responses.model import Direction
    from stiffscope.runtime.types import Array, Complex, Flags, Indices
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.network.loading import Response as StaticResponse
    from stiffscope.vjm.vibration.coordinates import PointMass
    from stiffscope.vjm.vibration.modal_model import ModalModel


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
    rounds
        Most steps of the fit of damping.
    step
        Largest change of that logarithm in one.
    settled
        Change at which the fit ends.
    least, most
        Range of damping ratios.
    beside
        Modes whose damping is fitted: from the lowest line over, to the highest times this.
    static
        Frequency of modes over the highest line from which inertial loads are left out of
        derivatives.
    """

    gain: float = 0.015
    turn: float = 0.015
    damping: float = 1.0
    rounds: int = 3
    step: float = 1.0
    settled: float = 0.01
    least: float = 1e-5
    most: float = 0.3
    beside: float = 1.15
    static: float = 4.0


SETTINGS = NuisanceSettings()


@dataclass(frozen=True, eq=False)
class _Nuisance:
    """What damping and the channels can follow, over the noise, in prior standard deviations.

    Attributes
    ----------
    gain
        Lines (r, m) times the prior of their gain, and of their phase, which is the same.
    columns
        Derivatives (n, q) by all others, as gains leave them.
    squares, vectors
        Eigenvalues (q,) and vectors (q, q) of their gram.
    """

    gain: Complex
    columns: Array
    squares: Array
    vectors: Array

    @classmethod
    def find(cls, gain: Complex, columns: Complex) -> _Nuisance:
        """Return the nuisances of gains (r, m) and other derivatives (r, m, q)."""
        left = stack_parts(_leave_gain(gain, columns))
        squares, vectors = np.linalg.eigh(left.T @ left)
        return cls(gain, left, squares.clip(min=0.0), vectors)

    def solve(self, change: Complex) -> Array:
        """Return the nuisances (q,) besides gains that fit a change (r, m) best."""
        left = stack_parts(_leave_gain(self.gain, change))
        inner = self.vectors.T @ (self.columns.T @ left)
        return self.vectors @ (inner / (self.squares + 1.0))

    def leave(self, change: Complex) -> Array:
        """Return what is left (n, ...) of changes (r, m, ...)."""
        left = stack_parts(_leave_gain(self.gain, change))
        inner = self.vectors.T @ (self.columns.T @ left)
        part = _take_share(self.squares).reshape(-1, *(1,) * (left.ndim - 1))
        return left - self.columns @ (self.vectors @ (part * inner))


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
    """Return the inertia (3, 3) of a payload about its point: ``(|h|² 1 - h hᵀ) / m``."""
    h = payload.moments
    if not payload.mass:
        return np.zeros((3, 3))
    return (h @ h * np.eye(3) - np.outer(h, h)) / payload.mass


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
    """

    block: ResponseBlock
    mechanism: Mechanism
    masses: tuple[PointMass, ...] = ()
    settings: NuisanceSettings = SETTINGS
    _twists: dict[Any, Array] = field(default_factory=dict[Any, Any])
    _fields: dict[Any, Any] = field(default_factory=dict[Any, Any])

    @cached_property
    def modal(self) -> ModalModel:
        """All modes."""
        measured = self.block.measured
        return solve_all_modes(
            self.mechanism,
            measured.configuration,
            drives=measured.setup.drives,
            masses=self.masses,
        )

    @cached_property
    def frequencies(self) -> Array:
        """Natural frequencies (c,), Hz: infinite of massless modes."""
        return np.sqrt(self.modal.squares) / (2.0 * np.pi)

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

    def displace(self, node: str, at: Array) -> Array:
        """Return the twists (6, c) of a node's home point in base axes, in every mode."""
        key = node, tuple(np.asarray(at, dtype=float).tolist())
        if key not in self._twists:
            self._twists[key] = self.modal.displace(node, at)
        return self._twists[key]

    def displace_point(self, name: str) -> Array:
        """Return the twists (6, c) of a measured point."""
        measured = self.block.measured
        return self.displace(measured.point(name).body, measured.places[name])

    @cached_property
    def directions(self) -> Array:
        """Directions (p, 6) of the ports in {O}."""
        return np.array([self.block.measured.find_direction(end) for end in self.ends])

    @cached_property
    def ports(self) -> Array:
        """Displacements (p, c) of the ports in every mode."""
        return self._project(self.directions)

    def _project(self, directions: Array) -> Array:
        """Return displacements (p, c) along directions (p, 6) at the ports' points."""
        moved = [
            along @ self.displace_point(end.point)
            for end, along in zip(self.ends, directions, strict=True)
        ]
        return np.array(moved)

    @cached_property
    def _crossing(self) -> tuple[Array, Array]:
        """Displacements (p, c) along two directions square to each port's."""
        own = self.directions[:, :3] + self.directions[:, 3:]
        least = np.eye(3)[np.argmin(np.abs(own), axis=1)]
        second = np.cross(own, least)
        second = second / np.linalg.norm(second, axis=1, keepdims=True)
        third = np.cross(own, second)
        turns: Flags = np.any(self.directions[:, 3:] != 0.0, axis=1, keepdims=True)
        spread = [
            np.hstack([np.where(turns, 0.0, each), np.where(turns, each, 0.0)])
            for each in (second, third)
        ]
        return self._project(spread[0]), self._project(spread[1])

    @cached_property
    def s(self) -> Complex:
        """Laplace variable (f,) of the lines, with the window's decay, 1/s."""
        block = self.block
        return block.measured.decay + 2j * np.pi * block.frequency

    @cached_property
    def window(self) -> Complex:
        """Factor (r, f) by which the window changes the lines of measured motions."""
        line = 2j * np.pi * self.block.frequency
        orders = [
            DERIVATIVES[response.quantity] for response in self.block.measured.responses
        ]
        return (self.s / line) ** np.array(orders)[:, None]

    @cached_property
    def _damped(self) -> Indices:
        """Modes (d,) whose damping is fitted: those in or beside the band."""
        lines = self.block.frequency
        beside = self.settings.beside
        found = self.frequencies
        return np.flatnonzero(
            (found > lines[0] / beside) & (found < lines[-1] * beside)
        )

    @cached_property
    def _fitted(self) -> tuple[Array, Complex, Complex, _Nuisance]:
        """Damping ratios (c,), flexibilities g (c, f), lines (r, f), and nuisances."""
        ratios = np.full(len(self.modal.mass), self.block.damping)
        limits = self.settings
        flexibility = self._respond(ratios)
        lines = self._superpose(flexibility)
        nuisance = self._find_nuisance(ratios, flexibility, lines)
        d = len(self._damped)
        fits = d > 0 and self.block.mean is None  # local means hardly show damping
        for _ in range(limits.rounds if fits else 0):
            left = (self.block.value - self.block.read(lines)) * self.block.weight
            change = nuisance.solve(left)[:d] * limits.damping
            change = np.clip(change, -limits.step, limits.step)
            ratios = ratios.copy()
            now = ratios[self._damped] * np.exp(change)
            ratios[self._damped] = np.clip(now, limits.least, limits.most)
            flexibility = self._respond(ratios)
            lines = self._superpose(flexibility)
            nuisance = self._find_nuisance(ratios, flexibility, lines)
            if np.abs(change).max() < limits.settled:
                break
        return ratios, flexibility, lines, nuisance

    @property
    def damping(self) -> Array:
        """Fitted damping ratios (c,) of all modes; those out of the band have the usual one."""
        return self._fitted[0]

    @property
    def lines(self) -> Complex:
        """Predicted lines (r, f), m/N, without errors of channels."""
        return self._fitted[2]

    def _respond(self, ratios: Array) -> Complex:
        """Return the flexibilities g (c, f) of modes with damping ratios (c,)."""
        mass = self.modal.mass[:, None]
        stiffness = self.modal.stiffness[:, None]
        loss = 2.0 * ratios[:, None] * np.sqrt(stiffness * mass)
        return 1.0 / (stiffness + self.s * (loss + self.s * mass))

    def _superpose(self, flexibility: Complex) -> Complex:
        force, motion = self.pairs.T
        part = self.ports[force] * self.ports[motion]
        return (part @ flexibility) * self.window

    def _find_nuisance(
        self, ratios: Array, flexibility: Complex, lines: Complex
    ) -> _Nuisance:
        """Return the nuisances about predicted lines (r, f): damping first, then directions."""
        force, motion = self.pairs.T
        d = self._damped
        r = len(lines)
        part = self.ports[force][:, d] * self.ports[motion][:, d]
        size = 2.0 * ratios[d] * np.sqrt(self.modal.stiffness[d] * self.modal.mass[d])
        slope = -(size[:, None] * self.s) * flexibility[d] ** 2
        weight = self.block.weight[..., None]
        damping = part[:, None] * slope.T * self.window[..., None]
        columns = [self.settings.damping * self.block.read(damping) * weight]
        rows = np.arange(r)
        for side, other in ((force, motion), (motion, force)):
            known, which = np.unique(side, return_inverse=True)
            crossing = np.stack([each[side] for each in self._crossing], axis=2)
            turned = [
                (crossing[..., k] * self.ports[other]) @ flexibility * self.window
                for k in range(crossing.shape[2])
            ]
            seen = self.block.read(np.stack(turned, axis=2)) * weight
            apart = np.zeros((*seen.shape, len(known)), dtype=complex)
            apart[rows, ..., which] = self.settings.turn * seen
            columns.append(apart.reshape(*seen.shape[:2], -1))
        gain = self.settings.gain * self.block.read(lines) * self.block.weight
        return _Nuisance.find(gain, np.concatenate(columns, axis=2))

    def share(self, change: Complex) -> Array:
        """Return weighted changes (r, m, ...) as readings (n, ...), without what nuisances follow.

        Their squares are those of errors with the nuisances marginalized.
        """
        return self._fitted[3].leave(change)

    @cached_property
    def _spread(self) -> Array:
        """Standard deviations (n,) of the readings."""
        return np.tile(self.block.sigma.ravel(), 2)

    @cached_property
    def values(self) -> Array:
        """Predicted readings (n,), with the nuisances that fit best."""
        block = self.block
        left = (block.value - block.read(self.lines)) * block.weight
        return stack_parts(block.value) - self._spread * self.share(left)

    def derive(self, columns: Complex) -> Array:
        """Return derivatives of the readings (n, k) of those of lines (r, f, k)."""
        shown = self.block.read(columns * self.window[..., None])
        return self._spread[:, None] * self.share(shown * self.block.weight[..., None])

    @property
    def flexibility(self) -> Complex:
        """Flexibilities g (c, f) of the modes."""
        return self._fitted[1]

    def move(self, node: str, at: Array) -> Complex:
        """Return the motion (6, p, f) of a node's point under unit forces at the ports."""
        key = "move", node, tuple(np.asarray(at, dtype=float).tolist())
        if key not in self._fields:
            twists = self.displace(node, at)
            part = (twists[:, None] * self.ports).reshape(-1, twists.shape[1])
            moved = part @ self.flexibility
            self._fields[key] = moved.reshape(6, len(self.ports), -1)
        return self._fields[key]

    @cached_property
    def _moving(self) -> Indices:
        """Modes (k,) whose inertial loads count."""
        return np.flatnonzero(
            self.frequencies < self.settings.static * self.block.frequency[-1]
        )

    @cached_property
    def _static(self) -> StaticResponse:
        """Response to unit forces at the ports, and the inertial loads."""
        measured = self.block.measured
        points = [
            (measured.point(end.point).body, measured.places[end.point], along[:, None])
            for end, along in zip(self.ends, self.directions, strict=True)
        ]
        return self.modal.solve_static(points, self._moving)

    def _carry(self, static: Array) -> Complex:
        """Return what acts (m, p, f) under unit forces at the ports, from static responses."""
        p = len(self.ports)
        moving = self._moving
        m = len(static)
        out = np.repeat(static[:, :p, None].astype(complex), len(self.s), axis=2)
        loads = -(self.s**2) * self.flexibility[moving]
        inertial = static[:, static.shape[1] - len(moving) :]
        part = (inertial[:, None] * self.ports[:, moving]).reshape(m * p, -1)
        out += (part @ loads).reshape(m, p, -1)
        return out

    def find_wrench(self, name: str) -> Complex:
        """Return wrenches (6m, p, f) in an element, own axes, under unit forces at the ports."""
        key = "wrench", name
        if key not in self._fields:
            rows = self.mechanism.rows(name)
            self._fields[key] = self._carry(self._static.find_wrench(rows)[0])
        return self._fields[key]

    def find_motion(self, name: str) -> Complex:
        """Return motions (k, p, f) in a joint's free directions under unit forces at the ports."""
        key = "motion", name
        if key not in self._fields:
            self._fields[key] = self._carry(self._static.elements[name].motions[0])
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
        where = self.modal.system.where
        for k, rate in enumerate(rates):
            if rate is None:
                continue
            moved = self.move(rate.body, rate.at)
            turn = np.asarray(where.rotation[rate.body]).reshape(-1, 3, 3)[0]
            arm = turn @ rate.moments
            matrix = np.zeros((6, 6))
            matrix[:3, :3] = rate.mass * np.eye(3)
            lever = np.cross(np.eye(3), arm).T  # v · (ω × a)
            matrix[:3, 3:] = lever
            matrix[3:, :3] = lever.T
            matrix[3:, 3:] = turn @ rate.inertia @ turn.T
            out[..., k] = -(self.s**2) * self._pair(moved, matrix[None])[..., 0]
        return out

    def _sum(self, parts: Any, count: int) -> Complex:
        out = np.zeros((len(self.pairs), len(self.s), count), dtype=complex)
        for part in parts:
            out += part
        return out

"""Predictions of a campaign with frequency responses: readings, then the lines of each block."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.forward.response_state import (
    MassRate,
    ResponseState,
    spread_inertia,
)
from stiffscope.gap.forward.robot_prediction import Pattern
from stiffscope.vjm.vibration.changed_modes import (
    AddedInertia,
    ChangedModes,
    SoundModes,
)
from stiffscope.vjm.vibration.coordinates import PointMass
from stiffscope.vjm.vibration.modal_model import solve_all_modes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.campaign.measured_responses import MeasuredResponses
    from stiffscope.gap.campaign.response_lines import ResponseBlock
    from stiffscope.gap.effects.effect import Candidate, Payload
    from stiffscope.gap.forward.elastic_state import ElasticState
    from stiffscope.gap.forward.robot_prediction import RobotPrediction
    from stiffscope.gap.forward.steps import Step, Steps
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.model.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class SoundSetups:
    """Modes of the nominal robot as it was hit in each set-up; lazy and cached."""

    mechanism: Mechanism
    _found: dict[str, SoundModes | None] = field(default_factory=dict[str, Any])

    def find(self, measured: MeasuredResponses) -> SoundModes | None:
        """Return those of a set-up; None if it moves freely there."""
        name = measured.setup.name
        if name not in self._found:
            sound = None
            if measured.setup.drives == "held":
                modal = solve_all_modes(
                    self.mechanism,
                    measured.configuration,
                    masses=list_masses(measured, {}),
                )
                sound = SoundModes(modal)
                points = measured.setup.points
                if any(
                    sound.moves_freely(p.body, measured.places[p.name]) for p in points
                ):
                    sound = None
            self._found[name] = sound
        return self._found[name]


def list_masses(
    measured: MeasuredResponses, extra: dict[str, float]
) -> tuple[PointMass, ...]:
    """Return the masses of a set-up's sensors, stated and extra by point."""
    return tuple(
        PointMass(point.body, measured.places[point.name], mass)
        for point in measured.setup.points
        for mass in [(point.mass or 0.0) + extra.get(point.name, 0.0)]
        if mass > 0.0
    )


def find_added(elastic: ElasticState) -> dict[str, Array] | None:
    """Return the added compliance of all changed elements; None if springs have changed, too."""
    added: dict[str, Array] = {}
    for changes in elastic.changes:
        for name, change in changes.items():
            if change.spring:
                return None
            if change.compliance is not None and change.compliance.any():
                added[name] = added.get(name, 0.0) + change.compliance
    return added


@dataclass(frozen=True)
class JointPrediction:
    """Readings of a robot with effects, and the lines of its frequency responses.

    Attributes
    ----------
    campaign
        Readings and lines.
    readings
        Prediction of the readings alone.
    blocks
        Measured responses.
    sound
        Modes of the nominal robot.
    """

    campaign: Campaign
    readings: RobotPrediction
    blocks: tuple[ResponseBlock, ...]
    sound: SoundSetups

    @cached_property
    def states(self) -> tuple[ResponseState, ...]:
        """The robot as it was hit, of each block; those of one set-up share their modes."""
        elastic = self.readings.elastic_state
        extra = dict[str, float]()
        for influence in self.readings.influences:
            for name, mass in influence.sensor_masses.items():
                extra[name] = extra.get(name, 0.0) + mass
        mechanism = elastic.loaded_mechanism  # checks that every change is possible
        added = find_added(elastic)
        changed: dict[str, ChangedModes | None] = {}
        states = list[ResponseState]()
        for block in self.blocks:
            measured = block.measured
            setup = measured.setup.name
            if setup not in changed:
                changed[setup] = self._change(measured, added, elastic.payloads, extra)
            masses = list_masses(measured, extra)
            state = ResponseState(
                block,
                mechanism,
                masses,
                changed=changed[setup],
                gains=self._find_gains(measured),
            )
            states.append(state)
        return tuple(states)

    def _find_gains(self, measured: MeasuredResponses) -> Array:
        """Return the gains (r,) of the channels of a set-up's responses."""
        channels = [response.motion.channel for response in measured.responses]
        out = np.ones(len(channels))
        for influence in self.readings.influences:
            excess = influence.response_gains
            out *= [1.0 + excess.get(channel, 0.0) for channel in channels]
        return out

    def _change(
        self,
        measured: MeasuredResponses,
        added: dict[str, Array] | None,
        payloads: Sequence[Payload],
        extra: dict[str, float],
    ) -> ChangedModes | None:
        """Return the modes of a set-up by changes of the nominal ones; None if they do not tell."""
        sound = self.sound.find(measured)
        if added is None or sound is None:
            return None
        where = sound.modal.system.where
        inertias = [
            AddedInertia(payload.body, payload.at, spread_inertia(payload, where))
            for payload in payloads
            if payload.mass or payload.moments.any()
        ]
        for point in measured.setup.points:
            mass = extra.get(point.name, 0.0)
            if mass:
                whole = np.zeros((6, 6))
                whole[:3, :3] = mass * np.eye(3)
                place = measured.places[point.name]
                inertias.append(AddedInertia(point.body, place, whole))
        return ChangedModes(sound, added, inertias)

    @property
    def values(self) -> Array:
        """Predicted readings and lines (n,)."""
        return self._values

    @cached_property
    def _values(self) -> Array:
        read = self.readings.values if self._is_read else np.zeros(0)
        return np.concatenate([read, *(state.values for state in self.states)])

    @property
    def _is_read(self) -> bool:
        """Whether there are readings beside the responses."""
        return len(self.readings.campaign) > 0

    @cached_property
    def plain_readings(self) -> Array:
        """Readings (n,) due to robot, loads and instruments, without their other faults."""
        read = self.readings.plain_readings if self._is_read else np.zeros(0)
        return np.concatenate([read, *(state.values for state in self.states)])

    def columns(self, candidate: Candidate) -> Array:
        """Return the derivatives (n, k) with respect to a candidate's internal parameters."""
        key = candidate.name, candidate.scale, id(candidate.action)
        if key not in self._columns:
            parts = [np.zeros((0, len(candidate.scale)))]
            if self._is_read:
                parts = [self.readings.columns(candidate)]
            if isinstance(candidate.action, Pattern):
                parts += [
                    np.zeros((len(block), len(candidate.scale)))
                    for block in self.blocks
                ]
            else:
                steps = self.readings.find_steps(candidate)
                parts += [self._derive(state, steps) for state in self.states]
            self._columns[key] = candidate, np.concatenate(parts)
        return self._columns[key][1]

    def _derive(self, state: ResponseState, moved: Steps) -> Array:
        """Return derivatives (n, k) of a block's readings by k parameters of one effect."""
        steps = moved.each
        count = len(steps)
        softer = dict[str, "Array"]()
        stiffer = dict[str, "Array"]()
        for name in moved.elements:
            for kind, into in (("compliance", softer), ("spring", stiffer)):
                rows, rates = moved.find_rates(name, kind)
                if len(rows):
                    whole = np.zeros((count, *rates.shape[1:]))
                    whole[rows] = rates
                    into[name] = whole
        out = state.soften(softer, count) + state.stiffen(stiffer, count)
        loaded = [_find_payloads(step) for step in steps]
        most = max((len(rates) for rates in loaded), default=0)
        for k in range(most):
            one = [rates[k] if k < len(rates) else None for rates in loaded]
            out = out + state.load(one, count)
        measured = state.block.measured
        for point in measured.setup.points:
            rates = np.array([_find_mass_rate(step, point.name) for step in steps])
            if rates.any():
                at = measured.places[point.name]
                heavier = [
                    MassRate(point.body, at, float(rate), np.zeros(3)) for rate in rates
                ]
                out = out + state.load(heavier, count)
        if not any(each.response_gains for step in steps for each in step[:2]):
            return state.derive(out)
        amplified = np.zeros((len(measured.responses), count))
        for j, response in enumerate(measured.responses):
            channel = response.motion.channel
            rates = np.array([_find_gain_rate(step, channel) for step in steps])
            now = 1.0 if state.gains is None else float(state.gains[j])
            amplified[j] = rates / now
        return state.derive(out) + state.amplify(amplified)

    @cached_property
    def _columns(
        self,
    ) -> dict[tuple[str, tuple[float, ...], int], tuple[Candidate, Array]]:
        return {}

    def step(self, candidate: Candidate) -> Array:
        """Return the change (n,) by a candidate without parameters; responses have none."""
        lines = np.zeros(sum(len(block) for block in self.blocks))
        read = self.readings.step(candidate) if self._is_read else np.zeros(0)
        return np.concatenate([read, lines])


def _find_payloads(step: Step) -> list[MassRate]:
    """Return the derivative of the payloads by a parameter."""
    (ahead, behind, width) = step
    pairs = zip(ahead.payloads, behind.payloads, strict=True)
    return [MassRate.between(more, less, width) for more, less in pairs]


def _find_mass_rate(step: Step, point: str) -> float:
    (ahead, behind, width) = step
    more, less = (state.sensor_masses.get(point, 0.0) for state in (ahead, behind))
    return (more - less) / width


def _find_gain_rate(step: Step, channel: str) -> float:
    """Return the derivative of a channel's gain by a parameter, of one effect."""
    (ahead, behind, width) = step
    more, less = (each.response_gains.get(channel, 0.0) for each in (ahead, behind))
    return (more - less) / width

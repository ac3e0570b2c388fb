"""Predictions of a campaign with frequency responses: readings, then the lines of each block."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.forward.response_state import MassRate, ResponseState
from stiffscope.gap.forward.robot_prediction import Pattern
from stiffscope.vjm.vibration.coordinates import PointMass

if TYPE_CHECKING:
    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.campaign.response_lines import ResponseBlock
    from stiffscope.gap.effects.effect import Candidate
    from stiffscope.gap.forward.robot_prediction import RobotPrediction
    from stiffscope.gap.forward.steps import Step, Steps
    from stiffscope.runtime.types import Array


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
    """

    campaign: Campaign
    readings: RobotPrediction
    blocks: tuple[ResponseBlock, ...]

    @cached_property
    def states(self) -> tuple[ResponseState, ...]:
        """The robot as it was hit, of each block; those of one set-up share their modes."""
        influences = self.readings.influences
        elastic = self.readings.elastic_state
        extra = dict[str, float]()
        for influence in influences:
            for name, mass in influence.sensor_masses.items():
                extra[name] = extra.get(name, 0.0) + mass
        mechanism = elastic.loaded_mechanism
        states = list[ResponseState]()
        for block in self.blocks:
            measured = block.measured
            masses = [
                PointMass(point.body, measured.places[point.name], mass)
                for point in measured.setup.points
                for mass in [(point.mass or 0.0) + extra.get(point.name, 0.0)]
                if mass > 0.0
            ]
            states.append(ResponseState(block, mechanism, tuple(masses)))
        return tuple(states)

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
                mine, rates = moved.find_rates(name, kind)
                if len(mine):
                    whole = np.zeros((count, *rates.shape[1:]))
                    whole[mine] = rates
                    into[name] = whole
        out = state.soften(softer, count) + state.stiffen(stiffer, count)
        loaded = [_find_payloads(step) for step in steps]
        most = max((len(each) for each in loaded), default=0)
        for k in range(most):
            one = [each[k] if k < len(each) else None for each in loaded]
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
        return state.derive(out)

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
    more, less = (each.sensor_masses.get(point, 0.0) for each in (ahead, behind))
    return (more - less) / width

"""Predicted readings of a robot with given effects, and derivatives by effect parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.columns import swap_columns
from stiffscope.gap.effects.effect import Effect, Influence
from stiffscope.gap.effects.instruments import SensorStep
from stiffscope.gap.forward.robot_readings import RobotReadings
from stiffscope.gap.forward.slopes import find_slopes
from stiffscope.gap.forward.steps import Steps

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.gap.effects.effect import Candidate
    from stiffscope.runtime.types import Array

_STEP = 1e-4  # finite-difference step relative to a parameter's prior size


@dataclass(frozen=True)
class Pattern(Effect):
    """A nuisance pattern defined by the derivatives (n, k) of the readings."""

    columns: Callable[[RobotReadings], Array]

    def influence(self, values: Array) -> Influence:
        """Return no change of the robot or its instruments."""
        del values
        return Influence()


@dataclass(frozen=True)
class Gain(Pattern):
    """A nuisance pattern whose columns (n, k) multiply the readings."""


class RobotPrediction(RobotReadings):
    """Prediction for the robot with effects at the campaign's poses."""

    @property
    def values(self) -> Array:
        """Predicted readings (n,), with patterns, weight in stiffnesses and instruments."""
        return self._values

    @cached_property
    def _values(self) -> Array:
        out = self.plain_readings
        if self.heavier:
            out = out + np.where(self.is_motion, 0.0, self.weight)
        for candidate, values in self.parameters:
            if isinstance(candidate.action, Pattern):
                out = out + self._follow(candidate.action) @ np.array(values)
        factor, shift = self.display
        out = factor * out + shift
        return out + self.projection.share(self.campaign.value - out)

    def columns(self, candidate: Candidate) -> Array:
        """Return the derivatives (n, k) with respect to a candidate's internal parameters."""
        key = candidate.name, candidate.scale, id(candidate.action)
        if key not in self._columns:
            if isinstance(candidate.action, Pattern):
                columns = self._follow(candidate.action)
            else:
                columns = self._grow(self._derivatives(candidate))
            columns = self.display[0][:, None] * columns
            if isinstance(candidate.action, SensorStep):
                columns[:, 0] += self.behind(
                    candidate.action.instrument, candidate.action.first
                )
            columns = self.projection.without(columns)
            self._columns[key] = (
                candidate,
                columns,
            )  # keeps the action alive, and so its id
        return self._columns[key][1]

    def _follow(self, pattern: Pattern) -> Array:
        """Return the columns (n, k) of a nuisance pattern."""
        columns = pattern.columns(self)
        return (
            columns * self.plain_readings[:, None]
            if isinstance(pattern, Gain)
            else columns
        )

    def _grow(self, columns: Array) -> Array:
        """Return other columns (n, k) multiplied by the gains among the patterns."""
        growth = np.ones(len(self.campaign))
        for candidate, values in self.parameters:
            if isinstance(candidate.action, Gain):
                growth += candidate.action.columns(self) @ np.array(values)
        return columns * growth[:, None]

    @cached_property
    def _columns(
        self,
    ) -> dict[tuple[str, tuple[float, ...], int], tuple[Candidate, Array]]:
        return {}

    def _derivatives(self, candidate: Candidate) -> Array:
        return find_slopes(self, self.find_steps(candidate))

    def find_steps(self, candidate: Candidate) -> Steps:
        """Return small steps of a candidate's parameters; those of a linear effect are kept."""
        action: Effect = candidate.action
        sizes = _STEP * np.array(candidate.scale)
        if not action.linear:
            key = candidate.name, len(candidate.scale)
            known = (v for c, v in self.parameters if (c.name, len(v)) == key)
            here = np.array(next(known, np.zeros(len(sizes))))
            within = here + 2.0 * sizes * candidate.one_sided  # its range
            return Steps.of(action, within, sizes)
        linear_steps = self.at.linear_steps
        if id(action) not in linear_steps:
            # holding the action keeps its id its own
            linear_steps[id(action)] = action, Steps.of(action, 0.0 * sizes, sizes)
        return linear_steps[id(action)][1]

    def step(self, candidate: Candidate) -> Array:
        """Return the change (n,) by a candidate without parameters: weight, unit or sign."""
        influence: Influence = candidate.action.influence(np.zeros(0))
        change = np.zeros(len(self.campaign))
        if influence.weight:
            change = self.display[0] * self._grow(self.weight[:, None])[:, 0]
        for name, factor in influence.factors.items():
            shown = self.shown_by(name) & self.campaign.is_displacement
            change = np.where(
                shown, (factor - 1.0) * self.display[0] * self.plain_readings, change
            )
        if influence.swaps:
            swapped = replace(
                self, campaign=swap_columns(self.campaign, influence.swaps)
            )
            return swapped.values - self.values
        return self.projection.without(change[:, None])[:, 0]

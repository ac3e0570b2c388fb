"""Readings of instruments for true motions, with rotated, scaled or shifted instruments."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.quantities import AXES
from stiffscope.gap.effects.instruments import INSTRUMENT, ROTATION, TRANSLATION

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.effects.effect import Influence, Row
    from stiffscope.gap.forward.forward_model import Parameters
    from stiffscope.runtime.types import Array, Flags, Indices


@dataclass(frozen=True)
class InstrumentReadings:
    """Instruments of a campaign with effects."""

    campaign: Campaign
    parameters: Parameters

    @cached_property
    def influences(self) -> tuple[Influence, ...]:
        """Changes by each effect."""
        return tuple(
            c.action.influence(np.array(values)) for c, values in self.parameters
        )

    def instrument(self, sensor: int) -> Array:
        """Return the matrix (6, 6) from true to shown motion of a sensor, or (-1) at M."""
        if sensor >= 0 and self.campaign.sensors[sensor].absolute:
            return np.eye(6)
        if sensor not in self._instruments:
            scale = 1.0
            (x, y, z) = np.zeros(3)
            for influence in self.influences:
                for name in self._names_of(sensor):
                    scale *= 1.0 + influence.gains.get(name, 0.0)
                    x, y, z = np.array([x, y, z]) + influence.turns.get(name, 0.0)
            turn = np.eye(3) + np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            self._instruments[sensor] = scale * np.kron(np.eye(2), turn)
        return self._instruments[sensor]

    @cached_property
    def _instruments(self) -> dict[int, Array]:
        return {}

    def _names_of(self, sensor: int) -> tuple[str, ...]:
        """Return names of an instrument in effects; `instrument` is all if nothing is read at M."""
        sensor_names = [] if sensor < 0 else [self.campaign.sensors[sensor].name]
        common = [INSTRUMENT] if sensor < 0 or not self.at_tool.any() else []
        return tuple(dict.fromkeys(sensor_names + common))

    def gain(self, sensor: int) -> float:
        """Return the mean gain of an instrument over all directions."""
        return float(np.cbrt(np.linalg.det(self.instrument(sensor)[:3, :3])))

    def gain_of(self, name: str) -> float:
        """Return the ratio of shown to true motion of a named instrument."""
        return float(
            np.prod(
                [1.0 + influence.gains.get(name, 0.0) for influence in self.influences]
            )
        )

    @cached_property
    def at_tool(self) -> Flags:
        """(n,) whether a reading is at M, including stiffnesses but not frequencies."""
        return self.campaign.at_tool

    def by_sensor(self, chosen: Flags) -> Iterator[tuple[int, Indices]]:
        """Yield every sensor, and -1 for M, that has chosen readings (n,), with their rows."""
        for k in range(-1, len(self.campaign.sensors)):
            rows = np.flatnonzero(chosen & (self.campaign.sensor == k))
            if rows.size:
                yield k, rows

    def split_sensors(self, rows: Indices) -> Iterator[tuple[int, Indices]]:
        """Yield every sensor, and -1 for M, that reads some of the rows (m,), with indices into them."""
        sensor = self.campaign.sensor[rows]
        for k in np.unique(sensor).tolist():
            yield k, np.flatnonzero(sensor == k)

    def shown_by(self, place: str) -> Flags:
        """Return flags (n,) of an instrument's readings; that at M means all if M is not read."""
        c = self.campaign
        if place in {INSTRUMENT, TRANSLATION, ROTATION}:
            shown = (
                self.at_tool
                if self.at_tool.any()
                else (c.sensor >= 0) & c.is_displacement
            )
            part = (
                True
                if place == INSTRUMENT
                else (c.direction >= 3) == (place == ROTATION)
            )
            return shown & part
        if place in AXES:
            return (
                (c.sensor < 0) & (c.direction == AXES.index(place)) & c.is_displacement
            )
        names = [sensor.name for sensor in c.sensors]
        return c.sensor == (names.index(place) if place in names else len(names))

    @cached_property
    def display(self) -> tuple[Array, Array]:
        """Factors (n,) on deflections and deviations, and shifts (n,)."""
        c = self.campaign
        moving = self.campaign.is_displacement
        factor = np.ones(len(c))
        shift = np.zeros(len(c))
        for influence in self.influences:
            for name, size in influence.factors.items():
                factor = np.where(moving & self.shown_by(name), size * factor, factor)
            for name, (row, size) in influence.jumps.items():
                shift = shift + size * self.behind(name, row)
        return factor, shift

    def behind(self, name: str, row: Row) -> Flags:
        """Return flags (n,) of an instrument's deflections and deviations from a row on."""
        c = self.campaign
        later = (c.file > row[0]) | ((c.file == row[0]) & (c.line >= row[1]))
        return self.shown_by(name) & c.is_displacement & later

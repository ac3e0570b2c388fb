"""Kinds that are motions: deflections, deviations and positions, and how they are predicted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.kinds.kind import (
    AXES,
    NO_MODE,
    Kind,
    Predictor,
    Quantity,
    along_axes,
)
from stiffscope.robot.file.quantities import LENGTH, Dimension

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.gap.effects.effect import Payload
    from stiffscope.gap.forward.robot_readings import RobotReadings
    from stiffscope.runtime.types import Array, Indices

# `least` is the smallest standard uncertainty of any instrument.
MOVED = Dimension("a displacement", "m", "um", 1e-14, 10.0)
_TURNED = Dimension("a rotation", "rad", "urad", 1e-14, 10)
_THERE = Dimension("a position", "m", "mm", 1e-14, LENGTH.most)


class Motions(Predictor):
    """Motions of M or of a sensor's point under terminal loads."""

    def read(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the readings (m,) due to robot, loads and instruments."""
        c = prediction.campaign
        out = np.zeros(len(rows))
        for k, which in prediction.split_sensors(rows):
            chosen = rows[which]
            axis = prediction.axis[chosen]
            twist = prediction.twist[chosen]
            shown = prediction.instrument(k)
            out[which] = np.einsum("ni,ij,nj->n", axis, shown, twist)
        placed = prediction.placed_instruments
        if placed is not None:
            instrument_rows = prediction.at.instruments.rows
            seen = np.zeros(len(c))
            seen[instrument_rows] = placed.seen - (
                0.0 if c.expected is None else c.expected[instrument_rows]
            )
            absolute = c.is_absolute[rows]
            out[absolute] = seen[rows[absolute]]
        return out

    def find_sense(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the sensed terminal directions a (m, cases)."""
        at = prediction.at
        sensors = prediction.campaign.sensors
        out = np.zeros((len(rows), at.cases))
        for k, which in prediction.split_sensors(rows):
            axis = prediction.axis[rows[which]]
            if k < 0:
                out[which, :6] = axis @ prediction.instrument(k)
            else:
                seen = axis if sensors[k].absolute else prediction.gain(k)
                out[which, at.sensor_cases(k)] = seen
        return out

    def find_drive(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the applied terminal loads b (m, cases)."""
        return prediction.applied_loads[rows]

    def find_modal_pair(
        self, prediction: RobotReadings, rows: Indices, sway: Callable[[], Array]
    ) -> tuple[Array, Array] | None:
        """Return None: sense and drive tell all."""
        del prediction, rows, sway
        return None

    def weigh(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the changes (m,) by the robot's own weight; zero for deflections."""
        c = prediction.campaign
        at = prediction.at
        out = np.zeros(len(rows))
        rest = np.flatnonzero(c.shows_rest[rows])
        for k, shown in prediction.split_sensors(rows[rest]):
            which = rest[shown]
            chosen = rows[which]
            moved = prediction.elastic_state.move_sensor(k)
            twist = at.robot.acceleration * moved[c.pose[chosen], :, at.weight_case]
            out[which] = np.einsum(
                "ni,ij,nj->n", prediction.axis[chosen], prediction.instrument(k), twist
            )
        return out

    def load(
        self,
        prediction: RobotReadings,
        rows: Indices,
        payload: Payload,
        work: Array,
    ) -> Array:
        """Return the derivatives (m,) by a payload: its work; zero for deflections."""
        del payload
        return np.where(prediction.campaign.shows_rest[rows], work, 0.0)

    def turn(self, prediction: RobotReadings, rows: Indices, turn: Array) -> Array:
        """Return the derivatives (m,) by a small rotation (6, 6) of their instrument."""
        out = np.zeros(len(rows))
        for k, which in prediction.split_sensors(rows):
            chosen = rows[which]
            axis = prediction.axis[chosen]
            looked = np.einsum("ni,ij,nj->n", axis, turn, prediction.twist[chosen])
            out[which] = prediction.gain(k) * looked
        return out


_MOTIONS = Motions()

DEFLECTION = Kind(
    name="deflection",
    plural="deflections",
    called="deflection",
    quantities=along_axes("d"),
    instrument="",
    dimensions=(MOVED, _TURNED),
    gaps=("displacement", "rotation", "displacement"),
    by_column=True,
    wrench="applied",
    is_difference=True,
    is_displacement=True,
    is_motion=True,
    is_relative=False,
    is_positive=False,
    is_absolute=False,
    is_steady=False,
    shows_rest=False,
    spare_modes=0,
    noise_group="deflection",
    gain_sign=1.0,
    force_sign=1.0,
    predictor=_MOTIONS,
)

DEVIATION = Kind(
    name="deviation",
    plural="deviations",
    called="deviation",
    quantities=along_axes("e"),
    instrument="",
    dimensions=(MOVED, _TURNED),
    gaps=("displacement", "rotation", "displacement"),
    by_column=True,
    wrench="zero",
    is_difference=False,
    is_displacement=True,
    is_motion=True,
    is_relative=False,
    is_positive=False,
    is_absolute=False,
    is_steady=False,
    shows_rest=True,
    spare_modes=0,
    noise_group="deviation",
    gain_sign=1.0,
    force_sign=0.0,
    predictor=_MOTIONS,
)

POSITION = Kind(
    name="position",
    plural="positions",
    called="position",
    quantities=tuple(
        Quantity("", direction, NO_MODE) for direction in range(len(AXES))
    ),
    instrument="",
    dimensions=(_THERE, _THERE),
    gaps=("position", "position", "distance"),
    by_column=False,
    wrench="applied",
    is_difference=False,
    is_displacement=False,
    is_motion=True,
    is_relative=False,
    is_positive=False,
    is_absolute=True,
    is_steady=False,
    shows_rest=True,
    spare_modes=0,
    noise_group="position",
    gain_sign=0.0,
    force_sign=0.0,
    predictor=_MOTIONS,
)

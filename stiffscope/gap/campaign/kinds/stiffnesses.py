"""Kinds that are stiffnesses at M, with other motions held or free, and their prediction."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.kinds.kind import Kind, Predictor, along_axes
from stiffscope.robot.file.quantities import Dimension

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.gap.effects.effect import Payload
    from stiffscope.gap.forward.robot_readings import RobotReadings
    from stiffscope.runtime.types import Array, Indices

_STIFF = (
    Dimension("a stiffness", "N/m", "N/um", 1e-6, 1e18),
    Dimension("a rotational stiffness", "N*m/rad", "N*m/mrad", 1e-6, 1e18),
)


class _AtTool(Predictor):
    """Stiffnesses at M, which see no weight of payloads."""

    def find_modal_pair(
        self, prediction: RobotReadings, rows: Indices, sway: Callable[[], Array]
    ) -> tuple[Array, Array] | None:
        """Return None: sense and drive tell all."""
        del prediction, rows, sway
        return None

    def load(
        self,
        prediction: RobotReadings,
        rows: Indices,
        payload: Payload,
        work: Array,
    ) -> Array:
        """Return zeros (m,)."""
        del prediction, payload, work
        return np.zeros(len(rows))


def _turned_back(prediction: RobotReadings, turn: Array) -> Array:
    """Return the change (6, 6) of shown motion over shown motion by a turned instrument."""
    shown = np.linalg.inv(prediction.instrument(-1))
    return turn @ shown * prediction.gain(-1)


class HeldStiffness(_AtTool):
    """Diagonals K_ii of the apparent stiffness matrix: other motions are held."""

    def read(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the readings (m,) due to robot, loads and instruments."""
        return prediction.entries(prediction.shown_stiffness)[rows]

    def find_sense(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the sensed terminal directions a (m, cases): ``-K_i``."""
        c = prediction.campaign
        out = np.zeros((len(rows), prediction.at.cases))
        shown = prediction.shown_stiffness[c.pose[rows], c.direction[rows]]
        out[:, :6] = -shown @ prediction.instrument(-1)
        return out

    def find_drive(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the applied terminal loads b (m, cases) of the unit motion."""
        c = prediction.campaign
        out = np.zeros((len(rows), prediction.at.cases))
        shown = prediction.shown_stiffness[c.pose[rows], :, c.direction[rows]]
        out[:, :6] = shown * prediction.force_scale
        return out

    def weigh(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the changes (m,) by the robot's own weight."""
        return prediction.entries(prediction.at.weight_stiffness)[rows]

    def turn(self, prediction: RobotReadings, rows: Indices, turn: Array) -> Array:
        """Return the derivatives (m,) by a small rotation (6, 6) of their instrument."""
        back = _turned_back(prediction, turn)
        return prediction.entries(-prediction.shown_stiffness @ back)[rows]


class FreeStiffness(_AtTool):
    """Pushes 1/C_ii: force over motion in its direction, other motions free."""

    def read(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the readings (m,) due to robot, loads and instruments."""
        return prediction.pushes[rows]

    def find_sense(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the sensed terminal directions a (m, cases)."""
        out = np.zeros((len(rows), prediction.at.cases))
        pushes = prediction.pushes[rows, None]
        out[:, :6] = -prediction.axis[rows] @ prediction.instrument(-1) * pushes
        return out

    def find_drive(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the applied terminal loads b (m, cases)."""
        out = np.zeros((len(rows), prediction.at.cases))
        pushes = prediction.pushes[rows, None]
        out[:, :6] = prediction.axis[rows] * pushes * prediction.force_scale
        return out

    def weigh(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the changes (m,) by the robot's own weight."""
        stiffness = prediction.shown_stiffness + prediction.at.weight_stiffness
        entries = prediction.entries(np.linalg.inv(stiffness))[rows]
        return 1.0 / entries - prediction.pushes[rows]

    def turn(self, prediction: RobotReadings, rows: Indices, turn: Array) -> Array:
        """Return the derivatives (m,) by a small rotation (6, 6) of their instrument."""
        back = _turned_back(prediction, turn)
        change = prediction.entries(back @ prediction.shown_compliance)[rows]
        return -(prediction.pushes[rows] ** 2) * change


STIFFNESS = Kind(
    name="stiffness",
    plural="stiffnesses",
    called="stiffness",
    quantities=along_axes("k"),
    instrument="",
    dimensions=_STIFF,
    gaps=("stiffness", "rotational stiffness", "stiffness"),
    by_column=False,
    wrench="none",
    is_difference=False,
    is_displacement=False,
    is_motion=False,
    is_relative=True,
    is_positive=True,
    is_absolute=False,
    is_steady=False,
    shows_rest=False,
    spare_modes=0,
    noise_group="stiffness",
    gain_sign=-1.0,
    force_sign=-1.0,
    predictor=HeldStiffness(),
)

PUSH = Kind(
    name="push",
    plural="pushes",
    called="stiffness",
    quantities=along_axes("p"),
    instrument="",
    dimensions=_STIFF,
    gaps=("stiffness", "rotational stiffness", "stiffness"),
    by_column=False,
    wrench="none",
    is_difference=False,
    is_displacement=False,
    is_motion=False,
    is_relative=True,
    is_positive=True,
    is_absolute=False,
    is_steady=False,
    shows_rest=False,
    spare_modes=0,
    noise_group="push",
    gain_sign=-1.0,
    force_sign=-1.0,
    predictor=FreeStiffness(),
)

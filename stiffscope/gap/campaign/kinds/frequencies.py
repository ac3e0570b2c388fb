"""Natural frequencies with locked drives, and how they are predicted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.kinds.kind import Kind, Predictor, Quantity
from stiffscope.robot.file.quantities import Dimension

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.gap.effects.effect import Payload
    from stiffscope.gap.forward.robot_readings import RobotReadings
    from stiffscope.runtime.types import Array, Indices

MOST_MODES = 30
_OFTEN = Dimension("a frequency", "Hz", "Hz", 1e-9, 1e12)


class Frequencies(Predictor):
    """Natural frequencies of modes, which no terminal load or instrument changes."""

    def read(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the natural frequencies (m,), Hz."""
        return prediction.elastic_state.frequencies[prediction.find_modes(rows)]

    def find_sense(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return zeros (m, cases)."""
        return np.zeros((len(rows), prediction.at.cases))

    def find_drive(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return zeros (m, cases)."""
        return np.zeros((len(rows), prediction.at.cases))

    def find_modal_pair(
        self, prediction: RobotReadings, rows: Indices, sway: Callable[[], Array]
    ) -> tuple[Array, Array] | None:
        """Return both factors (m, k) of ``δf = -w · δC w / (8 π² f)`` at an element."""
        pose, mode = prediction.find_modes(rows)
        moved = sway()[pose, :, mode]
        frequencies = prediction.elastic_state.frequencies[pose, mode, None]
        return -moved / (8.0 * np.pi**2 * frequencies), moved

    def weigh(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return zeros (m,): a weight does not change a frequency."""
        del prediction
        return np.zeros(len(rows))

    def load(
        self,
        prediction: RobotReadings,
        rows: Indices,
        payload: Payload,
        work: Array,
    ) -> Array:
        """Return the derivatives (m,) by a payload's inertia: ``δf = -f (v · m v + w · J w) / 2``."""
        del work
        at = prediction.at
        elastic = prediction.elastic_state
        v, w = np.split(elastic.twist_modes(payload.body, payload.at), 2, axis=1)
        axes = at.configurations.frame(payload.body)[0][at.shaken]
        arm = axes @ payload.moments
        turned = np.cross(w, arm[..., None], axis=1)
        inertia = payload.mass * np.square(v).sum(axis=1)
        own = axes @ payload.inertia @ np.swapaxes(axes, 1, 2)
        inertia = inertia + (w * (own @ w)).sum(axis=1)
        rate = inertia + 2.0 * (v * turned).sum(axis=1)
        return (-0.5 * elastic.frequencies * rate)[prediction.find_modes(rows)]

    def turn(self, prediction: RobotReadings, rows: Indices, turn: Array) -> Array:
        """Return zeros (m,): no instrument has a direction."""
        del prediction, turn
        return np.zeros(len(rows))


FREQUENCY = Kind(
    name="frequency",
    plural="frequencies",
    called="frequency",
    quantities=tuple(Quantity(f"f{k + 1}", 0, k) for k in range(MOST_MODES)),
    instrument="f",
    dimensions=(_OFTEN, _OFTEN),
    gaps=("frequency", "frequency", "frequency"),
    by_column=False,
    wrench="none",
    is_difference=False,
    is_displacement=False,
    is_motion=False,
    is_relative=True,
    is_positive=True,
    is_absolute=False,
    is_steady=True,
    shows_rest=False,
    spare_modes=0,
    noise_group="frequency",
    gain_sign=0.0,
    force_sign=0.0,
    predictor=Frequencies(),
)

"""What to measure next: the reading that best separates two explanations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.diagnosis import NextMeasurement
from stiffscope.gap.quantities import DEVIATION, QUANTITIES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.gap.forward_model import ForwardModel
    from stiffscope.gap.search import Hypothesis

    Array = NDArray[np.floating[Any]]

WORTHWHILE = float(np.log(3.0))  # expected ln-odds from which a reading is worth taking


def next_measurement(
    model: ForwardModel, sigma: Array, first: Hypothesis, second: Hypothesis
) -> NextMeasurement | None:
    """Return the measurement with the greatest expected ln-odds between two explanations.

    The expected ln-odds are half the squared distance of their predictions in standard deviations.

    Parameters
    ----------
    model
        Offers the measurements: `ForwardModel.trial`.
    sigma
        (n,) noise of the campaign's readings.
    first, second
        The explanations.

    Returns
    -------
        None where no reading brings more than `WORTHWHILE`.

    """
    trial = model.trial(sigma)
    first_values, second_values = (trial.model.predict(h.parameters).values for h in (first, second))
    gain = 0.5 * np.bincount(trial.group, ((first_values - second_values) / trial.sigma) ** 2)
    best = int(np.argmax(gain))
    if not gain[best] >= WORTHWHILE:
        return None
    separates = tuple(" + ".join(sorted(h.names)) or "no effect" for h in (first, second))
    c = trial.model.campaign
    rows = np.flatnonzero(trial.group == best)
    row = int(rows[0])
    pose, code = int(c.pose[row]), int(c.quantity[row])
    if np.isnan(c.poses).any():
        return NextMeasurement(separates, float(gain[best]), pose=c.pose_names[pose], quantity=QUANTITIES[code])
    at = tuple(float(v) for v in c.poses[pose])
    kind = "deviation" if code // 6 == DEVIATION else "deflection"
    wrench = None if np.isnan(c.wrench[row]).any() else tuple(float(w) for w in c.wrench[row])
    quantity = kind if len(rows) > 1 else QUANTITIES[code]
    return NextMeasurement(separates, float(gain[best]), at, wrench, None, quantity)

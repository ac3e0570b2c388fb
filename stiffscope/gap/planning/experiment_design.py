"""Experiment design: the measurement that best distinguishes two explanations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.campaign import AT_TOOL
from stiffscope.gap.campaign.kinds import KIND_OF, KINDS, QUANTITY
from stiffscope.gap.forward.forward_model import join_columns
from stiffscope.gap.inference.diagnosis import NextMeasurement

if TYPE_CHECKING:
    from collections.abc import Iterable

    from stiffscope.gap.forward.forward_model import Trial
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array

    Predicted = tuple[Array, Array, Array]

WORTHWHILE = 1.0  # least expected ln-odds of a worthwhile reading


def next_measurement(
    trial: Trial, first: Hypothesis, others: Iterable[Hypothesis]
) -> NextMeasurement | None:
    """Return the measurement with the greatest expected ln-odds between two explanations.

    Parameters
    ----------
    trial
        The available measurements.
    first
        The explanation assumed to be true.
    others
        Competing explanations; the first one that readings can distinguish is used.

    Returns
    -------
        None if no reading is expected to gain `WORTHWHILE`. Explanations whose effects are too large for
        one of the poses are left out.
    """
    here = _predict(trial, first)
    if here is None:
        return None
    for second in others:
        there = _predict(trial, second)
        if there is None:
            continue
        gain = expected_log_odds(trial, here, there)
        best = int(np.argmax(gain))
        if gain[best] >= WORTHWHILE:
            separates = tuple(
                " + ".join(sorted(h.names)) or "no effect" for h in (first, second)
            )
            return _describe(trial, best, separates, float(gain[best]))
    return None


def _describe(
    trial: Trial, best: int, separates: tuple[str, ...], gain: float
) -> NextMeasurement:
    """Return one of the available measurements in a campaign's terms."""
    c = trial.model.campaign
    rows = np.flatnonzero(trial.group == best)
    row = int(rows[0])
    pose, code, load = (int(column[row]) for column in (c.pose, c.quantity, c.load))
    if np.isnan(c.poses).any():
        return NextMeasurement(
            separates, gain, pose=c.pose_names[pose], quantity=QUANTITY[code].name
        )
    read = np.unique(c.sensor[rows])
    kind = KINDS[int(KIND_OF[code])].name
    return NextMeasurement(
        separates=separates,
        expected_gain=gain,
        position=dict(
            zip(c.coordinates, (float(v) for v in c.poses[pose]), strict=True)
        ),
        label=c.pose_names[pose] if c.shown_in else None,
        wrench=None
        if np.isnan(c.wrench[row]).any()
        else tuple(float(w) for w in c.wrench[row]),
        pose=None,
        quantity=kind if len(rows) > 1 else QUANTITY[code].name,
        sensors=tuple(c.sensors[int(k)].name for k in read if k != AT_TOOL) or None,
        load=None if load == AT_TOOL or not c.wrench[row].any() else c.loads[load].name,
    )


def expected_log_odds(trial: Trial, first: Predicted, second: Predicted) -> Array:
    """Return expected ln-odds (g,) of measurements between two explanations, given the first.

    This is the relative entropy of their predictive Gaussians, which include noise and parameter
    uncertainty, so differences that the second's parameters can fit do not count.

    Parameters
    ----------
    trial
        Readings in groups, g of them.
    first, second
        Means, columns and covariances of the two predictions.

    References
    ----------
    MacKay, Information-based objective functions for active data selection, Neural Comp. 4 (1992).
    """
    (m1, x1, c1) = first
    (m2, x2, c2) = second
    gain = np.zeros(int(trial.group.max()) + 1)
    order = np.argsort(trial.group, kind="stable")
    groups, starts, counts = np.unique(
        trial.group[order], return_index=True, return_counts=True
    )
    for count in np.unique(counts):
        rows = order[starts[counts == count][:, None] + np.arange(count)]  # (m, count)
        difference = (m2 - m1)[rows]
        columns = (x1[rows], c1), (x2[rows], c2)
        s1, s2 = (np.eye(count) + x @ covariance @ x.mT for x, covariance in columns)
        volume = np.linalg.slogdet(s2)[1] - np.linalg.slogdet(s1)[1]
        trace = np.trace(np.linalg.solve(s2, s1), axis1=1, axis2=2)
        pull = np.linalg.solve(s2, difference[..., None])[..., 0]
        distance = np.einsum("mi,mi->m", difference, pull)
        gain[groups[counts == count]] = 0.5 * (distance + trace - count + volume)
    return gain


def _predict(trial: Trial, hypothesis: Hypothesis) -> Predicted | None:
    """Return readings (n,), derivatives (n, k), both over sigma, and covariance (k, k).

    None if the robot cannot be assembled with these effects at one of the poses.
    """
    sigma = trial.sigma
    try:
        prediction = trial.model.predict(hypothesis.parameters)
        columns = join_columns(prediction, hypothesis.candidates)
    except InputError:
        return None
    return prediction.values / sigma, columns / sigma[:, None], hypothesis.covariance

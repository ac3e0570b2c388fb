"""Columns of a campaign that seem to be exchanged."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.columns import swap_columns
from stiffscope.gap.campaign.quantities import AXES, WRENCH

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.forward.robot_prediction import RobotPrediction
    from stiffscope.runtime.types import Array, Flags

_BETTER = 0.5  # ratio of misfits below which two columns seem exchanged
_LEAST = 6  # readings that an exchange must change
_ROUNDING = 1e-9  # of the largest reading
_MOST_SENSORS = 12


def find_swaps(prediction: RobotPrediction) -> tuple[tuple[str, str], ...]:
    """Return the pairs of columns whose exchange brings a prediction much nearer to the readings."""
    c = prediction.campaign
    kinds = c.kind_numbers
    size = np.sqrt(np.bincount(kinds, c.value**2) / np.bincount(kinds))
    weight = 1.0 / np.where(size > 0.0, size, np.inf)[kinds]
    largest = float(np.abs(prediction.values).max(initial=0.0))
    out: list[tuple[float, tuple[str, str]]] = []
    for pair in _list_pairs(c):
        swapped = replace(prediction, campaign=swap_columns(c, [pair]))
        changed = np.abs(swapped.values - prediction.values) > _ROUNDING * largest
        if changed.sum() < _LEAST:
            continue
        before, after = (
            _misfit(weight * (c.value - state.values), changed)
            for state in (prediction, swapped)
        )
        if after < _BETTER * before:
            out.append((after / before, pair))
    return tuple(pair for _, pair in sorted(out))


def _misfit(left: Array, chosen: Flags) -> float:
    """Return the sum of squares of some residuals, without the largest tenth."""
    squares: Array = np.sort(left[chosen] ** 2)
    return float(np.sum(squares[: max(1, int(0.9 * len(squares)))]))


def _list_pairs(c: Campaign) -> Iterator[tuple[str, str]]:
    """Yield pairs of columns of one unit that have readings or loads."""
    applied: Flags = np.any(np.nan_to_num(c.wrench), axis=0)
    at_tool = (c.sensor < 0) & c.is_displacement
    read = np.isin(np.arange(len(AXES)), c.direction[at_tool])
    for names, used in ((WRENCH, applied), (AXES, read)):
        for half in (range(3), range(3, 6)):
            for i, j in combinations(half, 2):
                if used[i] or used[j]:
                    yield names[i], names[j]
    plain = [
        (k, sensor)
        for k, sensor in enumerate(c.sensors)
        if not sensor.absolute and (c.sensor == k).any()
    ]
    if len(plain) <= _MOST_SENSORS:
        for (_, first), (_, second) in combinations(plain, 2):
            if first.rotates == second.rotates:
                yield first.name, second.name

"""Steps in which instruments read, and the scatter that rounding to them adds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.runtime.types import Array


@dataclass(frozen=True)
class ResolutionSettings:
    """When readings count as rounded, and when that counts."""

    least: int = 10
    """Readings of an instrument: of fewer, multiples of one step may be chance."""
    apart: int = 3
    """Least number of different multiples among them."""
    exact: float = 1e-4
    """Largest deviation from a multiple of the step, in steps, e.g. by a conversion of units."""
    decades: tuple[int, int] = (-9, 0)
    """Powers of ten, m or rad, of the steps that are tried: 1, 2 and 5 times each."""
    counts: float = 0.3
    """Least scatter by rounding over the stated uncertainty that counts."""


RESOLUTION = ResolutionSettings()


def find_steps(campaign: Campaign) -> Array:
    """Return the step (n,) in which each reading was shown, m or rad; zero where none is seen.

    Stiffnesses, frequencies and absolute positions are not looked at.
    """
    c = campaign
    out = np.zeros(len(c))
    shown = c.is_displacement
    groups = 2 * c.channel + c.is_difference
    for group in np.unique(groups[shown]):
        rows = np.flatnonzero(shown & (groups == group))
        if len(rows) >= RESOLUTION.least:
            out[rows] = _find_step(np.abs(c.value[rows]))
    return out


def _find_step(values: Array) -> float:
    """Return the largest step of which all values (n,) are multiples; zero if there is none."""
    first, last = RESOLUTION.decades
    for decade in range(last, first - 1, -1):
        for digit in (5.0, 2.0, 1.0):
            multiples = values / (digit * 10.0**decade)
            steps = np.round(multiples)
            if len(np.unique(steps)) < RESOLUTION.apart:
                continue
            if np.abs(multiples - steps).max() < RESOLUTION.exact:
                return digit * 10.0**decade
    return 0.0


def find_rounding(campaign: Campaign) -> Array:
    """Return the scatter (n,) by rounding where it counts beside the stated uncertainty.

    A step s rounds evenly: s/√12.
    """
    rounding = find_steps(campaign) / np.sqrt(12.0)
    counts = ~(rounding <= RESOLUTION.counts * campaign.sigma)
    return np.where(counts, rounding, 0.0)

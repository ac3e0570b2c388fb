"""Scatter of readings that needs no model: of repeats, and about smooth curves of ordered loads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.runtime.types import Array, Indices


@dataclass(frozen=True)
class ScatterSettings:
    """When repeats and load curves tell the noise."""

    least: float = 3.0
    """Degrees of freedom: fewer tell nothing."""
    degree: int = 3
    """Of the polynomial through the readings of a load ladder; with the load at most cubed, it
    follows springs that harden, gaps and rolling contacts to a per cent."""
    spare: int = 2
    """Readings of a ladder beyond the polynomial's coefficients; fewer would follow the noise."""
    sure: float = 0.975
    """Probability: a noise larger than its bound by repeats and ladders at it is no noise."""


SCATTER = ScatterSettings()


def find_scatter(campaign: Campaign, rows: Indices, size: Array) -> tuple[float, float]:
    """Return the sum of squares of what repeats and smooth curves leave, and its degrees of freedom.

    Parameters
    ----------
    campaign
        The readings.
    rows
        Indices (m,) of those of one kind, without copies.
    size
        Size (n,) by which each reading's noise grows.
    """
    c = campaign
    squares = 0.0
    count = 0.0
    value = c.value / size
    wrench = np.nan_to_num(c.wrench)
    force = np.linalg.norm(wrench, axis=1)
    length = np.where(force > 0.0, force, 1.0)
    along = np.round(wrench / length[:, None], 6) + 0.0
    first = np.argmax(np.abs(along) > 0.0, axis=1)
    sign = np.sign(along[np.arange(len(c)), first])
    along = along * np.where(sign == 0.0, 1.0, sign)[:, None] + 0.0
    words = [c.pose, c.quantity, c.sensor, c.load, c.session]
    ladder = np.column_stack([*words, along])[rows]
    groups = np.unique(ladder, axis=0, return_inverse=True)[1].ravel()
    for group in range(int(groups.max(initial=-1)) + 1):
        members = rows[groups == group]
        x = (sign * force)[members]
        steps, which = np.unique(x, return_inverse=True)
        which = which.ravel()
        repeats: Array = np.bincount(which).astype(float)
        mean = np.bincount(which, value[members]) / repeats
        squares += float(np.sum((value[members] - mean[which]) ** 2))
        count += len(members) - len(steps)
        left, spare = _leave_smooth(steps, mean, repeats)
        squares += left
        count += spare
    return squares, count


def _leave_smooth(x: Array, y: Array, repeats: Array) -> tuple[float, float]:
    """Return the squares that a polynomial in the load leaves of means (k,), and degrees of freedom."""
    terms = SCATTER.degree + 1
    spare = len(x) - terms
    if spare < SCATTER.spare:
        return 0.0, 0.0
    columns = np.vander(x / np.abs(x).max(), terms)
    weight = np.sqrt(repeats)
    best = np.linalg.lstsq(columns * weight[:, None], y * weight, rcond=None)[0]
    return float(np.sum(repeats * (y - columns @ best) ** 2)), float(spare)

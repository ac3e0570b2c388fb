"""Residual metrics: the gap in % rms, its noise floor and its location."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.kinds import CHANNEL_OF, INSTRUMENTS, KINDS
from stiffscope.gap.campaign.quantities import AXES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.runtime.types import Array, Flags, Indices


@dataclass(frozen=True)
class AbsoluteGap:
    """Rms difference of model and measurement for one kind of reading, in its own unit."""

    unit: str
    before: float
    """After fitting instruments, targets and zeros, which are not part of the gap."""
    after: float
    held_out: float
    noise: float


def percent_rms(campaign: Campaign, model: Array, sigma: Array, chosen: Flags) -> float:
    """Return the gap in % rms between model values (n,) and readings, over the `chosen` ones.

    Stiffness and frequency: rms of (model − measured)/measured. Deflections and deviations:
    100·sqrt(Σ(r/σ)²/Σ(v/σ)²). Both are joined by their numbers of readings.
    """
    stiff = chosen & campaign.relative
    loose = chosen & ~campaign.relative
    left = model - campaign.value
    value = campaign.value
    squares = float(np.sum((left[stiff] / value[stiff]) ** 2))
    weighted, size = (
        float(np.sum((each[loose] / sigma[loose]) ** 2)) for each in (left, value)
    )
    squares += loose.sum() * weighted / max(size, 1e-300)
    return float(100 * np.sqrt(squares / max(chosen.sum(), 1)))


def split_by_kind(campaign: Campaign) -> dict[str, tuple[str, Flags]]:
    """Return unit and flags (n,) by kind of reading; kinds without readings are omitted."""
    c = campaign
    ranged = np.array([s.measures == "distance" for s in c.sensors] + [False])[c.sensor]
    turns = c.direction >= len(AXES) // 2
    out: dict[str, tuple[str, Flags]] = {}
    none = np.zeros(len(c), dtype=np.bool_)
    motions_first = sorted(range(len(KINDS)), key=lambda k: not KINDS[k].is_motion)
    for number in motions_first:
        kind = KINDS[number]
        parts = (~turns & ~ranged, turns & ~ranged, ranged)
        for name, turned, part in zip(kind.gaps, (0, 1, 0), parts, strict=True):
            before = out.get(name, ("", none))[1]
            mine = before | ((c.kind == number) & part)
            if mine.any():
                out[name] = kind.unit(turns=bool(turned)), mine
    return out


def rms_by_kind(
    campaign: Campaign, chosen: Flags, *sizes: Array
) -> dict[str, AbsoluteGap]:
    """Return the rms of four sizes (n,) over the chosen readings, by kind of reading."""
    kinds = {
        name: (unit, mine & chosen)
        for name, (unit, mine) in split_by_kind(campaign).items()
    }
    return {
        name: AbsoluteGap(
            unit, *(float(np.sqrt(np.mean(each[mine] ** 2))) for each in sizes)
        )
        for name, (unit, mine) in kinds.items()
        if mine.any()
    }


def by_direction(campaign: Campaign, normalized: Array) -> dict[str, float]:
    """Return shares of Σ(r/σ)² by (nearest) direction and for frequencies; residuals (n,) in σ."""
    which = CHANNEL_OF[campaign.quantity]
    shares = _shares((*AXES, *INSTRUMENTS), which, normalized)
    idle = set(range(len(AXES), len(shares))) - set(which.tolist())
    return {
        name: share for k, (name, share) in enumerate(shares.items()) if k not in idle
    }


def by_sensor(campaign: Campaign, normalized: Array) -> dict[str, float]:
    """Return shares of Σ(r/σ)² by sensor and axis read at M; normalized residuals (n,)."""
    shares = _shares(campaign.instruments, campaign.channel, normalized)
    read = set(np.unique(campaign.channel).tolist())
    return {name: share for k, (name, share) in enumerate(shares.items()) if k in read}


def _shares(
    names: Sequence[str], which: Indices, normalized: Array
) -> dict[str, float]:
    totals = np.bincount(which, weights=normalized**2, minlength=len(names))
    return dict(zip(names, (totals / max(totals.sum(), 1e-300)).tolist(), strict=True))


def by_pose(campaign: Campaign, normalized: Array) -> tuple[tuple[float, ...], ...]:
    """Return the rms of normalized residuals (n,) by pose and direction; NaN if not read."""
    cell = campaign.pose * 6 + campaign.direction
    size = 6 * len(campaign.pose_names)
    count = np.bincount(cell, minlength=size)
    total = np.bincount(cell, weights=normalized**2, minlength=size)
    rms = np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan).reshape(
        -1, 6
    )
    return tuple(tuple(float(v) for v in row) for row in rms)

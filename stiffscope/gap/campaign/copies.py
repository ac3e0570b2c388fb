"""Readings that repeat others exactly: pasted twice, not measured twice."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.runtime.types import Flags

COPIES = 0.9
"""Least fraction of repetitions with equal values that are regarded as copies."""


def find_copies(c: Campaign) -> tuple[Flags, str]:
    """Return which readings (n,) are not copies, and a remark; empty if there are no copies."""
    words = [c.pose, c.quantity, c.sensor, c.load, c.session]
    cell = np.column_stack([*words, np.nan_to_num(c.wrench), np.nan_to_num(c.sigma)])
    read = np.flatnonzero(~np.isnan(c.value))  # empty cells of a plan are not readings
    whole = np.column_stack([cell, c.value])[read]
    repeated = len(read) - len(np.unique(cell[read], axis=0))
    first = np.unique(whole, axis=0, return_index=True)[1]
    count = len(read) - len(first)
    once = np.ones(len(c), dtype=np.bool_)
    if not count or count < COPIES * repeated:
        return once, ""
    once[read] = False
    once[read[first]] = True
    k = int(np.flatnonzero(~once[read])[0])
    same = first[int(np.flatnonzero((whole[first] == whole[k]).all(axis=1))[0])]
    where = c.where(int(read[k]))
    other = c.where(int(read[same]))
    return (
        once,
        f"{count} readings repeat others exactly and count once: {where} is {other}",
    )

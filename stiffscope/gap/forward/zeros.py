"""Unknown zeros that sessions of an instrument share: in every fit they take the value that fits best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.quantities import DEVIATION

if TYPE_CHECKING:
    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.runtime.types import Array, Indices


@dataclass(frozen=True)
class SharedZeros:
    """Which readings (n,) share a zero, -1 for none, and their weights (n,)."""

    group: Indices
    weight: Array

    @classmethod
    def from_campaign(cls, c: Campaign) -> SharedZeros:
        """Zeros of a campaign's sensors, one a session."""
        unknown = np.array([s.zero == "session" for s in c.sensors] + [False])
        free = unknown[c.sensor] & (c.kind <= DEVIATION)
        group = np.full(len(c), -1)
        weight = np.where(np.isnan(c.sigma), 1.0, c.sigma**-2.0)
        if free.any():
            key = np.stack([c.sensor, c.session], axis=1)[free]
            group[free] = np.unique(key, axis=0, return_inverse=True)[1].ravel()
        for k in range(group.max(initial=-1) + 1):  # stated and unknown uncertainties do not mix
            mine = group == k
            if np.isnan(c.sigma[mine]).any():
                weight[mine] = 1.0
        return cls(group, weight)

    def share(self, change: Array) -> Array:
        """The best zeros' share (n,) in a change (n,) of readings: the weighted mean over those that share a zero."""
        mine = self.group >= 0
        if not mine.any():
            return np.zeros(len(change))
        total = np.bincount(self.group[mine], self.weight[mine] * change[mine])
        return np.where(mine, (total / np.bincount(self.group[mine], self.weight[mine]))[self.group], 0.0)

    def without(self, columns: Array) -> Array:
        """Columns (n, k) with the unknown zeros projected out."""
        if not columns.shape[1] or not (self.group >= 0).any():
            return columns
        return columns - np.stack([self.share(column) for column in columns.T], axis=1)

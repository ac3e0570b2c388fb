"""Loads in the order in which they were applied, and what friction holds under them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.runtime.types import Array, Indices

_PARALLEL = 1e-6  # relative deviation of two wrenches along one line


def size_loads(wrench: Array) -> Array:
    """Return the sizes (n,) of wrenches (n, 6): of the force, N, or of a pure moment, N·m."""
    force, moment = np.split(np.nan_to_num(wrench), 2, axis=1)
    size: Array = np.linalg.norm(force, axis=1)
    turning: Array = np.linalg.norm(moment, axis=1)
    return np.where(size > 0.0, size, turning)


@dataclass(frozen=True)
class LoadChains:
    """Chains of loads at one pose, in the order of the table.

    Loads that follow each other at one pose and along one line, in either sense, are one chain:
    the robot was not unloaded in between. Each chain starts from the unloaded robot.
    """

    campaign: Campaign

    @cached_property
    def steps(self) -> tuple[Indices, tuple[Indices, ...]]:
        """Step (n,) of each reading, -1 if it is no deflection; and for each rank in a chain the steps."""
        c = self.campaign
        step = np.full(len(c), -1)
        rows = np.flatnonzero(c.is_difference)
        rows = rows[np.lexsort((c.line[rows], c.file[rows]))]
        wrench = np.nan_to_num(c.wrench)
        ranks: list[int] = []
        before = -1
        line = np.zeros(6)
        for row in rows.tolist():
            same_place = before >= 0 and (
                c.pose[row] == c.pose[before] and c.load[row] == c.load[before]
            )
            if same_place and np.array_equal(wrench[row], wrench[before]):
                step[row] = len(ranks) - 1
                continue
            goes_on = same_place and _is_parallel(wrench[row], line)
            ranks.append(ranks[-1] + 1 if goes_on else 0)
            line = wrench[row] if not goes_on or wrench[row].any() else line
            step[row] = len(ranks) - 1
            before = row
        rank = np.array(ranks, dtype=np.int64)
        levels = tuple(
            np.flatnonzero(rank == level) for level in range(max(ranks, default=-1) + 1)
        )
        return step, levels

    def hold(self, force: Array, friction: float) -> Array:
        """Return the force (n,) that friction holds under drive forces (n,) of n readings.

        The spring beside it carries the rest, the play operator of the drive's force: it stays
        where it is until that differs by more than the friction.
        """
        step, levels = self.steps
        read = step >= 0
        if not read.any():
            return np.zeros(len(force))
        applied = np.zeros(int(step.max(initial=-1)) + 1)
        applied[step[read]] = force[read]
        carried = np.zeros_like(applied)
        for level, here in enumerate(levels):
            before = carried[here - 1] if level else np.zeros(len(here))
            carried[here] = np.clip(
                before, applied[here] - friction, applied[here] + friction
            )
        return np.where(read, force - carried[step], 0.0)


def _is_parallel(first: Array, second: Array) -> bool:
    """Return whether two wrenches (6,) are along one line, as a load of zero always is."""
    across = first * np.linalg.norm(second) ** 2 - second * (first @ second)
    size = np.linalg.norm(first) * np.linalg.norm(second) ** 2
    return bool(np.linalg.norm(across) <= _PARALLEL * size)

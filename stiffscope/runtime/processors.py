"""Number of processors for this process: all available, or its share among parallel workers."""

from __future__ import annotations

import os

_shares: list[int] = []


def processors() -> int:
    """Return the number of processors for this process, at least one."""
    if _shares:
        return _shares[-1]
    able = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else ()
    return len(able) or os.cpu_count() or 1


def use_processors(count: int) -> None:
    """Set the number of processors for this process, one of several workers."""
    _shares[:] = [max(1, count)]

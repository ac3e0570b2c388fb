"""How many processors this process uses: all that it may, or its share where several of ours work side by side."""

from __future__ import annotations

import os

_shares: list[int] = []


def processors() -> int:
    """Processors for this process, at least one."""
    if _shares:
        return _shares[-1]
    able = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else ()
    return len(able) or os.cpu_count() or 1


def use_processors(count: int) -> None:
    """Let this process, a worker among others, use so many."""
    _shares[:] = [max(1, count)]

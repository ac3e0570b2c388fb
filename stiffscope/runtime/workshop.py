"""Where jobs are done: the cache, how several jobs run, and who is told of their progress."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stiffscope.runtime.cache import Cache, cache_folder
from stiffscope.runtime.files import scratch_folder
from stiffscope.runtime.listening import LISTENERS
from stiffscope.runtime.workers import work_here, work_together

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from stiffscope.runtime.listening import Report

    Work = Callable[..., dict[Any, Any]]


@dataclass(frozen=True)
class Workshop:
    """What jobs need.

    Attributes
    ----------
    cache : results of earlier jobs.
    work : `work_together` or `work_here` of `stiffscope.runtime.workers`.
    open_line : gives a function `report(stage, fraction)` for the progress of a job of some name.
    """

    cache: Cache
    work: Work
    open_line: Callable[[str], Report]


@contextmanager
def workshop(open_line: Callable[[str], Report] | None = None, *, together: bool = False) -> Iterator[Workshop]:
    """Open a workshop with the user's cache; what that cannot hold is kept until the workshop closes.

    Parameters
    ----------
    open_line
        Where progress goes; by default nowhere, in a notebook to bars.
    together
        Whether several jobs run at once, in processes of their own. These import the main module of the program
        anew, so that a notebook or a script without `if __name__ == "__main__"` had better not.

    """
    with scratch_folder() as spare:
        cache = Cache(cache_folder(), spare)
        yield Workshop(cache, work_together if together else work_here, open_line or LISTENERS.open_line)

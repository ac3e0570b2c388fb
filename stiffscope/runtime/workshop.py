"""Workshop of jobs: the cache, the executor and the progress callback."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stiffscope.runtime.cache import Cache, cache_folder
from stiffscope.runtime.executor import Here, Processes, work_through
from stiffscope.runtime.output import scratch_folder
from stiffscope.runtime.progress import LISTENERS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from stiffscope.runtime.types import Progress


@dataclass(frozen=True)
class Workshop:
    """Resources of jobs.

    Attributes
    ----------
    cache : results of earlier jobs.
    executor : runs the jobs.
    open_line : returns the progress callback `report(stage, fraction)` of a job by its name.
    """

    cache: Cache
    executor: Here | Processes
    open_line: Callable[[str], Progress]

    def work(
        self,
        function: Callable[..., Any],
        jobs: Mapping[Any, tuple[Any, ...]],
        limits: Mapping[Any, float] | None = None,
    ) -> dict[Any, Any]:
        """Call ``function(*arguments, report)`` once for each job.

        Parameters
        ----------
        function
            Function importable by name; its last argument is `report(stage, fraction)`.
        jobs, limits
            Arguments of each job by name, and time limits by job, s.

        Raises
        ------
        InputError
            A job refused its input; the other jobs are ended.
        WorkerError
            A job crashed.
        LateError
            A job exceeded its time limit.
        """
        done = work_through(
            self.executor, function, jobs.items(), self.open_line, limits
        )
        return {name: future.result() for name, future in done}


@contextmanager
def workshop(
    open_line: Callable[[str], Progress] | None = None, *, together: bool = False
) -> Iterator[Workshop]:
    """Open a workshop with the user's cache; uncacheable results are kept until it closes.

    Parameters
    ----------
    open_line
        Opens a progress line; by default silent, in a notebook a progress bar.
    together
        Whether several jobs run in parallel, in separate processes.
    """
    with scratch_folder() as spare, Processes() if together else Here() as executor:
        yield Workshop(
            Cache(cache_folder(), spare), executor, open_line or LISTENERS.open_line
        )

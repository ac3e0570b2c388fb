"""Where jobs are done: the cache, the executor, and who is told of their progress."""

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

    from stiffscope.runtime.progress import Report


@dataclass(frozen=True)
class Workshop:
    """What jobs need.

    Attributes
    ----------
    cache : results of earlier jobs.
    executor : how several jobs are done.
    open_line : gives a function `report(stage, fraction)` for the progress of a job of some name.
    """

    cache: Cache
    executor: Here | Processes
    open_line: Callable[[str], Report]

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
            Importable by name; its last argument is `report(stage, fraction)`.
        jobs
            Name of each job and its arguments.
        limits
            By job, seconds that it may take.

        Raises
        ------
        InputError
            What a job refused. The other jobs are ended.
        WorkerError
            A job crashed.
        LateError
            A job took longer than it may.

        """
        done = work_through(self.executor, function, jobs.items(), self.open_line, limits)
        return {name: future.result() for name, future in done}


@contextmanager
def workshop(open_line: Callable[[str], Report] | None = None, *, together: bool = False) -> Iterator[Workshop]:
    """Open a workshop with the user's cache; what that cannot hold is kept until the workshop closes.

    Parameters
    ----------
    open_line
        Where progress goes; by default nowhere, in a notebook to bars.
    together
        Whether several jobs run at once, in processes of their own.

    """
    with scratch_folder() as spare, Processes() if together else Here() as executor:
        yield Workshop(Cache(cache_folder(), spare), executor, open_line or LISTENERS.open_line)

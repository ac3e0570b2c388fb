"""Jobs done by the workers of a Dask scheduler, or, without one, by processes of our own."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from concurrent.futures import Executor, Future
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError
from stiffscope.runtime.executor import GoneError, Processes, WorkerError, take_answer
from stiffscope.runtime.processors import processors, use_processors
from stiffscope.runtime.worker import answer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

CONNECT = "20s"
ASKED = 3  # times that a scheduler is asked for an answer that it has lost


class Scheduler(Executor):
    """Has jobs done by the workers of a Dask scheduler.

    Parameters
    ----------
    address
        Such as "tcp://10.0.0.5:8786".

    Raises
    ------
    InputError
        No scheduler answers.

    """

    width = 64

    def __init__(self, address: str) -> None:
        from distributed import Client

        for each in ("distributed", "distributed.client", "tornado.application"):  # each has a level of its own
            logging.getLogger(each).setLevel(logging.CRITICAL)  # slow workers are no news, a lost scheduler is told
        try:
            self._client = Client(address, timeout=CONNECT)
        except (OSError, ValueError) as error:
            raise InputError(
                f"--scheduler: expected the address of a Dask scheduler that answers, got {address}"
            ) from error

    def submit(self, function: Callable[..., Any], /, *arguments: Any, name: Any = "", **_: Any) -> Future[Any]:
        """Have ``function(*arguments)`` done; see `Processes.submit`."""
        loop: Any = self._client.loop  # of tornado, which runs on asyncio's
        return asyncio.run_coroutine_threadsafe(self._ask(name, function, arguments), loop.asyncio_loop)

    async def _ask(self, name: Any, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        """Have a job done; again where Dask lost its answer with a worker, or says that it has done nothing."""
        from distributed import KilledWorker

        lost: Exception | None = None
        for _ in range(ASKED):
            try:
                kind, content = await self._client.submit(_on_worker, function, *arguments, pure=False)
            except KilledWorker as error:
                deaths = error.allowed_failures + 1
                raise WorkerError(f"{name}: {deaths} workers ended at it; is there enough memory?") from error
            except Exception as error:
                if self._client.status != "running":
                    raise GoneError from error
                lost = error
            else:
                return take_answer(name, kind, content)
        raise WorkerError(f"{name}: {type(lost).__name__}: {lost}") from lost

    def end(self) -> None:
        """Drop all jobs."""
        self.shutdown()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let the scheduler forget what is left."""
        del wait, cancel_futures
        with contextlib.suppress(Exception):
            self._client.close()


def _on_worker(function: Callable[..., Any], *arguments: Any) -> tuple[str, Any]:
    """Do a job on a worker of Dask: with no more processors than it has threads."""
    from distributed import get_worker

    use_processors(get_worker().state.nthreads)
    return answer(function, *arguments)


@contextlib.contextmanager
def workers(scheduler: str | None, width: int) -> Iterator[Processes | Scheduler]:
    """Workers of a scheduler at an address, or processes of our own that share this machine's processors."""
    width = max(1, width)
    with Scheduler(scheduler) if scheduler else Processes(width, max(1, processors() // width)) as executor:
        yield executor

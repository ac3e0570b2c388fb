"""Executor on the workers of a Dask scheduler, or without one on local processes."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from concurrent.futures import Executor, Future
from typing import TYPE_CHECKING, Any

from stiffscope.errors import expecting
from stiffscope.runtime.executor import GoneError, Processes, WorkerError, take_answer
from stiffscope.runtime.processors import processors, use_processors
from stiffscope.runtime.worker import answer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

log = logging.getLogger(__name__)
CONNECT = "20s"
ASKED = 3  # attempts to get a result that the scheduler lost


class Scheduler(Executor):
    """Executor on the workers of a Dask scheduler.

    Parameters
    ----------
    address
        Address, e.g. "tcp://10.0.0.5:8786".

    Raises
    ------
    InputError
        The scheduler does not respond.
    """

    width = 64

    def __init__(self, address: str) -> None:
        where = "--scheduler"
        cure = "none; install it by: python -m pip install 'stiffscope[cluster]'"
        with expecting(where, "the package distributed", ImportError, got=cure):
            from distributed import Client
        for logger in ("distributed", "distributed.client", "tornado.application"):
            logging.getLogger(logger).setLevel(
                logging.CRITICAL
            )  # a lost scheduler is reported
        # TypeError: distributed's own for "tls://" without certificates
        tls = "certificates in Dask's configuration for tls://"
        expected = "the address of a Dask scheduler that answers"
        with (
            expecting(where, tls, TypeError, got="none"),
            expecting(where, expected, OSError, ValueError, got=address),
        ):
            self._client = Client(address, timeout=CONNECT)
        if not self._client.scheduler_info()["workers"]:
            log.warning(
                "--scheduler: %s has no workers yet; waiting for one: dask worker %s",
                address,
                address,
            )

    def submit(
        self, function: Callable[..., Any], /, *arguments: Any, name: Any = "", **_: Any
    ) -> Future[Any]:
        """Submit ``function(*arguments)``; see `Processes.submit`."""
        loop: Any = self._client.loop  # tornado's loop wraps asyncio's
        asked = self._ask(name, function, arguments)
        return asyncio.run_coroutine_threadsafe(asked, loop.asyncio_loop)

    async def _ask(
        self, name: Any, function: Callable[..., Any], arguments: tuple[Any, ...]
    ) -> Any:
        """Run a job; retry it if Dask lost its result."""
        from distributed import KilledWorker

        lost: Exception | None = None
        for _ in range(ASKED):
            try:
                kind, content = await self._client.submit(
                    _on_worker, function, *arguments, pure=False
                )
            except KilledWorker as error:
                died = f"{error.allowed_failures + 1} workers ended at it"
                raise WorkerError(f"{name}: {died}; is there enough memory?") from error
            except Exception as error:
                if self._client.status != "running":
                    raise GoneError from error
                lost = error
            else:
                return take_answer(name, kind, content)
        raise WorkerError(f"{name}: {type(lost).__name__}: {lost}") from lost

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Close the client, which drops the remaining jobs."""
        del wait, cancel_futures
        with contextlib.suppress(Exception):
            self._client.close()

    end = shutdown


def _on_worker(function: Callable[..., Any], *arguments: Any) -> tuple[str, Any]:
    """Run a job on a Dask worker, with as many processors as it has threads."""
    from distributed import get_worker

    use_processors(get_worker().state.nthreads)
    return answer(function, *arguments)


@contextlib.contextmanager
def workers(scheduler: str | None, width: int) -> Iterator[Processes | Scheduler]:
    """Open an executor: a scheduler's workers, or local processes that share the processors."""
    width = max(1, width)
    share = max(1, processors() // width)
    with Scheduler(scheduler) if scheduler else Processes(width, share) as executor:
        yield executor

"""Workers on which blind cases and designs run: a Dask cluster, by default one on this machine that ends with us."""

from __future__ import annotations

import logging
import multiprocessing
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError, StiffscopeError
from stiffscope.runtime import children
from stiffscope.runtime.files import scratch_folder

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Mapping
    from typing import TypeVar

    Task = TypeVar("Task")

_CONNECT = "20s"
# Dask's value gives memory back after every array, to take it again for the next: half as much time again.
_TRIM = "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_"


@contextmanager
def cluster(scheduler: str | None = None, workers: int = 2, threads: int = 1) -> Generator[Any]:
    """Give a client of Dask.

    Parameters
    ----------
    scheduler
        Address of a running scheduler, such as "tcp://10.0.0.5:8786"; None: a cluster on this machine.
    workers
        Processes of the local cluster.
    threads
        Of each of these processes.

    Raises
    ------
    InputError
        No scheduler answers.
    StiffscopeError
        The scheduler goes while the client is in use.

    """
    import dask.config
    from distributed import Client
    from distributed.client import FutureCancelledError
    from distributed.comm.core import CommClosedError

    quiet = logging.CRITICAL
    for name in ("distributed", "distributed.client", "tornado.application"):  # each has a level of its own
        logging.getLogger(name).setLevel(quiet)  # slow workers are no news, a lost scheduler is told
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=_CONNECT)
        except (OSError, ValueError) as error:
            raise InputError(
                f"--scheduler: expected the address of a Dask scheduler that answers, got {scheduler}"
            ) from error
        try:
            with client:
                yield client
        except (CommClosedError, FutureCancelledError) as error:
            raise _gone("no connection") from error
        return
    with (
        children.safe_environment(),
        scratch_folder() as scratch,
        _none_left(),
        dask.config.set({"temporary-directory": str(scratch), _TRIM: None}),
        _local(
            n_workers=workers, threads_per_worker=threads, processes=True, silence_logs=quiet,
            local_directory=str(scratch), memory_limit=0, preload=[children.__name__], dashboard_address=None,
            env={"TMPDIR": str(scratch)},  # a worker that is killed leaves nothing outside of it
        ) as local,
        Client(local) as client,
    ):  # fmt: skip
        yield client


@contextmanager
def _local(**options: Any) -> Iterator[Any]:
    """Give a cluster on this machine; who stops us while it starts is obeyed as soon as it can be closed."""
    from distributed import LocalCluster

    with ExitStack() as stack:
        with children.deaf_to(*children.STOPS):
            local = stack.enter_context(LocalCluster(**options))
        yield local


@contextmanager
def _none_left() -> Iterator[None]:
    """End at last what Dask does not: a worker of ours that was just starting when it was told to close."""
    others = set(multiprocessing.active_children())
    try:
        yield
    finally:
        for process in set(multiprocessing.active_children()) - others:
            if process.name.startswith("Dask"):
                process.kill()
                process.join()


def finished(client: Any, running: Mapping[Any, Task]) -> Iterator[tuple[Task, Any]]:
    """Tasks by their futures, each with its future as soon as that has an answer or an error.

    Where the caller ends early, by Ctrl-C too, what is queued is cancelled: it is not to run on a cluster that stays.

    Raises
    ------
    StiffscopeError
        The scheduler has gone.

    """
    from distributed import as_completed

    left = dict(running)
    try:
        for future in as_completed(list(running)):
            if future.status not in {"finished", "error"}:
                raise _gone(future.status)
            yield left.pop(future), future
    finally:
        if left:
            client.cancel(list(left))


def _gone(how: str) -> StiffscopeError:
    return StiffscopeError(f"the scheduler has gone ({how}); what is finished is kept, run the same command again")

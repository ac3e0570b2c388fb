"""Workers on which blind cases run: a Dask cluster, by default one on this machine that ends with this process."""

from __future__ import annotations

import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from stiffscope import children
from stiffscope.errors import InputError
from stiffscope.files import scratch_folder

if TYPE_CHECKING:
    from collections.abc import Generator

_CONNECT = "20s"


@contextmanager
def cluster(scheduler: str | None = None, workers: int = 2) -> Generator[Any]:
    """Give a client of Dask; a local cluster's worker processes have one thread each.

    Parameters
    ----------
    scheduler
        Address of a running scheduler, such as "tcp://10.0.0.5:8786"; None: a cluster on this machine.
    workers
        Processes of the local cluster.

    Raises
    ------
    InputError
        No scheduler answers.

    """
    import dask
    from distributed import Client, LocalCluster

    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=_CONNECT)
        except (OSError, ValueError) as error:
            raise InputError(
                f"--scheduler: expected the address of a Dask scheduler that answers, got {scheduler}"
            ) from error
        with client:
            yield client
        return
    quiet = logging.ERROR
    no_page: dict[str, Any] = {"dashboard_address": None}
    logging.getLogger("distributed").setLevel(quiet)  # a worker that is slow to end is no news
    with (
        scratch_folder() as scratch,
        dask.config.set({"temporary-directory": str(scratch)}),
        LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, silence_logs=quiet,
            local_directory=str(scratch), memory_limit=0, preload=[children.__name__], **no_page,
        ) as local,  # pyright: ignore[reportUnknownVariableType]
        Client(local) as client,
    ):  # fmt: skip
        yield client

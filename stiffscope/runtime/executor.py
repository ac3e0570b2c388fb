"""Executors with one interface: this process, child processes, workers of a Dask scheduler.

The executors of `concurrent.futures` can neither end a running job nor identify the job that ended
its process. Pebble's can, but report no progress, and a kill at the wrong moment breaks a channel
shared by its processes. Dask's local workers take seconds to start.
"""

from __future__ import annotations

import contextlib
import copyreg
import functools
import itertools
import logging
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import (
    FIRST_COMPLETED,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from pathlib import Path
from types import MappingProxyType
from typing import IO, TYPE_CHECKING, Any

import psutil

from stiffscope.errors import StiffscopeError
from stiffscope.runtime.output import scratch_folder
from stiffscope.runtime.processors import processors
from stiffscope.runtime.signals import STOPS, block, defer_signals

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from stiffscope.runtime.types import Progress

    Job = tuple[Any, tuple[Any, ...]]

AHEAD = 4  # submitted jobs per worker
KILLED = {
    -signal.SIGTERM,
    -getattr(signal, "SIGKILL", signal.SIGTERM),
}  # exit codes if killed


class WorkerError(StiffscopeError):
    """A job ended without a result, or with an error that the user did not cause.

    ``code``: exit code of its process, None if it still runs; ``output``: printed output.
    """

    def __init__(self, message: str, code: int | None = None, output: str = "") -> None:
        super().__init__(message)
        self.code = code
        self.output = output


class LateError(StiffscopeError):
    """A job exceeded its time limit: `job`, the `stage` reached, the limit in `seconds`."""

    def __init__(self, job: Any, stage: str, seconds: float) -> None:
        got = f"no further than its stage {stage}"
        super().__init__(f"{job}: expected its end within {seconds:g} s, got {got}")
        self.job = job
        self.stage = stage
        self.seconds = seconds


class GoneError(StiffscopeError):
    """The connection to the scheduler was lost."""

    def __init__(self) -> None:
        super().__init__(
            "the scheduler has gone; what is finished is kept, run the same command again"
        )


class Here(Executor):
    """Executor that runs each job immediately in this process, without time limits."""

    width = 1
    ended = False

    def submit(  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        self,
        function: Callable[..., Any],
        /,
        *arguments: Any,
        name: Any = "",
        report: Progress | None = None,
        limit: float | None = None,
    ) -> Future[Any]:
        del name, limit
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments, *([report] if report else [])))
        except Exception as error:  # noqa: BLE001 (raised by the future's result)
            future.set_exception(error)
        return future

    def end(self) -> None:
        """Do nothing, since no job is running when this is called."""


class Processes(Executor):
    """Executor of parallel child processes, started on demand; none outlives this process.

    Parameters
    ----------
    width
        Most processes; by default the number of processors, at least two.
    share
        Processors per process; by default all.
    """

    def __init__(self, width: int = 0, share: int = 0) -> None:
        self.width = width or max(processors(), 2)
        self._share = share
        self.ended = False
        self._mine = threading.local()
        self._children: set[_Child] = set()
        self._stack = contextlib.ExitStack()
        self._folder = self._stack.enter_context(scratch_folder())
        self._threads = ThreadPoolExecutor(
            self.width, initializer=block, initargs=STOPS
        )

    def submit(  # pyright: ignore[reportIncompatibleMethodOverride]
        self,
        function: Callable[..., Any],
        /,
        *arguments: Any,
        name: Any = "",
        report: Progress | None = None,
        limit: float | None = None,
    ) -> Future[Any]:
        """Submit ``function(*arguments)``; function (importable), arguments and result are pickled.

        Parameters
        ----------
        name
            Name of the job for messages.
        report
            Progress callback; the function gets a `report(stage, fraction)` as last argument.
        limit
            Time limit in seconds of a processor, without imports; the process is then ended.

        Returns
        -------
        Future
            Result, or InputError raised by the job, WorkerError or LateError.
        """
        job = (function, arguments, report is not None)
        return self._threads.submit(self._work, name, job, report, limit)

    def _work(
        self, name: Any, job: Any, report: Progress | None, limit: float | None
    ) -> Any:
        """Run a job; retry it once if its process was killed from outside."""
        for last in (False, True):
            child = getattr(self._mine, "child", None) or self._start()
            try:
                return child.work(name, job, report, limit)
            except WorkerError as error:
                if last or self.ended or error.code not in KILLED:
                    raise
            finally:
                if not child.lives():
                    self._children.discard(child)
                    self._mine.child = None
        raise AssertionError

    def _start(self) -> _Child:
        self._mine.child = child = _Child(
            Path(tempfile.mkdtemp(dir=self._folder)), self._share
        )
        self._children.add(child)
        if self.ended:
            child.end()
        return child

    def end(self) -> None:
        """Kill all processes and drop waiting jobs."""
        self.ended = True
        self._threads.shutdown(wait=False, cancel_futures=True)
        for child in list(self._children):
            child.end()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End after all jobs, or if they are cancelled after the running ones."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        for child in list(self._children):
            child.end()
        self._stack.close()

    def __exit__(self, kind: Any, *_: object) -> None:
        """Finish the remaining jobs; after an exception, end at once."""
        with defer_signals(*STOPS):
            if kind is not None:
                self.end()
            self.shutdown()


_WAITING = 0.02  # of the time by the clock: a job with less of a processor waits
_LONGEST = 20.0  # times its limit by the clock, after which a job is late in any case


class _Child:
    """A child process that runs one job after another."""

    def __init__(self, folder: Path, share: int) -> None:
        self._errors: IO[bytes] = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        self._late = False
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "stiffscope.runtime.worker"],
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env={**os.environ, "TMPDIR": str(folder)},
        )
        with contextlib.suppress(BrokenPipeError):
            self._send((os.getpid(), share, [place for place in sys.path if place]))

    def _send(self, content: Any) -> None:
        stream = self._process.stdin
        if stream is not None:
            stream.write(pickle.dumps(content))
            stream.flush()

    def lives(self) -> bool:
        """Return whether the process is running."""
        return self._process.poll() is None

    def work(
        self, name: Any, job: Any, report: Progress | None, limit: float | None
    ) -> Any:
        """Run a job and return its result."""
        stage = ""
        watch = _Watch(self._process.pid, limit or 0.0, self._end_late)
        try:
            self._send(job)
            while True:
                kind, content = pickle.load(self._process.stdout)  # noqa: S301  # pyright: ignore[reportArgumentType]
                if kind in {"answer", "error", "failed"} and not self._late:
                    return take_answer(name, kind, content)
                if kind == "begun" and limit is not None:
                    watch.start()
                elif kind == "progress" and report:
                    stage = content[0]
                    report(*content)
                elif kind == "log":
                    logging.getLogger(content.name).handle(content)
        except (EOFError, BrokenPipeError, pickle.UnpicklingError):
            self._process.wait()
            if self._late and limit is not None:
                raise LateError(name, stage, limit) from None
            raise self._gone(name) from None
        finally:
            watch.cancel()

    def _end_late(self) -> None:
        self._late = True
        self.end()

    def _gone(self, name: Any) -> WorkerError:
        code = self._process.returncode
        self._errors.seek(0)
        output = self._errors.read().decode(errors="replace")
        with contextlib.suppress(ValueError):
            how = f"was ended by {signal.Signals(-code).name}"
            outside = "from outside; is there enough memory?"
            cause = outside if code in KILLED else "in a library that it uses"
            return WorkerError(f"{name}: its process {how}, {cause}", code, output)
        last_line = (output.strip().splitlines() or [f"exit code {code}"])[-1]
        return WorkerError(
            f"{name}: its process ended without an answer ({last_line})", code, output
        )

    def end(self) -> None:
        """Kill the process and its children; their temporary folders are removed later."""
        with contextlib.suppress(psutil.NoSuchProcess):
            children = psutil.Process(self._process.pid).children(recursive=True)
            for process in [*children, self._process]:
                with contextlib.suppress(psutil.NoSuchProcess):
                    process.kill()
        self._process.wait()


class _Watch:
    """A time limit of processor time: a job is late when it has had its time, not others.

    A job that has run for the limit by the clock, on a machine that others use, goes on until it
    has had as much of a processor. One that waits for something else is late by the clock.
    """

    def __init__(self, pid: int, limit: float, end: Callable[[], None]) -> None:
        self._pid = pid
        self._limit = limit
        self._end = end
        self._begun = 0.0
        self._before = 0.0
        self._timer: threading.Timer | None = None
        self._cancelled = False

    def start(self) -> None:
        """Start to count."""
        self._begun = time.monotonic()
        self._before = self._measure()
        self._arm(self._limit)

    def cancel(self) -> None:
        """Stop to count."""
        self._cancelled = True
        if self._timer is not None:
            self._timer.cancel()

    def _arm(self, seconds: float) -> None:
        if not self._cancelled:
            self._timer = threading.Timer(seconds, self._look)
            self._timer.daemon = True
            self._timer.start()

    def _look(self) -> None:
        elapsed = time.monotonic() - self._begun
        had = self._measure() - self._before
        waits = had < _WAITING * elapsed
        if self._cancelled:
            return
        if had >= self._limit or waits or elapsed >= _LONGEST * self._limit:
            self._end()
        else:
            self._arm(max(self._limit - had, 0.05 * self._limit))

    def _measure(self) -> float:
        """Return the processor time, s, of the process and its children so far."""
        total = 0.0
        with contextlib.suppress(psutil.NoSuchProcess):
            process = psutil.Process(self._pid)
            times = process.cpu_times()
            total = times.user + times.system
            total += getattr(times, "children_user", 0.0)
            total += getattr(times, "children_system", 0.0)
            for child in process.children(recursive=True):
                with contextlib.suppress(psutil.NoSuchProcess):
                    more = child.cpu_times()
                    total += more.user + more.system
        return total


def take_answer(name: Any, kind: str, content: Any) -> Any:
    """Return the result of a job or raise its error, by the ``kind`` of `worker.answer`."""
    if kind == "answer":
        return content
    if kind == "error":
        raise content
    raise WorkerError(f"{name}: {content.strip().splitlines()[-1]}", output=content)


def _freeze(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(content)


# read-only mappings, which robots hold, have no form of their own to be pickled in
copyreg.pickle(MappingProxyType, lambda mapping: (_freeze, (dict(mapping),)))


class Shared:
    """A large argument of many jobs: pickled once, and unpickled once in each process."""

    def __init__(self, value: Any) -> None:
        self._content = pickle.dumps(value)

    @property
    def value(self) -> Any:
        """The argument."""
        return _unpickle(self._content)


@functools.lru_cache(16)
def _unpickle(content: bytes) -> Any:
    return pickle.loads(content)  # noqa: S301


def do_alone(
    function: Callable[..., Any], *arguments: Any, name: str, limit: float
) -> Any:
    """Run a job in its own process, isolated from crashes, endless loops and temporary files.

    Parameters
    ----------
    function, arguments, name
        As in `Processes.submit`.
    limit
        Time limit, s.

    Raises
    ------
    LateError
        The job exceeded the limit.
    WorkerError
        Its process ended.
    """
    with Processes(1) as executor:
        return executor.submit(function, *arguments, name=name, limit=limit).result()


def work_through(
    executor: Any,
    function: Callable[..., Any],
    jobs: Iterable[Job],
    report: Callable[[Any], Progress] | None = None,
    limits: Mapping[Any, float] | None = None,
) -> Iterator[tuple[Any, Future[Any]]]:
    """Run jobs, drawn when needed; yield name and future of each as it finishes.

    Parameters
    ----------
    executor
        An executor of this module or a scheduler.
    function
        Function of each job's arguments.
    jobs
        Name and arguments of each job.
    report, limits
        Function that returns the progress callback of a job by name, and time limits by name, s.

    Raises
    ------
    GoneError
        The connection to the scheduler was lost.
    """
    left = iter(jobs)
    running: dict[Future[Any], Any] = {}
    try:
        while True:
            for name, arguments in itertools.islice(
                left, AHEAD * executor.width - len(running)
            ):
                more = {
                    "report": report and report(name),
                    "limit": (limits or {}).get(name),
                }
                running[executor.submit(function, *arguments, name=name, **more)] = name
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                if future.cancelled() or isinstance(future.exception(), GoneError):
                    raise GoneError
                yield running.pop(future), future
    finally:
        for future in running:
            future.cancel()

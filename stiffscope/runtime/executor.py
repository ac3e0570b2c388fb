"""Where jobs are done: here, in processes of our own, or by the workers of a Dask scheduler; one interface for all.

The executors of `concurrent.futures` cannot end a job that is running, nor say which job has ended its process.
Pebble's can, but tell no progress, and a kill at the wrong moment breaks a channel that its processes share. Dask's on
this machine take seconds to start.
"""

from __future__ import annotations

import contextlib
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
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import cloudpickle  # which knows read-only mappings
import psutil

from stiffscope.errors import StiffscopeError
from stiffscope.runtime.output import scratch_folder
from stiffscope.runtime.processors import processors
from stiffscope.runtime.signals import STOPS, block, deaf_to

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from stiffscope.runtime.progress import Report

    Job = tuple[Any, tuple[Any, ...]]

AHEAD = 4  # jobs that are given out before they are needed, for each that is worked on
KILLED = {-signal.SIGTERM, -getattr(signal, "SIGKILL", signal.SIGTERM)}  # exit codes of a process ended from outside


class WorkerError(StiffscopeError):
    """A job ended without an answer, or with an error that is not the user's.

    ``code``: exit code of its process, None where that lives on; ``output``: what the process has printed.
    """

    def __init__(self, message: str, code: int | None = None, output: str = "") -> None:
        super().__init__(message)
        self.code, self.output = code, output


class LateError(StiffscopeError):
    """A job was ended because it took longer than it may: `job`, the `stage` it had come to, the limit in `seconds`."""

    def __init__(self, job: Any, stage: str, seconds: float) -> None:
        super().__init__(f"{job}: expected its end within {seconds:g} s, got no further than its stage {stage}")
        self.job, self.stage, self.seconds = job, stage, seconds


class GoneError(StiffscopeError):
    """The scheduler has gone."""

    def __init__(self) -> None:
        super().__init__("the scheduler has gone; what is finished is kept, run the same command again")


class Here(Executor):
    """Does each job at once in this process: no limit ends it."""

    width, ended = 1, False

    def submit(  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        self, function: Callable[..., Any], /, *arguments: Any, name: Any = "", report: Report | None = None,
        limit: float | None = None,
    ) -> Future[Any]:  # fmt: skip
        del name, limit
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments, *([report] if report else [])))
        except Exception as error:  # noqa: BLE001 (whoever asks for the result gets it)
            future.set_exception(error)
        return future

    def end(self) -> None:
        """Nothing is under way when this is called."""


class Processes(Executor):
    """Does jobs side by side in processes of its own, each started when it is needed; none outlives this one.

    Parameters
    ----------
    width
        Processes at most; by default as many as there are processors, at least two.
    share
        Processors that each of them uses; by default all.

    """

    def __init__(self, width: int = 0, share: int = 0) -> None:
        self.width = width or max(processors(), 2)
        self._share = share
        self.ended = False
        self._mine = threading.local()
        self._children: set[_Child] = set()
        self._stack = contextlib.ExitStack()
        self._folder = self._stack.enter_context(scratch_folder())
        self._threads = ThreadPoolExecutor(self.width, initializer=block, initargs=STOPS)

    def submit(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, function: Callable[..., Any], /, *arguments: Any, name: Any = "", report: Report | None = None,
        limit: float | None = None,
    ) -> Future[Any]:  # fmt: skip
        """Have ``function(*arguments)`` done: it is importable by name; all of it, and its answer, can be pickled.

        Parameters
        ----------
        name
            Of the job, for messages.
        report
            Where its progress goes; the function is then given a `report(stage, fraction)` as its last argument.
        limit
            Seconds until its process is ended; what it imports first does not count.

        Returns
        -------
        Future
            The answer; or InputError, which the job has raised; WorkerError; or LateError.

        """
        return self._threads.submit(self._work, name, (function, arguments, report is not None), report, limit)

    def _work(self, name: Any, job: Any, report: Report | None, limit: float | None) -> Any:
        """Do a job; once more where its process was killed from outside."""
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
        self._mine.child = child = _Child(Path(tempfile.mkdtemp(dir=self._folder)), self._share)
        self._children.add(child)
        if self.ended:
            child.end()
        return child

    def end(self) -> None:
        """End all processes, whatever they are doing; jobs that wait are dropped."""
        self.ended = True
        self._threads.shutdown(wait=False, cancel_futures=True)
        for child in list(self._children):
            child.end()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End when all jobs are done, or, of what is cancelled, those that run."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        for child in list(self._children):
            child.end()
        self._stack.close()

    def __exit__(self, kind: Any, *_: object) -> None:
        """Do what is left; where something else has gone wrong, end at once."""
        with deaf_to(*STOPS):
            if kind is not None:
                self.end()
            self.shutdown()


class _Child:
    """A process of ours, which does one job after another."""

    def __init__(self, folder: Path, share: int) -> None:
        self._errors: IO[bytes] = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 (it lives as long as the process)
        self._late = False
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "stiffscope.runtime.worker"], cwd=folder, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=self._errors, env={**os.environ, "TMPDIR": str(folder)},
        )  # fmt: skip
        with contextlib.suppress(BrokenPipeError):
            self._send((os.getpid(), share, [place for place in sys.path if place]))

    def _send(self, content: Any) -> None:
        stream = self._process.stdin
        if stream is not None:
            stream.write(pickle.dumps(content))
            stream.flush()

    def lives(self) -> bool:
        """Whether it does further jobs."""
        return self._process.poll() is None

    def work(self, name: Any, job: Any, report: Report | None, limit: float | None) -> Any:
        """Do a job."""
        stage, timer = "", threading.Timer(limit or 0.0, self._end_late)
        try:
            self._send(job)
            while True:
                kind, content = pickle.load(self._process.stdout)  # noqa: S301  # pyright: ignore[reportArgumentType]
                if kind in {"answer", "error", "failed"} and not self._late:
                    return take_answer(name, kind, content)
                if kind == "begun" and limit is not None:
                    timer.start()
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
            timer.cancel()

    def _end_late(self) -> None:
        self._late = True
        self.end()

    def _gone(self, name: Any) -> WorkerError:
        code = self._process.returncode
        self._errors.seek(0)
        output = self._errors.read().decode(errors="replace")
        with contextlib.suppress(ValueError):
            how = f"was ended by {signal.Signals(-code).name}"
            cause = "from outside; is there enough memory?" if code in KILLED else "in a library that it uses"
            return WorkerError(f"{name}: its process {how}, {cause}", code, output)
        said = (output.strip().splitlines() or [f"exit code {code}"])[-1]
        return WorkerError(f"{name}: its process ended without an answer ({said})", code, output)

    def end(self) -> None:
        """End it and all that it has started, at once; what it has begun is in folders that are removed later."""
        with contextlib.suppress(psutil.NoSuchProcess):
            for process in [*psutil.Process(self._process.pid).children(recursive=True), self._process]:
                with contextlib.suppress(psutil.NoSuchProcess):
                    process.kill()
        self._process.wait()


def take_answer(name: Any, kind: str, content: Any) -> Any:
    """Return the answer of a job, or raise what it has raised: by ``kind``, as `worker.answer` says."""
    if kind == "answer":
        return content
    if kind == "error":
        raise content
    raise WorkerError(f"{name}: {content.strip().splitlines()[-1]}", output=content)


class Shared:
    """Something large that many jobs are given: it is pickled once, and each process unpickles it once."""

    def __init__(self, value: Any) -> None:
        self._content = cloudpickle.dumps(value)

    @property
    def value(self) -> Any:
        """It."""
        return _unpickle(self._content)


@functools.lru_cache(16)
def _unpickle(content: bytes) -> Any:
    return pickle.loads(content)  # noqa: S301


def do_alone(function: Callable[..., Any], *arguments: Any, name: str, limit: float) -> Any:
    """Do a job in a process of its own: a crash, an endless loop, and what it drops into its folder, stay there.

    Parameters
    ----------
    function, arguments, name
        As `Processes.submit` takes them.
    limit
        Seconds.

    Raises
    ------
    LateError
        It took longer.
    WorkerError
        Its process ended.

    """
    with Processes(1) as executor:
        return executor.submit(function, *arguments, name=name, limit=limit).result()


def work_through(
    executor: Any, function: Callable[..., Any], jobs: Iterable[Job], report: Callable[[Any], Report] | None = None,
    limits: Mapping[Any, float] | None = None,
) -> Iterator[tuple[Any, Future[Any]]]:  # fmt: skip
    """Do jobs, drawn as they are needed, and give each that is done: its name, and its answer or error as a future.

    Parameters
    ----------
    executor
        One of those above.
    function
        Of each job's arguments.
    jobs
        Name and arguments of each.
    report
        By name, where a job's progress goes.
    limits
        By name, the seconds that a job may take.

    Raises
    ------
    GoneError
        The scheduler has gone.

    """
    left = iter(jobs)
    running: dict[Future[Any], Any] = {}
    try:
        while True:
            for name, arguments in itertools.islice(left, AHEAD * executor.width - len(running)):
                more = {"report": report and report(name), "limit": (limits or {}).get(name)}
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

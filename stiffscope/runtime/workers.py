"""Jobs side by side in a few processes: progress comes back, errors too, and nobody outlives the parent.

`concurrent.futures` cannot end a job that is running (before Python 3.14), nor say which job took its process down.
"""

from __future__ import annotations

import contextlib
import logging
import logging.handlers
import multiprocessing
import signal
import sys
import time
import traceback
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError, StiffscopeError
from stiffscope.runtime.children import STOPS, deaf_to, end_with_parent, leave_out, safe_environment
from stiffscope.runtime.processors import processors

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from multiprocessing.process import BaseProcess

log = logging.getLogger(__name__)


class WorkerError(RuntimeError):
    """A job ended without an answer, or with an error that is not the user's."""


class LateError(StiffscopeError):
    """A job was ended at some stage because it took longer than it may: `job`, `stage`, `seconds`."""

    def __init__(self, job: Any, stage: str, seconds: float) -> None:
        super().__init__(f"{job}: expected its end within {seconds:g} s, got no further than its stage {stage}")
        self.job, self.stage, self.seconds = job, stage, seconds


def work_together(
    function: Callable[..., Any],
    jobs: Mapping[Any, tuple[Any, ...]],
    reports: Mapping[Any, Any],
    limits: Mapping[Any, float] | None = None,
) -> dict[Any, Any]:
    """Call `function(*arguments, report)` once for each job, as many at a time as there are processors, at least two.

    Parameters
    ----------
    function
        Importable by name; its last argument is `report(stage, fraction)`.
    jobs
        Name of each job and its arguments.
    reports
        Where a job's progress goes, by name.
    limits
        By job, seconds that may pass from its first report to its answer.

    Raises
    ------
    InputError
        What a job refused. The other jobs are ended.
    WorkerError
        A job crashed.
    LateError
        A job took longer than it may.

    """
    context = multiprocessing.get_context("spawn")
    running: dict[Connection, BaseProcess] = {}
    try:
        for _ in range(min(len(jobs), max(processors(), 2))):
            here, there = context.Pipe()
            process = context.Process(target=_child, args=(there, function), daemon=False)
            with safe_environment(), deaf_to(*STOPS):  # it is told all that it begins with
                process.start()
                running[here] = process
            there.close()
        return _gather(running, jobs, reports, limits or {})
    finally:
        for process in running.values():
            _end(process)


def work_here(
    function: Callable[..., Any],
    jobs: Mapping[Any, tuple[Any, ...]],
    reports: Mapping[Any, Any],
    _limits: Mapping[Any, float] | None = None,
) -> dict[Any, Any]:
    """Call the function once for each job like `work_together`, one after another in this process: no limit ends it."""
    return {name: function(*arguments, reports[name]) for name, arguments in jobs.items()}


def _gather(
    running: Mapping[Connection, BaseProcess],
    jobs: Mapping[Any, tuple[Any, ...]],
    reports: Mapping[Any, Any],
    limits: Mapping[Any, float],
) -> dict[Any, Any]:
    answers: dict[Any, Any] = {}
    left = iter(jobs.items())
    doing: dict[Connection, Any] = {}
    clock = _Clock(limits)

    def go_on(end: Connection) -> None:
        """Give a process its next job, or let it end."""
        doing.pop(end, None)
        name, arguments = next(left, (None, None))
        if arguments is not None:
            doing[end] = name
        end.send(arguments)

    for end in running:
        go_on(end)
    while doing:
        for end in wait(list(doing), clock.left()):
            if not isinstance(end, Connection):
                continue
            name = doing[end]
            kind, content = _received(end, name, running[end])
            if kind == "progress":
                reports[name](*content)
                clock.begin(name, content[0])
            elif kind == "answer":
                answers[name] = content
                clock.end(name)
                go_on(end)
        clock.check()
    return answers


class _Clock:
    """When each job must end, of those that have a limit, and the stage that it is at."""

    def __init__(self, limits: Mapping[Any, float]) -> None:
        self._limits = limits
        self._ends: dict[Any, float] = {}
        self._stages: dict[Any, str] = {}

    def begin(self, name: Any, stage: str) -> None:
        """A job is at a stage."""
        self._stages[name] = stage
        if name in self._limits:
            self._ends.setdefault(name, time.monotonic() + self._limits[name])

    def end(self, name: Any) -> None:
        """A job is done."""
        self._ends.pop(name, None)

    def left(self) -> float | None:
        """Seconds until the first job must end; None where none must."""
        first = min(self._ends.values(), default=None)
        return None if first is None else max(first - time.monotonic(), 0.0)

    def check(self) -> None:
        """Raise LateError where a job should have ended."""
        for name, when in self._ends.items():
            if time.monotonic() > when:
                raise LateError(name, self._stages[name], self._limits[name])


def _received(end: Connection, name: Any, process: BaseProcess) -> tuple[str, Any]:
    """What a job sends: progress, its answer, or a record for the log. Raises what it refused, or that it crashed."""
    try:
        kind, content = end.recv()
    except EOFError:
        process.join(5)
        raise WorkerError(f"{name}: its process ended without an answer (exit code {process.exitcode})") from None
    if kind == "refused":
        raise InputError(content)
    if kind == "failed":
        log.debug("%s", content)
        raise WorkerError(f"{name}: {content.strip().splitlines()[-1]}")
    if kind == "log":
        logging.getLogger(content.name).handle(content)
    return kind, content


def _end(process: BaseProcess) -> None:
    if process.is_alive():
        process.join(0.5)
    if process.is_alive():
        process.terminate()
        process.join(2)
    if process.is_alive():
        process.kill()
    process.join()


def _child(end: Any, function: Callable[..., Any]) -> None:
    _obey_parent()
    leave_out("sklearn", "sklearn.cluster")  # a third of the time of importing build123d, which clusters STL files
    root = logging.getLogger()
    root.addHandler(_Forward(end))
    root.setLevel(logging.WARNING)
    logging.captureWarnings(capture=True)
    try:
        for arguments in iter(end.recv, None):
            answer = function(*arguments, lambda stage, fraction: end.send(("progress", (stage, fraction))))
            end.send(("answer", answer))
    except InputError as error:
        end.send(("refused", str(error)))
    except (BrokenPipeError, EOFError):  # the parent has gone, or has been stopped
        return
    except Exception:  # noqa: BLE001 (whatever it is, the parent tells it)
        end.send(("failed", traceback.format_exc()))


class _Forward(logging.handlers.QueueHandler):
    """Sends log records to the parent, which knows where they go."""

    def enqueue(self, record: logging.LogRecord) -> None:
        """Send one record."""
        end: Any = self.queue
        with contextlib.suppress(OSError):
            end.send(("log", record))


def _obey_parent() -> None:
    """End cleanly on SIGTERM, leave Ctrl-C to the parent, and end when the parent is gone."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):  # it was started deaf to it
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    end_with_parent()

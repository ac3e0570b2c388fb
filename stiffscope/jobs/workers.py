"""Jobs side by side, each in a process of its own: progress comes back, errors too, and nobody outlives the parent.

`concurrent.futures` cannot end a job that is running (before Python 3.14), nor say which job took its process down.
"""

from __future__ import annotations

import contextlib
import logging
import logging.handlers
import multiprocessing
import os
import signal
import sys
import time
import traceback
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any

from stiffscope.children import end_with_parent, leave_out
from stiffscope.errors import InputError, StiffscopeError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from multiprocessing.process import BaseProcess

log = logging.getLogger(__name__)


class WorkerError(RuntimeError):
    """A job ended without an answer, or with an error that is not the user's."""


class LateError(StiffscopeError):
    """A job was ended because a stage of it took longer than it may: `job`, `stage`, `seconds`."""

    def __init__(self, job: Any, stage: str, seconds: float) -> None:
        super().__init__(f"{job}: expected its stage {stage} within {seconds:g} s, got no end")
        self.job, self.stage, self.seconds = job, stage, seconds


def work_together(
    function: Callable[..., Any],
    jobs: Mapping[Any, tuple[Any, ...]],
    reports: Mapping[Any, Any],
    limits: Mapping[Any, Mapping[str, float]] | None = None,
) -> dict[Any, Any]:
    """Call `function(*arguments, report)` once for each job, all at the same time.

    Parameters
    ----------
    function
        Importable by name; its last argument is `report(stage, fraction)`.
    jobs
        Name of each job and its arguments.
    reports
        Where a job's progress goes, by name.
    limits
        By job and stage, seconds that may pass from one report of the stage to the next report of any.

    Raises
    ------
    InputError
        What a job refused. The other jobs are ended.
    WorkerError
        A job crashed.
    LateError
        A stage took longer than it may.

    """
    context = multiprocessing.get_context("spawn")
    running: dict[Connection, tuple[Any, BaseProcess]] = {}
    try:
        for name, arguments in jobs.items():
            here, there = context.Pipe(duplex=False)
            process = context.Process(target=_child, args=(there, function, arguments), daemon=False)
            with _safe_path():
                process.start()
            there.close()
            running[here] = (name, process)
        return _gather(running, reports, limits or {})
    finally:
        for _, process in running.values():
            _end(process)


def work_here(
    function: Callable[..., Any],
    jobs: Mapping[Any, tuple[Any, ...]],
    reports: Mapping[Any, Any],
    _limits: Mapping[Any, Mapping[str, float]] | None = None,
) -> dict[Any, Any]:
    """Call the function once for each job like `work_together`, one after another in this process: no limit ends it."""
    return {name: function(*arguments, reports[name]) for name, arguments in jobs.items()}


def _gather(
    running: dict[Connection, tuple[Any, BaseProcess]],
    reports: Mapping[Any, Any],
    limits: Mapping[Any, Mapping[str, float]],
) -> dict[Any, Any]:
    answers: dict[Any, Any] = {}
    open_ends = dict(running)
    stages: dict[Any, tuple[float, str, float]] = {}  # of each job: when its present stage must end, name, limit
    while open_ends:
        first = min((when for when, _, _ in stages.values()), default=None)
        for end in wait(list(open_ends), None if first is None else max(first - time.monotonic(), 0.0)):
            if not isinstance(end, Connection):
                continue
            name, process = open_ends[end]
            kind, content = _received(end, name, process)
            if kind == "progress":
                reports[name](*content)
                stages.pop(name, None)
                seconds = limits.get(name, {}).get(content[0])
                if seconds is not None:
                    stages[name] = time.monotonic() + seconds, content[0], seconds
            elif kind == "answer":
                answers[name] = content
                stages.pop(name, None)
                del open_ends[end]
        for name, (when, stage, seconds) in stages.items():
            if time.monotonic() > when:
                raise LateError(name, stage, seconds)
    return answers


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


@contextlib.contextmanager
def _safe_path() -> Iterator[None]:
    """Let a child start without the working folder on its path: a user's random.py must not stand in for Python's."""
    former = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if former is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = former


def _end(process: BaseProcess) -> None:
    if process.is_alive():
        process.join(0.5)
    if process.is_alive():
        process.terminate()
        process.join(2)
    if process.is_alive():
        process.kill()
    process.join()


def _child(end: Any, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    _obey_parent()
    leave_out("sklearn", "sklearn.cluster")  # a third of the time of importing build123d, which clusters STL files
    root = logging.getLogger()
    root.addHandler(_Forward(end))
    root.setLevel(logging.WARNING)
    logging.captureWarnings(capture=True)
    try:
        answer = function(*arguments, lambda stage, fraction: end.send(("progress", (stage, fraction))))
        end.send(("answer", answer))
    except InputError as error:
        end.send(("refused", str(error)))
    except BrokenPipeError:
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
    end_with_parent()

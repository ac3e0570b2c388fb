"""Worker process: runs jobs read from standard input until the input or the parent ends.

`runtime.executor` starts it as ``python -P -m stiffscope.runtime.worker``, without user modules.
"""

from __future__ import annotations

import contextlib
import ctypes
import logging
import logging.handlers
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError
from stiffscope.runtime.collection import no_collection
from stiffscope.runtime.processors import use_processors

if TYPE_CHECKING:
    from collections.abc import Callable

PERIOD = 0.5  # s between checks of the parent on systems without parent-death signals


def end_with_parent(parent: int) -> None:
    """End this process immediately when its parent with this process id ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(
            1, signal.SIGKILL
        )  # PR_SET_PDEATHSIG, also acts in C code
    else:
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()
    if os.getppid() != parent:  # the parent has already ended
        os._exit(1)


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(PERIOD)
    os._exit(1)


class _Channel(logging.handlers.QueueHandler):
    """Thread-safe channel of messages to the parent: results, progress and log records."""

    def __init__(self) -> None:
        super().__init__(self)  # pyright: ignore[reportArgumentType]
        self._stream = os.fdopen(os.dup(1), "wb")
        self._turn = threading.Lock()
        os.dup2(2, 1)  # keeps output of libraries out of the channel

    def send(self, kind: str, content: Any) -> None:
        """Send a message."""
        message = pickle.dumps((kind, content))
        with self._turn:
            self._stream.write(message)
            self._stream.flush()

    def enqueue(self, record: logging.LogRecord) -> None:
        """Send a log record."""
        with contextlib.suppress(OSError):
            self.send("log", record)


def main() -> None:
    """Run jobs one after another."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    if hasattr(signal, "pthread_sigmask"):  # blocked at the start
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    parent, share, sys.path[:] = pickle.load(sys.stdin.buffer)  # noqa: S301
    end_with_parent(parent)
    if share:
        use_processors(share)
    channel = _Channel()
    logging.getLogger().addHandler(channel)
    logging.getLogger().setLevel(logging.WARNING)
    logging.captureWarnings(capture=True)
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            _work(channel)
    sys.stderr.flush()
    os._exit(0)  # skips slow or crashing shutdown of libraries


def _work(channel: _Channel) -> None:
    """Run a job and send its result or its error."""
    with no_collection():  # imports what the job needs
        function, arguments, heard = pickle.load(sys.stdin.buffer)  # noqa: S301
    channel.send("begun", None)
    report = (
        [lambda stage, fraction: channel.send("progress", (stage, fraction))]
        if heard
        else []
    )
    channel.send(*answer(function, *arguments, *report))


def answer(function: Callable[..., Any], *arguments: Any) -> tuple[str, Any]:
    """Run a job; return "answer" and result, "error" and user error, or "failed" and traceback."""
    try:
        return "answer", function(*arguments)
    except BrokenPipeError:
        raise
    except (InputError, OSError, MemoryError) as error:
        return "error", error
    except Exception:  # noqa: BLE001 (the caller reports it)
        return "failed", traceback.format_exc()


if __name__ == "__main__":
    main()

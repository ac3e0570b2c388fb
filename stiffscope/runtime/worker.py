"""A process of ours: it does jobs that it reads from its standard input until that ends, or its parent does.

Started by `stiffscope.runtime.executor` as ``python -P -m stiffscope.runtime.worker``, without the user's modules.
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
from stiffscope.runtime.processors import use_processors

if TYPE_CHECKING:
    from collections.abc import Callable

PERIOD = 0.5  # s between two looks at the parent, where the system does not tell of its end


def end_with_parent(parent: int) -> None:
    """Let this process end, at once and whatever it is doing, when its parent, of this process id, does."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG; Python's handlers wait for C code to end
    else:
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()
    if os.getppid() != parent:  # it has ended before
        os._exit(1)


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(PERIOD)
    os._exit(1)


class _Channel(logging.handlers.QueueHandler):
    """What goes to the parent: answers, progress, and records for the log, each whole, from any thread."""

    def __init__(self) -> None:
        super().__init__(self)  # pyright: ignore[reportArgumentType]
        self._stream = os.fdopen(os.dup(1), "wb")
        self._turn = threading.Lock()
        os.dup2(2, 1)  # what libraries print is no message

    def send(self, kind: str, content: Any) -> None:
        """Send a message."""
        message = pickle.dumps((kind, content))
        with self._turn:
            self._stream.write(message)
            self._stream.flush()

    def enqueue(self, record: logging.LogRecord) -> None:
        """Send a record for the log."""
        with contextlib.suppress(OSError):
            self.send("log", record)


def main() -> None:
    """Do jobs, one after another."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's affair
    if hasattr(signal, "pthread_sigmask"):  # it was started deaf
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
    os._exit(0)  # the ends of graphics and CAD libraries take time, and have been seen to crash


def _work(channel: _Channel) -> None:
    """Do a job, and send its answer or what has gone wrong."""
    function, arguments, heard = pickle.load(sys.stdin.buffer)  # noqa: S301
    channel.send("begun", None)
    report = [lambda stage, fraction: channel.send("progress", (stage, fraction))] if heard else []
    channel.send(*answer(function, *arguments, *report))


def answer(function: Callable[..., Any], *arguments: Any) -> tuple[str, Any]:
    """Do a job: "answer" and what it gives, "error" and what it raises for its user, or "failed" and why."""
    try:
        return "answer", function(*arguments)
    except BrokenPipeError:
        raise
    except (InputError, OSError, MemoryError) as error:
        return "error", error
    except Exception:  # noqa: BLE001 (whatever it is, the caller reports it)
        return "failed", traceback.format_exc()


if __name__ == "__main__":
    main()

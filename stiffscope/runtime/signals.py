"""Deferred signals."""

from __future__ import annotations

import contextlib
import signal
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

STOPS = ("SIGINT", "SIGTERM", "SIGHUP")
"""Signals by which a user stops a command."""


def block(*names: str) -> set[signal.Signals]:
    """Block signals for this thread and its child processes; return those blocked before."""
    if not hasattr(signal, "pthread_sigmask"):
        return set()
    numbers = [getattr(signal, name) for name in names]
    return set(map(signal.Signals, signal.pthread_sigmask(signal.SIG_BLOCK, numbers)))


@contextlib.contextmanager
def defer_signals(*names: str) -> Iterator[None]:
    """Defer signals until the block is done; threads and processes started in it never get them.

    ``names``: "SIGINT" (Ctrl-C), "SIGTERM" etc. If an existing thread receives a signal for the
    main thread, the latter only records it.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    noted: list[int] = []
    main = threading.current_thread() is threading.main_thread()
    numbers = [getattr(signal, name) for name in names if main]
    handlers = {number: signal.getsignal(number) for number in numbers}
    for number in handlers:
        signal.signal(number, lambda number, _frame: noted.append(number))
    former = block(*names)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)
        for number, handler in handlers.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        if noted:
            signal.raise_signal(noted[0])

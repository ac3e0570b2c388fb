"""Processes of our own: each ends with its parent, whatever ends that, and starts without the user's modules."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import types
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

_SAFE = {"PYTHONSAFEPATH": "1", "PYTHONWARNINGS": "ignore:resource_tracker:UserWarning"}
_PARENT = "STIFFSCOPE_PARENT"
STOPS = ("SIGINT", "SIGTERM", "SIGHUP")
"""Signals by which a user stops a command."""
_SECONDS = 0.5  # between two looks at the parent, where the system does not tell of its end


def run_module(module: str, *arguments: str, time_limit: float, folder: str) -> subprocess.CompletedProcess[bytes]:
    """Run a module of this package in a process of its own, which calls `end_with_parent` before anything else.

    Parameters
    ----------
    module
        Such as "stiffscope.cad.step_reader".
    arguments
        Words for it; paths must be absolute.
    time_limit
        Seconds; the process is killed afterwards.
    folder
        Where it runs and keeps what is temporary: a folder of ours that is removed later. A random.py in the user's may
        be found before Python's own.

    Raises
    ------
    subprocess.TimeoutExpired
        It took longer.

    """
    with start_module(module, *arguments, folder=folder) as process:
        try:
            out, errors = process.communicate(timeout=time_limit)
        except BaseException:
            process.kill()
            raise
    return subprocess.CompletedProcess(process.args, process.returncode, out, errors)


def start_module(module: str, *arguments: str, folder: str) -> subprocess.Popen[bytes]:
    """Start such a process, which may be told more through a pipe; Ctrl-C is its parent's affair."""
    process = None
    try:
        with deaf_to("SIGINT"):
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", module, *arguments], cwd=folder, stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                env={**os.environ, _PARENT: str(os.getpid()), "TMPDIR": folder},
            )  # fmt: skip
    except BaseException:  # Ctrl-C that has waited
        if process is not None:
            process.kill()
        raise
    return process


@contextlib.contextmanager
def safe_environment() -> Iterator[None]:
    """Keep the working folder off the path of what `multiprocessing` starts: a random.py there is not Python's.

    Nor does its tracker warn of the semaphores of a killed process.
    """
    former = {name: os.environ.get(name) for name in _SAFE}
    os.environ.update(_SAFE)
    try:
        if hasattr(signal, "pthread_sigmask"):
            from multiprocessing import resource_tracker

            resource_tracker.ensure_running()  # when the first child brings this about, it undoes `deaf_to`
        yield
    finally:
        for name, value in former.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


@contextlib.contextmanager
def deaf_to(*names: str) -> Iterator[None]:
    """Let signals wait until the block is done; threads and processes that it starts never see them.

    ``names``: "SIGINT" (Ctrl-C), "SIGTERM"; those that this system has count. Threads that are there already may take a
    signal for the main one, which then only notes it.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    numbers: list[int] = [getattr(signal, name) for name in names]
    noted: list[int] = []
    main = threading.current_thread() is threading.main_thread()
    handlers = {number: signal.getsignal(number) for number in numbers if main}
    for number in handlers:
        signal.signal(number, lambda number, _frame: noted.append(number))
    former = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)
        for number, handler in handlers.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        if noted:
            signal.raise_signal(noted[0])


def end_with_parent(parent: int | None = None) -> None:
    """Let this process end, at once and whatever it is doing, when its parent does.

    Parameters
    ----------
    parent
        Process id; by default the one that `run_module` has left, or that of `multiprocessing`.

    """
    above = multiprocessing.parent_process()
    parent = parent or (above and above.pid) or int(os.environ.get(_PARENT, "0")) or os.getppid()
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG; Python's handlers wait for C code to end
    else:
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()
    if os.getppid() != parent:  # it has ended before
        os._exit(1)


def dask_setup(_worker: Any) -> None:
    """Let a worker of Dask that loads this module end with the process that has started it."""
    end_with_parent()


def leave_out(*modules: str) -> None:
    """Let modules be empty in this process, which is one of ours: a library imports them for what we never call.

    What is asked of them is a class of that name that does nothing.
    """
    for name in modules:
        sys.modules.setdefault(name, _Empty(name))


class _Empty(types.ModuleType):
    def __getattr__(self, name: str) -> type:
        if name.startswith("__"):
            raise AttributeError(name)
        return type(name, (), {})


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_SECONDS)
    os._exit(1)

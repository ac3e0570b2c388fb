"""Pictures are drawn in a process of their own: what its graphics library does there cannot hurt a run."""

from __future__ import annotations

import errno
import json
import logging
import os
import signal
import subprocess
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from stiffscope.errors import StiffscopeError
from stiffscope.runtime.children import start_module
from stiffscope.runtime.files import scratch_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

log = logging.getLogger(__name__)

TIME_LIMIT = 300.0
_CRASHES = {"SIGSEGV", "SIGABRT", "SIGBUS", "SIGILL", "SIGFPE", "SIGTRAP"}  # how a graphics library ends a process


class PictureError(StiffscopeError, RuntimeError):
    """Pictures cannot be drawn on this machine; the message names what is missing."""


@contextmanager
def optional_pictures() -> Iterator[None]:
    """Draw what a result can do without: where this machine cannot, say so."""
    try:
        yield
    except PictureError as error:
        log.warning("%s", error)


def draw(picture: str, target: Path, **arguments: Any) -> None:
    """Draw one picture in a child process.

    Parameters
    ----------
    picture
        Name of a function of `stiffscope.report.drawing`.
    target
        File, or folder for pictures that come in sets, that the function writes.
    arguments
        What the function takes besides, as JSON knows it: numbers, texts, lists, paths.

    Raises
    ------
    PictureError
        No picture; the message is one line that names the cause and the cure.
    OSError
        The disk is full.

    """
    with drawing() as draw_now:
        draw_now(picture, target, **arguments)


@contextmanager
def drawing(*, ahead: bool = False) -> Iterator[Callable[..., None]]:
    """Start a child process that draws one picture; gives what is then called once, like `draw`.

    ``ahead``: the picture is known in some seconds only, which the process takes to load what it needs.
    """
    words = ("ahead",) if ahead else ()
    with (
        scratch_folder() as folder,
        start_module("stiffscope.report.drawing", *words, folder=str(folder)) as process,
    ):
        try:
            yield partial(_draw, process, folder / "order.json")
        finally:
            process.kill()


def _draw(process: subprocess.Popen[bytes], order: Path, picture: str, target: Path, **arguments: Any) -> None:
    asked = {"picture": picture, "target": target, "arguments": arguments}
    order.write_text(json.dumps(asked, default=_plain))
    try:
        errors = process.communicate(str(order).encode(), TIME_LIMIT)[1].decode(errors="replace")
    except subprocess.TimeoutExpired as error:
        raise PictureError(f"no pictures: drawing took more than {TIME_LIMIT:.0f} s") from error
    if process.returncode != 0:
        log.debug("drawing %s failed:\n%s", picture, errors)
        full = os.strerror(errno.ENOSPC)
        if full in errors:
            raise OSError(errno.ENOSPC, full, str(target))
        raise PictureError(_cause(process.returncode, errors))


def _cause(code: int, errors: str) -> str:
    """One line on why there is no picture."""
    ended = signal.Signals(-code).name if -code in set(signal.Signals) else ""
    if ended and ended not in _CRASHES:
        return f"no pictures: the process that draws them was killed from outside ({ended}); is there enough memory?"
    lines = [line for line in errors.splitlines() if line.strip()]
    last = lines[-1].strip() if lines else f"the process ended with code {code}"
    graphics = ("libGL", "libEGL", "libOSMesa", "OpenGL", "libX", "RenderWindow", "cannot open shared object")
    if code < 0 or any(word in errors for word in graphics):
        return (
            "no pictures: OpenGL does not work here; on Debian or Ubuntu install libegl1 and libgl1-mesa-dri "
            f"(or libosmesa6) [{last[:160]}]"
        )
    return f"no pictures: {last[:200]}"


def _plain(value: Any) -> Any:
    """What JSON does not know: arrays and paths."""
    return value.tolist() if hasattr(value, "tolist") else str(value.absolute())

"""Drawing in a separate process, so that a crash of the graphics library cannot stop a run."""

from __future__ import annotations

import json
import logging
import re
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError, StiffscopeError
from stiffscope.runtime.collection import no_collection
from stiffscope.runtime.executor import KILLED, LateError, Processes, WorkerError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

log = logging.getLogger(__name__)

TIME_LIMIT = 300.0


class PictureError(StiffscopeError, RuntimeError):
    """Pictures cannot be drawn on this machine; the message names what is missing."""


@contextmanager
def optional_pictures() -> Iterator[None]:
    """Draw optional pictures: log a warning if this machine cannot draw."""
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
        File to write, or folder for a set of pictures.
    arguments
        Further arguments of the function, as JSON-compatible data: numbers, texts, lists, paths.

    Raises
    ------
    PictureError
        Drawing failed; the message states cause and remedy in one line.
    OSError
        The disk is full.
    """
    with open_drawing() as draw_now:
        draw_now(picture, target, **arguments)


@contextmanager
def open_drawing(*, ahead: bool = False) -> Iterator[Callable[..., None]]:
    """Start a child process for drawing; yield a function that is called like `draw`.

    ``ahead``: the picture follows some seconds later; meanwhile the process loads its libraries.
    """
    with Processes(1) as executor:
        if ahead:
            executor.submit(_draw_now, "warm_up", (), {}, name="no pictures")
        try:
            yield draw_by(executor)
        finally:
            executor.end()


def draw_by(executor: Processes) -> Callable[..., None]:
    """Return a function that is called like `draw`, and draws in an executor's processes."""
    return partial(_draw, executor)


def _draw(executor: Processes, picture: str, target: Path, **arguments: Any) -> None:
    asked = json.loads(json.dumps(arguments, default=_to_plain))
    given = picture, (target.absolute(),), asked
    try:
        executor.submit(
            _draw_now, *given, name="no pictures", limit=TIME_LIMIT
        ).result()
    except LateError as error:
        raise PictureError(
            f"no pictures: drawing took more than {TIME_LIMIT:.0f} s"
        ) from error
    except InputError as error:
        raise PictureError(f"no pictures: {error}") from error
    except WorkerError as error:
        log.debug("drawing %s failed:\n%s", picture, error.output)
        raise PictureError(_cause(error)) from error


def _to_plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value.absolute())


def _draw_now(
    picture: str, targets: tuple[Path, ...], arguments: dict[str, Any]
) -> None:
    """Draw in this process, or only load the libraries for it ("warm_up")."""
    with no_collection():
        from stiffscope.report.drawing.part import part_pictures, stressed_part
        from stiffscope.report.drawing.robot import robot, warm_up

    known: dict[str, Any] = {
        f.__name__: f for f in (part_pictures, stressed_part, robot, warm_up)
    }
    known[picture](*targets, **arguments)


def _cause(error: WorkerError) -> str:
    """Return one line on why drawing failed."""
    if error.code in KILLED:
        return str(error)
    lines = [line for line in error.output.splitlines() if line.strip()]
    last = lines[-1].strip() if lines else f"the process ended with code {error.code}"
    graphics = "lib(GL|EGL|OSMesa|X)|OpenGL|RenderWindow|cannot open shared object"
    if (error.code or 0) < 0 or re.search(graphics, error.output):
        cure = "on Debian or Ubuntu install libegl1 and libgl1-mesa-dri (or libosmesa6)"
        return f"no pictures: OpenGL does not work here; {cure} [{last[:160]}]"
    return f"no pictures: {last[:200]}"

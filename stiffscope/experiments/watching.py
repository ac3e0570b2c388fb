"""Monitoring of a robot's files: which files, when they change, and the changes of the robot."""

from __future__ import annotations

import functools
import threading
import time
from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError
from stiffscope.robot.file.parse import parse_text
from stiffscope.runtime.reading import file_digest

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from stiffscope.experiments.experiments import PartResult
    from stiffscope.robot.file.description import RobotFile

PERIOD = 0.05  # s, polling interval
GONE = 1.0  # s for which editors may leave a file missing or empty while they save it
HEAVY = (
    "stiffscope.cad.drawing",
    "stiffscope.cad.step",
    "stiffscope.fea.run",
    "stiffscope.fea.adapt",
    "stiffscope.fea.design_velocity",
    "stiffscope.fea.dynamics",
)


def sources(robot: RobotFile) -> list[Path]:
    """Return the paths of the robot file and of its STEP files and meshes."""
    beside = robot.path.parent
    solids = (getattr(part, "file", None) for part in robot.parts.values())
    drawn = (getattr(body, "mesh", None) for body in robot.bodies.values())
    files = [beside / file for file in (*solids, *drawn) if file]
    return list(dict.fromkeys([robot.path, *files]))


def changes(files: Sequence[Path]) -> Iterator[None]:
    """Yield at once, and whenever the content of a file has changed; the list itself may change.

    A file that is missing or empty only while an editor saves it has not changed.
    """
    held: dict[Path, str] = {}  # contents at the last yield
    read: dict[Path, tuple[Any, str]] = {}
    changed = {}
    since = 0.0
    while True:
        former = changed
        changed = {path: _content(path, read) for path in files}
        if changed != former:
            since = time.monotonic()
        known = held
        held = {**changed, **held}
        settled = time.monotonic() - since >= (
            PERIOD if all(changed.values()) else GONE
        )
        if not known or (settled and changed != {path: held[path] for path in changed}):
            held |= changed
            yield
        time.sleep(PERIOD)


def _content(path: Path, read: dict[Path, tuple[Any, str]]) -> str:
    """Return a file's checksum, "" if missing or empty; ``read`` keeps those of unchanged files."""
    with suppress(OSError, InputError):
        status = path.stat()
        stamp = (status.st_mtime_ns, status.st_size, status.st_ino)
        if status.st_size and (path not in read or read[path][0] != stamp):
            read[path] = (stamp, file_digest(path))
        return read[path][1] if status.st_size else ""
    return ""


@functools.cache
def keep_warm() -> None:
    """Import the modules of virtual experiments in the background, once."""

    def load() -> None:
        for name in HEAVY:
            import_module(name)

    threading.Thread(target=load, daemon=True).start()


def keep_meshed(held: dict[str, PartResult], results: Mapping[str, PartResult]) -> None:
    """Keep the last meshed result of each part; a morphed mesh is not morphed again."""
    held.update(
        {name: part for name, part in results.items() if not part.experiment.moved}
    )


def digest_sources(robot: RobotFile) -> dict[str, str]:
    """Return the checksums of the robot's STEP files and meshes, by file name."""
    return {path.name: file_digest(path) for path in sources(robot)[1:]}


def differences(
    before: RobotFile,
    after: RobotFile,
    former: Mapping[str, str] | None = None,
    present: Mapping[str, str] | None = None,
) -> list[str]:
    """Return up to four differences of two versions: "slider.thickness 20 mm → 25 mm".

    Parameters
    ----------
    before, after
        Robot before and after a file was saved.
    former, present
        Checksums of its files before and after, from `digest_sources`.
    """
    known = former or {}
    now = present or {}
    files = [
        f"content of {name}" for name in now if known.get(name, now[name]) != now[name]
    ]
    old, new = (
        _leaves(parse_text(robot.path, robot.source.text)) for robot in (before, after)
    )
    names = [
        name for name in dict.fromkeys([*new, *old]) if old.get(name) != new.get(name)
    ]
    pairs = (
        (name, old.get(name, "nothing"), new.get(name, "nothing")) for name in names[:4]
    )
    shown = [f"{name} {one} → {two}" for name, one, two in pairs]
    return files + ([*shown, f"{len(names) - 4} more"] if len(names) > 4 else shown)


def _leaves(value: Any, name: str = "") -> dict[str, Any]:
    if not isinstance(value, dict | list):
        return {
            name.removeprefix("parts.")
            .removeprefix("joints.")
            .removeprefix("bodies."): value
        }
    leaves: dict[str, Any] = {}
    for key, each in value.items() if isinstance(value, dict) else enumerate(value):
        leaves |= _leaves(each, f"{name}.{key}" if name else str(key))
    return leaves

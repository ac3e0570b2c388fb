"""The robots bundled with stiffscope: find one by name, list them, copy one to a new file."""

from __future__ import annotations

import contextlib
import os
from itertools import islice
from pathlib import Path

from stiffscope.data import FOLDER
from stiffscope.errors import InputError, suggest
from stiffscope.runtime import reading
from stiffscope.runtime.output import write_new

ROBOTS = FOLDER / "robots"


def robot_names() -> dict[str, str]:
    """Return the robots in `data/robots`: their names, and the first lines of their files."""
    texts = {
        path.stem: path.read_text(encoding="utf-8")
        for path in sorted(ROBOTS.glob("*.toml"))
    }
    return {
        name: text.partition("\n")[0].removeprefix("#").strip()
        for name, text in texts.items()
    }


def find_robot(name_or_path: str | Path) -> Path:
    """Return the path of a robot file, given as a path or as a name in `data/robots`."""
    path = Path(name_or_path)
    names = list(robot_names())
    # Path.is_file raises on some names
    if str(name_or_path) in names and not os.path.isfile(path):  # noqa: PTH113
        return ROBOTS / f"{name_or_path}.toml"
    try:
        reading.open_file(
            name_or_path, f"a robot file or one of {', '.join(names)}"
        ).close()
    except InputError as error:
        with contextlib.suppress(OSError, ValueError):
            names += [str(file) for file in islice(path.parent.glob("*.toml"), 1000)]
        raise InputError(f"{error}{suggest(str(name_or_path)[:100], names)}") from error
    return path


def copy_robot(name: str, target: str | Path) -> Path:
    """Copy a robot of `data/robots` to a new file; raise InputError if the file exists."""
    source = find_robot(name)
    goal = Path(target)
    if str(target) and goal.is_dir():
        goal = goal / f"{source.stem}.toml"
    write_new(goal, reading.read_bytes(source))
    return goal

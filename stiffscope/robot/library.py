"""The robots that come with stiffscope: finding one by name, listing them, copying one to start from."""

from __future__ import annotations

import difflib
from pathlib import Path

from stiffscope.data import FOLDER
from stiffscope.errors import InputError
from stiffscope.files import write_bytes

ROBOTS = FOLDER / "robots"


def robot_names() -> dict[str, str]:
    """Names of the robots in `data/robots`, each with its one line of description, the first comment of its file."""
    return {path.stem: _first_line(path) for path in sorted(ROBOTS.glob("*.toml"))}


def _first_line(path: Path) -> str:
    with path.open(encoding="utf-8") as lines:
        return next(lines, "").removeprefix("#").strip()


def find_robot(name_or_path: str | Path) -> Path:
    """Path of a robot file given as a path or as the name of a robot in `data/robots`."""
    path = Path(name_or_path)
    if path.is_file():
        return path
    if path.name == str(name_or_path) and (ROBOTS / f"{name_or_path}.toml").is_file():
        return ROBOTS / f"{name_or_path}.toml"
    names = list(robot_names())
    close = difflib.get_close_matches(str(name_or_path), names, n=1, cutoff=0.6)
    guess = f'; did you mean "{close[0]}"?' if close else ""
    what = "a folder" if path.is_dir() else "no file"
    raise InputError(f"{path}: expected a robot file or one of {', '.join(names)}, got {what}{guess}")


def copy_robot(name: str, target: str | Path) -> Path:
    """Copy a robot of `data/robots` to a file of one's own. Raises InputError for one that is there."""
    source, goal = find_robot(name), Path(target)
    if goal.is_dir():
        goal = goal / f"{source.stem}.toml"
    if goal.exists():
        raise InputError(f"{goal}: expected a file that is not there yet, got one that is")
    text = source.read_text(encoding="utf-8")
    write_bytes(goal, text.encode())
    return goal

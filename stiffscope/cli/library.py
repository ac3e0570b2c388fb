"""`stiffscope robots` and `stiffscope new`: the robots that come with the package, and a copy to start from."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stiffscope import files
from stiffscope.report import tables
from stiffscope.robot.library import copy_robot, robot_names

if TYPE_CHECKING:
    from pathlib import Path


def list_robots(target: str | None = None) -> None:
    """Show the robots of the package with a line each, or write them as JSON, ("-": standard output)."""
    names = robot_names()
    if target is not None:
        files.write_json(target, names)
        return
    width = max(map(len, names))
    for name, line in names.items():
        tables.show_line(f"{name:{width}}  {line.partition(': ')[2] or line}")


def new_robot(name: str, target: Path) -> None:
    """Copy a robot of the package to a file that is not there yet. Raises InputError."""
    goal = copy_robot(name, target)
    tables.show_line(f"Written: {goal}. Next: stiffscope check {goal}")

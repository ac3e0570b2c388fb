"""Robot files written from others: comments are kept, `--set` changes applied, paths adjusted."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomlkit

from stiffscope.robot.file.override import assign, split
from stiffscope.robot.file.part_sections import ParametricPart

if TYPE_CHECKING:
    from stiffscope.robot.file.description import RobotFile


def robot_document(
    robot: RobotFile, target: Path, components: str | None = None
) -> Any:
    """Return a robot's file as a tomlkit document, to be written to another file.

    Parameters
    ----------
    robot
        Robot with its `--set` changes, which are applied, except those of copies.
    target
        Path of the new file; paths of STEP files and meshes become relative to it.
    components
        Source of the matrices of rods and plates to write; None keeps that of the file.
    """
    document: Any = tomlkit.parse(robot.source.text)
    for key, text in robot.source.changed.items():
        if text.startswith("--set "):
            assign(document, key, split(text.removeprefix("--set "))[1], text)
    for name, part in robot.parts.items():
        if (
            isinstance(part, ParametricPart)
            and components in part.sources
            and part.compliance != components
        ):
            document["parts"][name]["compliance"] = components
        if getattr(part, "file", None):
            _move(document["parts"][name], "file", robot.path, target)
    for body in document["bodies"].values():
        if "mesh" in body:
            _move(body, "mesh", robot.path, target)
    return document


def _move(table: Any, key: str, source: Path, target: Path) -> None:
    """Make a file's path relative to the target."""
    if not Path(table[key]).is_absolute():
        place = (source.parent / table[key]).resolve()
        table[key] = Path(os.path.relpath(place, target.resolve().parent)).as_posix()

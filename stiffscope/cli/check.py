"""`stiffscope check`: what a robot file says, what it can do, and pictures of it; without any virtual experiment."""

from __future__ import annotations

import logging
import sys
from typing import TYPE_CHECKING

from stiffscope import files
from stiffscope.errors import InputError
from stiffscope.jobs.cache import file_digest
from stiffscope.jobs.manifest import Manifest
from stiffscope.report.check_tables import show_check
from stiffscope.report.pictures import PictureError, draw
from stiffscope.report.robot_scene import moves, picture, pose_text, scene
from stiffscope.robot.inspection import inspect_robot, inspection_json
from stiffscope.robot.reader import load_robot

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.robot.inspection import Inspection

log = logging.getLogger(__name__)


def check_robot(
    name: str,
    *,
    overrides: Sequence[str] = (),
    out: Path | None = None,
    target: str | None = None,
    quiet: bool = False,
) -> None:
    """Show what a robot file amounts to.

    Parameters
    ----------
    name
        A path, or the name of a robot in `data/robots`.
    overrides
        As `--set` takes them.
    out
        Folder for pictures of the robot at home and at every named pose, and `check.json`.
    target
        File for the same as JSON, "-" for standard output.
    quiet
        No tables.

    Raises
    ------
    InputError
        No such file, a bad one, or, once all that can be told was shown, a mechanism that cannot move as its poses say.

    """
    robot = load_robot(name, overrides)
    if out is not None:
        files.check_output(out, None if target in {None, "-"} else target)
    found = inspect_robot(robot)
    if not quiet and target != "-":
        show_check(found)
    if out is not None:
        _write(found, out, overrides)
    if target is not None:
        files.write_json(target, inspection_json(found))
    if found.error:
        raise InputError(found.error)


def _write(found: Inspection, out: Path, overrides: Sequence[str]) -> None:
    path = found.robot.path
    with files.staged_folder(out) as folder:
        files.write_json(folder / "check.json", inspection_json(found))
        try:
            _draw(found, folder)
        except PictureError as error:
            log.warning("%s", error)
        Manifest(sys.argv[1:], str(path), file_digest(path), list(overrides)).write(folder)


def _draw(found: Inspection, folder: Path) -> None:
    """The robot at home and at every named pose that it reaches."""
    if found.configurations is None:
        return
    pictures = []
    for k, pose in enumerate(found.poses):
        if pose.reached:
            moved = moves(found.mechanism, found.configurations, k)
            title = f"{found.robot.name} at {pose.name}: {pose_text(found.mechanism, pose.tool)}"
            pictures.append(picture(f"robot_{pose.name}.png", title, moved))
    draw("robot", folder, pictures=pictures, **scene(found.robot, found.mechanism))

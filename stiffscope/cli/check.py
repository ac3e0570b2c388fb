"""`stiffscope check`: what a robot file says, what it can do, and pictures of it; without any virtual experiment."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.errors import InputError
from stiffscope.experiments.manifest import manifest_of
from stiffscope.runtime import files

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.robot.inspection import Inspection

log = logging.getLogger(__name__)


@click.command()
@takes(
    options.robot,
    options.overrides,
    options.folder("--out", "Folder to write: report, pictures at home and at every named pose, and check.json."),
    options.target,
)
def check(name: str, *, overrides: tuple[str, ...], out: Path | None, target: str | None, quiet: bool) -> None:
    """What a robot file says: bodies, joints, mobility, masses, drives, reach, poses; no experiment is made.

    All that can be told is shown before a mechanism that cannot move as its poses say is refused.
    """
    from stiffscope.report.check_tables import show_check
    from stiffscope.robot.inspection import inspect_robot, inspection_json
    from stiffscope.robot.reader import load_robot

    robot = load_robot(name, overrides)
    if out is not None:
        files.check_output(out, target)
    found = inspect_robot(robot)
    if not quiet and target != "-":
        show_check(found)
    if out is not None:
        _write(found, out)
    if target is not None:
        files.write_json(target, inspection_json(found))
    if found.error:
        raise InputError(found.error)


def _write(found: Inspection, out: Path) -> None:
    from stiffscope.report.check_tables import show_check
    from stiffscope.report.pictures import PictureError
    from stiffscope.report.run_report import write_check_report
    from stiffscope.report.terminal import recorded
    from stiffscope.robot.inspection import inspection_json

    manifest = manifest_of(found.robot)
    with files.staged_folder(out) as folder:
        files.write_json(folder / "check.json", inspection_json(found))
        try:
            _draw(found, folder)
        except PictureError as error:
            log.warning("%s", error)
        manifest.write(folder)
        with recorded() as shown:
            show_check(found)
        write_check_report(folder, found, shown)


def _draw(found: Inspection, folder: Path) -> None:
    """The robot at home and at every named pose that it reaches."""
    from stiffscope.report.pictures import draw
    from stiffscope.report.robot_scene import moves, picture, pose_text, scene
    from stiffscope.report.run_report import GEOMETRY

    if found.configurations is None:
        return
    pictures = []
    for k, pose in enumerate(found.poses):
        if pose.reached:
            moved = moves(found.mechanism, found.configurations, k)
            title = f"{found.robot.name} at {pose.name}: {pose_text(found.mechanism, pose.tool)}"
            pictures.append(picture(f"robot_{pose.name}.png", title, moved))
    if pictures:
        draw("robot", folder, pictures=pictures, geometry=GEOMETRY, **scene(found.robot, found.mechanism))

"""The designer's command: what a part and a robot gain by each of their parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from stiffscope import files
from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.errors import InputError
from stiffscope.jobs.manifest import manifest_of

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.jobs.manifest import Manifest
    from stiffscope.robot.description import RobotFile


@click.command()
@takes(options.robot, options.part, options.poses, options.components, options.overrides, options.target)
@options.folder("--out", "Folder to write: bar chart and numbers (JSON), complete or absent.")
def sensitivity(
    name: str, part: str | None, *, poses: tuple[str, ...], components: Any, overrides: tuple[str, ...],
    target: str | None, out: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """What changes the stiffness most: derivatives by dimensions, materials, drives, bearings and masses.

    Of the robot's stiffness, sag and first frequency at tool poses, by default those of the robot file; with --part of
    one part's compliance, own weight and mass. Largest first, with error bars and per kilogram; tolerances of the robot
    file ("20 mm ± 0.1 mm") give the scatter of the robot.
    """
    from stiffscope.robot.reader import load_robot

    if part and (poses or components):
        raise InputError(f"--part {part}: expected neither --at nor --components with it, which are of the robot")
    robot = load_robot(name, overrides)
    if out is not None:
        files.check_output(out, target)
    manifest = manifest_of(robot)
    work = _of_part if part else _of_robot
    shown = not quiet and target != "-"
    work(robot, part or "", poses, components, target, out, manifest, quiet=quiet, shown=shown)
    if shown and out is not None:
        from stiffscope.report import tables

        tables.show_line(f"Written to {out}")


def _of_part(
    robot: RobotFile, part: str, _poses: Any, _components: Any, target: str | None, out: Path | None,
    manifest: Manifest, *, quiet: bool, shown: bool,
) -> None:  # fmt: skip
    from stiffscope.cli.showing import shown_workshop, warn_of
    from stiffscope.jobs.experiments import solve_parts
    from stiffscope.jobs.orders import order_part
    from stiffscope.jobs.sensitivities import part_sensitivities
    from stiffscope.report import sensitivities as report

    order = order_part(robot, part)
    with shown_workshop(quiet=quiet) as shop:
        (result,) = solve_parts([order], shop)
        (found,) = part_sensitivities([order], shop)
        warn_of([result])
        if out is not None:
            with files.staged_folder(out) as folder:
                report.write_part_chart(found, result, folder)
                files.write_json(folder / "sensitivity.json", report.part_json(found, result))
                manifest.write(folder)
    if target:
        files.write_json(target, report.part_json(found, result))
    if shown:
        report.show_part_sensitivity(found, result)


def _of_robot(
    robot: RobotFile, _part: str, poses: tuple[str, ...], components: Any, target: str | None, out: Path | None,
    manifest: Manifest, *, quiet: bool, shown: bool,
) -> None:  # fmt: skip
    from stiffscope.cli.poses import asked_poses
    from stiffscope.cli.showing import shown_workshop
    from stiffscope.jobs.sensitivities import robot_sensitivities
    from stiffscope.report import sensitivities as report

    asked = asked_poses(robot, poses, ())
    with shown_workshop(quiet=quiet) as shop:
        found = robot_sensitivities(robot, asked.configurations.poses, components, shop)
    if out is not None:
        with files.staged_folder(out) as folder:
            report.write_chart(found, asked.names, folder)
            files.write_json(folder / "sensitivity.json", report.robot_json(found))
            manifest.write(folder)
    if target:
        files.write_json(target, report.robot_json(found))
    if shown:
        report.show_sensitivity(found, asked.names)

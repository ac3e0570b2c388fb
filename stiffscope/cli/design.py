"""The designer's commands: what a robot gains by each of its parameters, and studies of many designs."""

from __future__ import annotations

import logging
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.errors import InputError
from stiffscope.experiments.manifest import manifest_of
from stiffscope.runtime import files
from stiffscope.runtime.processors import processors

if TYPE_CHECKING:
    from stiffscope.design.studies import Study
    from stiffscope.experiments.manifest import Manifest
    from stiffscope.robot.file.description import RobotFile


@click.command()
@takes(options.robot, options.part, options.poses, options.components, options.overrides, options.target)
@options.folder("--out", "Folder to write: report, bar chart and numbers (JSON), complete or absent.")
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
    from stiffscope.design.sensitivities import part_sensitivities
    from stiffscope.experiments.experiments import solve_parts
    from stiffscope.experiments.orders import order_part
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
                report.write_part_page(found, result, folder, robot.name)
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
    from stiffscope.design.sensitivities import robot_sensitivities
    from stiffscope.report import sensitivities as report

    asked = asked_poses(robot, poses, ())
    with shown_workshop(quiet=quiet) as shop:
        found = robot_sensitivities(robot, asked.configurations.poses, components, shop)
    if out is not None:
        with files.staged_folder(out) as folder:
            report.write_chart(found, asked.names, folder)
            files.write_json(folder / "sensitivity.json", report.robot_json(found))
            manifest.write(folder)
            report.write_page(found, asked.names, folder)
    if target:
        files.write_json(target, report.robot_json(found))
    if shown:
        report.show_sensitivity(found, asked.names)


log = logging.getLogger(__name__)

MOST_FILES = 10  # robot files of the best designs
DESIGNS = "designs"


@click.command()
@takes(click.argument("name", metavar="STUDY", type=click.Path(path_type=Path)), options.out, options.target)
@options.scheduler
def study(name: Path, out: Path, *, target: str | None, scheduler: str | None, quiet: bool) -> None:
    """Many designs of a robot: a sweep, an optimum under constraints, or a Pareto front.

    STUDY is a TOML file: robot, ranges of parameters, responses, constraints, objectives. Every finished design is
    stored in DIR.designs until all are: the same command goes on where it was interrupted, and takes up those of DIR.
    """
    from stiffscope.design.studies import run_study
    from stiffscope.design.study_file import load_study
    from stiffscope.report import studies as report
    from stiffscope.report import tables
    from stiffscope.report.progress import progress

    files.check_output(out, target)
    file = load_study(name)
    manifest = manifest_of(file.robot, file.path)
    store = out.with_name(f"{out.name}.{DESIGNS}")
    if (out / DESIGNS).is_dir() and not store.exists():
        shutil.copytree(out / DESIGNS, store)
    with progress(quiet=quiet) as open_line:
        made = run_study(file, store, open_line("study"), workers=processors(), scheduler=scheduler)
    with files.staged_folder(out) as folder:
        files.copy_files(store, folder / DESIGNS, [each.name for each in sorted(store.glob("*.parquet"))])
        report.write_study(made, folder)
        _write_robots(made, folder, out)
        manifest.write(folder)
        report.write_study_page(made, folder)
    if not files.remove_copied(store, out, f"{DESIGNS}/"):
        log.warning("%s: holds files that are no designs of this study; they stay there", store)
    if target:
        files.write_json(target, report.study_json(made))
    if not quiet and target != "-":
        report.show_study(made)
        tables.show_line(f"Written to {out} in {manifest.elapsed():.0f} s")


def _write_robots(made: Study, folder: Path, out: Path) -> None:
    """Robot files of the best designs, best-1.toml and on; of a long front some along it."""
    import numpy as np
    import tomlkit

    from stiffscope.experiments.robot_files import robot_document

    if not made.file.goals:
        return
    chosen = np.unique(np.linspace(0, len(made.best) - 1, min(MOST_FILES, len(made.best))).round().astype(int))
    for number, index in enumerate((made.best[k] for k in chosen), 1):
        file = f"best-{number}.toml"
        text = tomlkit.dumps(robot_document(made.robot(index), out / file, made.file.components))
        (folder / file).write_text(f"# Design {index + 1} of {made.file.path.name}\n{text}", encoding="utf-8")

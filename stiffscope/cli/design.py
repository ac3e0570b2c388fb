"""The designer's commands: what a robot gains by each of its parameters, and studies of many designs."""

from __future__ import annotations

import logging
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
import tomlkit

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.cli.output import emit, open_workshop, warn_of
from stiffscope.cli.poses import find_poses
from stiffscope.design.sensitivities import part_sensitivities, robot_sensitivities
from stiffscope.design.studies import run_study
from stiffscope.design.study_file import load_study
from stiffscope.errors import InputError
from stiffscope.experiments.experiments import solve_parts
from stiffscope.experiments.manifest import manifest_of
from stiffscope.experiments.orders import order_part
from stiffscope.experiments.robot_files import robot_document
from stiffscope.report import sensitivities as report
from stiffscope.report import studies as study_report
from stiffscope.report.progress import progress
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.output import copy_files, remove_copied
from stiffscope.runtime.processors import processors

if TYPE_CHECKING:
    from stiffscope.cli.output import Output
    from stiffscope.design.studies import Study
    from stiffscope.experiments.manifest import Manifest
    from stiffscope.robot.file.description import RobotFile

log = logging.getLogger(__name__)

MOST_FILES = 10  # robot files of the best designs
DESIGNS = "designs"


@click.command()
@takes(options.robot, options.part, options.poses, options.components, options.overrides, options.json)
@options.folder("--out", "Folder to write: report, bar chart and numbers (JSON), complete or absent.")
def sensitivity(
    name: str, part: str | None, *, poses: tuple[str, ...], components: Any, overrides: tuple[str, ...], output: Output
) -> None:
    """Rank the parameters by what they change of the stiffness.

    Derivatives by dimensions, materials, drives, bearings and masses, with error bars and per kilogram: of the robot's
    stiffness, sag and first frequency at tool poses (by default those of the robot file), or with --part of one part's
    compliance, sag and mass. Tolerances in the robot file ("20 mm ± 0.1 mm") give the scatter of the robot.
    """
    if part and (poses or components):
        raise InputError(f"--part {part}: expected neither --at nor --components with it, which are of the robot")
    robot = load_robot(name, overrides)
    manifest = manifest_of(robot)
    if part:
        _emit_part(robot, part, output, manifest)
    else:
        _emit_robot(robot, poses, components, output, manifest)


def _emit_part(robot: RobotFile, part: str, output: Output, manifest: Manifest) -> None:
    order = order_part(robot, part)
    with open_workshop(output) as shop:
        (result,) = solve_parts([order], shop)
        (found,) = part_sensitivities([order], shop)
    warn_of([result])
    emit(
        output, report.part_json(found, result), lambda: report.show_part_sensitivity(found, result),
        manifest=manifest, fill=lambda folder: report.write_part_chart(found, result, folder),
        page=lambda folder, shown: report.write_part_page(found, folder, robot.name, shown), kept="sensitivity.json",
    )  # fmt: skip


def _emit_robot(robot: RobotFile, poses: tuple[str, ...], components: Any, output: Output, manifest: Manifest) -> None:
    asked = find_poses(robot, poses, ())
    with open_workshop(output) as shop:
        found = robot_sensitivities(robot, asked.configurations.poses, components, shop)
    emit(
        output, report.robot_json(found), lambda: report.show_sensitivity(found, asked.names),
        manifest=manifest, fill=lambda folder: report.write_chart(found, asked.names, folder),
        page=lambda folder, shown: report.write_page(found, asked.names, folder, shown), kept="sensitivity.json",
    )  # fmt: skip


@click.command()
@takes(click.argument("name", metavar="STUDY", type=click.Path(path_type=Path)), options.out, options.json)
@options.scheduler
def study(name: Path, *, scheduler: str | None, output: Output) -> None:
    """Evaluate many designs: a sweep, an optimum under constraints, a Pareto front.

    STUDY is a TOML file: robot, ranges of parameters, responses, constraints, objectives. Finished designs are stored
    in DIR.designs until all are done: the same command resumes an interrupted study, and reuses the designs of DIR.
    """
    out = output.required_folder()
    file = load_study(name)
    manifest = manifest_of(file.robot, file.path)
    store = out.with_name(f"{out.name}.{DESIGNS}")
    if (out / DESIGNS).is_dir() and not store.exists():
        shutil.copytree(out / DESIGNS, store)
    with progress(quiet=output.quiet) as open_line:
        made = run_study(file, store, open_line("study"), workers=processors(), scheduler=scheduler)

    def fill(folder: Path) -> None:
        copy_files(store, folder / DESIGNS, [each.name for each in sorted(store.glob("*.parquet"))])
        study_report.write_study(made, folder)
        _write_robots(made, folder, out)

    emit(
        output, study_report.study_json(made), lambda: study_report.show_study(made), manifest=manifest, fill=fill,
        page=lambda folder, shown: study_report.write_study_page(made, folder, shown),
    )  # fmt: skip
    if not remove_copied(store, out, f"{DESIGNS}/"):
        log.warning("%s: holds files that are no designs of this study; they stay there", store)


def _write_robots(made: Study, folder: Path, out: Path) -> None:
    """Robot files of the best designs, best-1.toml and on; of a long front some along it."""
    if not made.file.goals:
        return
    chosen = np.unique(np.linspace(0, len(made.best) - 1, min(MOST_FILES, len(made.best))).round().astype(int))
    for number, index in enumerate((made.best[k] for k in chosen), 1):
        file = f"best-{number}.toml"
        text = tomlkit.dumps(robot_document(made.robot(index), out / file, made.file.components))
        (folder / file).write_text(f"# Design {index + 1} of {made.file.path.name}\n{text}", encoding="utf-8")

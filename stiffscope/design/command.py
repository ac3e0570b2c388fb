"""Commands for design: sensitivities to the parameters, and studies of many designs."""

from __future__ import annotations

import logging
import re
import shutil
from functools import partial
from typing import TYPE_CHECKING, Any

import click
import tomlkit

from stiffscope.cli import options
from stiffscope.cli.main import Stopped
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit, open_workshop, warn_of_parts
from stiffscope.cli.poses import find_poses
from stiffscope.design.making import SUFFIX, Journal
from stiffscope.design.sensitivities import part_sensitivities, robot_sensitivities
from stiffscope.design.show import sensitivities as report
from stiffscope.design.show import studies as study_report
from stiffscope.design.studies import WHOLE, find_study, merge_study, run_study
from stiffscope.design.study_reading import load_study
from stiffscope.errors import require, require_given
from stiffscope.experiments.experiments import solve_parts
from stiffscope.experiments.manifest import manifest_of
from stiffscope.experiments.orders import order_part
from stiffscope.experiments.robot_files import robot_document
from stiffscope.path.course import pick_evenly
from stiffscope.report.figures import save_figures
from stiffscope.report.progress import progress
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.output import remove_copied
from stiffscope.runtime.processors import processors

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.cli.output import Output
    from stiffscope.design.studies import Study
    from stiffscope.experiments.manifest import Manifest

log = logging.getLogger(__name__)

MOST_FILES = 10  # most robot files written for the best designs
DESIGNS = "designs"


@click.command()
@takes(
    options.robot,
    options.part,
    options.poses,
    options.components,
    options.overrides,
    options.json,
)
@options.folder("--out", "report, bar chart and numbers (JSON), complete or absent.")
def sensitivity(
    name: str,
    part: str | None,
    *,
    poses: Texts,
    components: Any,
    overrides: Texts,
    output: Output,
) -> None:
    """Rank the parameters by their effect on the stiffness.

    Derivatives by dimensions, materials, drives, bearings and masses, with error bars and per
    kilogram: of the robot's stiffness, sag and first frequency at tool poses (by default those of
    the robot file), or with --part of one part's compliance, sag and mass. Tolerances in the robot
    file ("20 mm ± 0.1 mm") give the scatter of the robot.
    """
    alone = "neither --at nor --components with it, which are of the robot"
    require(part is None or not (poses or components), f"--part {part}", alone)
    robot = load_robot(name, overrides)
    manifest = manifest_of(robot)
    if part is not None:
        order = order_part(robot, part)
        with open_workshop(output) as shop:
            (result,) = solve_parts([order], shop)
            (sensitivities,) = part_sensitivities([order], shop)
        warn_of_parts([result])
        answer = report.part_json(sensitivities, result)
        show = partial(report.show_part_sensitivity, sensitivities, result)
        draw = partial(report.draw_part, sensitivities, result)
        title = f"{robot.name}: what changes the {sensitivities.part}'s compliance"
        words = "bars of what changes each diagonal entry of the compliance, % per %, with bounds"
    else:
        asked = find_poses(robot, poses, ())
        with open_workshop(output) as shop:
            of_robot = robot_sensitivities(
                robot, asked.configurations.poses, components, shop
            )
        pose = asked.names[0]
        answer = report.robot_json(of_robot)
        show = partial(report.show_sensitivity, of_robot, asked.names)
        draw = partial(report.draw_robot, of_robot, pose)
        title = f"{robot.name}: what changes its stiffness"
        words = f"bars of what changes K_tx at {pose}, in % per % and % per kilogram, with bounds"
    emit(
        output,
        answer,
        show,
        manifest=manifest,
        kept="sensitivity.json",
        fill=lambda folder: save_figures(folder, {"sensitivity": draw}),
        page=lambda page: report.write_page(page, title, words),
    )


@click.command()
@takes(
    click.argument(
        "names",
        metavar="STUDY | merge DIR...",
        nargs=-1,
        required=True,
        type=options.PATH,
    ),
    options.out,
    options.json,
)
@options.scheduler
@click.option(
    "--part", metavar="I/N", help="Share I of N of a sweep; study merge joins them."
)
def study(
    names: tuple[Path, ...], *, scheduler: str | None, part: str | None, output: Output
) -> None:
    """Evaluate many designs: a sweep, an optimum under constraints, a Pareto front.

    STUDY is a TOML file: robot, ranges of parameters, responses, constraints, objectives. Finished
    designs are stored in DIR.designs until all are done: the same command resumes an interrupted
    study, and reuses the designs of DIR.

    study merge DIR... joins the output folders of shares that were made with --part.
    """
    out = output.required_folder()
    if str(names[0]) == "merge":
        _merge(names[1:], output)
        return
    require(len(names) == 1, names[-1], "one study's file", len(names))
    share = _read_part(part)
    file = load_study(names[0])
    manifest = manifest_of(file.robot, file.path)
    store = out.with_name(f"{out.name}.{DESIGNS}")
    if (out / DESIGNS).is_dir() and not store.exists():
        shutil.copytree(out / DESIGNS, store)
    try:
        on: Any = {"workers": processors(), "scheduler": scheduler}
        with progress(quiet=output.quiet) as open_line:
            result = run_study(
                file, store, open_line("study"), **on, part=share or WHOLE
            )
    except (KeyboardInterrupt, Stopped) as error:
        count = Journal(file, store).count()
        if not count:
            raise
        progress_note = f"{count} finished designs are kept in {store}"
        raise Stopped(f"stopped; {progress_note}, the same command goes on") from error
    _emit_study(result, output, manifest, [store])
    if not remove_copied(store, out, f"{DESIGNS}/"):
        log.warning("%s: holds files that %s does not; they stay there", store, out)
    reason = result.designs.reasons.get(0, "")
    require(
        share is not None or not result.outcomes.failed.all(),
        file.path,
        "a design that can be computed",
        f"none; the first: {reason}",
    )


def _read_part(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
    match = require_given(match, "--part", "I/N such as 3/20", text)
    return int(match[1]), int(match[2])


def _merge(places: tuple[Path, ...], output: Output) -> None:
    """Join shares from their output folders; the study's file may be given first."""
    given = [path for path in places[:1] if path.is_file()]
    folders = places[len(given) :]
    require(folders, "study merge", "output folders of shares", "none")
    shares = [folder / DESIGNS for folder in folders]
    file = load_study(given[0] if given else find_study(shares))
    manifest = manifest_of(file.robot, file.path)
    _emit_study(merge_study(file, shares), output, manifest, shares)


def _emit_study(
    completed: Study, output: Output, manifest: Manifest, stores: Sequence[Path]
) -> None:
    def fill(folder: Path) -> None:
        (folder / DESIGNS).mkdir()
        for store in stores:
            for journal in sorted(store.glob(f"*{SUFFIX}")):
                with (folder / DESIGNS / journal.name).open("ab") as target:
                    target.write(journal.read_bytes())
        study_report.write_study(completed, folder)
        _write_robots(completed, folder, output.required_folder())

    emit(
        output,
        partial(study_report.study_json, completed),
        partial(study_report.show_study, completed),
        manifest=manifest,
        fill=fill,
        page=partial(study_report.write_study_page, completed),
    )


def _write_robots(completed: Study, folder: Path, out: Path) -> None:
    """Write robot files of the best designs, best-1.toml etc.; of a long front only a selection."""
    if not completed.file.goals:
        return
    for number, k in enumerate(pick_evenly(len(completed.best), MOST_FILES), 1):
        index = completed.best[k]
        file = f"best-{number}.toml"
        head = f"# Design {index + 1} of {completed.file.path.name}\n"
        text = tomlkit.dumps(
            robot_document(
                completed.robot(index), out / file, completed.file.components
            )
        )
        (folder / file).write_text(head + text, encoding="utf-8")

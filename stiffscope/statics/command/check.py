"""`stiffscope check`: contents of a robot file, its mobility and pictures, without experiments."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import check_solids
from stiffscope.experiments.manifest import manifest_of
from stiffscope.gap.effects.vocabulary import check_effects
from stiffscope.report.kept_pictures import draw_inspection
from stiffscope.report.pictures import open_drawing
from stiffscope.report.run_report import write_check_report
from stiffscope.robot.inspection import inspect_robot, inspection_json
from stiffscope.robot.reader import load_robot
from stiffscope.statics.show.check import show_check

if TYPE_CHECKING:
    from stiffscope.cli.output import Output


@click.command()
@takes(
    options.robot,
    options.overrides,
    options.folder(
        "--out", "report, pictures at home and at every named pose, and check.json."
    ),
    options.json,
)
def check(name: str, *, overrides: Texts, output: Output) -> None:
    """Report what a robot file describes, without virtual experiments.

    Bodies, joints, mobility, masses, drives, reach and poses are shown, even if the mechanism is
    then refused because it cannot move as its poses command.
    """
    robot = load_robot(name, overrides)
    with open_drawing(ahead=output.folder is not None) as draw_now:
        inspection = inspect_robot(robot)
        parts = {}
        try:
            check_effects(robot)
            parts = check_solids(robot)
        except InputError as error:
            inspection = replace(inspection, error=inspection.error or str(error))
        emit(
            output,
            inspection_json(inspection),
            lambda: show_check(inspection),
            manifest=manifest_of(robot),
            fill=lambda folder: draw_inspection(inspection, folder, parts, draw_now),
            page=lambda report: write_check_report(report, inspection),
            kept="check.json",
        )
    if inspection.error:
        raise InputError(inspection.error)

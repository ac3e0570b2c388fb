"""`stiffscope path`: error of the tool along a path under process forces."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.cli.output import emit
from stiffscope.experiments.manifest import manifest_of
from stiffscope.path import show as paths
from stiffscope.path.along import along, compensate, respond_at_worst
from stiffscope.path.job import load_job
from stiffscope.path.stress import find_stresses
from stiffscope.report.kept_pictures import draw_deflection
from stiffscope.report.progress import progress
from stiffscope.report.robot_view import read_cases
from stiffscope.runtime.formats import write_table
from stiffscope.statics.command.poses import assemble

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.cli.output import Output


@click.command()
@takes(
    click.argument("name", metavar="JOB", type=options.PATH), options.out, options.json
)
@click.option(
    "--compensate",
    "undo",
    is_flag=True,
    help="Also write commands with which the loaded tool is where it should be.",
)
@click.option(
    "--robot", metavar="FILE", help="An adopted robot to use instead of the job's."
)
def path(name: Path, *, undo: bool, robot: str | None, output: Output) -> None:
    """Error of the tool along a path under process forces.

    JOB is a TOML file: robot, path (a table or G-code), process. The folder has path.csv, figures
    and a report, and with --compensate the compensated path in the format that came in.
    """
    job = load_job(name, robot)
    manifest = manifest_of(job.robot, job.file)
    assembled = assemble(job.robot, job.section.components, output)
    with progress(quiet=output.quiet) as open_line:
        report = open_line("path")
        state = along(job, assembled, report)
        after = compensate(assembled, state, report) if undo else None
    worst, response = respond_at_worst(state, assembled)
    stresses = find_stresses(state, assembled, response)
    cases = read_cases(response, {"the loads there": state.wrench[state.worst]})

    def fill(folder: Path) -> None:
        write_table(paths.path_columns(state), folder / "path")
        if after is not None:
            suffix = job.path_file.suffix if after.path.program else ".csv"
            after.path.write(folder / f"compensated{suffix}")
        paths.draw_path(state, after, folder)
        draw_deflection(assembled, ["greatest error"], worst, cases, folder)
        paths.write_stress(stresses, folder)

    results = state, after, stresses
    emit(
        output,
        partial(paths.path_json, *results),
        partial(paths.show_path, *results),
        manifest=manifest,
        fill=fill,
        page=lambda report: paths.write_path_page(report, state, after, worst, cases),
    )

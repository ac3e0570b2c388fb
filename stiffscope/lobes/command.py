"""`stiffscope lobes`: depths of cut that stay stable, over speed and along a path."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit
from stiffscope.cli.poses import find_poses
from stiffscope.experiments.manifest import manifest_of
from stiffscope.lobes import show
from stiffscope.lobes.chatter import check_cut, find_lobes
from stiffscope.lobes.damping import lobes_section
from stiffscope.lobes.workspace import POINTS, map_depth
from stiffscope.path.job import load_job
from stiffscope.report.progress import progress
from stiffscope.report.run_report import write_map_report
from stiffscope.runtime.threads import one_thread
from stiffscope.statics.command.poses import assemble
from stiffscope.statics.maps import require_map, to_dataset

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.cli.output import Output


@click.command()
@takes(
    click.argument("name", metavar="JOB", type=options.PATH),
    click.option(
        "--at",
        "poses",
        multiple=True,
        metavar="POSE",
        help="Pose of the lobes: a name of the robot file, or coordinates. May be repeated; "
        "by default those of [lobes] poses, else points of the path.",
    ),
    options.out,
    options.json,
)
@click.option(
    "--map",
    "mapped",
    is_flag=True,
    help="Instead, the critical depth over [map] of the robot file, fed along the job's x.",
)
@options.count("--points", POINTS, "With --map: poses along each coordinate.", 2, 400)
@click.option(
    "--robot", metavar="FILE", help="An adopted robot to use instead of the job's."
)
def lobes(
    name: Path,
    *,
    poses: Texts,
    mapped: bool,
    points: int,
    robot: str | None,
    output: Output,
) -> None:
    """Depths of cut that stay stable over the spindle's speed, along a path.

    JOB is a TOML file as for `stiffscope path`, with [process.milling] or [process.turning], and
    [lobes]. The folder has the lobes with their bands, the path coloured by its margin, tables and a
    report; with --map, a map of the depth that is stable at all speeds.
    """
    job = load_job(name, robot)
    check_cut(job)
    if mapped:
        require_map(job.robot)
    names = poses or lobes_section(job).poses
    asked = find_poses(job.robot, names, ()) if names else None
    manifest = manifest_of(job.robot, job.file)
    assembled = assemble(job.robot, job.section.components, output)
    if mapped:
        with progress(quiet=output.quiet) as open_line, one_thread():
            swept = map_depth(job, assembled, points, open_line("map"))
        emit(
            output,
            lambda: to_dataset(swept).to_dict(),
            partial(show.show_map, swept),
            manifest=manifest,
            fill=partial(show.write_depth_map, job, swept),
            page=lambda report: write_map_report(report, assembled, show.MAP_TITLES),
        )
        return
    at = None if asked is None else (asked.names, asked.configurations)
    with progress(quiet=output.quiet) as open_line, one_thread():
        found = find_lobes(job, assembled, at, open_line("lobes"))
    emit(
        output,
        partial(show.lobes_json, found),
        partial(show.show_lobes, found),
        manifest=manifest,
        fill=partial(show.write_lobes, found),
        page=partial(show.write_lobes_page, found),
        kept="lobes.json",
    )

"""`stiffscope lobes`: depths of cut that stay stable, over speed and along a path."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import click
from threadpoolctl import threadpool_limits

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit
from stiffscope.cli.poses import find_poses
from stiffscope.experiments.manifest import manifest_of
from stiffscope.lobes import show
from stiffscope.lobes.chatter import check_cut, find_lobes
from stiffscope.lobes.damping import lobes_section
from stiffscope.path.job import load_job
from stiffscope.report.progress import progress
from stiffscope.statics.command.poses import assemble

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
    "--robot", metavar="FILE", help="An adopted robot to use instead of the job's."
)
def lobes(name: Path, *, poses: Texts, robot: str | None, output: Output) -> None:
    """Depths of cut that stay stable over the spindle's speed, along a path.

    JOB is a TOML file as for `stiffscope path`, with [process.milling] and [lobes]. The folder has
    the lobes with their bands, the path coloured by its margin, tables and a report.
    """
    job = load_job(name, robot)
    check_cut(job)
    names = poses or lobes_section(job).poses
    asked = find_poses(job.robot, names, ()) if names else None
    manifest = manifest_of(job.robot, job.file)
    made = assemble(job.robot, job.section.components, output)
    at = None if asked is None else (asked.names, asked.configurations)
    with progress(quiet=output.quiet) as open_line, threadpool_limits(1):
        found = find_lobes(job, made, at, open_line("lobes"))
    emit(
        output,
        partial(show.lobes_json, found),
        partial(show.show_lobes, found),
        manifest=manifest,
        fill=partial(show.write_lobes, found),
        page=partial(show.write_lobes_page, found),
        kept="lobes.json",
    )

"""The commands on a whole robot at some poses or over its workspace: stiffness, deflection, map."""

from __future__ import annotations

import dataclasses
import logging
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import click

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.errors import InputError
from stiffscope.experiments.manifest import manifest_of
from stiffscope.runtime import files

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.vjm.kinematics import Configurations
    from stiffscope.vjm.statics import Stiffness

log = logging.getLogger(__name__)


@click.command()
@takes(
    *(options.robot, options.poses, options.joints, options.components, options.gravity(None)),
    *(options.overrides, options.target),
)
@options.folder(
    "--superelement",
    "Folder to write: stiffness and mass condensed on the tool at each pose (npz, .mtx, DMIG), complete or absent.",
)
def stiffness(
    name: str, *, poses: tuple[str, ...], joints: tuple[str, ...], components: Any, gravity: str | None,
    overrides: tuple[str, ...], target: str | None, superelement: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """The robot's 6x6 stiffness at tool poses, and its sag.

    Without --at and --joints, at the poses of the robot file.
    """
    from stiffscope.biglide.literal_gravity import require_biglide
    from stiffscope.cli.poses import asked_poses
    from stiffscope.cli.showing import shown_assembly
    from stiffscope.experiments.assembly import stiffness_bars, stiffness_json
    from stiffscope.experiments.superelements import write_robot
    from stiffscope.report import tables
    from stiffscope.robot.reader import load_robot

    robot = load_robot(name, overrides)
    asked = asked_poses(robot, poses, joints)
    gravity = gravity or ("exact" if robot.carries("gravity") else "none")
    if gravity == "literal":
        require_biglide(asked.configurations.mechanism)
    if superelement:
        files.check_output(superelement, target)
    manifest = manifest_of(robot)
    assembled = shown_assembly(robot, components, quiet=quiet)
    state = _state(assembled, asked.configurations, gravity)
    bars = stiffness_bars(assembled, state.configurations)
    if superelement:
        write_robot(assembled, asked.names, asked.configurations, superelement, manifest)
    if target:
        files.write_json(target, stiffness_json(state, bars))
    _warn_of_singular(asked.names, state)
    if not quiet and target != "-":
        title = f"Stiffness at M ({made_of(assembled)}; gravity {gravity})"
        tables.show_stiffness(asked.names, state, bars, title=title)
        if superelement:
            tables.show_line(f"Superelement written to {superelement}")


@click.command()
@takes(options.robot, options.poses, options.joints, options.components, options.overrides, options.target)
@options.folder("--out", "Folder to write: report and pictures of the robot deformed, complete or absent.")
@click.option(
    "--wrench", required=True, metavar="FX,FY,FZ,MX,MY,MZ",
    help='Wrench on the tool at M, axes {O}, in N and N·m or with units ("100 N,0,0,0,0,5 N*m").',
)  # fmt: skip
def deflection(
    name: str, *, poses: tuple[str, ...], joints: tuple[str, ...], components: Any, overrides: tuple[str, ...],
    target: str | None, out: Path | None, wrench: str, quiet: bool,
) -> None:  # fmt: skip
    """How far the tool yields under a wrench, and which element yields how much of it."""
    import numpy as np

    from stiffscope.cli.poses import asked_poses
    from stiffscope.cli.showing import shown_assembly
    from stiffscope.experiments.assembly import deflection_bars
    from stiffscope.report import tables
    from stiffscope.robot.file import quantities as q
    from stiffscope.robot.reader import load_robot
    from stiffscope.vjm.screws import CONVENTION
    from stiffscope.vjm.yielding import deflection as deflected

    robot = load_robot(name, overrides)
    asked = asked_poses(robot, poses, joints)
    try:
        load = np.array(q.several(wrench, *[q.FORCE] * 3, *[q.MOMENT] * 3))
    except ValueError as error:
        raise InputError(f'--wrench {wrench}: {error}; FX,FY,FZ,MX,MY,MZ such as "100 N,0,0,0,0,5 N*m"') from error
    if out is not None:
        files.check_output(out, target)
    manifest = manifest_of(robot)
    assembled = shown_assembly(robot, components, quiet=quiet)
    found = deflected(assembled.mechanism, asked.configurations, load)
    words = ",".join(f"{value:g}" for value in load)

    def show() -> None:
        error = deflection_bars(assembled, asked.configurations, found.twist)
        tables.show_deflection(asked.names, found.twist, found.shares, words, error)

    if out is not None:
        from stiffscope.report.kept_pictures import draw_deflection
        from stiffscope.report.robot_view import wrench_cases
        from stiffscope.report.run_report import write_deflection_report
        from stiffscope.report.terminal import recorded

        cases = wrench_cases(assembled.mechanism, asked.configurations, load, f"{words} N, N·m")
        with files.staged_folder(out) as folder:
            draw_deflection(assembled, asked.names, asked.configurations, cases, folder)
            manifest.write(folder)
            with recorded() as shown:
                show()
            write_deflection_report(folder, assembled, asked.names, asked.configurations, cases, shown)
    if target:
        at = {"poses": asked.configurations.poses, "tool": asked.configurations.tool}
        shares = {"energy": found.energy, "shares": found.shares}
        files.write_json(target, {**at, "wrench": load, "twist": found.twist, **shares, "convention": CONVENTION})
    if not quiet and target != "-":
        show()
        if out is not None:
            tables.show_line(f"Written to {out}")


@click.command("map")
@takes(options.robot, options.out, options.components, options.gravity("exact"), options.overrides, options.target)
@click.option(
    "--points", default=200, show_default=True, type=click.IntRange(2, 3000), help="Poses along either coordinate."
)
@click.option(
    "--frequencies", "count", default=0, type=click.IntRange(0, 12), metavar="N",
    help="Also the first N natural frequencies, drives held.",
)  # fmt: skip
def map_(
    name: str, out: Path, *, components: Any, gravity: Any, overrides: tuple[str, ...], target: str | None,
    points: int, count: int, quiet: bool,
) -> None:  # fmt: skip
    """Stiffness over what [map] of the robot file sweeps: figures, numbers, a report."""
    from stiffscope.cli.showing import shown_assembly
    from stiffscope.report import maps, tables
    from stiffscope.report.kept_pictures import draw_named_poses
    from stiffscope.report.run_report import write_map_report
    from stiffscope.robot.inspection import configured_poses, rigid_mechanism
    from stiffscope.robot.reader import load_robot

    robot = load_robot(name, overrides)
    if gravity == "literal":
        raise InputError("--gravity literal: expected none or exact for a map, got literal, which is for single poses")
    maps.swept(robot)
    moving = rigid_mechanism(robot)
    configured_poses(robot, moving, moving.tool.home)  # before any experiment
    files.check_output(out, target)
    manifest = manifest_of(robot)
    made = shown_assembly(robot, components, quiet=quiet)
    with files.staged_folder(out) as folder, ThreadPoolExecutor(1) as pool:
        drawn = pool.submit(draw_named_poses, made, folder)  # in a process of its own
        found = maps.robot_map(robot, made.mechanism, points, gravity, count)
        maps.write_map(found, folder, f"{robot.name}: stiffness over the workspace, gravity {gravity}")
        figures = _figures(gravity, maps.held_text(found), frequencies=bool(count))
        for title, stem, draw in figures:
            draw(found, robot.poses, f"{robot.name}: {title}", folder / f"{stem}.png", folder / f"{stem}.svg")
        drawn.result()
        manifest.write(folder)
        write_map_report(folder, made, {stem: title for title, stem, _ in figures})
    if target:
        files.write_json(target, maps.as_dataset(found).to_dict())
    if not quiet and target != "-":
        tables.show_line(f"Written to {out}")


def _state(assembled: Assembled, found: Configurations, gravity: str) -> Stiffness:
    """Stiffness, mobility and sag under a gravity of `--gravity`."""
    from stiffscope.vjm.statics import analyse, sag

    if gravity != "literal":
        return analyse(assembled.mechanism, found, gravity="exact" if gravity == "exact" else "none")
    from stiffscope.biglide.literal_gravity import literal_gravity

    matrix = literal_gravity(assembled.mechanism, found.poses)
    return dataclasses.replace(analyse(assembled.mechanism, found), matrix=matrix, sag=sag(assembled.mechanism, found))


def _warn_of_singular(names: Sequence[str], state: Stiffness) -> None:
    from stiffscope.vjm.singularity import singular_note

    for pose, matrix, sag in zip(names, state.matrix, state.sag, strict=True):
        if note := singular_note(matrix):
            log.warning("%s: %s", pose, note)
        elif any(value != value for value in sag):  # noqa: PLR0124 (NaN)
            log.warning("%s: its weight moves the tool too far for a linear answer; the stiffness is without it", pose)


def made_of(assembled: Assembled) -> str:
    """Where the parts' matrices come from, in a few words."""
    return ", ".join(f"{part} {source}" for part, source in assembled.sources.items()) or "rigid parts"


def _figures(gravity: str, held: str, *, frequencies: bool) -> list[tuple[str, str, Callable[..., None]]]:
    """Title, file and drawing function of each figure of a map."""
    from stiffscope.report import maps

    where = f", {held}" if held else ""
    figures = [(f"stiffness at M (diagonal of K){where}, gravity {gravity}", "map", maps.draw_stiffness)]
    if frequencies:
        figures.append((f"natural frequencies, drives held{where}", "frequencies", maps.draw_frequencies))
    if gravity != "none":
        figures.append((f"what gravity changes{where}", "gravity_difference", maps.draw_difference))
        figures.append((f"sag under its own weight{where}", "sag", maps.draw_sag))
    return figures

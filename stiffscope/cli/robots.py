"""The commands on a whole robot: stiffness, deflection, map, and the full run from CAD to pictures."""

from __future__ import annotations

import functools
import logging
import shutil
from typing import TYPE_CHECKING, Any

import click

from stiffscope import files
from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.errors import InputError
from stiffscope.jobs.manifest import manifest_of
from stiffscope.robot.robot_file import load_robot

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from stiffscope.jobs.assembly import Assembled
    from stiffscope.jobs.manifest import Manifest
    from stiffscope.robot.schema import RobotFile
    from stiffscope.vjm.analysis import Gravity, Stiffness

    Points = Mapping[str, Sequence[float]]

log = logging.getLogger(__name__)


@click.command()
@takes(options.robot, options.poses, options.components, options.gravity(None), options.overrides, options.target)
def stiffness(
    name: str, *, poses: tuple[str, ...], components: Any, gravity: Gravity | None, overrides: tuple[str, ...],
    target: str | None, quiet: bool,
) -> None:  # fmt: skip
    """The robot's 6x6 stiffness at tool points, and its sag.

    Without --at, at the poses of the robot file.
    """
    from stiffscope.jobs.assembly import stiffness_bars, stiffness_json
    from stiffscope.report import tables
    from stiffscope.vjm.analysis import analyse

    robot = load_robot(name, overrides)
    points = _tool_points(robot, poses)
    gravity = gravity or ("exact" if robot.carries("gravity") else "none")
    assembled = _assembled(robot, components, points, quiet=quiet)
    state = analyse(assembled.elastic, list(points.values()), gravity=gravity, g=robot.gravity.acceleration)
    bars = stiffness_bars(assembled, state.poses)
    if target:
        files.write_json(target, stiffness_json(state, bars))
    _warn_of_singular(points, state)
    if not quiet and target != "-":
        title = f"Stiffness at M ({_made_of(assembled)}; gravity {gravity})"
        tables.show_stiffness(list(points), state.poses, state.matrix, state.sag, bars, title=title)


@click.command()
@takes(options.robot, options.poses, options.components, options.overrides, options.target)
@click.option(
    "--wrench", required=True, metavar="FX,FY,FZ,MX,MY,MZ",
    help='Wrench on the platform at M, axes {O}, in N and N·m or with units ("100 N,0,0,0,0,5 N*m").',
)  # fmt: skip
def deflection(
    name: str, *, poses: tuple[str, ...], components: Any, overrides: tuple[str, ...], target: str | None,
    wrench: str, quiet: bool,
) -> None:  # fmt: skip
    """How far the tool yields under a wrench, and which part yields how much of it."""
    from stiffscope.jobs.assembly import deflection_bars
    from stiffscope.report import tables
    from stiffscope.robot import quantities as q
    from stiffscope.vjm.deflection import deflection as deflected

    robot = load_robot(name, overrides)
    points = _tool_points(robot, poses)
    try:
        load = q.several(wrench, *[q.FORCE] * 3, *[q.MOMENT] * 3)
    except ValueError as error:
        raise InputError(f'--wrench {wrench}: {error}; FX,FY,FZ,MX,MY,MZ such as "100 N,0,0,0,0,5 N*m"') from error
    assembled = _assembled(robot, components, points, quiet=quiet)
    found = deflected(assembled.elastic, list(points.values()), load)
    if target:
        shares = {"energy": found.energy, "shares": found.shares}
        files.write_json(target, {"poses": list(points.values()), "wrench": load, "twist": found.twist, **shares})
    if not quiet and target != "-":
        error = deflection_bars(assembled, list(points.values()), found.twist)
        tables.show_deflection(list(points), found.twist, found.shares, ",".join(f"{v:g}" for v in load), error)


@click.command("map")
@takes(options.robot, options.out, options.components, options.gravity("exact"), options.overrides)
@click.option(
    "--points", default=200, show_default=True, type=click.IntRange(2, 3000), help="Tool points along x and z."
)
def map_(
    name: str, out: Path, *, components: Any, gravity: Gravity, overrides: tuple[str, ...], points: int, quiet: bool
) -> None:
    """Stiffness over the workspace: figures and numbers."""
    from stiffscope.report import maps, tables

    robot = load_robot(name, overrides)
    files.check_output(out)
    manifest = manifest_of(robot)
    elastic = _assembled(robot, components, {}, quiet=quiet).elastic
    with files.staged_folder(out) as folder:
        found = maps.robot_maps(elastic, robot.poses, points, gravity, robot.gravity.acceleration)
        maps.write_map(found, folder, f"{robot.name}: stiffness over the workspace, gravity {gravity}")
        for title, stem, draw in _figures(gravity):
            draw(found, robot.poses, f"{robot.name}: {title}", folder / f"{stem}.png", folder / f"{stem}.svg")
        manifest.write(folder)
    if not quiet:
        tables.show_line(f"Written to {out}")


@click.command()
@takes(options.robot, options.out, options.components, options.tolerance, options.overrides)
def run(
    name: str, out: Path, *, components: Any, tolerance: str | None, overrides: tuple[str, ...], quiet: bool
) -> None:
    """The whole chain: parts, robot, tables, pictures.

    Builds the parts in CAD, meshes them, runs their virtual experiments, assembles the robot, and writes
    pictures, fields, matrices and a manifest to DIR. What was computed before is reused.
    """
    from stiffscope.cli.showing import shown_workshop, warn_of
    from stiffscope.jobs.assembly import assemble_robots, at_named_poses, check_reach
    from stiffscope.report import tables
    from stiffscope.report.kept_pictures import write_run_pictures

    robot = load_robot(name, overrides, tolerance)
    if not robot.poses:
        raise InputError(f'{robot.path}: has no poses; give one in [poses], such as Q1 = ["0 mm", "0 mm", "350 mm"]')
    check_reach(robot, robot.poses)
    files.check_output(out)
    robots = {"now": robot} | ({"before": load_robot(name, (), tolerance)} if overrides else {})
    manifest = manifest_of(robot)
    with shown_workshop(quiet=quiet) as shop, files.staged_folder(out) as folder:
        solved = assemble_robots(robots, components, shop)
        now = solved["now"]
        manifest.seconds["parts"] = manifest.elapsed()
        report = shop.open_line("robot")
        report("assembling", 0.2)
        states = {label: at_named_poses(each, robot.poses) for label, each in solved.items()}
        _write_parts(now, folder, manifest)
        _write_robot(now, states["now"], folder)
        report("pictures", 0.5)
        write_run_pictures(now, folder, shop.cache, manifest)
        manifest.seconds["robot"] = manifest.elapsed() - manifest.seconds["parts"]
        manifest.write(folder)
        report("done", 1.0)
    if quiet:
        warn_of(now.results.values())
    else:
        _show_run(now, states)
        tables.show_line(f"Written to {out} in {manifest.elapsed():.1f} s")


def _write_parts(assembled: Assembled, folder: Path, manifest: Manifest) -> None:
    """A folder for each part that was tested: numbers, fields, solid."""
    from stiffscope.jobs.results import EXPERIMENT, FIELDS, compliance_json

    for name, result in assembled.results.items():
        place = folder / name
        place.mkdir()
        files.write_json(place / "compliance.json", compliance_json(assembled.robot, result))
        for file in (EXPERIMENT, FIELDS, f"{name}.step", f"{name}.stl"):
            shutil.copyfile(result.folder / file, place / file)
        stages = result.experiment.seconds
        manifest.note(name, key=result.key, reused=result.reused, seconds=result.seconds, stages=stages)


def _write_robot(assembled: Assembled, state: Stiffness, folder: Path) -> None:
    """Matrices as JSON and npz, and the robot file as it was used."""
    import numpy as np

    from stiffscope.jobs.assembly import stiffness_bars, stiffness_json

    robot = assembled.robot
    names = {"names": list(robot.poses), "components": assembled.sources}
    bars = stiffness_bars(assembled, state.poses)
    files.write_json(folder / "stiffness.json", {**stiffness_json(state, bars), **names})
    matrices: dict[str, Any] = {f"{name}_compliance": matrix for name, matrix in assembled.matrices.items()}
    matrices |= {"poses": state.poses, "stiffness": state.matrix, "sag": state.sag}
    np.savez_compressed(folder / "matrices.npz", **matrices)
    files.write_json(folder / "robot.json", robot.model_dump(mode="json"))


def _show_run(now: Assembled, states: Mapping[str, Stiffness]) -> None:
    """The tables at the end of a run."""
    from stiffscope.cli.showing import show_compliance
    from stiffscope.report import tables

    if now.results:
        tables.show_parts(list(now.results.values()))
    for name, result in now.results.items():
        if now.sources[name] == "fea":
            show_compliance(now.robot, result)
    names, state = list(now.robot.poses), states["now"]
    tables.show_stiffness(names, state.poses, state.matrix, state.sag, title=f"Stiffness at M ({_made_of(now)})")
    if "before" in states:
        tables.show_change(names, states["before"].matrix, state.matrix, now.robot.overrides)


def _warn_of_singular(points: Points, state: Stiffness) -> None:
    from stiffscope.vjm.analysis import singular_note

    for pose, matrix, sag in zip(points, state.matrix, state.sag, strict=True):
        if note := singular_note(matrix):
            log.warning("%s: %s", pose, note)
        elif any(value != value for value in sag):  # noqa: PLR0124 (NaN)
            log.warning("%s: its weight moves the tool too far for a linear answer; the stiffness is without it", pose)


def _made_of(assembled: Assembled) -> str:
    return ", ".join(f"{part} {source}" for part, source in assembled.sources.items())


def _figures(gravity: Gravity) -> list[tuple[str, str, Callable[..., None]]]:
    """Title, file and drawing function of each figure of a map."""
    from stiffscope.report import maps

    plain = [("stiffness at M (diagonal of K), y = 0, without gravity", "stiffness", maps.draw_stiffness)]
    if gravity == "none":
        return plain
    loaded = functools.partial(maps.draw_stiffness, loaded=True)
    return [
        ("stiffness at M without and with weight, and what it changes", "map", maps.draw_all),
        *plain,
        (f"stiffness at M (diagonal of K), y = 0, gravity {gravity}", "stiffness_with_gravity", loaded),
        (f"what gravity ({gravity}) changes", "gravity_difference", maps.draw_difference),
        ("sag under its own weight", "sag", maps.draw_sag),
    ]


def _tool_points(robot: RobotFile, poses: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """The tool points (m) of `--at`, by their texts or names; without any, those of the robot file."""
    from stiffscope.robot import quantities as q

    points: dict[str, tuple[float, ...]] = {}
    for text in poses or robot.poses:
        try:
            points[text] = robot.poses[text] if text in robot.poses else q.several(text, *[q.LENGTH] * 3)
        except ValueError as error:
            names = f" or a pose of {robot.path}: {', '.join(robot.poses)}" if robot.poses else ""
            raise InputError(f'--at {text}: {error}; expected X,Y,Z such as "0,0,350 mm"{names}') from error
    if not points:
        raise InputError(f"{robot.path}: has no poses; give a tool point with --at X,Y,Z")
    return points


def _assembled(robot: RobotFile, components: Any, points: Points, *, quiet: bool) -> Assembled:
    """The robot with its parts; that it reaches the points is checked before they are made."""
    from stiffscope.cli.showing import shown_workshop, warn_of
    from stiffscope.jobs.assembly import assemble_robots, check_reach

    check_reach(robot, points)
    with shown_workshop(quiet=quiet) as shop:
        made = assemble_robots({"now": robot}, components, shop)["now"]
    warn_of(made.results.values())
    return made

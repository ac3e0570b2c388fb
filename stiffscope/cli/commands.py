"""The commands that answer one question: a part's compliance, the robot's stiffness, a comparison, a map."""

from __future__ import annotations

import functools
import logging
import sys
from typing import TYPE_CHECKING

import numpy as np

from stiffscope import files
from stiffscope.cli.run import (
    Assembled,
    check_one_interface,
    check_reach,
    compliance_json,
    show_compliance,
    solve_robots,
    stiffness_bars,
    stiffness_json,
    warn_of,
    workshop,
    write_superelement,
)
from stiffscope.errors import InputError
from stiffscope.jobs.cache import file_digest
from stiffscope.jobs.experiments import order_part, solve_parts
from stiffscope.jobs.manifest import Manifest
from stiffscope.report import tables
from stiffscope.robot import quantities as q
from stiffscope.robot.robot_file import load_robot

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from stiffscope.robot.schema import PartName, RobotFile
    from stiffscope.vjm.analysis import Gravity


log = logging.getLogger(__name__)


def part_compliance(
    name: str,
    part: PartName,
    *,
    overrides: Sequence[str],
    tolerance: str | None,
    step: str | None,
    target: str | None,
    superelement: Path | None,
    quiet: bool,
) -> None:
    """`stiffscope compliance`: one part's virtual experiment as JSON, as a table, as a superelement."""
    robot = load_robot(name, overrides, tolerance)
    if superelement:
        files.check_output(superelement, target)
    manifest = Manifest(sys.argv[1:], str(robot.path), file_digest(robot.path), list(overrides))
    with workshop(quiet=quiet) as (cache, spare, open_line):
        order = order_part(robot, part, step, pictures=False)
        (result,) = solve_parts([order], cache, spare, {part: open_line(part)})
        if superelement:
            write_superelement(result, superelement, manifest)
    if target:
        files.write_json(target, compliance_json(robot, result))
    if not quiet and target != "-":
        tables.show_parts([result])
        if "flexibility" in result.facts:
            tables.show_each_interface(result)
        else:
            show_compliance(robot, result)
        if superelement:
            tables.show_line(f"Superelement written to {superelement}")
    else:
        warn_of([result])


def robot_stiffness(
    name: str,
    poses: Sequence[str],
    *,
    components: str | None,
    gravity: Gravity | None,
    overrides: Sequence[str],
    target: str | None,
    quiet: bool,
) -> None:
    """`stiffscope stiffness`: K, sag and mobility at tool points; without any, at the robot file's poses."""
    from stiffscope.vjm.analysis import analyse, singular_note

    robot = load_robot(name, overrides)
    points = _tool_points(robot, poses)
    gravity = gravity or ("exact" if robot.carries("gravity") else "none")
    assembled = _assembled(robot, components, points, quiet=quiet)
    state = analyse(assembled.elastic, list(points.values()), gravity=gravity, g=robot.gravity.acceleration)
    bars = stiffness_bars(assembled, state.poses)
    if target:
        files.write_json(target, stiffness_json(state, bars))
    for pose, matrix, droop in zip(points, state.matrix, state.sag, strict=True):
        if note := singular_note(matrix):
            log.warning("%s: %s", pose, note)
        elif np.isnan(droop).any():
            log.warning("%s: its weight moves the tool too far for a linear answer; the stiffness is without it", pose)
    if not quiet and target != "-":
        made_of = ", ".join(f"{part} {source}" for part, source in assembled.sources.items())
        title = f"Stiffness at M ({made_of}; gravity {gravity})"
        tables.show_stiffness(list(points), state.poses, state.matrix, state.sag, bars, title=title)


def robot_deflection(
    name: str, poses: Sequence[str], wrench: str, *, components: str | None, overrides: Sequence[str],
    target: str | None, quiet: bool,
) -> None:  # fmt: skip
    """`stiffscope deflection`: how far the tool yields under a wrench, and which part yields how much of it."""
    from stiffscope.vjm.deflection import deflection

    robot = load_robot(name, overrides)
    points = _tool_points(robot, poses)
    try:
        load = [float(part) for part in wrench.split(",")]
    except ValueError as error:
        raise InputError(f"--wrench {wrench}: {error}; expected FX,FY,FZ,MX,MY,MZ in N and N·m") from error
    if len(load) != 6:
        raise InputError(f"--wrench {wrench}: expected six numbers FX,FY,FZ,MX,MY,MZ in N and N·m")
    assembled = _assembled(robot, components, points, quiet=quiet)
    found = deflection(assembled.elastic, list(points.values()), load)
    if target:
        shares = {"energy": found.energy, "shares": found.shares}
        files.write_json(target, {"poses": list(points.values()), "wrench": load, "twist": found.twist, **shares})
    if not quiet and target != "-":
        tables.show_deflection(list(points), found.twist, found.shares, wrench)


def compare_parts(name: str, parts: Sequence[PartName], *, overrides: Sequence[str], quiet: bool) -> None:
    """`stiffscope compare`: tables and words."""
    robot = load_robot(name, overrides)
    for part in parts:
        check_one_interface(robot, part)
    with workshop(quiet=quiet) as (cache, spare, open_line):
        orders = [order_part(robot, part, pictures=False) for part in parts]
        results = solve_parts(orders, cache, spare, {part: open_line(part) for part in parts})
    warn_of(results)
    for result in results:
        show_compliance(robot, result)


def robot_map(
    name: str,
    out: Path,
    *,
    components: str | None,
    gravity: Gravity,
    overrides: Sequence[str],
    points: int,
    quiet: bool,
) -> None:
    """`stiffscope map`: figures as PNG and SVG, numbers as CSV, netCDF and npz."""
    from stiffscope.report import maps

    robot = load_robot(name, overrides)
    files.check_output(out)
    manifest = Manifest(sys.argv[1:], str(robot.path), file_digest(robot.path), list(overrides))
    elastic = _assembled(robot, components, {}, quiet=quiet).elastic
    with files.staged_folder(out) as folder:
        found = maps.robot_maps(elastic, robot.poses, points, gravity, robot.gravity.acceleration)
        maps.write_map(found, folder, f"{robot.name}: stiffness over the workspace, gravity {gravity}")
        for title, stem, draw in _figures(gravity):
            draw(found, robot.poses, f"{robot.name}: {title}", folder / f"{stem}.png", folder / f"{stem}.svg")
        manifest.write(folder)
    if not quiet:
        tables.show_line(f"Written to {out}")


def _figures(gravity: Gravity) -> list[tuple[str, str, Callable[..., None]]]:
    """Title, file and drawing function of each figure of a map."""
    from stiffscope.report import maps

    plain = [("principal stiffness at M, y = 0, without gravity", "stiffness", maps.draw_stiffness)]
    if gravity == "none":
        return plain
    loaded = functools.partial(maps.draw_stiffness, loaded=True)
    return [
        ("stiffness at M without and with weight, and what it changes", "map", maps.draw_all),
        *plain,
        (f"principal stiffness at M, y = 0, gravity {gravity}", "stiffness_with_gravity", loaded),
        (f"what gravity ({gravity}) changes", "gravity_difference", maps.draw_difference),
        ("sag under its own weight", "sag", maps.draw_sag),
    ]


def list_faces(file: str, *, target: str | None, quiet: bool) -> None:
    """`stiffscope faces`: what each face of a STEP file is, and how to choose it in a robot file."""
    from stiffscope.cad.faces import describe
    from stiffscope.cad.step import read_solid

    rows = describe(read_solid(file))
    if target:
        files.write_json(target, rows)
    if not quiet and target != "-":
        tables.show_faces(file, rows)


def _tool_points(robot: RobotFile, poses: Sequence[str]) -> dict[str, tuple[float, float, float]]:
    """The tool points of `--at`, by their texts; without any, those of the robot file."""
    points = dict(_parse_pose(robot, text) for text in poses) if poses else dict(robot.poses)
    if not points:
        raise InputError(f"{robot.path}: has no poses; give a tool point with --at X,Y,Z")
    return points


def _parse_pose(robot: RobotFile, text: str) -> tuple[str, tuple[float, float, float]]:
    """Name and tool point (m) of `--at`: "0,0,0.35", "0,0,350 mm", or the name of a pose."""
    if text in robot.poses:
        return text, robot.poses[text]
    numbers = [part.strip() for part in text.split(",")]
    names = f" or a pose of {robot.path}: {', '.join(robot.poses)}" if robot.poses else ""
    if len(numbers) != 3:
        raise InputError(f'--at {text}: expected X,Y,Z in m such as "0,0,0.35"{names}')
    try:
        x, y, z = (q.to_si(_number(part), q.LENGTH, sign="any") for part in numbers)
    except ValueError as error:
        raise InputError(f"--at {text}: {error}{names}") from error
    return text, (x, y, z)


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _assembled(
    robot: RobotFile, components: str | None, points: Mapping[str, Sequence[float]], *, quiet: bool
) -> Assembled:
    """The robot with its parts."""
    check_reach(robot, points)
    with workshop(quiet=quiet) as (cache, spare, open_line):
        made = solve_robots({"now": robot}, components, cache, spare, open_line, pictures=False)["now"]
    warn_of(made.results.values())
    return made

"""`stiffscope map`: stiffness over the workspace."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import click

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit
from stiffscope.cli.poses import find_poses
from stiffscope.errors import naming, require
from stiffscope.experiments.manifest import manifest_of
from stiffscope.report.kept_pictures import draw_named_poses
from stiffscope.report.run_report import write_map_report
from stiffscope.robot.file import quantities as q
from stiffscope.robot.mechanism_of import configured_poses, rigid_mechanism
from stiffscope.robot.reader import load_robot
from stiffscope.statics import maps as evaluated
from stiffscope.statics.command.poses import assemble
from stiffscope.statics.maps import PRINCIPAL, Wanted
from stiffscope.statics.show import maps

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from stiffscope.cli.output import Output
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.statics.maps import StiffnessMap

_POINTS = {2: 200, 3: 25}  # along each coordinate


@click.command("map")
@takes(
    options.robot,
    options.out,
    options.components,
    options.gravity("exact"),
    options.overrides,
    options.json,
)
@click.option(
    "--points",
    type=click.IntRange(2, 3000),
    help=f"Poses along each coordinate [{_POINTS[2]} of two, {_POINTS[3]} of three].",
)
@click.option(
    "--over",
    multiple=True,
    metavar="NAME=LOW,HIGH",
    help='A coordinate that is swept, twice or three times, in place of [map]: "x=-150 mm,150 mm".',
)
@click.option(
    "--at", metavar="POSE", help="Pose that gives the other coordinates; default: home."
)
@click.option(
    "--show",
    multiple=True,
    type=click.Choice(list(PRINCIPAL)),
    help="Also the stiffness along the softest or stiffest direction of translation, or their ratio.",
)
@click.option(
    "--direction",
    metavar="X,Y,Z",
    help="Also the stiffness to a force along it, axes {O}.",
)
@click.option(
    "--wrench",
    metavar="FX,FY,FZ,MX,MY,MZ",
    help="Also the tool's error under a wrench at M.",
)
@click.option(
    "--frequencies",
    "count",
    default=0,
    type=click.IntRange(0, 12),
    metavar="N",
    help="Also the first N natural frequencies, drives held.",
)
def map_(
    name: str,
    *,
    components: Any,
    gravity: Any,
    overrides: Texts,
    points: int | None,
    over: Texts,
    at: str | None,
    show: Texts,
    direction: str | None,
    wrench: str | None,
    count: int,
    output: Output,
) -> None:
    """Stiffness over the workspace: figures, numbers, a report.

    [map] of the robot file, or --over, names the coordinates that are swept and their ranges. Three
    make a volume (map.vti, for ParaView) and figures of its first, middle and last slice.
    """
    robot = load_robot(name, overrides)
    require(
        gravity != "literal",
        "--gravity literal",
        "none or exact for a map",
        "literal, which is for single poses",
    )
    wanted = _read_wanted(show, direction, wrench)
    ranges = _find_ranges(robot, over)
    moving = rigid_mechanism(robot)
    points = points or _POINTS[len(ranges)]
    evaluated.check_points(moving, ranges, points)
    configured_poses(robot, moving, moving.tool.home)  # raises before any experiment
    fixed = evaluated.require_map(robot).at if not over else None
    if at is not None:
        fixed = tuple(find_poses(robot, (at,), ()).configurations.poses[0].tolist())
    manifest = manifest_of(robot)
    assembled = assemble(robot, components, output)
    swept = evaluated.map_volume(
        assembled.mechanism,
        ranges,
        points,
        gravity=gravity,
        at=fixed,
        frequencies=count,
        wanted=wanted,
    )
    stiffness_map = swept.maps[0] if len(ranges) == 2 else swept
    slices = maps.pick_slices(stiffness_map)
    figures: dict[
        str, tuple[str, StiffnessMap, Callable[[StiffnessMap], list[maps.Panel]]]
    ] = {}
    for number, each in enumerate(slices, 1):
        end = f"_{number}" if len(slices) > 1 else ""
        for title, stem, panels in _figures(gravity, each, frequencies=bool(count)):
            figures[f"{stem}{end}"] = title, each, panels

    def fill(folder: Path) -> None:
        with ThreadPoolExecutor(1) as pool:
            drawn = pool.submit(
                draw_named_poses, assembled, folder
            )  # in a separate process
            title = f"{robot.name}: stiffness over the workspace, gravity {gravity}"
            evaluated.write_map(stiffness_map, folder, title)
            if isinstance(stiffness_map, evaluated.StiffnessVolume):
                maps.write_volume(evaluated.volume_dataset(stiffness_map), folder)
            for stem, (words, each, panels) in figures.items():
                files = folder / f"{stem}.png", folder / f"{stem}.svg"
                maps.draw_map(
                    each, panels(each), robot.poses, f"{robot.name}: {words}", *files
                )
            drawn.result()

    titles = {stem: words for stem, (words, *_) in figures.items()}
    emit(
        output,
        lambda: evaluated.volume_dataset(stiffness_map).to_dict(),
        manifest=manifest,
        fill=fill,
        page=lambda report: write_map_report(report, assembled, titles),
    )


def _read_wanted(show: Texts, direction: str | None, wrench: str | None) -> Wanted:
    along = load = None
    if direction is not None:
        along = _read(f"--direction {direction}", direction, [q.NUMBER] * 3)
        require(any(along), f"--direction {direction}", "a direction", "none")
    if wrench is not None:
        load = _read(f"--wrench {wrench}", wrench, [q.FORCE] * 3 + [q.MOMENT] * 3)
    return Wanted(show, along, load)


def _find_ranges(
    robot: RobotFile, over: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Return the swept coordinates and their ends, m and rad, from `--over` or `[map]`."""
    if not over:
        return evaluated.require_map(robot).ranges()
    out: dict[str, tuple[float, float]] = {}
    for text in over:
        name, _, ends = (piece.strip() for piece in text.partition("="))
        require(
            name in robot.tool.pose and name not in out,
            f"--over {text}",
            f"each of {', '.join(robot.tool.pose)} at most once",
            name,
        )
        kind = q.ANGLE if name.startswith("r") else q.LENGTH
        low, high = _read(f"--over {text}", ends, [kind] * 2)
        require(low < high, f"--over {text}", "the lower end first", ends)
        out[name] = low, high
    require(len(out) in _POINTS, "--over", "two or three coordinates", len(out))
    return out


def _read(
    option: str, text: str, dimensions: Sequence[q.Dimension]
) -> tuple[float, ...]:
    with naming(option):
        return q.several(text, *dimensions)


def _figures(
    gravity: str, stiffness_map: StiffnessMap, *, frequencies: bool
) -> list[tuple[str, str, Callable[[StiffnessMap], list[maps.Panel]]]]:
    """Return title, file stem and panels of each figure of a map."""
    where = maps.held_text(stiffness_map)
    weighs = gravity != "none"
    under = f", gravity {gravity}"
    held = f"natural frequencies, drives held{where}"
    kinds = (
        (
            True,
            maps.stiffness_title(stiffness_map) + under,
            "map",
            maps.stiffness_panels,
        ),
        (True, f"1/C_ii at M, a push{where}{under}", "push", maps.push_panels),
        (
            stiffness_map.more,
            f"translation of M{where}{under}",
            "quantities",
            maps.scalar_panels,
        ),
        (frequencies, held, "frequencies", maps.frequency_panels),
        (
            weighs,
            f"what gravity changes{where}",
            "gravity_difference",
            maps.difference_panels,
        ),
        (weighs, f"sag under its own weight{where}", "sag", maps.sag_panels),
    )
    return [(title, stem, panels) for wanted, title, stem, panels in kinds if wanted]

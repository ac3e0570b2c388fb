"""Commands for vibration: natural frequencies with mode shapes, and frequency response."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit
from stiffscope.cli.poses import find_poses
from stiffscope.errors import naming, require
from stiffscope.experiments.assembly import name_robot
from stiffscope.experiments.manifest import manifest_of
from stiffscope.report.progress import progress
from stiffscope.report.run_report import write_modes_report
from stiffscope.report.tables import show_modes
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.quantities import FREQUENCY
from stiffscope.robot.reader import load_robot
from stiffscope.statics.command.poses import assemble
from stiffscope.vibration.show import frequency_response as report
from stiffscope.vibration.show.modes import draw_modes, modes_json
from stiffscope.vjm.model.mechanism import COORDINATES
from stiffscope.vjm.vibration.frequency_response import Port, frequency_response
from stiffscope.vjm.vibration.modes import frequencies
from stiffscope.vjm.vibration.modes import modes as find_modes

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.cli.output import Output
    from stiffscope.vjm.model.mechanism import Mechanism

drives = click.option(
    "--drives",
    type=click.Choice(("held", "free")),
    default="held",
    show_default=True,
    help="Drives as springs at their commands, or moving freely.",
)


@click.command()
@takes(
    options.robot,
    options.poses,
    options.joints,
    options.components,
    drives,
    options.overrides,
    options.json,
)
@options.count(
    "--count", 6, "How many modes, with free motions of tool or drives (0 Hz).", 1, 200
)
@options.folder(
    "--out",
    "report and pictures of the shapes, animations at the first pose, complete or absent.",
)
def modes(
    name: str,
    *,
    poses: Texts,
    joints: Texts,
    components: Any,
    drives: Any,
    overrides: Texts,
    count: int,
    output: Output,
) -> None:
    """Natural frequencies and mode shapes of the robot at tool poses.

    With error bars and each element's share of the energy. Without --at and --joints, at the poses
    of the robot file. Weight is neglected: its effect on the stiffness is far smaller than the
    error bars.
    """
    robot = load_robot(name, overrides)
    asked = find_poses(robot, poses, joints)
    manifest = manifest_of(robot)
    assembled = assemble(robot, components, output)
    with name_robot(robot):
        vibration_modes = find_modes(
            assembled.mechanism, asked.configurations, count, drives=drives
        )

    def fill(folder: Path) -> None:
        with progress(quiet=output.quiet) as open_line:
            draw_modes(
                assembled, asked.names, vibration_modes, folder, open_line("shapes")
            )

    title = f"Natural frequencies, drives {drives}"
    emit(
        output,
        modes_json(vibration_modes),
        lambda: show_modes(asked.names, vibration_modes, title),
        manifest=manifest,
        fill=fill,
        page=lambda report: write_modes_report(
            report, assembled, asked.names, vibration_modes
        ),
        kept="modes.json",
    )


@click.command()
@takes(
    *(
        options.robot,
        options.poses,
        options.joints,
        options.components,
        drives,
        options.overrides,
    ),
    *(options.out, options.json),
)
@click.option(
    "--from",
    "source",
    required=True,
    metavar="BODY:POINT:DIRECTION",
    help="Where a harmonic force acts: a body or an end of an elastic one (link.tip), or tool; a "
    "point at home (X,Y,Z, a joint's name, M, or centre); x y z of a force, rx ry rz of a moment, "
    "with - before it for the other way.",
)
@click.option(
    "--to",
    "target",
    required=True,
    metavar="BODY:POINT:DIRECTION",
    help="Where the displacement is read, as --from.",
)
@click.option(
    "--band",
    metavar="LOW,HIGH",
    help="Frequencies in Hz; by default from a fifth of the first to above the sixth.",
)
@options.count("--points", 2000, "Frequencies.", 2, 200_000)
@click.option(
    "--damping",
    default=0.01,
    show_default=True,
    type=click.FloatRange(0.0, 1.0, max_open=True),
    help="Damping ratio of every mode.",
)
def frf(
    name: str,
    *,
    poses: Texts,
    joints: Texts,
    components: Any,
    drives: Any,
    overrides: Texts,
    source: str,
    target: str,
    band: str | None,
    points: int,
    damping: float,
    output: Output,
) -> None:
    """Frequency response from a force at one point to the displacement at another.

    By superposition of modes. Writes a report, a figure, a table (CSV) and a netCDF file to DIR.
    """
    robot = load_robot(name, overrides)
    asked = find_poses(robot, poses, joints)
    mechanism = asked.configurations.mechanism
    shaken = _port(mechanism, "--from", source)
    read = _port(mechanism, "--to", target)
    given = _band(band)
    manifest = manifest_of(robot)
    assembled = assemble(robot, components, output)
    if given is None:
        count = 6 + len(mechanism.drives)
        natural = frequencies(
            assembled.mechanism, asked.configurations, count, drives=drives
        )
        natural = np.sort(natural[natural > 0.0])
        given = (
            0.2 * float(natural[0]),
            1.5 * float(natural[: 6 * len(asked.names)][-1]),
        )
    hertz = np.geomspace(*given, points)
    each = (asked.configurations[np.array([k])] for k in range(len(asked.names)))
    ports = partial(frequency_response, damping=damping, drives=drives)
    curves = np.stack(
        [ports(assembled.mechanism, one, shaken, read, hertz) for one in each]
    )
    response = report.Response(
        robot.name,
        asked.names,
        hertz,
        curves,
        source,
        target,
        damping,
        asked.configurations.tool,
    )
    title = f"{robot.name}: frequency response"
    emit(
        output,
        lambda: report.as_dataset(response, title).to_dict(),
        manifest=manifest,
        fill=partial(report.write, response),
        page=partial(report.write_page, response),
    )


def _band(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        low, high = (float(word) for word in text.split(","))
    except ValueError:
        low = high = -1.0
    require(
        0.0 < low < high and not FREQUENCY.refusal(low) and not FREQUENCY.refusal(high),
        f"--band {text}",
        "LOW,HIGH in Hz, 0 < LOW < HIGH, such as 5,500",
    )
    return low, high


def _port(mechanism: Mechanism, option: str, text: str) -> Port:
    """Return the port given as ``BODY:POINT:DIRECTION``."""
    words = [word.strip() for word in text.split(":")]
    require(
        len(words) == 3, f"{option} {text}", "BODY:POINT:DIRECTION such as platform:M:z"
    )
    name, point, way = words
    nodes = {node: body for body in mechanism.bodies for node in body.nodes}
    node = mechanism.tool.body if name == "tool" else name
    require(
        node in nodes,
        f"{option} {text}",
        f"tool or one of {', '.join(nodes)}",
        f"{name!r}",
    )
    axis = way.lstrip("+-")
    require(
        axis in COORDINATES and len(way) <= 1 + len(axis),
        f"{option} {text}",
        f"a direction among {', '.join(COORDINATES)}",
        f"{way!r}",
    )
    centre = nodes[node].centre
    places = {} if centre is None else {"centre": centre}
    places |= {joint.name: joint.at for joint in mechanism.joints} | {
        "M": mechanism.tool.at
    }
    at = places.get(point)
    if at is None:
        known = "M, a joint's name" + (", centre" if "centre" in places else "")
        form = f"a point: X,Y,Z such as 0,0,350 mm, {known}"
        with naming(f"{option} {text}", form):
            at = np.array(q.several(point, *[q.LENGTH] * 3))
    direction = np.eye(6)[COORDINATES.index(axis)] * (
        -1.0 if way.startswith("-") else 1.0
    )
    return Port(None if name == "tool" else node, at, direction)

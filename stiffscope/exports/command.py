"""The command `export`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit
from stiffscope.cli.poses import find_poses
from stiffscope.errors import naming, require
from stiffscope.experiments.assembly import name_robot
from stiffscope.experiments.manifest import manifest_of
from stiffscope.exports.show import show_export
from stiffscope.exports.target import Order, load_target, target_names
from stiffscope.robot.file import quantities as q
from stiffscope.robot.reader import load_robot
from stiffscope.statics.command.poses import assemble

if TYPE_CHECKING:
    from stiffscope.cli.output import Output


@click.command("export")
@takes(
    options.robot,
    click.option(
        "--to",
        "target_name",
        required=True,
        type=click.Choice(target_names()),
        help="The other program, or the form.",
    ),
    options.poses,
    options.joints,
    click.option(
        "--highest",
        metavar="FREQUENCY",
        help='Highest frequency of interest, such as "2 kHz": what vibrates above is lumped, which '
        "allows larger time steps.",
    ),
    options.components,
    options.overrides,
    options.out,
    options.json,
)
def export(
    name: str,
    *,
    target_name: str,
    poses: Texts,
    joints: Texts,
    highest: str | None,
    components: Any,
    overrides: Texts,
    output: Output,
) -> None:
    """Write a robot for another program, such as MuJoCo.

    With its elasticity, its weight and the effects adopted in its file. Without --at and --joints,
    at the poses of the robot file.
    """
    target = load_target(target_name)
    limit = _frequency(highest)
    robot = load_robot(name, overrides)
    target.check(robot)
    asked = find_poses(robot, poses, joints)
    manifest = manifest_of(robot)
    assembled = assemble(robot, components, output)
    order = Order(assembled, asked, limit)
    with name_robot(robot):
        exported = target.export(order)
    about = {"robot": robot.name, "target": target.name, "poses": asked.names}
    title = f"{robot.name} for {target.name}"
    emit(
        output,
        {**about, **exported.answer},
        lambda: show_export(title, exported),
        manifest=manifest,
        fill=exported.write,
    )


def _frequency(text: str | None) -> float | None:
    """Return a frequency in Hz."""
    if text is None:
        return None
    with naming(f"--highest {text}", 'such as "2 kHz"'):
        (value,) = q.several(text, q.FREQUENCY)
    require(value > 0.0, f"--highest {text}", "a frequency above 0")
    return value

"""The bundled robots, a copy to start from, and robot files made from a simulator's model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.cli.output import emit
from stiffscope.report.terminal import show_line
from stiffscope.robot.imports.import_model import import_model
from stiffscope.robot.library import copy_robot, robot_names

if TYPE_CHECKING:
    from stiffscope.cli.output import Output


@click.command()
@takes(options.json)
def robots(*, output: Output) -> None:
    """List the bundled robots."""
    names = robot_names()
    width = max(map(len, names))

    def show() -> None:
        for name, line in names.items():
            show_line(f"{name:{width}}  {line.partition(': ')[2] or line}")

    emit(output, names, show)


@click.command()
@takes(click.argument("name", metavar="NAME"), click.argument("goal", metavar="FILE"), options.json)
def new(name: str, goal: str, *, output: Output) -> None:
    """Copy a bundled robot to start from: stiffscope new delta mine.toml."""
    written = copy_robot(name, goal)
    line = f"Written: {written}. Next: stiffscope check {written}"
    emit(output, {"file": str(written)}, lambda: show_line(line))


@click.command("import")
@takes(
    click.argument("model", metavar="FILE.urdf|FILE.xml", type=click.Path(path_type=Path)),
    click.option(
        "--out", "goal", required=True, metavar="ROBOT.toml", type=click.Path(path_type=Path),
        help="Robot file to write.",
    ),
    click.option(
        "--drive", "drives", multiple=True, metavar="JOINT=STIFFNESS",
        help='Drive a joint: "joint1=25 kN*m/rad", "slide=20 N/um". May be repeated; other joints are passive.',
    ),
    click.option("--tool", metavar="NAME", help="Body or site that is the tool; by default the last of the model."),
    click.option(
        "--home", multiple=True, metavar="JOINT=POSITION",
        help='Another home than the model\'s: "elbow=90 deg". May be repeated.',
    ),
    options.json,
)  # fmt: skip
def import_(
    model: Path, goal: Path, *, drives: tuple[str, ...], tool: str | None, home: tuple[str, ...], output: Output
) -> None:
    """Convert a URDF or MJCF model to a robot file.

    Bodies, masses, joints and ranges are converted. The stiffness of drives and elastic parts are not in such a model;
    comments in the file mark where to add them.
    """
    read = import_model(model, goal, drives, tool, home)

    def show() -> None:
        for note in read.notes:
            show_line(f"Note: {note}.")
        driven = ", ".join(each.partition("=")[0].strip() for each in drives) or "none"
        counts = f"{len(read.bodies)} bodies, {len(read.joints)} joints (driven: {driven})"
        show_line(f"Written: {goal}, {counts}. Next: stiffscope check {goal}")

    counted = {"bodies": len(read.bodies), "joints": len(read.joints), "notes": list(read.notes)}
    emit(output, {"file": str(goal), **counted}, show)

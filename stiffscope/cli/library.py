"""The robots that come along, a copy to start from, and robot files made from a simulator's model."""

from __future__ import annotations

from pathlib import Path

import click

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.runtime import files


@click.command()
@takes(options.target)
def robots(*, target: str | None, quiet: bool) -> None:
    """The robots that come along, by the names that every command takes."""
    from stiffscope.report import tables
    from stiffscope.robot.library import robot_names

    names = robot_names()
    if target is not None:
        files.write_json(target, names)
    if not quiet and target != "-":
        width = max(map(len, names))
        for name, line in names.items():
            tables.show_line(f"{name:{width}}  {line.partition(': ')[2] or line}")


@click.command()
@takes(click.argument("name", metavar="NAME"), click.argument("goal", metavar="FILE"), options.target)
def new(name: str, goal: str, *, target: str | None, quiet: bool) -> None:
    """Copy a robot that comes along, to start from: stiffscope new delta mine.toml."""
    from stiffscope.report import tables
    from stiffscope.robot.library import copy_robot

    written = copy_robot(name, goal)
    if target:
        files.write_json(target, {"file": str(written)})
    if not quiet and target != "-":
        tables.show_line(f"Written: {written}. Next: stiffscope check {written}")


@click.command("import")
@takes(
    click.argument("model", metavar="FILE.urdf|FILE.xml", type=click.Path(path_type=Path)),
    click.option(
        "--out", required=True, metavar="ROBOT.toml", type=click.Path(path_type=Path), help="Robot file to write."
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
    options.target,
)  # fmt: skip
def import_(
    model: Path, out: Path, *, drives: tuple[str, ...], tool: str | None, home: tuple[str, ...], target: str | None,
    quiet: bool,
) -> None:  # fmt: skip
    """A robot file from a simulator's model, URDF or MJCF: bodies, masses, joints, ranges.

    What such a model does not say (stiffness of drives, elastic parts) is left to fill in; the file says where.
    """
    from stiffscope.report import tables
    from stiffscope.robot.imports.import_model import import_model

    read = import_model(model, out, drives, tool, home)
    if target:
        counted = {"bodies": len(read.bodies), "joints": len(read.joints), "notes": list(read.notes)}
        files.write_json(target, {"file": str(out), **counted})
    if quiet or target == "-":
        return
    for note in read.notes:
        tables.show_line(f"Note: {note}.")
    driven = ", ".join(each.partition("=")[0].strip() for each in drives) or "none"
    counts = f"{len(read.bodies)} bodies, {len(read.joints)} joints (driven: {driven})"
    tables.show_line(f"Written: {out}, {counts}. Next: stiffscope check {out}")

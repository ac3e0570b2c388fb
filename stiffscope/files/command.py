"""Commands for files: bundled robots, copies of them, keys, and import of models and assemblies."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.cli.output import emit
from stiffscope.files.keys import find_keys, show_keys
from stiffscope.report.terminal import show_line
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
@takes(
    click.argument("name", metavar="NAME"),
    click.argument("goal", metavar="FILE"),
    options.json,
)
def new(name: str, goal: str, *, output: Output) -> None:
    """Copy a bundled robot to start from: stiffscope new delta mine.toml."""
    written = copy_robot(name, goal)
    line = f"Written: {written}. Next: stiffscope check {written}"
    emit(output, {"file": str(written)}, lambda: show_line(line))


@click.command()
@takes(click.argument("section", required=False), options.json)
def keys(section: str | None, *, output: Output) -> None:
    """List every key of a robot file, study, job or campaign, with its meaning.

    SECTION is robot, study, job or campaign, or part of a section's title: joints or milling.
    """
    keys_by_kind = find_keys(section)
    answer = {
        kind: {title: list(map(asdict, rows)) for title, rows in titles.items()}
        for kind, titles in keys_by_kind.items()
    }
    emit(output, answer, lambda: show_keys(keys_by_kind))

"""`stiffscope compliance`: the compliance of one part, with no more imports than it needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit, open_workshop, warn_of_parts
from stiffscope.experiments.experiments import compliance_json, solve_parts
from stiffscope.experiments.manifest import manifest_of
from stiffscope.experiments.orders import name_lines, order_part
from stiffscope.experiments.superelements import write_part
from stiffscope.report import part_tables, tables
from stiffscope.robot.reader import load_robot

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.cli.output import Output


@click.command()
@takes(
    options.robot,
    options.required_part,
    options.tolerance,
    options.overrides,
    options.json,
)
@options.superelement("part's interfaces")
@click.option(
    "--step",
    metavar="FILE",
    help="Take this solid as the part: clamped at its least x, loaded at its greatest.",
)
def compliance(
    name: str,
    part: str,
    *,
    tolerance: str | None,
    overrides: Texts,
    superelement: Path | None,
    step: str | None,
    output: Output,
) -> None:
    """6x6 compliance of a part, with error bars."""
    robot = load_robot(name, overrides, tolerance)
    output.check_folder(superelement)
    manifest = manifest_of(robot)
    with open_workshop(output) as shop:
        order = order_part(robot, part, step)
        with name_lines(robot):
            (result,) = solve_parts([order], shop)
    if superelement:
        write_part(result, superelement, manifest)

    def show() -> None:
        part_tables.show_parts([result])
        part_tables.show_compliance(robot, result)
        if superelement:
            tables.show_line(f"Superelement written to {superelement}")

    emit(output, compliance_json(robot, result), show)
    if not output.loud:
        warn_of_parts([result])

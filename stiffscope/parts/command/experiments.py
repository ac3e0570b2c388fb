"""Commands for parts: comparison with beam theory, interfaces, faces of a STEP file."""

from __future__ import annotations

import dataclasses
import logging
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from stiffscope.cad.faces import describe
from stiffscope.cad.step import read_solid
from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit, open_workshop, warn_of_parts, warn_of_robot
from stiffscope.errors import InputError
from stiffscope.experiments import comparison
from stiffscope.experiments.assembly import check_one_interface
from stiffscope.experiments.experiments import solve_parts
from stiffscope.experiments.manifest import manifest_of
from stiffscope.experiments.orders import order_part
from stiffscope.parts import show as interface_figure
from stiffscope.parts.interfaces import (
    compare_interfaces,
    interfaces_columns,
    interfaces_json,
)
from stiffscope.report import part_tables
from stiffscope.robot.file.part_sections import ParametricPart
from stiffscope.robot.part_matrices import used_parts
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.formats import write_table
from stiffscope.statics.comparison import compare_robots
from stiffscope.statics.show import comparison as robot_comparison

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.cli.output import Output
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.file.part_sections import PartSection

log = logging.getLogger(__name__)


@click.command()
@takes(
    options.robot,
    click.argument("other", metavar="[ROBOT]", required=False),
    options.part,
    options.components,
    options.overrides,
    options.json,
)
@options.folder(
    "--out", "with two robots, report, tables, map of the change; complete or absent."
)
def compare(
    name: str,
    other: str | None,
    part: str | None,
    *,
    components: Any,
    overrides: Texts,
    output: Output,
) -> None:
    """Compare two robots or versions, or a robot's parts by FEA, beam theory and published values.

    With two robots: stiffness and sag at the named poses that both reach, and the change over the
    workspace. --set changes the second.
    """
    if other is not None:
        if part is not None:
            raise InputError(f"--part {part}: expected none with two robots, got one")
        _compare_robots(
            load_robot(name), load_robot(other, overrides), components, output
        )
        return
    robot = load_robot(name, overrides)
    orders = [
        order_part(robot, solid)
        for solid in ((part,) if part is not None else _solids(robot))
    ]
    for order in orders:
        check_one_interface(robot, order.name)
    with open_workshop(output) as shop:
        results = solve_parts(orders, shop)
    warn_of_parts(results)
    comparisons = [
        comparison.compare(robot, result.name, result)
        for result in results
        if result.own_shape
    ]

    def show() -> None:
        for result in results:
            part_tables.show_compliance(robot, result)

    emit(output, {each.part: dataclasses.asdict(each) for each in comparisons}, show)


def _compare_robots(
    first: RobotFile, second: RobotFile, components: Any, output: Output
) -> None:
    manifest = manifest_of(first, second.path)
    with open_workshop(output) as shop:
        compared = compare_robots(first, second, components, shop)
    for assembled in compared.robots.values():
        warn_of_robot(assembled)
    emit(
        output,
        robot_comparison.robots_json(compared),
        partial(robot_comparison.show_robots, compared),
        manifest=manifest,
        fill=partial(robot_comparison.draw_both, compared),
        page=partial(robot_comparison.write_robots_page, compared),
    )


@click.command()
@takes(
    options.robot,
    options.out,
    options.part,
    options.tolerance,
    options.overrides,
    options.json,
)
def interfaces(
    name: str,
    *,
    tolerance: str | None,
    overrides: Texts,
    part: str | None,
    output: Output,
) -> None:
    """Effect of clamping and loading on a part's compliance.

    Tests the part (by default the robot's first plate, else its first solid) loaded as a rigid face
    and by a uniform traction (a plate also on three joint pads), and clamped at its face or on an
    elastic foundation (a plate also in its bolt holes). Shows what each choice changes; writes a
    report, CSV, JSON and a figure to DIR.
    """
    robot = load_robot(name, overrides, tolerance)
    if part is None:
        part = min(_solids(robot), key=lambda each: not _is_plate(robot.part(each)))
    manifest = manifest_of(robot)
    with open_workshop(output) as shop:
        compared = compare_interfaces(robot, part, shop)
    for tested in (compared.own, *compared.others):
        result = tested.result
        how = tested.choice.name
        manifest.note(how, key=result.key, reused=result.reused, seconds=result.seconds)
        if result.note:
            log.warning("%s, %s: %s", part, how, result.note)

    def fill(folder: Path) -> None:
        write_table(interfaces_columns(compared), folder / "interfaces", digits=9)
        interface_figure.draw(compared, folder / "interfaces.png")

    show = interface_figure.show_interfaces
    page = interface_figure.write_page
    emit(
        output,
        interfaces_json(compared),
        partial(show, compared),
        manifest=manifest,
        fill=fill,
        page=partial(page, compared),
        kept="interfaces.json",
    )


def _is_plate(part: PartSection) -> bool:
    return isinstance(part, ParametricPart) and part.describes.is_plate


def _solids(robot: RobotFile) -> list[str]:
    """Return the parts suitable for virtual experiments. Raise InputError if there are none."""
    solids = [name for name in used_parts(robot) if robot.part(name).sources]
    if not solids:
        expected = "expected a rod, a plate or a STEP file's solid"
        raise InputError(f"{robot.path}: parts: {expected}, got none")
    return solids


@click.command()
@takes(click.argument("file", metavar="FILE.step"), options.json)
@click.option(
    "--solid",
    metavar="N|all",
    help='Of several solids, the number of one, or "all": fused, if they touch.',
)
def faces(file: str, *, solid: str | None, output: Output) -> None:
    """List the faces of a STEP file."""
    if solid is not None and solid != "all" and not solid.isdecimal():
        raise InputError(f'--solid: expected a number or "all", got "{solid}"')
    chosen = int(solid) if solid is not None and solid != "all" else solid
    rows = describe(read_solid(file, chosen=chosen))
    emit(output, rows, lambda: part_tables.show_faces(file, rows))

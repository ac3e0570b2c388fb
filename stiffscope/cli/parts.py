"""The commands on one part: compliance, comparison with beam theory, choices of interface, faces of a STEP file."""

from __future__ import annotations

import dataclasses
import logging
import time
from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.errors import InputError
from stiffscope.experiments.manifest import manifest_of
from stiffscope.runtime import files

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.robot.file.description import RobotFile

log = logging.getLogger(__name__)


@click.command()
@takes(options.robot, options.required_part, options.tolerance, options.overrides, options.target)
@options.folder(
    "--superelement",
    "Folder to write: stiffness and mass condensed on the part's interfaces (npz, .mtx, DMIG), complete or absent.",
)
@click.option(
    "--step", metavar="FILE", help="Take this solid as the part: clamped at its least x, loaded at its greatest."
)
def compliance(
    name: str, part: str, *, tolerance: str | None, overrides: tuple[str, ...], target: str | None,
    superelement: Path | None, step: str | None, quiet: bool,
) -> None:  # fmt: skip
    """A part's 6x6 compliance with error bars."""
    from stiffscope.cli.showing import show_compliance, shown_workshop, warn_of
    from stiffscope.experiments.experiments import solve_parts
    from stiffscope.experiments.orders import order_part
    from stiffscope.experiments.results import compliance_json
    from stiffscope.experiments.superelements import write_part
    from stiffscope.report import tables
    from stiffscope.robot.reader import load_robot

    robot = load_robot(name, overrides, tolerance)
    if superelement:
        files.check_output(superelement, target)
    manifest = manifest_of(robot)
    with shown_workshop(quiet=quiet) as shop:
        (result,) = solve_parts([order_part(robot, part, step)], shop)
    if superelement:
        write_part(result, superelement, manifest)
    if target:
        files.write_json(target, compliance_json(robot, result))
    if quiet or target == "-":
        warn_of([result])
        return
    tables.show_parts([result])
    show_compliance(robot, result)
    if superelement:
        tables.show_line(f"Superelement written to {superelement}")


@click.command()
@takes(options.robot, options.part, options.overrides, options.target)
def compare(name: str, part: str | None, *, overrides: tuple[str, ...], target: str | None, quiet: bool) -> None:
    """FEA beside beam theory beside published, entry by entry."""
    from stiffscope.cli.showing import show_compliance, shown_workshop, warn_of
    from stiffscope.experiments.assembly import check_one_interface
    from stiffscope.experiments.experiments import solve_parts
    from stiffscope.experiments.orders import order_part
    from stiffscope.report.compare import compare as compared
    from stiffscope.robot.reader import load_robot

    robot = load_robot(name, overrides)
    orders = [order_part(robot, each) for each in ((part,) if part else _solids(robot))]
    for order in orders:
        check_one_interface(robot, order.name)
    with shown_workshop(quiet=quiet) as shop:
        results = solve_parts(orders, shop)
    warn_of(results)
    if target:
        own = {result.name: compared(robot, result.name, result) for result in results if result.own_shape}
        files.write_json(target, {part: dataclasses.asdict(each) for part, each in own.items()})
    if not quiet and target != "-":
        for result in results:
            show_compliance(robot, result)


@click.command()
@takes(options.robot, options.out, options.part, options.tolerance, options.overrides, options.target)
def interfaces(
    name: str, out: Path, *, tolerance: str | None, overrides: tuple[str, ...], part: str | None, target: str | None,
    quiet: bool,
) -> None:  # fmt: skip
    """How much a part's compliance depends on how it is held and loaded.

    Tests the part (without --part: the robot's first plate, else its first solid) loaded as a rigid face and by an even
    traction, a plate also on three joint pads, and held by its face, on an elastic foundation, a plate also in its bolt
    holes. Prints what each choice changes; writes a report, CSV, JSON and a figure to DIR.
    """
    from stiffscope.cli.showing import shown_workshop
    from stiffscope.experiments.interfaces import compare_interfaces, interfaces_csv, interfaces_json
    from stiffscope.experiments.orders import order_part
    from stiffscope.report import tables
    from stiffscope.report.interface_figure import draw, write_page
    from stiffscope.robot.reader import load_robot

    begun = time.perf_counter()
    robot = load_robot(name, overrides, tolerance)
    part = part or min(_solids(robot), key=lambda each: robot.part(each).shape != "plate")
    order_part(robot, part)  # refuses what is no solid before a folder is begun
    files.check_output(out, target)
    manifest = manifest_of(robot)
    with shown_workshop(quiet=quiet) as shop, files.staged_folder(out) as folder:
        compared = compare_interfaces(robot, part, shop)
        files.write_bytes(folder / "interfaces.csv", interfaces_csv(compared).encode())
        files.write_json(folder / "interfaces.json", interfaces_json(compared))
        draw(compared, f"{robot.name}: effect of the interfaces on the {part}'s compliance", folder / "interfaces.png")
        for tested in (compared.own, *compared.others):
            result = tested.result
            manifest.note(tested.choice.name, key=result.key, reused=result.reused, seconds=result.seconds)
            if result.note:
                log.warning("%s, %s: %s", part, tested.choice.name, result.note)
        manifest.write(folder)
        write_page(compared, folder, robot.name)
    if target:
        files.write_json(target, interfaces_json(compared))
    if not quiet and target != "-":
        tables.show_interfaces(compared)
        tables.show_line(f"Written to {out} in {time.perf_counter() - begun:.1f} s")


def _solids(robot: RobotFile) -> list[str]:
    """Parts that a virtual experiment can be made on. Raises InputError where there is none."""
    from stiffscope.robot.part_matrices import used_parts

    solids = [name for name in used_parts(robot) if robot.part(name).shape != "matrix"]
    if not solids:
        raise InputError(f"{robot.path}: parts: expected a rod, a plate or a STEP file's solid, got none")
    return solids


@click.command()
@takes(click.argument("file", metavar="FILE.step"), options.target)
def faces(file: str, *, target: str | None, quiet: bool) -> None:
    """The faces of a STEP file, to choose from."""
    from stiffscope.cad.faces import describe
    from stiffscope.cad.step import read_solid
    from stiffscope.report import tables

    rows = describe(read_solid(file))
    if target:
        files.write_json(target, rows)
    if not quiet and target != "-":
        tables.show_faces(file, rows)

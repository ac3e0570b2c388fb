"""The command `audit`."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import click

from stiffscope.biglide.audit import findings_on_paper
from stiffscope.biglide.show import show_findings
from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.cli.output import emit, open_workshop
from stiffscope.experiments.experiments import solve_parts
from stiffscope.experiments.orders import order_part
from stiffscope.robot.reader import load_robot

if TYPE_CHECKING:
    from stiffscope.cli.output import Output


GROUPS = {
    "Eq. (29)": "Eq. (29): compliance of the slidable platform",
    "Eq. (30a)": "Eq. (30a): stiffness at P1 with gravity",
    "Eq. (30b)": "Eq. (30b): stiffness at P2 with gravity",
    "Table 5": "Table 5: stiffness (diagonal of K) at Q1",
    "Table 6": "Table 6: stiffness (diagonal of K) at Q2",
    "text": "RMS figures of the text, %",
}


@click.command()
@takes(options.json)
def audit(*, output: Output) -> None:
    """Recompute the paper's numbers, each with a verdict."""
    robot = load_robot("biglide")
    with open_workshop(output) as shop:
        (slider,) = solve_parts([order_part(robot, "slider")], shop)
    findings = findings_on_paper(robot, slider.compliance)

    def show() -> None:
        for source, title in GROUPS.items():
            show_findings(
                title, [finding for finding in findings if finding.source == source]
            )

    emit(output, [dataclasses.asdict(finding) for finding in findings], show)

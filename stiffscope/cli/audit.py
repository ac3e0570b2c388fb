"""`stiffscope audit`: what the paper prints, recomputed as published and correctly, entry by entry."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope import files
from stiffscope.cli.run import workshop
from stiffscope.jobs.experiments import order_part, solve_parts
from stiffscope.report import tables
from stiffscope.robot import components as parts_of
from stiffscope.robot.published import published
from stiffscope.robot.robot_file import load_robot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.robot.schema import RobotFile
    from stiffscope.vjm.audit import Finding

GROUPS = {
    "Eq. (29)": "Eq. (29): compliance of the slidable platform",
    "Eq. (30a)": "Eq. (30a): stiffness at P1 with gravity",
    "Eq. (30b)": "Eq. (30b): stiffness at P2 with gravity",
    "Table 5": "Table 5: principal stiffness at Q1",
    "Table 6": "Table 6: principal stiffness at Q2",
    "text": "RMS figures of the text, %",
}


def audit(*, target: str | None, quiet: bool) -> None:
    """Show, and write as JSON, the findings on every published number."""
    robot = load_robot("biglide")
    with workshop(quiet=quiet) as (cache, spare, open_line):
        (slider,) = solve_parts(
            [order_part(robot, "slider", pictures=False)], cache, spare, {"slider": open_line("slider")}
        )
    findings = findings_on_paper(robot, slider.compliance)
    if target:
        files.write_json(target, [{k: _finite(v) for k, v in dataclasses.asdict(f).items()} for f in findings])
    if not quiet and target != "-":
        for source, title in GROUPS.items():
            tables.show_findings(title, [f for f in findings if f.source == source])


def findings_on_paper(robot: RobotFile, solid: np.ndarray) -> list[Finding]:
    """Findings on Eqs. (29) and (30), Tables 5 and 6 and the RMS figures; `solid` (6, 6) is the slider's experiment."""
    from stiffscope.fea.beam import euler_bernoulli, polar
    from stiffscope.vjm import audit as paper

    elastic = parts_of.assemble(
        robot, {name: parts_of.published_compliance(robot, name) for name in ("link", "slider")}, float(robot.link.mass)
    )
    beam = parts_of.beam_compliance(
        robot, "slider", lambda length, plate, *e: euler_bernoulli(length, polar(plate), *e)
    )
    found = paper.compliance_findings("Eq. (29)", parts_of.published_compliance(robot, "slider"), beam, solid)
    matrices = published("stiffness")
    for source, point in (("Eq. (30a)", "P1"), ("Eq. (30b)", "P2")):
        printed = np.array(matrices[point]["stiffness"]) * matrices["unit"]
        found += paper.matrix_findings(elastic, source, math.radians(matrices[point]["q_deg"]), printed)
    principal = published("principal_stiffness")
    rows = {point: _rows(principal, point) for point in ("Q1", "Q2")}
    for source, point in (("Table 5", "Q1"), ("Table 6", "Q2")):
        found += paper.principal_findings(elastic, source, math.radians(principal[point]["q_deg"]), rows[point])
    for point in ("Q1", "Q2"):
        printed = {row: values[point] for row, values in principal["rms_percent"].items()}
        found += [dataclasses.replace(f, source="text") for f in paper.rms_findings(point, printed, rows[point])]
    return found


def _rows(principal: dict[str, Any], point: str) -> dict[str, Sequence[float]]:
    rows = ("without_gravity", "with_gravity", "experiment")
    return {row: [value * principal["unit"] for value in principal[point][row]] for row in rows}


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value

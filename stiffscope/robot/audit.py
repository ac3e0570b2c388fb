"""What the paper prints, recomputed as published and correctly, entry by entry."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.robot import components as parts_of
from stiffscope.robot.published import published

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.robot.schema import RobotFile
    from stiffscope.vjm.audit import Finding


def findings_on_paper(robot: RobotFile, solid: np.ndarray) -> list[Finding]:
    """Recompute what the paper prints: Eqs. (29) and (30), Tables 5 and 6, and the RMS figures of the text.

    Parameters
    ----------
    robot
        The paper's robot.
    solid
        Compliance (6, 6) of its slider by virtual experiment, SI.

    Returns
    -------
    list of Finding
        One for each published number.

    """
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

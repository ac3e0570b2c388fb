"""Two robots side by side: tables, map of the change, JSON, page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report import maps, page
from stiffscope.report.page import Section
from stiffscope.report.run_report import write_report
from stiffscope.report.terminal import show_table
from stiffscope.vjm.mechanism import COORDINATES

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.design.comparison import RobotComparison
    from stiffscope.report.terminal import Shown

_UNITS = ("N/µm", "N/µm", "N/µm", "N·m/mrad", "N·m/mrad", "N·m/mrad")
_FACTORS = np.array([1e-6] * 3 + [1e-3] * 3)


def robots_json(found: RobotComparison) -> dict[str, Any]:
    """What scripts read: both robots' stiffness and sag at the poses, and the ratio of the diagonals."""
    diagonal = np.diagonal(found.stiffness, axis1=2, axis2=3)
    return {
        "robots": list(found.names), "poses": list(found.poses), "stiffness": found.stiffness, "sag": found.sag,
        "ratio": diagonal[1] / diagonal[0],
    }  # fmt: skip


def show_robots(found: RobotComparison) -> None:
    """Print the diagonal of the stiffness and the sag of both, and the change."""
    first, second = found.names
    diagonal = np.diagonal(found.stiffness, axis1=2, axis2=3)
    rows = [
        [pose if k == 0 else "", f"K_{('t' if k < 3 else 'r') + 'xyz'[k % 3]}", _UNITS[k]]
        + [f"{_FACTORS[k] * each:.5g}" for each in diagonal[:, p, k]]
        + [_change(*diagonal[:, p, k])]
        for p, pose in enumerate(found.poses)
        for k in range(6)
    ]
    show_table("Stiffness at M, no gravity", [["pose"], ["entry", "unit", first, second, "change"]], rows)
    least = 1e-9 * np.nanmax(np.abs(found.sag))
    rows = [
        [pose if k == 0 else "", f"{COORDINATES[k]}", "µm" if k < 3 else "µrad"]
        + [f"{1e6 * each:.4g}" for each in np.where(np.abs(found.sag[:, p, k]) < least, 0.0, found.sag[:, p, k])]
        for p, pose in enumerate(found.poses)
        for k in range(6)
    ]
    show_table("Sag under their own weight", [["pose"], ["component", "unit", first, second]], rows)


def _change(before: float, after: float) -> str:
    return f"{100 * (after / before - 1):+.2f} %" if np.isfinite(before) and np.isfinite(after) and before else ""


def draw_change(found: RobotComparison, folder: Path) -> None:
    """Write change.png and change.svg: what the second robot changes over the workspace of the first, in percent."""
    if found.change is not None:
        title = f"{found.names[1]} against {found.names[0]}: change of the stiffness"
        files = folder / "change.png", folder / "change.svg"
        maps.draw_map(found.change, maps.change_panels(found.change), found.made["first"].robot.poses, title, *files)


def write_robots_page(found: RobotComparison, folder: Path, tables: Sequence[Shown]) -> None:
    """Write report.html."""
    figures = []
    if found.change is not None:
        caption = f"Change of the stiffness at M from {found.names[0]} to {found.names[1]} over the workspace."
        figures = [page.figure(folder / "change.png", caption, "change of the stiffness over the workspace")]
    facts = [f"robots: {found.names[0]}, {found.names[1]}", "SI units at the tool point M in base axes {O}"]
    write_report(folder, " against ".join(found.names), facts, [Section("Side by side", tables, figures)])

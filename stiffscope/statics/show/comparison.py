"""Comparison of two robots: tables, map of the change, JSON, HTML page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report.page import Section
from stiffscope.report.pictures import draw, optional_pictures
from stiffscope.report.robot_scene import place_robot, scene_of
from stiffscope.report.run_report import AT_M
from stiffscope.report.tables import PUSH_WORDS
from stiffscope.report.terminal import show_line, show_table
from stiffscope.statics.show import maps
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.mechanism import COORDINATES, DIAGONAL

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.report.run_report import Draft
    from stiffscope.statics.comparison import RobotComparison

_UNITS = ("N/µm", "N/µm", "N/µm", "N·m/mrad", "N·m/mrad", "N·m/mrad")
_WORDS = ("entry", "component", "unit")
_FACTORS = np.array([1e-6] * 3 + [1e-3] * 3)


def robots_json(comparison: RobotComparison) -> dict[str, Any]:
    """Return stiffness, sag and mass of both robots, and ratios of stiffnesses, for JSON output."""
    diagonal = np.diagonal(comparison.stiffness, axis1=2, axis2=3)
    return {
        "robots": list(comparison.names),
        "poses": list(comparison.poses),
        "stiffness": comparison.stiffness,
        "push": comparison.push,
        "sag": comparison.sag,
        "mass": comparison.mass,
        "ratio": diagonal[1] / diagonal[0],
        "push_ratio": comparison.push[1] / comparison.push[0],
    }


def show_robots(comparison: RobotComparison) -> None:
    """Print K_ii, 1/C_ii, sag and mass of both robots, and the change of stiffness and mass."""
    first, second = comparison.names
    diagonal = np.diagonal(comparison.stiffness, axis1=2, axis2=3)
    rows = []
    sags = []
    sag = _round_alike(1e6 * comparison.sag.reshape(2, -1, 2, 3)).reshape(
        comparison.sag.shape
    )
    for p, pose in enumerate(comparison.poses):
        pushes = []
        for k, entry in enumerate(DIAGONAL):
            name = "" if k else pose
            held = _compare(diagonal[:, p, k], _FACTORS[k])
            rows.append([name, entry, _UNITS[k], *held])
            pushed = _compare(comparison.push[:, p, k], _FACTORS[k])
            pushes.append(["", f"1/C_{entry[2:]}", _UNITS[k], *pushed])
            unit = "µm" if k < 3 else "µrad"
            sags.append(
                [
                    name,
                    COORDINATES[k],
                    unit,
                    *(f"{value:.4g}" for value in sag[:, p, k]),
                ]
            )
        rows += pushes
    groups = [["pose"], ["entry", "unit", first, second, "change"]]
    show_table("Stiffness at M, no gravity", groups, rows, prose=_WORDS)
    show_line(f"  {PUSH_WORDS}")
    groups = [["pose"], ["component", "unit", first, second]]
    show_table("Sag under their own weight", groups, sags, prose=_WORDS)
    masses = (
        "solids (volume × density) and rigid bodies",
        *_compare(comparison.mass, 1.0),
    )
    show_table("Mass", [["kg", first, second, "change"]], [masses])


def _compare(both: np.ndarray, factor: float) -> tuple[str, str, str]:
    """Return two values in the unit of a table, and the change of the second in percent."""
    before, after = (float(state) for state in both)
    known = np.isfinite(before) and np.isfinite(after) and before
    change = f"{100 * (after / before - 1):+.2f} %" if known else ""
    first, second = (
        f"{factor * state:.5g}" if np.isfinite(state) else "rigid"
        for state in (before, after)
    )
    return first, second, change


def _round_alike(values: np.ndarray) -> np.ndarray:
    """Round values (2, n, 2, 3) to four digits of the largest of both robots, by pose and kind.

    What is below is rounding, and noise of meshes where symmetry has none.
    """
    size = np.abs(np.nan_to_num(values)).max(axis=(0, 3), keepdims=True)
    size = np.maximum(size, 1e-6 * size.max(initial=1e-6))
    step = 10.0 ** (np.floor(np.log10(size)) - 3.0)
    return np.round(values / step) * step + 0.0


def draw_both(comparison: RobotComparison, folder: Path) -> None:
    """Write both.png: the second robot at the first common pose, with outlines of the first.

    Write change.png and change.svg: change in stiffness over the first robot's map, in percent.
    """
    drawn = [scene_of(robot) for robot in comparison.robots.values()]
    places = [
        configure(robot.mechanism, comparison.places[:1])
        for robot in comparison.robots.values()
    ]
    former, now = (place_robot(place).moves for place in places)
    ghost = {
        **{key: drawn[0][key] for key in ("bodies", "joints", "tool")},
        "moves": former,
    }
    shown = {"file": "both.png", "moves": now, "ghost": ghost}
    title = f"{comparison.names[1]} at {comparison.poses[0]}; in light outlines {comparison.names[0]}"
    with optional_pictures():
        draw("robot", folder, pictures=[shown | {"title": title}], **drawn[1])
    if comparison.change is not None:
        title = f"{comparison.names[1]} against {comparison.names[0]}: change of the stiffness"
        files = folder / "change.png", folder / "change.svg"
        panels = maps.difference_panels(comparison.change, "change (%)", 100.0)
        maps.draw_map(
            comparison.change,
            panels,
            comparison.robots["first"].robot.poses,
            title,
            *files,
        )


def write_robots_page(comparison: RobotComparison, report: Draft) -> None:
    """Write report.html."""
    first, second = comparison.names
    words = "over the workspace"
    change = f"Change of the stiffness at M from {first} to {second} {words}."
    captions = {
        "both.png": (
            f"{second}, and {first} in light outlines.",
            "both robots at one pose",
        ),
        "change.png": (change, f"change of the stiffness {words}"),
    }
    facts = [f"robots: {first}, {second}", AT_M]
    sections = [Section("Side by side", report.shown, report.figures(captions))]
    report.write(" against ".join(comparison.names), facts, sections)

"""The target `compensation`: the tool's error over a grid, and tables for a controller."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from stiffscope.exports.compensation import (
    form_compensation,
    grid_text,
    levels,
    plane_table,
)
from stiffscope.exports.target import Exported, Order, Target

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.exports.compensation import Compensation


def export_compensation(order: Order) -> Exported:
    """Return the tool's error over a grid about the poses."""
    configurations = order.asked.configurations
    mechanism = order.assembled.mechanism
    grid = form_compensation(
        mechanism, configurations.poses, configurations.linkage.length
    )
    names = {
        f"beckhoff-{axis}{'' if len(levels(grid)) == 1 else f'-{level + 1}'}.lis": (
            axis,
            level,
        )
        for level in levels(grid)
        for axis in grid.axes
    }
    size = " x ".join(str(len(line)) for line in grid.lines)
    spans = "; ".join(
        f"{name} {line[0]:.4g} to {line[-1]:.4g} m"
        for name, line in zip(grid.axes, grid.lines, strict=True)
    )
    signs = (
        "an error is the tool's position less the commanded one; a correction is added to the "
        "command, and leaves the tool's rotation as it is"
    )
    remarks = [signs, "try the sign of a controller's table at one point first"]
    if not mechanism.gravity.any():
        remarks.append(
            "the robot has no gravity: the error is that of its lacks of fit"
        )
    return Exported(
        partial(_write, grid, names),
        answer={
            "files": ["grid.csv", *names],
            "axes": grid.axes,
            "before": grid.before,
            "left": grid.left,
        },
        rows=(
            ("grid", size),
            ("from", spans),
            ("greatest error between grid points", f"{1e6 * grid.before:.4g} um"),
            ("left with interpolated corrections", f"{1e6 * grid.left:.3g} um"),
        ),
        remarks=tuple(remarks),
    )


def _write(grid: Compensation, names: dict[str, tuple[str, int]], folder: Path) -> None:
    (folder / "grid.csv").write_text(grid_text(grid), encoding="utf-8")
    for name, (axis, level) in names.items():
        text = plane_table(grid, axis, level)
        (folder / name).write_text(text, encoding="utf-8")


TARGET = Target(
    name="compensation",
    help="The tool's error over a grid (CSV) and plane compensation for Beckhoff TwinCAT CNC.",
    files={
        "grid.csv": "command x y z, error dx dy dz, correction cx cy cz, m",
        "beckhoff-AXIS-LEVEL.lis": "plane compensation of an axis, 0.1 µm",
    },
    export=export_compensation,
)

"""The tool's error over a grid of commands, the commands that cancel it, and a controller's tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import (  # pyright: ignore[reportMissingTypeStubs]
    RegularGridInterpolator,
)

from stiffscope.errors import InputError
from stiffscope.vjm.model.mechanism import COORDINATES
from stiffscope.vjm.statics.analysis import sag

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array

_CELLS = 8  # of the longer side of the first two axes
_LEVELS = 4  # cells along the third axis
_SIDE = 0.2  # of the robot's length: side of a grid about one pose
_STEP = 1e-4  # m: spacings are whole multiples of it
_SHRUNK = 0.8
_ATTEMPTS = 12
_ROUNDS = 20
_SETTLED = 1e-12  # m
_UNIT = 1e-7  # m: a controller's table counts tenths of a micrometre


@dataclass(frozen=True, eq=False)
class Compensation:
    """The tool's error on a grid, and its remedy.

    Attributes
    ----------
    axes
        Names of the grid's axes, commanded translations among x, y, z.
    lines
        Commanded positions along each axis, m.
    held
        Values of the other commanded coordinates, m and rad.
    error
        (n1, …, 3) tool position less commanded one, base axes, m.
    correction
        (n1, …, a) what to add to the command of each axis so that the tool arrives there, m.
    before, left
        Greatest error between grid points, m, without and with interpolated corrections.
    """

    axes: tuple[str, ...]
    lines: tuple[Array, ...]
    held: dict[str, float]
    error: Array
    correction: Array
    before: float
    left: float

    def correct(self, points: Array) -> Array:
        """Return the corrections (n, a) at commands (n, a), interpolated linearly, m."""
        return RegularGridInterpolator(self.lines, self.correction)(points)


def form_compensation(
    mechanism: Mechanism, poses: Array, length: float
) -> Compensation:
    """Return the tool's error under weight and lacks of fit over a grid about poses.

    Parameters
    ----------
    mechanism
        The robot; its tool's small displacement is the error.
    poses
        (n, k) commanded poses that the grid spans; about a single one, a fifth of ``length``. Other
        coordinates than translations are those of the first pose.
    length
        Characteristic length of the robot, m.

    Returns
    -------
    Compensation
        Error and corrections; the grid is shrunk about its middle to what the robot reaches.

    Raises
    ------
    InputError
        Fewer than two translations are commanded, or the robot reaches no grid.
    """
    pose = mechanism.tool.pose
    axes = tuple(name for name in COORDINATES[:3] if name in pose)
    if len(axes) < 2:
        raise InputError(
            f"tool.pose: expected two or three of x, y, z for a grid, got {', '.join(pose)}; "
            "`stiffscope path JOB --compensate` corrects the commands of a path"
        )
    columns = [pose.index(name) for name in axes]
    rows = [COORDINATES.index(name) for name in axes]

    def displace(points: Array) -> Array:
        """Return tool positions less commands (n, 3); NaN out of reach."""
        commands = np.repeat(poses[:1], len(points), axis=0)
        commands[:, columns] = points
        return sag(mechanism, commands)[:, :3]

    lines, error = _reach(displace, poses[:, columns], length)
    points = _points(lines)
    correction = _correct(displace, points, rows)
    shape = error.shape[:-1]
    out = Compensation(
        axes=axes,
        lines=lines,
        held={
            n: float(v) for n, v in zip(pose, poses[0], strict=True) if n not in axes
        },
        error=error,
        correction=correction.reshape(*shape, len(axes)),
        before=0.0,
        left=0.0,
    )
    middles = _points(tuple(0.5 * (line[1:] + line[:-1]) for line in lines))
    added = out.correct(middles)
    after = added + displace(middles + added)[:, rows]
    displacement = displace(middles)[:, rows]
    before, left = (
        float(np.linalg.norm(e, axis=1).max()) for e in (displacement, after)
    )
    return Compensation(
        axes=out.axes,
        lines=out.lines,
        held=out.held,
        error=error,
        correction=out.correction,
        before=before,
        left=left,
    )


def _points(lines: tuple[Array, ...]) -> Array:
    """Return all points (n, a) of a grid, the last axis fastest."""
    return np.stack([m.ravel() for m in np.meshgrid(*lines, indexing="ij")], axis=1)


def _reach(
    displace: Callable[[Array], Array], points: Array, length: float
) -> tuple[tuple[Array, ...], Array]:
    """Return the lines of the largest grid that the robot reaches, and its errors there."""
    low = points.min(axis=0)
    high = points.max(axis=0)
    middle = 0.5 * (low + high)
    half = np.where(high > low, 0.5 * (high - low), 0.5 * _SIDE * length)
    for _ in range(_ATTEMPTS):
        # squares in the plane of the first two axes, as controllers' tables have them
        square = max(_STEP, _STEP * np.floor(2.0 * half[:2].max() / _CELLS / _STEP))
        counts = np.maximum(1, np.floor(2.0 * half / square + 1e-9)).astype(int)
        spacing = np.full(len(half), square)
        if len(half) == 3:
            counts[2] = _LEVELS
            spacing[2] = 2.0 * half[2] / _LEVELS
        start = _STEP * np.round((middle - 0.5 * counts * spacing) / _STEP)
        lines = tuple(
            s + d * np.arange(n + 1)
            for s, d, n in zip(start, spacing, counts, strict=True)
        )
        error = displace(_points(lines))
        if np.isfinite(error).all():
            return lines, error.reshape(*(len(line) for line in lines), 3)
        half = _SHRUNK * half
    raise InputError(
        "--at: expected poses with a reachable neighbourhood for a grid, got none; give poses "
        "inside the workspace"
    )


def _correct(
    displace: Callable[[Array], Array], points: Array, rows: list[int]
) -> Array:
    """Return what (n, a) to add to commands so that the tool arrives at points (n, a)."""
    out = np.zeros_like(points)
    for _ in range(_ROUNDS):
        before = out
        out = -displace(points + out)[:, rows]
        if np.isnan(out).any():
            raise InputError(
                "--at: expected a grid whose corrected commands are within reach, got one at its "
                "edge; give poses inside the workspace"
            )
        if np.abs(out - before).max() < _SETTLED:
            break
    return out


def grid_text(grid: Compensation) -> str:
    """Return the grid as CSV, m: command, error, and correction of each axis."""
    position = _points(grid.lines)
    place = {name: position[:, k] for k, name in enumerate(grid.axes)}
    fixed = {name: np.full(len(position), v) for name, v in grid.held.items()}
    error = grid.error.reshape(-1, 3)
    columns = {**{n: place.get(n, fixed.get(n)) for n in "xyz"}}
    columns = {n: v for n, v in columns.items() if v is not None}
    columns |= {f"d{n}": error[:, k] for k, n in enumerate("xyz")}
    added = grid.correction.reshape(-1, len(grid.axes))
    columns |= {f"c{n}": added[:, k] for k, n in enumerate(grid.axes)}
    rows = np.stack(list(columns.values()), axis=1)
    lines = [",".join(repr(float(v)) for v in row) for row in rows]
    return "\n".join([",".join(columns), *lines, ""])


def plane_table(grid: Compensation, axis: str, level: int) -> str:
    """Return the plane compensation of one axis for Beckhoff TwinCAT CNC and ISG kernels.

    Positions and corrections in 0.1 µm. The correction is added to the command of the axis, the
    slave; masters are the grid's first two axes. Axis numbers are 1, 2, 3 for x, y, z.

    References
    ----------
    Beckhoff Information System, TF5200 axis compensation, plane compensation (kw.crosscomp2.*),
    P-COMP-00009 to P-COMP-00017.
    """
    column = grid.axes.index(axis)
    values = grid.correction[..., column]
    if values.ndim == 3:
        values = values[:, :, level]
    counted = np.round(values / _UNIT).astype(int)
    starts = [round(float(line[0]) / _UNIT) for line in grid.lines[:2]]
    interval = round(float(grid.lines[0][1] - grid.lines[0][0]) / _UNIT)
    number = {name: k for k, name in enumerate("xyz", 1)}
    head = [
        f"kopf.achs_nr {number[axis]}",
        f"kopf.log_achs_name {axis.upper()}",
        f"kw.crosscomp2.interval {interval}",
        f"kw.crosscomp2.last_index_master1 {len(values) - 1}",
        f"kw.crosscomp2.last_index_master2 {values.shape[1] - 1}",
        f"kw.crosscomp2.start_position_master1 {starts[0]}",
        f"kw.crosscomp2.start_position_master2 {starts[1]}",
        f"kw.crosscomp2.master1_ax_nr {number[grid.axes[0]]}",
        f"kw.crosscomp2.master2_ax_nr {number[grid.axes[1]]}",
        "kw.crosscomp2.unit 1",
        "kw.crosscomp2.n_cycles 10",
    ]
    # the first index of a table is that of the second master
    body = [
        f"kw.crosscomp2.table[{j}][{i}].correction {counted[i, j]}"
        for j in range(values.shape[1])
        for i in range(len(values))
    ]
    note = "# corrections in 0.1 um, added to the command; masters in 0.1 um"
    if len(grid.lines) == 3:
        at = float(grid.lines[2][level])
        note += f"; {grid.axes[2]} = {at:.6g} m"
    return "\n".join([note, *head, *body, "End", ""])


def levels(grid: Compensation) -> range:
    """Return the indices of the planes along the third axis; one without it."""
    return range(len(grid.lines[2]) if len(grid.lines) == 3 else 1)

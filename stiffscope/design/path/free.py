"""Coordinates that the process leaves free, such as the turn about the spindle: chosen along a path for least error.

The error is predicted on a grid of values at stations of the path. Dynamic programming (R. Bellman, 1957) finds the
values of least squared error that change slowly and are nowhere worse than the best constant value; a smooth course
through them is then optimized, and verified between the stations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from stiffscope.design.path.course import BLOCK, find_errors, plan_course
from stiffscope.errors import InputError
from stiffscope.vjm.kinematics import configure
from stiffscope.vjm.mechanism import COORDINATES

if TYPE_CHECKING:
    from stiffscope.design.path.course import Course
    from stiffscope.design.path.job import Job
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.runtime.types import Array, Indices, Progress

TURN = "turn"
VALUES = 73  # tried of a coordinate, both ends among them
_STATIONS, _CHECKED = 160, 2000  # points of the path
_STEPS = 4  # of the grid between two stations, at most
_SLOWNESS = 1e-2  # weight of a step of the grid beside the squared error, in parts of the best held value's
_BENDING = 1.0  # weight of second differences, as steps
_PENALTIES = (1e2, 1e4, 1e6)  # weight of what exceeds the best held value's error
_PATIENT = {"maxiter": 20_000, "maxfun": 20_000, "ftol": 1e-14, "gtol": 1e-9}
_ALIKE = 1e-6  # relative difference of errors that does not count
_ROUNDS, _MORE = 6, 24  # of adding stations where it is worse between them
_ROOM = 1e-4  # of the greatest error: how much worse it may be at a point


@dataclass(frozen=True, eq=False)
class Freed:
    """A coordinate that was chosen along a path.

    Attributes
    ----------
    name : "turn", or a coordinate of the pose.
    values : (n,) m or rad, from what the path commands.
    held : the best value that is the same everywhere.
    before, after : greatest error that counts, m: with that value, and with `values`.
    """

    name: str
    values: Array
    held: float
    before: float
    after: float


def choose_free(job: Job, assembled: Assembled, progress: Progress | None = None) -> Job:
    """Return the job with its free coordinates chosen for the least error; as it is where none is free.

    Parameters
    ----------
    job
        The path and what loads it; `[free]` says what may be chosen, within which range.
    assembled
        The job's robot.
    progress
        Told how far it is.

    Raises
    ------
    InputError
        The robot is not commanded in such a coordinate, or reaches no value everywhere.

    """
    free = job.section.free
    for name, ends in {} if free is None else free.ranges().items():
        job = _choose(job, assembled, name, ends, progress)
    return job


def _choose(job: Job, assembled: Assembled, name: str, ends: tuple[float, float], progress: Progress | None) -> Job:
    path, pose = job.path, job.robot.tool.pose
    needed = COORDINATES[3:] if name == TURN else (name,)
    if path.by_joints or not set(needed) <= set(pose):
        words = "by joints" if path.by_joints else f"in {', '.join(pose)}"
        raise InputError(
            f"{job.file.name}: free.{name}: expected a path commanded in {', '.join(needed)}, got one {words}"
        )
    course = plan_course(job, assembled)
    grid = np.linspace(*ends, VALUES)

    def find(which: Indices, values: Array) -> Array:
        return _find_error(course, assembled, name, which, values)

    def tabulate(stations: Indices) -> Array:
        columns = []
        for k, value in enumerate(grid):
            columns.append(find(stations, np.full(len(stations), value)))
            if progress is not None:
                progress(f"free {name}", (k + 1) / VALUES)
        return np.column_stack(columns)

    stations, checked = _spread(len(path), _STATIONS), _spread(len(path), _CHECKED)
    table = tabulate(stations)
    best = _find_best(table, grid)
    if best is None:
        stuck = np.flatnonzero(np.isnan(table).all(axis=1))
        line = path.lines[int(stations[stuck[0] if len(stuck) else 0])]
        raise InputError(f"{job.path_file.name}:{line}: no {name} in its range is within reach along the whole path")
    held = np.abs(find(checked, np.full(len(checked), grid[best])))
    room, margin = _ROOM * held.max(), np.zeros(len(stations))
    for _ in range(_ROUNDS):
        chosen = _refine(table, grid, best, _find_slow(table, best), margin)
        values = PchipInterpolator(stations, chosen)(np.arange(len(path)))
        found = np.abs(find(checked, values[checked]))
        worse = checked[~(found <= held + room)]
        if not len(worse):
            break
        beyond = np.abs(find(stations, chosen)) - np.abs(table[:, best])  # what the curves over the grid miss
        margin += 1.5 * np.nan_to_num(beyond, nan=0.0).clip(min=0.0)
        more = np.setdiff1d(worse[_spread(len(worse), _MORE)], stations)
        stations, order = np.unique(np.concatenate([stations, more]), return_index=True)
        table = np.concatenate([table, tabulate(more)])[order]
        margin = np.concatenate([margin, np.zeros(len(more))])[order]
    else:  # between the stations it stays worse than the held value
        values, found = np.full(len(path), grid[best]), held
    freed = Freed(name, values, float(grid[best]), float(held.max()), float(found.max()))
    turned = replace(path.command(_turn(course, name, np.arange(len(path)), values)), program=None, place=None)
    return replace(job, path=turned, freed=(*job.freed, freed))


def _find_best(table: Array, grid: Array) -> int | None:
    """The value that is best held, of those alike the one nearest to the command; None where none is in reach."""
    worst = np.where(np.isnan(table), np.inf, np.abs(table)).max(axis=0)
    if not np.isfinite(worst.min()):
        return None
    return int(np.argmin(np.where(worst <= worst.min() * (1.0 + _ALIKE), np.abs(grid), np.inf)))


def _spread(count: int, most: int) -> Indices:
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def _turn(course: Course, name: str, which: Indices, values: Array) -> Array:
    """Commands (m, k) at points of the path with other values (m,) of a coordinate."""
    pose, out = list(course.job.robot.tool.pose), course.job.path.values[which].copy()
    if name != TURN:
        out[:, pose.index(name)] += values
        return out
    turns = [pose.index(each) for each in COORDINATES[3:]]
    about = Rotation.from_rotvec(values[:, None] * course.axes.spindle[which])
    out[:, turns] = (about * Rotation.from_rotvec(out[:, turns])).as_rotvec()
    return out


def _find_error(course: Course, assembled: Assembled, name: str, which: Indices, values: Array) -> Array:
    """The error (m,) that counts at points of the path, with other values of a coordinate; NaN out of reach."""
    free, commands = course.job.section.free, _turn(course, name, which, values)
    out = np.full(len(which), np.nan)
    for start in range(0, len(which), BLOCK):
        some = slice(start, start + BLOCK)
        found = configure(assembled.mechanism, commands[some])
        reached = np.flatnonzero(found.valid)
        if not len(reached):
            continue
        at = which[some][reached]
        twist = find_errors(course.job, assembled, found[reached], course.wrench[at]).twist[:, :3, 0]
        counted = course.axes.binormal if free is not None and free.least == "binormal" else course.axes.normal
        out[start + reached] = np.einsum("ni,ni->n", twist, counted[at])
    return out


def _find_slow(table: Array, best: int) -> Indices:
    """Columns (s,) of least squared error (s, g) that change slowly and are nowhere worse than the best held one."""
    limit = np.abs(table[:, best])
    allowed = np.abs(table) <= limit[:, None] + _ROOM * limit.max()
    cost = np.where(allowed, (table / (limit.max() or 1.0)) ** 2, np.inf)
    cost[:, best] = (limit / (limit.max() or 1.0)) ** 2
    cost += _ALIKE * np.abs(np.arange(table.shape[1]) - best)
    steps = np.arange(-_STEPS, _STEPS + 1)
    columns = np.arange(table.shape[1])
    before = columns[:, None] - steps
    inside = (before >= 0) & (before < table.shape[1])
    before = before.clip(0, table.shape[1] - 1)
    total, came = cost[0], np.zeros(table.shape, dtype=int)
    for row in range(1, len(table)):
        ways = np.where(inside, total[before] + _SLOWNESS * steps**2, np.inf)
        chosen = ways.argmin(axis=1)
        came[row] = before[columns, chosen]
        total = ways[columns, chosen] + cost[row]
    out = [int(np.argmin(total))]
    for row in range(len(table) - 1, 0, -1):
        out.append(int(came[row, out[-1]]))
    return np.array(out[::-1])


def _refine(table: Array, grid: Array, best: int, start: Indices, margin: Array) -> Array:
    """Values (s,) that follow a first course smoothly, by curves of the errors over the grid."""
    unit, held = grid[1] - grid[0], np.abs(table[:, best])
    scale, limit = held.max() or 1.0, (held - margin).clip(min=0.0)
    known = np.where(np.isnan(table), 10.0 * np.nanmax(np.abs(table)), table) / scale
    curves = PchipInterpolator(np.arange(len(grid)), known.T)
    slopes = curves.derivative()
    rows = np.arange(len(table))

    def measure(at: Array, penalty: float) -> tuple[float, Array]:
        value, slope = curves(at)[rows, rows], slopes(at)[rows, rows]
        over = np.maximum(value**2 - (limit / scale) ** 2, 0.0)
        bent = np.diff(at, 2)
        cost = (value**2).sum() + penalty * over.sum() + _BENDING * (bent**2).sum()
        gradient = 2.0 * value * slope * (1.0 + penalty * (over > 0.0))
        for k, weight in enumerate((1.0, -2.0, 1.0)):
            gradient[k : len(at) - 2 + k] += 2.0 * _BENDING * weight * bent
        return cost, gradient

    ends = [(0.0, len(grid) - 1.0)] * len(table)
    at = start.astype(float)
    for penalty in _PENALTIES:
        at = minimize(measure, at, (penalty,), jac=True, method="L-BFGS-B", bounds=ends, options=_PATIENT).x
    return grid[0] + unit * at

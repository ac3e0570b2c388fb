"""Smooth choice of the coordinates left free by the process, for minimum error along a path.

Dynamic programming over a grid of the coordinate (R. Bellman, Dynamic Programming, Princeton 1957)
finds a path, which Gauss-Newton steps refine. No point may be worse than with the best fixed value.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.linalg import solve_banded

from stiffscope.errors import require
from stiffscope.path.course import Axes, pick_evenly, respond_under, tool_error
from stiffscope.vjm.kinematics.configurations import configure, learn_configurations
from stiffscope.vjm.model.mechanism import COORDINATES

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.path.course import Course
    from stiffscope.path.job import Job, Motion
    from stiffscope.path.toolpath import ToolPath
    from stiffscope.runtime.types import Array, Flags, Indices
    from stiffscope.vjm.kinematics.configurations import Configurations

FIXED = 72  # values tried per full turn
STATIONS = 100  # points where coordinates are chosen; they are interpolated in between
_JUMP = 0.8  # rad or m; largest motion of a drive between stations
_BEND = 1e-3  # cost of a change of one grid step, over the mean square error
_ROUNDS = 16
_STEPS = 15
_LEARNT = 1200  # poses solved first, as starting points for all others
_SMOOTHINGS = 4
_TINY = 1e-10  # m
_BLOCK = 4096


@dataclass(frozen=True, eq=False)
class FreeChoice:
    """A course and its commands with the free coordinates chosen.

    Attributes
    ----------
    values
        Values (n,) by free coordinate, rad or m.
    fixed
        Best constant value by free coordinate.
    error, before
        Minimized error (n,), m, with the chosen and with the best constant values.
    """

    course: Course
    path: ToolPath
    values: dict[str, Array]
    fixed: dict[str, float]
    error: Array
    before: Array


@dataclass(frozen=True, eq=False)
class _Problem:
    """A course with free coordinates to choose; ``motions`` in the order they act on the tool."""

    job: Job
    assembled: Assembled
    course: Course
    motions: tuple[Motion, ...]
    configure: Callable[[Array], Configurations]

    def place(self, values: Array, stations: Indices) -> Course:
        """Return the course at some points (m,) for values (m, c)."""
        tool = self.course.tool[stations]
        at = self.course.axes
        turned = np.broadcast_to(np.eye(3), (len(stations), 3, 3))
        for motion, value in zip(self.motions, values.T, strict=True):
            tool, more = motion.place(tool, value)
            turned = more @ turned
        wrench = self.course.wrench[stations].reshape(-1, 2, 3)
        both = np.einsum("nij,nkj->nki", turned, wrench).reshape(-1, 6)
        directions = (at.along, at.normal, at.binormal, at.spindle)
        axes = Axes(
            *(
                np.einsum("nij,nj->ni", turned, direction[stations])
                for direction in directions
            )
        )
        return replace(self.course, tool=tool, axes=axes, wrench=both)

    def commands(self, course: Course) -> Array:
        """Return the commanded poses (m, k). Raise InputError if the robot lacks coordinates."""
        pose = [COORDINATES.index(name) for name in self.job.robot.tool.pose]
        home = np.array([*self.job.robot.tool.at, 0.0, 0.0, 0.0])
        moves = np.ptp(course.tool - home, axis=0) > 1e-9
        missing = [COORDINATES[k] for k in np.flatnonzero(moves) if k not in pose]
        what = f"a robot whose pose commands {', '.join(missing)} too"
        require(not missing, f"{self.job.file.name}: free", what)
        return course.tool[:, pose]

    def evaluate(self, values: Array, stations: Indices) -> tuple[Array, Array]:
        """Return the signed objective error (m,), infinite if unreachable, and drives (m, d)."""
        error = np.full(len(stations), np.inf)
        drives = np.full((len(stations), len(self.assembled.mechanism.drives)), np.nan)
        for start in range(0, len(stations), _BLOCK):
            block = slice(start, start + _BLOCK)
            course = self.place(values[block], stations[block])
            configurations = self.configure(self.commands(course))
            good = np.flatnonzero(configurations.valid)
            if not good.size:
                continue
            configurations = configurations[good]
            state = respond_under(
                self.job, self.assembled, configurations, course.wrench[good]
            )
            off = tool_error(
                course.tool[good], configurations.tool, state.twist[..., 0]
            )[:, :3]
            least = self.job.section.free.least  # type: ignore[union-attr]
            error[start + good] = np.linalg.norm(off, axis=1)
            if least != "size":
                axes = getattr(course.axes, least)[good]
                error[start + good] = np.einsum("ni,ni->n", off, axes)
            drives[start + good] = configurations.drives
        return error, drives


def choose_free_coordinates(course: Course, assembled: Assembled) -> FreeChoice:
    """Choose the free coordinates of a job along its path.

    Parameters
    ----------
    course, assembled
        Course of the job with zero free coordinates, and assembled robot of the job.

    Returns
    -------
    FreeChoice
        Values that are nowhere worse than the best constant ones (72 per turn); the constant values
        themselves if no smooth choice is better.

    Raises
    ------
    InputError
        No constant value reaches the whole path, or the robot cannot command the free motion.
    """
    job = course.job
    section = course.job.section
    motions = section.free.motions(section.axis) if section.free is not None else ()
    require(motions, f"{job.file.name}: free", "spindle, table or slide", "none")
    problem = _Problem(
        job, assembled, course, motions, partial(configure, assembled.mechanism)
    )
    n = len(job.path)
    stations = pick_evenly(n, STATIONS)
    acting = job.path.acting
    values = np.tile([motion.start for motion in motions], (len(stations), 1))
    rng = np.random.default_rng(0)
    spread = np.column_stack([rng.uniform(*motion.ends, _LEARNT) for motion in motions])
    poses = problem.commands(problem.place(spread, rng.choice(n, _LEARNT)))
    problem = replace(
        problem, configure=learn_configurations(assembled.mechanism, poses)
    )
    grids: list[tuple[Array, Array]] = []
    for k in range(len(motions)):  # the best constant values
        error, drives = _scan(problem, values, k, stations)
        counts = acting[stations, None] | ~np.isfinite(error)
        values[:, k] = _best_single(
            problem, values[0], k, np.where(counts, error, 0.0), acting
        )
        grids.append((error, drives))
    fixed = dict(
        zip((motion.name for motion in motions), values[0].tolist(), strict=True)
    )
    every = np.arange(n)
    single = np.tile(values[0], (n, 1))
    before, _ = problem.evaluate(single, every)
    reached = np.isfinite(before)
    require(
        reached.all(),
        f"{job.path_file.name}:{job.path.lines[int(np.argmin(reached))]}",
        "a path that one value of the free coordinates reaches",
    )
    limit = np.where(acting, np.abs(before), np.inf)
    for k in range(len(motions)):
        found = _scan(problem, values, k, stations) if len(motions) > 1 else grids[k]
        valley = _follow_valley(
            problem, k, stations, *found, limit[stations], values[:, k]
        )
        values[:, k] = valley
    chosen = _settle(problem, values, stations, limit, single)
    error, _ = problem.evaluate(chosen, every)
    placed = problem.place(chosen, every)
    named = {motion.name: chosen[:, k] for k, motion in enumerate(motions)}
    path = replace(
        job.path,
        columns=tuple(job.robot.tool.pose),
        values=problem.commands(placed),
        program=None,
        free=named,
    )
    return FreeChoice(
        course=placed,
        path=path,
        values=named,
        fixed=fixed,
        error=np.abs(error),
        before=np.abs(before),
    )


def _scan(
    problem: _Problem, values: Array, k: int, stations: Indices
) -> tuple[Array, Array]:
    """Return errors (m, g) and drives (m, g, d) on the grid of a coordinate."""
    grid = problem.motions[k].grid(FIXED)
    m = len(stations)
    g = len(grid)
    tried = np.repeat(values, g, axis=0)
    tried[:, k] = np.tile(grid, m)
    error, drives = problem.evaluate(tried, np.repeat(stations, g))
    return np.abs(error).reshape(m, g), drives.reshape(m, g, -1)


def _best_single(
    problem: _Problem, values: Array, k: int, error: Array, acting: Flags
) -> float:
    """Return the grid value with the smallest maximum error; ``error`` (m, g) is at stations."""
    grid = problem.motions[k].grid(FIXED)
    every = np.arange(len(acting))
    best = (True, np.inf)
    found = float(values[k])
    least = error.max(axis=0)
    for g in np.argsort(least):
        if (False, least[g]) >= best:  # so are all later values
            break
        tried = np.tile(values, (len(every), 1))
        tried[:, k] = grid[g]
        exact, drives = problem.evaluate(tried, every)
        worst = float(np.where(acting | ~np.isfinite(exact), np.abs(exact), 0.0).max())
        jumps = not np.abs(np.diff(drives, axis=0)).max(initial=0.0) <= _JUMP
        if (jumps, worst) < best:
            best = (jumps, worst)
            found = float(grid[g])
    return found


def _follow_valley(
    problem: _Problem,
    k: int,
    stations: Indices,
    error: Array,
    drives: Array,
    limit: Array,
    single: Array,
) -> Array:
    """Return grid values (m,) with the least sum of squared errors and bounded steps."""
    motion = problem.motions[k]
    course = problem.course
    grid = motion.grid(FIXED)
    step = float(grid[1] - grid[0])
    (m, g) = error.shape
    acts = np.isfinite(limit)[:, None]
    allowed = np.where(acts, error <= limit[:, None] * (1.0 + 1e-9), np.isfinite(error))
    scale = max(float(np.mean(limit[acts[:, 0]] ** 2)), 1e-300)
    cost = np.where(allowed, np.where(acts & allowed, error, 0.0) ** 2 / scale, np.inf)
    total = cost[0]
    origin = np.zeros((m, g), dtype=int)
    reach = np.maximum(1, np.diff(course.length[stations]) * motion.rate / step).astype(
        int
    )
    for i in range(1, m):
        best = np.full(g, np.inf)
        source = np.zeros(g, dtype=int)
        most = min(reach[i - 1], g - 1)
        for shift in range(-most, most + 1):
            to = np.arange(max(0, shift), min(g, g + shift))
            moved = np.abs(drives[i, to] - drives[i - 1, to - shift]).max(
                axis=1, initial=0.0
            )
            tried = np.where(
                moved < _JUMP, total[to - shift] + _BEND * shift**2, np.inf
            )
            better = tried < best[to]
            best[to[better]], source[to[better]] = tried[better], (to - shift)[better]
        total = best + cost[i]
        origin[i] = source
    if not np.isfinite(total).any():
        return single.copy()
    which = np.empty(m, dtype=int)
    which[-1] = int(np.argmin(total))
    for i in range(m - 1, 0, -1):
        which[i - 1] = origin[i, which[i]]
    levels = grid[which]
    for _ in range(_SMOOTHINGS):  # smooth the grid steps before the descent
        levels[1:-1] = 0.25 * (levels[:-2] + 2.0 * levels[1:-1] + levels[2:])
    return levels


def _settle(
    problem: _Problem, values: Array, stations: Indices, limit: Array, single: Array
) -> Array:
    """Return smooth values (n, c), blended with the constants if they exceed the limit (n,)."""
    every = np.arange(len(limit))
    acts = np.isfinite(limit)
    scale = max(float(np.mean(limit[acts] ** 2)), 1e-300)
    for k in range(len(problem.motions)):
        values = _descend(
            problem=problem,
            values=values,
            k=k,
            stations=stations,
            acts=acts[stations],
            scale=scale,
        )
    spread = values[:1]
    if len(stations) > 1:
        spread = PchipInterpolator(stations, values, axis=0)(every)
    share = np.ones(len(limit))
    width = max(2.0, len(limit) / 50)
    for number in range(_ROUNDS):
        tried = single + share[:, None] * (spread - single)
        error, drives = problem.evaluate(tried, every)
        wrong = ~np.isfinite(error) | (
            acts & (np.abs(error) > limit * (1.0 + 1e-6) + _TINY)
        )
        wrong[1:] |= np.abs(np.diff(drives, axis=0)).max(axis=1, initial=0.0) > _JUMP
        if not wrong.any():
            return tried
        off = np.abs(every[:, None] - np.flatnonzero(wrong)[None, :]).min(axis=1)
        share *= 1.0 - (0.5 if number < _ROUNDS // 2 else 1.0) * np.exp(
            -((off / width) ** 2)
        )
    return single


def _descend(
    problem: _Problem,
    values: Array,
    k: int,
    stations: Indices,
    acts: Flags,
    scale: float,
) -> Array:
    """Minimize squared errors and second differences of a coordinate by Gauss-Newton steps."""
    motion = problem.motions[k]
    grid = motion.grid(FIXED)
    step = float(grid[1] - grid[0])
    m = len(values)
    small = 1e-3 * step
    if m < 3:
        return values
    bends = np.diff(np.eye(m), 2, axis=0) / step
    stiff = 10.0 * _BEND * bends.T @ bends
    bands = ((np.diagonal(stiff, d), d) for d in (2, 1, 0, -1, -2))
    banded = np.array([np.pad(band, (max(d, 0), max(-d, 0))) for band, d in bands])

    def cost(tried: Array) -> tuple[float, Array]:
        error, _ = problem.evaluate(tried, stations)
        error = np.where(acts | ~np.isfinite(error), error, 0.0)
        whole = np.sum(error**2) / scale + 10.0 * _BEND * np.sum(
            (bends @ tried[:, k]) ** 2
        )
        return float(whole), error

    now, error = cost(values)
    for _ in range(_STEPS):
        other = values.copy()
        other[:, k] += np.where(values[:, k] + small > motion.ends[1], -small, small)
        slope = (cost(other)[1] - error) / (other[:, k] - values[:, k])
        slope = np.where(np.isfinite(slope), slope, 0.0)
        downhill = -(slope * error / scale + stiff @ values[:, k])
        low = (values[:, k] <= motion.ends[0]) & (downhill < 0)
        high = (values[:, k] >= motion.ends[1]) & (downhill > 0)
        matrix = banded.copy()
        matrix[2] += slope**2 / scale + np.where(low | high, 1e9, 1e-6) / step**2
        change = solve_banded((2, 2), matrix, downhill)
        change *= min(1.0, 2.0 * step / max(float(np.abs(change).max()), 1e-300))
        for _ in range(5):
            tried = values.copy()
            tried[:, k] = np.clip(values[:, k] + change, *motion.ends)
            new, improved = cost(tried)
            if new < now:
                break
            change *= 0.3
        else:
            break
        gain = now - new
        values = tried
        now = new
        error = improved
        if gain < 1e-6 * now:
            break
    return values

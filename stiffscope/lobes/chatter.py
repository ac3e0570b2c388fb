"""Stability of a job's cut: limits along the path, lobes at poses, bands and causes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter

from stiffscope.errors import InputError
from stiffscope.experiments.assembly import name_robot
from stiffscope.lobes.bands import relative_error
from stiffscope.lobes.cutting import cutting_of
from stiffscope.lobes.damping import (
    check_damping,
    damping_of,
    list_measured,
    lobes_section,
)
from stiffscope.lobes.holder import find_holder_modes
from stiffscope.lobes.levers import find_levers
from stiffscope.lobes.limits import Limits, join_limits
from stiffscope.lobes.methods import limits_at, sweep_limits, worst_limits
from stiffscope.lobes.model import Lobes, Stability
from stiffscope.lobes.response import couple_holder, tool_response
from stiffscope.lobes.zero_order import find_coupling
from stiffscope.path.along import along as predict_along
from stiffscope.path.course import configure_path, find_axes, pick_evenly
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.screws import rotation_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.lobes.damping import Rated
    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.methods import Method
    from stiffscope.lobes.model import Cutting
    from stiffscope.lobes.response import ToolResponse
    from stiffscope.path.job import Job
    from stiffscope.runtime.types import Array, Indices, Progress
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.vibration.modes import Modes

MOST_POINTS = 2000  # of a path at which limits are computed
FEW_POINTS = 200  # of a path, in each design of a study
STATIONS = 3  # poses of the lobes along a path, besides the worst
_CHUNK = 256  # poses at a time
_ALIKE = 9  # neighbouring speeds, the median of whose bands counts
_ADVISED = 3  # speeds
_APART = 0.03  # of the range of speeds between two of them


@dataclass(frozen=True, eq=False)
class Stretch:
    """Configurations, tool poses (n, 6) and axes (n, 3, 3) of the cut at points of a path.

    ``points``: indices of the points in the path; ``length`` (n,) from its start, m.
    """

    found: Configurations
    tool: Array
    axes: Array
    points: Indices
    length: Array


def files_of(job: Job) -> list[Path]:
    """Return the files that a job's results depend on, besides itself and its robot."""
    section = getattr(job.section, "lobes", None)
    files = [job.path_file]
    if section is not None:
        files += list_measured(job)
        if section.responses is not None:
            files.append(job.file.parent / section.responses.file)
    return files


def check_cut(job: Job) -> None:
    """Raise InputError if a job lacks what the stability of its cut needs."""
    cutting_of(job)
    check_damping(job)
    find_holder_modes(job)


def respond(
    assembled: Assembled, found: Configurations, axes: Array, rated: Rated
) -> tuple[ToolResponse, Modes]:
    """Return the response of the robot at its tool point, and its modes."""
    with name_robot(assembled.robot):
        return tool_response(assembled.mechanism, found, axes, rated)


def holder_of(job: Job) -> Callable[[ToolResponse], ToolResponse]:
    """Return a function from the robot's response to that at the tip of its tool."""
    modes = find_holder_modes(job)
    if modes is None:
        return lambda response: response
    return lambda response: couple_holder(response, modes)


def speed_range(job: Job, cutting: Cutting) -> tuple[float, float]:
    """Return the slowest and fastest speed of [lobes], rev/s, or half and double the job's."""
    given = lobes_section(job).speeds
    return given or (0.5 * cutting.speed, 2.0 * cutting.speed)


def method_of(job: Job, cut: Engagement) -> Method:
    """Return the method: all harmonics for few teeth or small radial depth."""
    wanted = lobes_section(job).method
    if wanted != "auto":
        return wanted
    return "all-harmonics" if cut.interrupted else "zero-order"


def stretch_of(job: Job, assembled: Assembled, most: int = MOST_POINTS) -> Stretch:
    """Return the points of a job's path that cut, at most so many, evenly spread."""
    path = job.path
    if job.section.free is not None:
        state = predict_along(job, assembled)
        path = state.path
    blocks = list(configure_path(job, assembled, path))
    tool = np.concatenate([block.tool for block in blocks])
    axes = cut_axes(job, tool)
    acting = np.flatnonzero(path.acting)
    if not acting.size:
        expected = "expected a move that cuts"
        raise InputError(f"{job.path_file.name}: {expected}, got rapid moves alone")
    points = acting[pick_evenly(len(acting), most)]
    steps = np.linalg.norm(np.diff(tool[:, :3], axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    found = blocks[0][points] if len(blocks) == 1 else None
    if found is None:  # a long path: its points once more, from their tool poses
        pose = assembled.mechanism.tool.pose
        found = configure(assembled.mechanism, _pose_columns(tool[points], pose))
    return Stretch(found, tool[points], axes[points], points, length[points])


def _pose_columns(tool: Array, pose: tuple[str, ...]) -> Array:
    order = ("x", "y", "z", "rx", "ry", "rz")
    return tool[:, [order.index(name) for name in pose]]


def cut_axes(job: Job, tool: Array) -> Array:
    """Return feed, normal and spindle as rows (n, 3, 3) along a path of tool poses (n, 6)."""
    axes = find_axes(job, tool)
    return _square_axes(axes.normal, axes.spindle)


def named_axes(job: Job, tool: Array) -> Array:
    """Return the same at poses off the path, with the feed along the job's x."""
    axis = np.array(job.section.axis) / np.linalg.norm(job.section.axis)
    spindle = rotation_of(tool[:, 3:]) @ axis
    normal = np.cross(spindle, job.section.x)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    if (size < 1e-9).any():
        expected = "expected a feed across the spindle"
        raise InputError(f"{job.file}: x: {expected}, got one along it")
    return _square_axes(normal / size, spindle)


def _square_axes(normal: Array, spindle: Array) -> Array:
    return np.stack([np.cross(normal, spindle), normal, spindle], axis=1)


def judge(
    job: Job,
    assembled: Assembled,
    found: Configurations,
    axes: Array,
    progress: Progress | None = None,
) -> Stability:
    """Return the limits of a job's cut at n configurations.

    Parameters
    ----------
    job, assembled
        Job with a cut and [lobes], and its robot.
    found, axes
        Configurations, and axes (n, 3, 3) of the cut there.
    progress
        Progress callback.
    """
    cutting = cutting_of(job)
    couple = holder_of(job)
    rated = damping_of(job, assembled)
    parts = list[Stability]()
    for start in range(0, len(found), _CHUNK):
        some = np.arange(start, min(start + _CHUNK, len(found)))
        robot, shaken = respond(assembled, found[some], axes[some], rated)
        tool = found.tool[some]
        parts.append(_judge(job, cutting, couple(robot), shaken, tool))
        if progress is not None:
            progress("limits", (int(some[-1]) + 1) / len(found))
    return _join(parts)


def _join(parts: list[Stability]) -> Stability:
    if len(parts) == 1:
        return parts[0]

    def join(name: str) -> Array:
        return np.concatenate([getattr(part, name) for part in parts])

    names = parts[0].shares
    shares = {
        name: np.concatenate([part.shares[name] for part in parts]) for name in names
    }
    return Stability(
        tool=join("tool"),
        critical=join_limits([part.critical for part in parts]),
        critical_error=join("critical_error"),
        limit=join("limit"),
        limit_error=join("limit_error"),
        coupling=join("coupling"),
        mode=join("mode"),
        shares=shares,
    )


def _judge(
    job: Job, cutting: Cutting, response: ToolResponse, shaken: Modes, tool: Array
) -> Stability:
    cut = cutting.cut
    force_error = lobes_section(job).kt_error
    method = method_of(job, cut)
    critical = worst_limits(response, cut, speed_range(job, cutting), method)
    limit = limits_at(response, cut, np.array([cutting.speed]), method)[:, 0]
    mode = np.abs(critical.shares).argmax(axis=1)
    poses = np.arange(len(tool))
    return Stability(
        tool=tool,
        critical=critical,
        critical_error=relative_error(critical, response, force_error, method),
        limit=limit.depth,
        limit_error=relative_error(limit, response, force_error, method),
        coupling=find_coupling(response, cut),
        mode=response.rates[poses, mode] / (2.0 * np.pi),
        shares=_element_shares(response, shaken, mode),
    )


def _element_shares(
    response: ToolResponse, shaken: Modes, mode: Indices
) -> dict[str, Array]:
    """Return each element's share (n,) in the strain energy of a mode (n,) at each pose."""
    poses = np.arange(len(mode))
    energy = {name: np.nan_to_num(share) for name, share in shaken.energy.items()}
    if response.origin is None:
        return {name: share[poses, mode] for name, share in energy.items()}
    own = shaken.frequencies.shape[1]
    of_modes = response.origin[poses, :own, mode]
    shares = {name: (share * of_modes).sum(axis=1) for name, share in energy.items()}
    shares["tool holder"] = response.origin[poses, own:, mode].sum(axis=1)
    return shares


def critical_along(job: Job, assembled: Assembled) -> Array:
    """Return the depth of cut (n,), m, stable at all speeds of the range, by point of the path.

    Points without a cut have the value of the nearest point that cuts.
    """
    stretch = stretch_of(job, assembled, FEW_POINTS)
    depth = judge(job, assembled, stretch.found, stretch.axes).critical.depth
    nearest = np.searchsorted(
        0.5 * (stretch.points[1:] + stretch.points[:-1]), np.arange(len(job.path))
    )
    return depth[nearest]


def find_lobes(
    job: Job,
    assembled: Assembled,
    at: tuple[tuple[str, ...], Configurations] | None = None,
    progress: Progress | None = None,
) -> Lobes:
    """Return the stability of a job's cut along its path, and its lobes at poses.

    Parameters
    ----------
    job, assembled
        Job with [process.milling] and [lobes], and its robot.
    at
        Names and configurations of the poses of the lobes; by default points of the path, among
        them the worst.
    progress
        Progress callback.

    Raises
    ------
    InputError
        The job has no milling or no damping, a pose is out of reach, or the robot has no masses.
    """
    section = lobes_section(job)
    cutting = cutting_of(job)
    cut = cutting.cut
    method = method_of(job, cut)
    stretch = stretch_of(job, assembled)
    limits = judge(job, assembled, stretch.found, stretch.axes, progress)
    if at is None:
        worst = int(np.argmin(limits.critical.depth))
        some = np.unique([worst, *pick_evenly(len(stretch.points), STATIONS)])
        names = tuple(
            f"{1e3 * stretch.length[k]:.0f} mm{' (worst)' * int(k == worst)}"
            for k in some
        )
        found = stretch.found[some]
        axes = stretch.axes[some]
    else:
        names, found = at
        axes = named_axes(job, found.tool)
    here = judge(job, assembled, found, axes)
    speeds = np.linspace(*speed_range(job, cutting), section.points)
    robot, _ = respond(assembled, found, axes, damping_of(job, assembled))
    couple = holder_of(job)
    response = couple(robot)
    parts = list[Limits]()
    for start in range(0, len(found), _CHUNK // 8):
        some = slice(start, start + _CHUNK // 8)
        parts.append(sweep_limits(response[some], cut, speeds, method))
        if progress is not None:
            progress("lobes", min(1.0, (start + _CHUNK // 8) / len(found)))
    lobes = join_limits(parts)
    # where two lobes meet, changes of first order diverge
    width = median_filter(
        relative_error(lobes, response, section.kt_error, method),
        (1, _ALIKE),
        mode="nearest",
    )
    low = lobes.depth * np.exp(-width)
    high = lobes.depth * np.exp(width)
    worst = int(np.argmin(here.critical.depth))
    one = np.array([worst])
    levers = find_levers(
        assembled.mechanism,
        found[one],
        robot[one],
        couple=couple,
        cut=cut,
        axes=axes[worst],
        speed=float(here.critical.speed[worst]),
        method=method,
    )
    advised = _advise(low.min(axis=0), speeds)
    return Lobes(
        job=job,
        cutting=cutting,
        method=method,
        names=names,
        found=found,
        at=here,
        speeds=speeds,
        depth=lobes.depth,
        low=low,
        high=high,
        levers=levers,
        advised=speeds[advised],
        advised_depth=low.min(axis=0)[advised],
        along=limits,
        points=stretch.points,
        length=stretch.length,
    )


def _advise(lowest: Array, speeds: Array) -> Indices:
    """Return indices of the speeds with the highest depths (s,) among their neighbours."""
    order = np.argsort(-lowest, kind="stable")
    reach = _APART * (speeds[-1] - speeds[0])
    chosen = list[int]()
    for k in order:
        peak = lowest[k] >= lowest[max(k - 1, 0) : k + 2].max()
        if peak and all(abs(speeds[k] - speeds[j]) > reach for j in chosen):
            chosen.append(int(k))
        if len(chosen) == _ADVISED:
            break
    return np.array(chosen, dtype=int)

"""Stability of a job's cut: limits along the path, lobes at poses, bands and causes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.experiments.assembly import name_robot
from stiffscope.lobes.bands import critical_error, depth_band
from stiffscope.lobes.engagement import milling
from stiffscope.lobes.floquet import interrupted_depth
from stiffscope.lobes.levers import find_levers
from stiffscope.lobes.model import Cutting, Lobes, Stability
from stiffscope.lobes.response import couple_holder, tool_response
from stiffscope.lobes.zero_order import (
    find_critical,
    join_criticals,
    zero_order_depth,
)
from stiffscope.path.along import along as predict_along
from stiffscope.path.course import configure_path, find_axes, pick_evenly
from stiffscope.runtime.table import numbers, read_table
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.screws import rotation_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.model import LobesSection
    from stiffscope.lobes.response import ToolResponse
    from stiffscope.lobes.zero_order import Critical
    from stiffscope.path.job import Job, MillingSection
    from stiffscope.runtime.types import Array, Indices, Progress
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.vibration.modes import Modes

    Rated = Callable[[Array], tuple[Array, Array]]

MOST_POINTS = 2000  # of a path at which limits are computed
FEW_POINTS = 200  # of a path, in each design of a study
STATIONS = 3  # poses of the lobes along a path, besides the worst
_CHUNK = 256  # poses at a time
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


def lobes_section(job: Job) -> LobesSection:
    """Return the section [lobes] of a job. Raise InputError if it is missing."""
    section = getattr(job.section, "lobes", None)
    if section is None:
        expected = "expected a section with the damping of the modes"
        raise InputError(f"{job.file}: lobes: {expected}, got none")
    return section


def files_of(job: Job) -> list[Path]:
    """Return the files that a job's results depend on, besides itself and its robot."""
    section = getattr(job.section, "lobes", None)
    if section is None or section.measured is None:
        return [job.path_file]
    return [job.path_file, job.file.parent / section.measured]


def check_cut(job: Job) -> None:
    """Raise InputError if a job lacks what the stability of its cut needs."""
    cutting_of(job)
    damping_of(job)


def cutting_of(job: Job) -> Cutting:
    """Return the milling cut of a job. Raise InputError if there is none.

    The force of a material is linearized at its mean chip: of ``kc1 h^(1 - mc)`` the derivative is
    ``(1 - mc) kc``. ``kt`` is taken as it stands.
    """
    section = job.section.process.milling
    if section is None:
        raise InputError(
            f"{job.file}: process: expected [process.milling], got no milling"
        )
    _, exponent = section.law()
    feed = _mean_feed(job, section)
    if feed is None and exponent:
        expected = "expected a feed of the path or of the cut, or kt"
        raise InputError(f"{job.file}: process.milling: {expected}, got none")
    forces = section.forces(1e-3 if feed is None else feed)
    stiffness = section.kt
    if stiffness is None:
        # power = kc · depth · width · feed
        area = section.depth * section.width * (1e-3 if feed is None else feed)
        stiffness = (1.0 - exponent) * forces.power / area
    cut = milling(
        teeth=section.teeth,
        width=section.width,
        diameter=section.diameter,
        stiffness=stiffness,
        radial=section.radial_ratio,
        axial=section.axial,
        lead=section.lead,
        climb=section.climb,
    )
    return Cutting(cut, section.speed, section.depth, forces.chip)


def _mean_feed(job: Job, section: MillingSection) -> float | None:
    """Return the mean feed of the moves that cut, m/s, or None if there is none."""
    feeds = job.path.feed
    if feeds is not None:
        known = feeds[job.path.acting & np.isfinite(feeds)]
        if known.size:
            return float(known.mean())
    return section.feed


def damping_of(job: Job) -> Rated:
    """Return a function from frequencies (n, m), Hz, to damping ratios and relative bounds."""
    section = lobes_section(job)
    given = section.damping
    doubt = section.damping_error
    measured = None
    if given == "measured":
        measured = _read_measured(job, section)
    elif section.measured is not None:
        expected = 'expected damping = "measured" beside a table of measured modes'
        raise InputError(f"{job.file}: lobes.measured: {expected}, got ratios")

    def rate(hertz: Array) -> tuple[Array, Array]:
        if measured is not None:
            apart = np.abs(np.log(hertz[..., None] / measured[0]))
            ratio = measured[1][apart.argmin(axis=-1)]
        elif isinstance(given, tuple):  # further modes as the last
            order = np.minimum(np.arange(hertz.shape[1]), len(given) - 1)
            ratio = np.broadcast_to(np.array(given)[order], hertz.shape)
        else:
            ratio = np.full(hertz.shape, float(given))
        return np.array(ratio), np.full(hertz.shape, doubt)

    return rate


def _read_measured(job: Job, section: LobesSection) -> tuple[Array, Array]:
    """Return frequencies, Hz, and damping ratios of measured modes."""
    if section.measured is None:
        expected = 'expected a table of measured modes: measured = "modes.csv"'
        raise InputError(f"{job.file}: lobes.damping: {expected}, got none")
    file = job.file.parent / section.measured

    def check(name: str, columns: list[str]) -> None:
        for wanted in ("frequency", "zeta"):
            if wanted not in columns:
                got = ", ".join(columns)
                raise InputError(f"{name}:1: expected a column {wanted}, got {got}")

    table = read_table(file, check)
    hertz = numbers(table, "frequency")
    ratio = numbers(table, "zeta")
    table.refuse_where(hertz <= 0.0, "frequency", "a frequency above 0 Hz")
    table.refuse_where((ratio <= 0.0) | (ratio > 0.7), "zeta", "a ratio above 0")
    return hertz, ratio


def respond(
    job: Job, assembled: Assembled, found: Configurations, axes: Array
) -> tuple[ToolResponse, Modes]:
    """Return the response at the tool's tip, with its holder, and the robot's modes."""
    with name_robot(assembled.robot):
        response, shaken = tool_response(
            assembled.mechanism, found, axes, damping_of(job)
        )
    holder = lobes_section(job).holder
    if not holder:
        return response, shaken
    squares = list[float]()
    damping = list[float]()
    stiffness = list[list[float]]()
    ways = {"feed": (0,), "normal": (1,), "axial": (2,), "radial": (0, 1)}
    for mode in holder:
        for way in ways[mode.direction]:
            squares.append((2.0 * np.pi * mode.frequency) ** 2)
            damping.append(mode.damping)
            stiffness.append([mode.stiffness if k == way else np.inf for k in range(3)])
    coupled = couple_holder(
        response, np.array(squares), np.array(damping), np.array(stiffness)
    )
    return coupled, shaken


def speed_range(job: Job, cutting: Cutting) -> tuple[float, float]:
    """Return the slowest and fastest speed of [lobes], rev/s, or half and double the job's."""
    given = lobes_section(job).speeds
    return given or (0.5 * cutting.speed, 2.0 * cutting.speed)


def method_of(job: Job, cut: Engagement) -> str:
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
        Job with [process.milling] and [lobes], and its robot.
    found, axes
        Configurations, and axes (n, 3, 3) of the cut there.
    progress
        Progress callback.
    """
    parts = list[Stability]()
    for start in range(0, len(found), _CHUNK):
        some = slice(start, start + _CHUNK)
        parts.append(
            _judge(job, assembled, found[np.arange(len(found))[some]], axes[some])
        )
        if progress is not None:
            progress("limits", min(1.0, (start + _CHUNK) / len(found)))
    if len(parts) == 1:
        return parts[0]
    return _join(parts)


def _join(parts: list[Stability]) -> Stability:
    def join(name: str) -> Array:
        return np.concatenate([getattr(part, name) for part in parts])

    critical = join_criticals([part.critical for part in parts])
    names = parts[0].shares
    shares = {
        name: np.concatenate([part.shares[name] for part in parts]) for name in names
    }
    return Stability(
        tool=join("tool"),
        critical=critical,
        critical_error=join("critical_error"),
        limit=join("limit"),
        mode=join("mode"),
        shares=shares,
    )


def _judge(
    job: Job, assembled: Assembled, found: Configurations, axes: Array
) -> Stability:
    cutting = cutting_of(job)
    cut = cutting.cut
    response, shaken = respond(job, assembled, found, axes)
    critical = find_critical(response, cut, speed_range(job, cutting))
    error = critical_error(response, cut, critical, lobes_section(job).kt_error)
    speeds = np.array([cutting.speed, *speed_range(job, cutting)])
    method = method_of(job, cut)
    limit = stable_depth(response, cut, speeds, critical.depth, method)
    critical = _cap(critical, limit)
    mode = np.abs(critical.shares).argmax(axis=1)
    poses = np.arange(len(found))
    return Stability(
        tool=found.tool,
        critical=critical,
        critical_error=error,
        limit=limit[:, 0],
        mode=response.rates[poses, mode] / (2.0 * np.pi),
        shares=_element_shares(response, shaken, mode),
    )


def _cap(critical: Critical, depth: Array) -> Critical:
    """Return limits at all speeds that are not above depths (n, s) at some speeds.

    Those of all harmonics may be lower than the zero-order limit.
    """
    return replace(critical, depth=np.minimum(critical.depth, depth.min(axis=1)))


def stable_depth(
    response: ToolResponse, cut: Engagement, speeds: Array, scale: Array, method: str
) -> Array:
    """Return the stable depths (n, s), m, at speeds (s,), rev/s, by a method.

    ``scale``: depths (n,), m, around which all harmonics are searched.
    """
    if method == "zero-order":
        return zero_order_depth(response, cut, speeds)
    return interrupted_depth(response, cut, speeds, scale)


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
    response, _ = respond(job, assembled, found, axes)
    depth = np.empty((len(found), len(speeds)))
    ends = np.empty((2, len(found), len(speeds)))
    for k in range(len(found)):
        one = response[k : k + 1]
        scale = here.critical.depth[k : k + 1]
        depth[k] = stable_depth(one, cut, speeds, scale, method)[0]
        band = depth_band(one, cut, speeds, section.kt_error)
        plain = zero_order_depth(one, cut, speeds)[0]
        ends[0, k], ends[1, k] = _carry_band(depth[k], plain, band)
        if progress is not None:
            progress("lobes", (k + 1) / len(found))
    here = replace(here, critical=_cap(here.critical, depth))
    worst = int(np.argmin(here.critical.depth))
    levers = find_levers(
        assembled.mechanism,
        found[np.array([worst])],
        response[worst : worst + 1],
        cut=cut,
        axes=axes[worst],
        critical=find_critical(
            response[worst : worst + 1], cut, speed_range(job, cutting)
        ),
    )
    advised = _advise(ends[0].min(axis=0), speeds)
    return Lobes(
        job=job,
        cutting=cutting,
        method=method,
        names=names,
        found=found,
        at=here,
        speeds=speeds,
        depth=depth,
        low=ends[0],
        high=ends[1],
        levers=levers,
        advised=speeds[advised],
        advised_depth=ends[0].min(axis=0)[advised],
        along=limits,
        points=stretch.points,
        length=stretch.length,
    )


def _carry_band(
    depth: Array, plain: Array, band: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the band (s,), (s,) of a depth, in proportion to that of the zero-order depth."""
    with np.errstate(invalid="ignore"):
        share = np.where(np.isfinite(plain) & np.isfinite(depth), depth / plain, 1.0)
    low = np.minimum(share * band[0], depth)
    high = np.maximum(share * band[1], depth)
    return low, high


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

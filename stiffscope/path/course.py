"""Course of the tool: wanted poses of a job's path, with axes, wrenches and configurations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from stiffscope.errors import InputError, require, require_given
from stiffscope.vjm.kinematics.configurations import configure_chunks
from stiffscope.vjm.model.mechanism import COORDINATES
from stiffscope.vjm.model.screws import rotation_of
from stiffscope.vjm.statics.yielding import Load, respond

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.path.cutting import CuttingForces
    from stiffscope.path.job import Job
    from stiffscope.path.toolpath import ToolPath
    from stiffscope.runtime.types import Array, Indices
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.network.loading import Response

BLOCK = 4096  # points per block
_STILL = 1e-12  # m: a shorter step is no motion
_CLOSED = 1e-6  # of its length: a path whose ends are nearer is closed


@dataclass(frozen=True, eq=False)
class Axes:
    """Directions (n, 3) at each point: along the path, to its left seen from the spindle, binormal.

    ``spindle``: the tool's axis, pointing away from the workpiece.
    """

    along: Array
    normal: Array
    binormal: Array
    spindle: Array


@dataclass(frozen=True, eq=False)
class Course:
    """Wanted poses and loads of the tool at n points, independent of the commands.

    Attributes
    ----------
    length, time
        Length and time (n,) from the start, m and s; ``time`` is None without a feed.
    tool
        Wanted poses (n, 6): x y z in m, rotation vector from home in rad.
    axes
        Axes of the path.
    wrench
        Wrench (n, 6) of the process on the tool: N, N·m.
    cutting
        Forces of the process at its mean feed, or None.
    """

    job: Job
    length: Array
    time: Array | None
    tool: Array
    axes: Axes
    wrench: Array
    cutting: CuttingForces | None


def plan_course(
    job: Job, assembled: Assembled, known: Sequence[Configurations] | None = None
) -> Course:
    """Return the course of a job: its wanted poses and process loads. Raise InputError as `along`.

    Parameters
    ----------
    job, assembled
        Robot, path and process, and robot with its parts' matrices.
    known
        Known configurations along the path, in blocks.
    """
    if job.section.free is None:
        every = known or configure_path(job, assembled, job.path)
        tool = np.concatenate([found.tool for found in every])
    else:  # the wanted poses before the choice of free coordinates
        require(
            not job.path.by_joints,
            f"{job.path_file.name}:1",
            "a path of poses, since [free] chooses some",
            "drives",
        )
        tool = np.tile([*job.robot.tool.at, 0.0, 0.0, 0.0], (len(job.path), 1))
        tool[:, [COORDINATES.index(name) for name in job.path.columns]] = (
            job.path.values
        )
    axes = find_axes(job, tool)
    steps = np.linalg.norm(np.diff(tool[:, :3], axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    wrench, cutting = process_wrench(job, axes, length)
    path = job.path
    time = None
    if path.time is not None:
        time = path.time - path.time[0]
    elif (
        path.feed is not None
        and np.isfinite(path.feed[1:]).all()
        and not path.rapid[1:].any()
    ):
        time = np.concatenate([[0.0], np.cumsum(np.diff(length) / path.feed[1:])])
    return Course(
        job=job,
        length=length,
        time=time,
        tool=tool,
        axes=axes,
        wrench=wrench,
        cutting=cutting,
    )


def pick_evenly(n: int, most: int) -> Indices:
    """Return at most so many of n indices, evenly spread from the first to the last."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int))


def tool_error(target: Array, commanded: Array, twist: Array) -> Array:
    """Return the loaded minus the wanted tool pose (n, 6): translation and rotation vector.

    Parameters
    ----------
    target, commanded
        Wanted and commanded tool poses (n, 6), m and rotation vectors, rad.
    twist
        Deflection of the tool (n, 6), m and rad.
    """
    turned = Rotation.from_rotvec(twist[:, 3:]) * Rotation.from_rotvec(commanded[:, 3:])
    turn = (turned * Rotation.from_rotvec(target[:, 3:]).inv()).as_rotvec()
    return np.concatenate(
        [commanded[:, :3] + twist[:, :3] - target[:, :3], turn], axis=1
    )


def respond_under(
    job: Job, assembled: Assembled, configurations: Configurations, wrench: Array
) -> Response:
    """Return the response at n configurations to weight, payload and process wrenches (n, 6)."""
    payload = job.section.payload
    mechanism = assembled.mechanism
    loads: tuple[Load, ...] = ()
    if payload is not None:
        tool = mechanism.tool
        at = np.array(
            tool.at if payload.centre is None else payload.centre, dtype=float
        )
        weight = payload.mass * np.asarray(mechanism.gravity, dtype=float)
        loads = (Load(tool.body, np.concatenate([weight, np.zeros(3)]), at),)
    gravity = float(job.section.gravity != "none")
    return respond(
        mechanism,
        configurations,
        wrench[:, :, None],
        loads=loads,
        gravity=gravity,
        misfit=1.0,
    )


def configure_path(
    job: Job, assembled: Assembled, path: ToolPath
) -> Iterator[Configurations]:
    """Yield configurations along a path in blocks. Raise InputError for a point out of reach."""
    mechanism = assembled.mechanism
    given = "tool"
    values = path.values
    start = 0
    if path.by_joints:
        given = "drives"
        names = [name.removeprefix("q:") for name in path.columns]
        known = [joint.name for joint in mechanism.drives]
        wanted = ", ".join(f"q:{name}" for name in known)
        require(
            sorted(names) == sorted(known),
            f"{job.path_file.name}:1",
            f"a column of every drive ({wanted})",
            "others",
        )
        values = values[:, [names.index(name) for name in known]]
    for configurations in configure_chunks(mechanism, values, BLOCK, given):
        if not configurations.valid.all():
            k = int(np.argmin(configurations.valid))
            raise InputError(
                f"{job.path_file.name}:{path.lines[start + k]}: {configurations.refusal(k)}"
            )
        start += len(configurations)
        yield configurations


def find_axes(job: Job, tool: Array) -> Axes:
    """Return the axes of a path through tool poses (n, 6): tangent, normal, binormal, spindle."""
    tangent = _find_tangents(tool[:, :3], job.path.rapid)
    moves = "a path that moves the tool"
    tangent = require_given(tangent, job.path_file.name, moves, "one point")
    axis = np.array(job.section.axis) / np.linalg.norm(job.section.axis)
    blocks = np.array_split(tool[:, 3:], range(BLOCK, len(tool), BLOCK))
    spindle = np.concatenate([rotation_of(block) @ axis for block in blocks])
    across = np.cross(spindle, tangent)
    flat = np.linalg.norm(across, axis=1) < 1e-6
    if flat.any():  # a plunge: use one arbitrary transverse direction for all points
        size = np.abs(spindle[int(np.argmax(flat))]).round(
            6
        )  # the same whatever the last digits
        side = np.eye(3)[int(np.argmin(size))]
        across[flat] = np.cross(spindle[flat], side)
    across /= np.linalg.norm(across, axis=1)[:, None]
    return Axes(tangent, across, np.cross(tangent, across), spindle)


def _find_tangents(points: Array, rapid: NDArray[np.bool_]) -> Array | None:
    """Return unit tangents (n, 3) at points (n, 3) by central differences; None if nothing moves.

    At uneven steps they are those of the parabola through a point and its neighbours. A path that
    ends where it begins goes on there. A point of a cut next to a rapid move looks along the cut.
    """
    steps = np.diff(points, axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    moving = np.flatnonzero(sizes > _STILL)
    if not moving.size:
        return None
    units = steps[moving] / sizes[moving, None]
    lengths = sizes[moving]
    kinds = rapid[moving + 1]
    after = np.searchsorted(moving, np.arange(len(points)))  # the first step from here
    before = np.searchsorted(moving, np.arange(len(points))) - 1
    count = len(moving)
    has_after = after < count
    has_before = before >= 0
    if np.linalg.norm(points[-1] - points[0]) < _CLOSED * lengths.sum():
        after %= count
        before %= count
        has_after[:] = True
        has_before[:] = True
    after = np.where(has_after, after, 0)
    before = np.where(has_before, before, 0)
    mixed = has_after & has_before & (kinds[after] != kinds[before])
    has_after &= ~mixed | (kinds[after] == rapid)
    has_before &= ~mixed | (kinds[before] == rapid)
    weight_after = np.where(has_after, np.where(has_before, lengths[before], 1.0), 0.0)
    weight_before = np.where(has_before, np.where(has_after, lengths[after], 1.0), 0.0)
    sums = weight_after[:, None] * units[after] + weight_before[:, None] * units[before]
    norms = np.linalg.norm(sums, axis=1)
    turned = norms < 1e-9 * (weight_after + weight_before)  # back the way it came
    sums[turned] = units[after[turned]]
    return sums / np.linalg.norm(sums, axis=1)[:, None]


def process_wrench(
    job: Job, axes: Axes, length: Array
) -> tuple[Array, CuttingForces | None]:
    """Return the process wrench (n, 6) on the tool at M in base axes, and forces at the mean feed.

    Parameters
    ----------
    job
        Job with process and path.
    axes, length
        Axes of the path, and length (n,) from its start, m.
    """
    path = job.path
    process = job.section.process
    out = np.zeros((len(path), 6)) if path.wrench is None else path.wrench.copy()
    acting = ~path.rapid
    along_ = axes.along[acting]
    normal = axes.normal[acting]
    spindle = axes.spindle[acting]
    if process.force is not None:
        force = process.force
        out[acting, :3] += (
            force.feed * along_ + force.across * normal + force.axial * spindle
        )
    cutting = None
    require(
        not (process.cuts and path.rapid.all()),
        job.path_file.name,
        "a move that cuts (G1 to G3)",
        "rapid moves alone",
    )
    for cut in process.cuts:
        feeds = _feeds(job, cut.feed, length)[acting]
        cutting = cut.forces(float(np.mean(feeds)))
        values, which = np.unique(feeds, return_inverse=True)
        forces = [cut.forces(float(feed)) for feed in values]
        parts = np.array([(f.feed, f.across, f.axial, f.torque) for f in forces])[which]
        feed, across, axial, torque = parts.T[..., None]
        out[acting, :3] += feed * along_ + across * normal + axial * spindle
        out[acting, 3:] += torque * spindle
    return out, cutting


def _feeds(job: Job, otherwise: float | None, length: Array) -> Array:
    """Return the feed (n,), m/s, of the path or the cut. Raise InputError if neither has one."""
    path = job.path
    feeds = np.full(len(path), np.nan) if path.feed is None else path.feed.copy()
    if path.feed is None and path.time is not None:
        speeds = np.diff(length) / np.diff(path.time)
        feeds = np.concatenate([speeds, speeds[-1:]])
    feeds[np.isnan(feeds)] = np.nan if otherwise is None else otherwise
    missing = np.isnan(feeds) & ~path.rapid
    where = f"{job.path_file.name}:{path.lines[int(np.argmax(missing))]}: feed"
    require(not missing.any(), where, "a feed of the path or of the cut", "none")
    return feeds

"""Where the tool is to go and what loads it there: a job's path with its axes, its wrench and its configurations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from stiffscope.errors import InputError
from stiffscope.vjm.kinematics import configure_chunks
from stiffscope.vjm.mechanism import COORDINATES
from stiffscope.vjm.screws import rotation_of
from stiffscope.vjm.yielding import Load, respond

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from stiffscope.design.path.cutting import CuttingForces
    from stiffscope.design.path.job import Job
    from stiffscope.design.path.toolpath import ToolPath
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.kinematics import Configurations
    from stiffscope.vjm.loading import Response

BLOCK = 4096  # points at once


@dataclass(frozen=True, eq=False)
class Axes:
    """Directions (n, 3) at every point: along the path, to its left seen from the spindle, and square to both.

    ``spindle``: the tool's own axis, from the workpiece.
    """

    along: Array
    normal: Array
    binormal: Array
    spindle: Array


@dataclass(frozen=True, eq=False)
class Course:
    """Where the tool is to go and what loads it there, at n points; the same whatever is commanded.

    Attributes
    ----------
    length, time
        (n,) m and s from the start; ``time`` is None where the path has no feed.
    tool
        (n, 6) where the tool is to be: x y z in m, rotation vector from home in rad.
    axes
        Of the path.
    wrench
        (n, 6) of the process on the tool: N, N·m.
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


def plan_course(job: Job, assembled: Assembled, known: Sequence[Configurations] | None = None) -> Course:
    """Find where a job's path leads the tool, and the load of its process there. Raises InputError as `along`.

    Parameters
    ----------
    job
        Robot, path and process.
    assembled
        The robot with its parts' matrices.
    known
        Configurations along the path, a block at a time, if they were found before.

    """
    if job.section.free is None:
        tool = np.concatenate([found.tool for found in known or configure_path(job, assembled, job.path)])
    else:
        tool = _wanted(job)
    axes = find_axes(job, tool)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(tool[:, :3], axis=0), axis=1))])
    wrench, cutting = process_wrench(job, axes, length)
    return Course(job, length, _times(job.path, length), tool, axes, wrench, cutting)


def _wanted(job: Job) -> Array:
    """Poses (n, 6) that a path wants of the tool, before its free coordinates are chosen."""
    if job.path.by_joints:
        raise InputError(f"{job.path_file.name}:1: expected a path of poses, since [free] chooses some, got drives")
    tool = np.tile([*job.robot.tool.at, 0.0, 0.0, 0.0], (len(job.path), 1))
    tool[:, [COORDINATES.index(name) for name in job.path.columns]] = job.path.values
    return tool


def tool_error(target: Array, commanded: Array, twist: Array) -> Array:
    """Where the loaded tool is (n, 6), less where it is to be: a translation, and the rotation vector between them."""
    turned = Rotation.from_rotvec(twist[:, 3:]) * Rotation.from_rotvec(commanded[:, 3:])
    turn = (turned * Rotation.from_rotvec(target[:, 3:]).inv()).as_rotvec()
    return np.concatenate([commanded[:, :3] + twist[:, :3] - target[:, :3], turn], axis=1)


def respond_under(job: Job, assembled: Assembled, found: Configurations, wrench: Array) -> Response:
    """Response at n configurations under the job's weight and payload and wrenches (n, 6) of its process."""
    return respond(
        assembled.mechanism, found, wrench[:, :, None], loads=_payload(job, assembled),
        gravity=float(job.section.gravity != "none"), misfit=1.0,
    )  # fmt: skip


def configure_path(job: Job, assembled: Assembled, path: ToolPath) -> Iterator[Configurations]:
    """Configurations along a path, a block at a time. Raises InputError that names the line of a point out of reach."""
    mechanism, given, values, start = assembled.mechanism, "tool", path.values, 0
    if path.by_joints:
        given = "drives"
        names = [name.removeprefix("q:") for name in path.columns]
        known = [joint.name for joint in mechanism.drives]
        if sorted(names) != sorted(known):
            wanted = ", ".join(f"q:{name}" for name in known)
            raise InputError(f"{job.path_file.name}:1: expected a column of every drive ({wanted}), got others")
        values = values[:, [names.index(name) for name in known]]
    for found in configure_chunks(mechanism, values, BLOCK, given):
        if not found.valid.all():
            k = int(np.argmin(found.valid))
            raise InputError(f"{job.path_file.name}:{path.lines[start + k]}: {found.reason(k)}")
        start += len(found)
        yield found


def find_axes(job: Job, tool: Array) -> Axes:
    """Axes of a path through tool poses (n, 6): along it, to its left seen from the spindle, and square to both."""
    steps = np.diff(tool[:, :3], axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    moving = np.flatnonzero(sizes > 1e-12)
    if not moving.size:
        raise InputError(f"{job.path_file.name}: expected a path that moves the tool, got one point")
    ahead = np.concatenate([moving, moving[-1:]])[np.searchsorted(moving, np.arange(len(tool)))]
    tangent = steps[ahead] / sizes[ahead, None]
    axis = np.array(job.section.axis) / np.linalg.norm(job.section.axis)
    blocks = range(0, len(tool), BLOCK)
    spindle = np.concatenate([rotation_of(tool[start : start + BLOCK, 3:]) @ axis for start in blocks])
    across = np.cross(spindle, tangent)
    flat = np.linalg.norm(across, axis=1) < 1e-6
    if flat.any():  # a plunge: any direction across will do, the same at all points
        side = np.eye(3)[int(np.argmin(np.abs(spindle[int(np.argmax(flat))])))]
        across[flat] = np.cross(spindle[flat], side)
    across /= np.linalg.norm(across, axis=1)[:, None]
    return Axes(tangent, across, np.cross(tangent, across), spindle)


def process_wrench(job: Job, axes: Axes, length: Array) -> tuple[Array, CuttingForces | None]:
    """Wrench (n, 6) of the process on the tool at M in base axes, and its forces at the mean feed.

    Parameters
    ----------
    job
        The process and the path.
    axes, length
        Of the path; (n,) m from its start.

    """
    path, process = job.path, job.section.process
    out = np.zeros((len(path), 6)) if path.wrench is None else path.wrench.copy()
    acting = ~path.rapid
    along_, normal, spindle = axes.along[acting], axes.normal[acting], axes.spindle[acting]
    if process.force is not None:
        force = process.force
        out[acting, :3] += force.feed * along_ + force.across * normal + force.axial * spindle
    cutting = None
    for cut in process.cuts:
        feeds = _feeds(job, cut.feed, length)[acting]
        cutting = cut.forces(float(np.mean(feeds)))
        values, which = np.unique(feeds, return_inverse=True)
        found = [cut.forces(float(feed)) for feed in values]
        feed, across, axial, torque = np.array([(f.feed, f.across, f.axial, f.torque) for f in found])[which].T
        out[acting, :3] += feed[:, None] * along_ + across[:, None] * normal + axial[:, None] * spindle
        out[acting, 3:] += torque[:, None] * spindle
    return out, cutting


def _feeds(job: Job, otherwise: float | None, length: Array) -> Array:
    """Feed (n,) in m/s, of the path or of the cut. Raises InputError where neither has one."""
    path = job.path
    feeds = np.full(len(path), np.nan) if path.feed is None else path.feed.copy()
    if path.feed is None and path.time is not None:
        speeds = np.diff(length) / np.diff(path.time)
        feeds = np.concatenate([speeds, speeds[-1:]])
    feeds[np.isnan(feeds)] = np.nan if otherwise is None else otherwise
    missing = np.isnan(feeds) & ~path.rapid
    if missing.any():
        line = path.lines[int(np.argmax(missing))]
        raise InputError(f"{job.path_file.name}:{line}: feed: expected a feed of the path or of the cut, got none")
    return feeds


def _times(path: ToolPath, length: Array) -> Array | None:
    """Time (n,) in s from the start, as far as the path says how fast it is run."""
    if path.time is not None:
        return path.time - path.time[0]
    if path.feed is None or np.isnan(path.feed[1:]).any() or path.rapid[1:].any():
        return None
    return np.concatenate([[0.0], np.cumsum(np.diff(length) / path.feed[1:])])


def _payload(job: Job, assembled: Assembled) -> tuple[Load, ...]:
    payload = job.section.payload
    if payload is None:
        return ()
    tool = assembled.mechanism.tool
    at = np.array(tool.at if payload.centre is None else payload.centre, dtype=float)
    weight = payload.mass * np.asarray(assembled.mechanism.gravity, dtype=float)
    return (Load(tool.body, np.concatenate([weight, np.zeros(3)]), at),)

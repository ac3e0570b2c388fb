"""What the tool does along a path: its error under weight and process, its bound, what the drives carry, and why."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from stiffscope.design.path.job import Job, load_job
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots, deflection_bars
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.kinematics import configure, configure_drives
from stiffscope.vjm.mechanism import COORDINATES
from stiffscope.vjm.modes import frequencies
from stiffscope.vjm.screws import rotation_of
from stiffscope.vjm.statics import Load, respond

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from stiffscope.design.path.cutting import CuttingForces
    from stiffscope.design.path.toolpath import ToolPath
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.runtime.types import Array, Indices, Progress
    from stiffscope.vjm.kinematics import Configurations

BLOCK = 8192  # points at once
_STATIONS = 9  # of the path, whose first frequency is worked out


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


@dataclass(frozen=True, eq=False)
class Along(Course):
    """The tool along its course with some commands; d drives.

    Attributes
    ----------
    path
        The commands.
    commanded
        (n, 6) where a rigid robot would bring it.
    error
        (n, 6) how far weight and process leave it from where it is to be: m, rad, base axes.
    bound
        (n,) m, on the size of the error's translation: from the error bars of the parts.
    forces
        (n, d) N, N·m that the drives carry; ``units`` of each.
    shares
        By element, (n,) of the strain energy.
    stations, first
        Points (m,) whose first natural frequency (m,) in Hz is known.
    """

    path: ToolPath
    commanded: Array
    error: Array
    bound: Array
    drives: tuple[str, ...]
    units: tuple[str, ...]
    forces: Array
    shares: dict[str, Array]
    stations: Indices
    first: Array

    @cached_property
    def parts(self) -> dict[str, Array]:
        """Error (n,) in m along the path's normal, tangent and binormal."""
        named = {"normal": self.axes.normal, "along": self.axes.along, "binormal": self.axes.binormal}
        return {name: np.einsum("ni,ni->n", self.error[:, :3], axes) for name, axes in named.items()}

    @property
    def commanded_poses(self) -> Array:
        """(n, k) coordinates of the robot's pose that are commanded."""
        return self.commanded[:, [COORDINATES.index(name) for name in self.job.robot.tool.pose]]

    @property
    def size(self) -> Array:
        """(n,) m, of the error's translation."""
        return np.linalg.norm(self.error[:, :3], axis=1)

    @property
    def worst(self) -> int:
        """The point of the greatest error while the process acts; of all where it acts nowhere."""
        acting = ~self.path.rapid
        return int(np.argmax(np.where(acting, self.size, -1.0) if acting.any() else self.size))


def along(job: Job | str | Path, assembled: Assembled | None = None, progress: Progress | None = None) -> Along:
    """Predict the error of the tool along a path.

    Parameters
    ----------
    job
        The path and what loads it, or its file.
    assembled
        The job's robot with its parts; by default they are made as the job says.
    progress
        Told how far it is.

    Returns
    -------
    Along
        What a rigid machine would do apart from what this one does.

    Raises
    ------
    InputError
        A point out of reach, with file and line, or a robot that moves freely under its load.

    """
    job = job if isinstance(job, Job) else load_job(job)
    if assembled is None:
        with workshop() as shop:
            assembled = assemble_robots({"robot": job.robot}, job.section.components, shop)["robot"]
    return predict(plan_course(job, assembled), assembled, job.path, progress)


def plan_course(job: Job, assembled: Assembled) -> Course:
    """Find where a job's path leads the tool, and the load of its process there. Raises InputError as `along`."""
    tool = np.concatenate([found.tool for found in configure_path(job, assembled, job.path)])
    axes = find_axes(job, tool)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(tool[:, :3], axis=0), axis=1))])
    wrench, cutting = process_wrench(job, axes, length)
    return Course(job, length, _times(job.path, length), tool, axes, wrench, cutting)


def predict(course: Course, assembled: Assembled, path: ToolPath, progress: Progress | None = None) -> Along:
    """Predict the error of the tool on its course with some commands; parameters and errors as for `along`."""
    job, mechanism, n = course.job, assembled.mechanism, len(path)
    drives = mechanism.drives
    commanded, twist, bound = np.empty((n, 6)), np.empty((n, 6)), np.empty(n)
    forces = np.empty((n, len(drives)))
    shares: dict[str, Array] = {}
    start = 0
    for found in configure_path(job, assembled, path):
        some = slice(start, start + len(found))
        start += len(found)
        state = respond(
            mechanism, found, course.wrench[some, :, None], loads=_payload(job, assembled),
            gravity=float(job.section.gravity != "none"), misfit=1.0,
        )  # fmt: skip
        commanded[some], twist[some] = found.tool, state.twist[..., 0]
        bars = deflection_bars(assembled, found, twist[some])
        bound[some] = np.linalg.norm(np.broadcast_to(bars, (len(found), 6))[:, :3], axis=1)
        for k, joint in enumerate(drives):
            component = 3 if joint.kind == "revolute" else 0
            forces[some, k] = state.elements[joint.name].wrench[:, component, 0]
        energies = {name: each[:, 0] for name, each in state.energies.items()}
        total = np.maximum(sum(energies.values(), np.zeros(1)), 1e-300)
        for name, each in energies.items():
            shares.setdefault(name, np.zeros(n))[some] = each / total
        if progress is not None:
            progress("path", start / n)
    stations = np.unique(np.linspace(0, n - 1, _STATIONS).round().astype(int))
    return Along(
        job, course.length, course.time, course.tool, course.axes, course.wrench, course.cutting,
        path, commanded, _error(course.tool, commanded, twist), bound, tuple(j.name for j in drives),
        tuple("N·m" if j.kind == "revolute" else "N" for j in drives),
        forces, shares, stations, _first_frequencies(job, assembled, path, stations),
    )  # fmt: skip


def _error(target: Array, commanded: Array, twist: Array) -> Array:
    """Where the loaded tool is (n, 6), less where it is to be: a translation, and the rotation vector between them."""
    turned = Rotation.from_rotvec(twist[:, 3:]) * Rotation.from_rotvec(commanded[:, 3:])
    turn = (turned * Rotation.from_rotvec(target[:, 3:]).inv()).as_rotvec()
    return np.concatenate([commanded[:, :3] + twist[:, :3] - target[:, :3], turn], axis=1)


def configure_path(job: Job, assembled: Assembled, path: ToolPath) -> Iterator[Configurations]:
    """Configurations along a path, a block at a time. Raises InputError that names the line of a point out of reach."""
    mechanism = assembled.mechanism
    for start in range(0, len(path), BLOCK):
        values = path.values[start : start + BLOCK]
        if path.by_joints:
            names = [name.removeprefix("q:") for name in path.columns]
            known = [joint.name for joint in mechanism.drives]
            if sorted(names) != sorted(known):
                wanted = ", ".join(f"q:{name}" for name in known)
                raise InputError(f"{job.path_file.name}:1: expected a column of every drive ({wanted}), got others")
            found = configure_drives(mechanism, values[:, [names.index(name) for name in known]])
        else:
            found = configure(mechanism, values)
        if not found.valid.all():
            k = int(np.argmin(found.valid))
            raise InputError(f"{job.path_file.name}:{path.lines[start + k]}: {found.reason(k)}")
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
    turns = rotation_of(tool[:, 3:])
    spindle = np.array(job.section.axis) / np.linalg.norm(job.section.axis)
    spindle = turns @ spindle
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
    if np.isnan(feeds[~path.rapid]).any():
        raise InputError(f"{job.path_file.name}: feed: expected a feed of the path or of the cut, got none")
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
    return (Load(tool.body, at, np.concatenate([weight, np.zeros(3)])),)


def _first_frequencies(job: Job, assembled: Assembled, path: ToolPath, stations: Indices) -> Array:
    """First natural frequency (m,) at some points, Hz; NaN where the robot has no masses."""
    some = path.command(path.values[stations])
    try:
        found = next(configure_path(job, assembled, some))
        return frequencies(assembled.mechanism, found, 1)[:, 0]
    except InputError:
        return np.full(len(stations), np.nan)

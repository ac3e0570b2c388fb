"""Prediction along a path: tool error under weight and process, drive loads; compensation."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots, deflection_bars
from stiffscope.path.course import (
    BLOCK,
    Course,
    configure_path,
    pick_evenly,
    plan_course,
    respond_under,
    tool_error,
)
from stiffscope.path.free_coordinates import choose_free_coordinates
from stiffscope.path.job import Job, load_job
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.mechanism import COORDINATES
from stiffscope.vjm.vibration.modes import frequencies

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.path.free_coordinates import FreeChoice
    from stiffscope.path.toolpath import ToolPath
    from stiffscope.runtime.types import Array, Indices, Progress
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.network.loading import Response

ROUNDS = 6  # most steps of a compensation
_SETTLED = 1e-11  # m, rad
_MOST_KEPT = (
    200_000  # most points whose configurations are kept instead of solved twice
)
_STATIONS = 9  # points of the path at which the first frequency is computed


@dataclass(frozen=True, eq=False)
class Along(Course):
    """The tool along its course for given commands; d drives.

    Attributes
    ----------
    path
        Commands.
    commanded
        Tool poses (n, 6) of a rigid robot.
    error
        Deviation (n, 6) from the wanted pose due to weight and process: m, rad, base axes.
    bound
        Bound (n,) on the size of the translation error, m, from the error bars of the parts.
    forces
        Drive loads (n, d), N or N·m; see ``units``.
    shares
        Share (n,) of the strain energy by element.
    stations, first
        Indices of points (m,), and first natural frequencies (m,) there, Hz.
    free_choice
        Choice of the free coordinates, if any.
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
    free_choice: FreeChoice | None = None

    @cached_property
    def parts(self) -> dict[str, Array]:
        """Errors (n,) along the path's normal, tangent and binormal, m."""
        off = self.error[:, :3]
        axes = {
            name: getattr(self.axes, name) for name in ("normal", "along", "binormal")
        }
        return {name: np.einsum("ni,ni->n", off, each) for name, each in axes.items()}

    @property
    def size(self) -> Array:
        """Size (n,) of the translation error, m."""
        return np.linalg.norm(self.error[:, :3], axis=1)

    @property
    def worst(self) -> int:
        """Index of the greatest error while the process acts, or of all points if it never acts."""
        return int(np.argmax(np.where(self.path.acting, self.size, -1.0)))


def along(
    job: Job | str | Path,
    assembled: Assembled | None = None,
    progress: Progress | None = None,
) -> Along:
    """Predict the error of the tool along a path.

    Parameters
    ----------
    job
        Job with path and loads, or its file.
    assembled
        Assembled robot of the job; by default assembled according to the job.
    progress
        Progress callback.

    Returns
    -------
    Along
        Error of the tool relative to the wanted poses, with its causes.

    Raises
    ------
    InputError
        A point is out of reach (with file and line), or the robot moves freely under its load.
    """
    job = job if isinstance(job, Job) else load_job(job)
    if assembled is None:
        with workshop() as shop:
            assembled = assemble_robots(
                {"robot": job.robot}, job.section.components, shop
            )["robot"]
    if job.section.free is None:
        known = None
        if len(job.path) <= _MOST_KEPT:
            known = list(configure_path(job, assembled, job.path))
        return predict(
            plan_course(job, assembled, known), assembled, job.path, progress, known
        )
    course = plan_course(job, assembled)
    choice = choose_free_coordinates(course, assembled)
    return replace(
        predict(choice.course, assembled, choice.path, progress), free_choice=choice
    )


def predict(
    course: Course,
    assembled: Assembled,
    path: ToolPath,
    progress: Progress | None = None,
    known: Sequence[Configurations] | None = None,
) -> Along:
    """Predict the error of the tool on its course for given commands; raises like `along`.

    Parameters
    ----------
    course, assembled
        Wanted tool poses and process loads at the path's n points, and robot with its matrices.
    path
        Commands at the points: the path itself, or a compensated one.
    progress
        Called with the name of a stage and its completed fraction.
    known
        Known configurations along the path, in blocks.
    """
    job = course.job
    mechanism = assembled.mechanism
    n = len(path)
    drives = mechanism.drives
    commanded = np.empty((n, 6))
    error = np.empty((n, 6))
    bound = np.empty(n)
    forces = np.empty((n, len(drives)))
    shares: dict[str, Array] = {}
    start = 0
    for configurations in known or configure_path(job, assembled, path):
        rows = slice(start, start + len(configurations))
        start += len(configurations)
        state = respond_under(job, assembled, configurations, course.wrench[rows])
        twist = state.twist[..., 0]
        error[rows] = tool_error(course.tool[rows], configurations.tool, twist)
        commanded[rows] = configurations.tool
        bars = deflection_bars(assembled, configurations, twist)
        bound[rows] = np.linalg.norm(
            np.broadcast_to(bars, (len(configurations), 6))[:, :3], axis=1
        )
        for k, joint in enumerate(drives):
            wrench = state.elements[joint.name].wrench
            forces[rows, k] = wrench[:, joint.type.driven, 0]
        energies = {name: each[:, 0] for name, each in state.energies.items()}
        total = np.maximum(sum(energies.values(), np.zeros(1)), 1e-300)
        for name, each in energies.items():
            if name not in shares:
                shares[name] = np.zeros(n, dtype=np.float32)
            shares[name][rows] = each / total
        if progress is not None:
            progress("path", start / n)
    stations = pick_evenly(n, _STATIONS)
    first = np.full(len(stations), np.nan)
    with suppress(InputError):  # without masses
        configurations = next(
            configure_path(job, assembled, path.command(path.values[stations]))
        )
        first = frequencies(mechanism, configurations, 1)[:, 0]
    return Along(
        job=job,
        length=course.length,
        time=course.time,
        tool=course.tool,
        axes=course.axes,
        wrench=course.wrench,
        cutting=course.cutting,
        path=path,
        commanded=commanded,
        error=error,
        bound=bound,
        drives=tuple(j.name for j in drives),
        units=tuple("N·m" if j.turns else "N" for j in drives),
        forces=forces,
        shares=shares,
        stations=stations,
        first=first,
    )


def respond_at_worst(
    state: Along, assembled: Assembled
) -> tuple[Configurations, Response]:
    """Return configuration and response to process, weight and payload at the greatest error."""
    pose = [COORDINATES.index(name) for name in state.job.robot.tool.pose]
    configurations = configure(
        assembled.mechanism, state.commanded[state.worst, pose][None]
    )
    return configurations, respond_under(
        state.job, assembled, configurations, state.wrench[[state.worst]]
    )


@dataclass(frozen=True, eq=False)
class Compensated:
    """Compensated commands, the prediction with them, and the remaining error.

    ``left`` (n, c): error of the commanded coordinates, m and rad. ``refused``: line and reason of
    points whose command would exceed the reach or a drive's range; they keep their own command.
    """

    path: ToolPath
    after: Along
    left: Array
    refused: tuple[tuple[int, str], ...]


def compensate(
    assembled: Assembled, before: Along, progress: Progress | None = None
) -> Compensated:
    """Find commands that cancel the tool's error by fixed-point steps, compliance updated at each.

    Parameters
    ----------
    assembled, progress
        Assembled robot, and progress callback, as in `along`.
    before
        Prediction by `along` for the job's own commands.

    Returns
    -------
    Compensated
        New commands and the remaining error predicted with them. Coordinates that are not commanded
        remain uncompensated.
    """
    pose = [COORDINATES.index(name) for name in before.job.robot.tool.pose]
    refused = dict[int, str]()
    state = before
    for number in range(ROUNDS):
        off = state.error
        at = state.commanded
        back = Rotation.from_rotvec(-off[:, 3:]) * Rotation.from_rotvec(at[:, 3:])
        wanted = np.concatenate([at[:, :3] - off[:, :3], back.as_rotvec()], axis=1)[
            :, pose
        ]
        drives = np.empty((len(wanted), len(before.drives)))
        for start in range(0, len(wanted), BLOCK):
            rows = slice(start, start + BLOCK)
            configurations = configure(assembled.mechanism, wanted[rows])
            refused |= {
                start + int(k): configurations.reason(int(k))
                for k in np.flatnonzero(~configurations.valid)
            }
            drives[rows] = configurations.drives
        commands = wanted
        if before.path.by_joints:
            order = [
                before.drives.index(name.removeprefix("q:"))
                for name in before.path.columns
            ]
            commands = drives[:, order]
        commands[list(refused)] = before.path.values[list(refused)]
        new = predict(before, assembled, before.path.command(commands))
        if progress is not None:
            progress("compensation", (number + 1) / ROUNDS)
        last = np.abs(state.error[:, pose]).max()
        state = new
        if np.abs(new.error[:, pose]).max() < max(_SETTLED, 1e-9 * last):
            break
    lines = tuple(
        (int(before.path.lines[k]), why) for k, why in sorted(refused.items())
    )
    return Compensated(state.path, state, state.error[:, pose], lines)

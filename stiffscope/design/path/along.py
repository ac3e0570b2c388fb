"""What the tool does along a path: its error under weight and process, its bound, what the drives carry, and why."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.design.path.course import Course, configure_path, plan_course, respond_under, tool_error
from stiffscope.design.path.free import choose_free
from stiffscope.design.path.job import Job, load_job
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots, deflection_bars
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.kinematics import configure
from stiffscope.vjm.mechanism import COORDINATES
from stiffscope.vjm.modes import frequencies

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.design.path.free import Freed
    from stiffscope.design.path.toolpath import ToolPath
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.runtime.types import Array, Indices, Progress
    from stiffscope.vjm.kinematics import Configurations
    from stiffscope.vjm.loading import Response

_MOST_KEPT = 200_000  # points whose configurations are kept, rather than found twice
_STATIONS = 9  # of the path, whose first frequency is worked out


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
    freed
        How the free coordinates were chosen, if there are any.
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
    freed: Freed | None = None

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
    if job.section.free is None:
        known = list(configure_path(job, assembled, job.path)) if len(job.path) <= _MOST_KEPT else None
        return predict(plan_course(job, assembled, known), assembled, job.path, progress, known)
    course = plan_course(job, assembled)
    freed = choose_free(course, assembled)
    return replace(predict(freed.course, assembled, freed.path, progress), freed=freed)


def predict(
    course: Course, assembled: Assembled, path: ToolPath, progress: Progress | None = None,
    known: Sequence[Configurations] | None = None,
) -> Along:  # fmt: skip
    """Predict the error of the tool on its course with some commands; errors as for `along`.

    Parameters
    ----------
    course
        Where the n points of the path want the tool, and the load of the process there.
    assembled
        The robot with its parts' matrices.
    path
        What is commanded at the points: the path itself, or a compensated one.
    progress
        Called with a stage's name and its fraction done.
    known
        Configurations along the path, a block at a time, if they were found before.

    """
    job, mechanism, n = course.job, assembled.mechanism, len(path)
    drives = mechanism.drives
    commanded, error, bound = np.empty((n, 6)), np.empty((n, 6)), np.empty(n)
    forces = np.empty((n, len(drives)))
    shares: dict[str, Array] = {}
    start = 0
    for found in known or configure_path(job, assembled, path):
        some = slice(start, start + len(found))
        start += len(found)
        state = respond_under(job, assembled, found, course.wrench[some])
        twist = state.twist[..., 0]
        commanded[some], error[some] = found.tool, tool_error(course.tool[some], found.tool, twist)
        bars = deflection_bars(assembled, found, twist)
        bound[some] = np.linalg.norm(np.broadcast_to(bars, (len(found), 6))[:, :3], axis=1)
        for k, joint in enumerate(drives):
            component = 3 if joint.kind == "revolute" else 0
            forces[some, k] = state.elements[joint.name].wrench[:, component, 0]
        energies = {name: each[:, 0] for name, each in state.energies.items()}
        total = np.maximum(sum(energies.values(), np.zeros(1)), 1e-300)
        for name, each in energies.items():
            if name not in shares:
                shares[name] = np.zeros(n, dtype=np.float32)
            shares[name][some] = each / total
        if progress is not None:
            progress("path", start / n)
    stations = np.unique(np.linspace(0, n - 1, _STATIONS).round().astype(int))
    return Along(
        job, course.length, course.time, course.tool, course.axes, course.wrench, course.cutting,
        path, commanded, error, bound, tuple(j.name for j in drives),
        tuple("N·m" if j.kind == "revolute" else "N" for j in drives),
        forces, shares, stations, _first_frequencies(job, assembled, path, stations),
    )  # fmt: skip


def respond_at_worst(state: Along, assembled: Assembled) -> tuple[Configurations, Response]:
    """The robot where the error is greatest, and its response to process, weight and payload there."""
    found = configure(assembled.mechanism, state.commanded_poses[[state.worst]])
    return found, respond_under(state.job, assembled, found, state.wrench[[state.worst]])


def _first_frequencies(job: Job, assembled: Assembled, path: ToolPath, stations: Indices) -> Array:
    """First natural frequency (m,) at some points, Hz; NaN where the robot has no masses."""
    some = path.command(path.values[stations])
    try:
        found = next(configure_path(job, assembled, some))
        return frequencies(assembled.mechanism, found, 1)[:, 0]
    except InputError:
        return np.full(len(stations), np.nan)

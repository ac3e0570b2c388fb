"""Map of the critical depth over the workspace."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.lobes.chatter import judge, named_axes
from stiffscope.statics.maps import Scalar, map_robot
from stiffscope.vjm.kinematics.configurations import configure

if TYPE_CHECKING:
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.path.job import Job
    from stiffscope.runtime.types import Array, Progress
    from stiffscope.statics.maps import StiffnessMap

POINTS = 45  # along each coordinate: about two thousand poses


def map_depth(
    job: Job, assembled: Assembled, points: int, progress: Progress | None = None
) -> StiffnessMap:
    """Return a map with the critical depth of a job's cut, fed along the job's x.

    Its quantities are ``critical_depth`` with ``critical_low`` and ``critical_high``, m, and the
    frequencies ``chatter`` and ``limiting_mode``, Hz.

    Parameters
    ----------
    job, assembled
        Job with a cut and [lobes], and its robot, whose file has [map].
    points
        Points along each coordinate of [map].
    progress
        Progress callback.

    Raises
    ------
    InputError
        The robot has no [map], or no pose of it is within reach.
    """
    mechanism = assembled.mechanism
    found = map_robot(job.robot, mechanism, points, "none")
    poses = _grid_poses(found, mechanism.tool.pose)
    every = configure(mechanism, poses)
    known = np.flatnonzero(every.valid)
    reached = every[known]
    axes = named_axes(job, reached.tool)
    limits = judge(job, assembled, reached, axes, progress)

    def spread(values: Array) -> Array:
        whole = np.full(len(poses), np.nan)
        whole[known] = np.where(np.isfinite(values), values, np.nan)
        return whole.reshape(len(found.rows), len(found.columns))

    more = {
        "critical_depth": Scalar(
            spread(limits.critical.depth), "m", "depth of cut stable at all speeds"
        ),
        "critical_low": Scalar(
            spread(limits.critical_low), "m", "lower end of its 95 % band"
        ),
        "critical_high": Scalar(
            spread(limits.critical_high), "m", "upper end of its 95 % band"
        ),
        "chatter": Scalar(spread(limits.chatter), "Hz", "frequency of chatter there"),
        "limiting_mode": Scalar(
            spread(limits.mode), "Hz", "natural frequency of the mode that limits"
        ),
    }
    return replace(found, more=more)


def _grid_poses(found: StiffnessMap, pose: tuple[str, ...]) -> Array:
    """Return the poses (n, k) of a map's grid, row by row."""
    across, up = np.meshgrid(found.columns, found.rows)
    values = {name: np.full(across.size, value) for name, value in found.at.items()}
    values[found.across] = across.ravel()
    values[found.up] = up.ravel()
    return np.stack([values[name] for name in pose], axis=1)

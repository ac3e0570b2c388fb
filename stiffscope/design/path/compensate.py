"""Compensation: commands along a path that bring the loaded tool to its wanted poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from stiffscope.design.path.along import predict
from stiffscope.design.path.course import BLOCK
from stiffscope.vjm.kinematics import configure
from stiffscope.vjm.mechanism import COORDINATES

if TYPE_CHECKING:
    from stiffscope.design.path.along import Along
    from stiffscope.design.path.toolpath import ToolPath
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.runtime.types import Array, Progress

ROUNDS = 6
_SETTLED = 1e-11  # m, rad


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


def compensate(assembled: Assembled, before: Along, progress: Progress | None = None) -> Compensated:
    """Find commands that cancel the tool's error by fixed-point steps, compliance updated at each.

    Parameters
    ----------
    assembled
        Assembled robot, as in `along`.
    before
        Prediction by `along` for the job's own commands.
    progress
        Progress callback.

    Returns
    -------
    Compensated
        New commands and the remaining error predicted with them. Coordinates that are not commanded
        remain uncompensated.

    """
    pose = [COORDINATES.index(name) for name in before.job.robot.tool.pose]
    refused, state = dict[int, str](), before
    for number in range(ROUNDS):
        wanted = _undo(state)[:, pose]
        drives = np.empty((len(wanted), len(before.drives)))
        for start in range(0, len(wanted), BLOCK):
            some = slice(start, start + BLOCK)
            found = configure(assembled.mechanism, wanted[some])
            refused |= {start + int(k): found.reason(int(k)) for k in np.flatnonzero(~found.valid)}
            drives[some] = found.drives
        commands = wanted
        if before.path.by_joints:
            order = [before.drives.index(name.removeprefix("q:")) for name in before.path.columns]
            commands = drives[:, order]
        commands[list(refused)] = before.path.values[list(refused)]
        new = predict(before, assembled, before.path.command(commands))
        if progress is not None:
            progress("compensation", (number + 1) / ROUNDS)
        last, state = np.abs(state.error[:, pose]).max(), new
        if np.abs(new.error[:, pose]).max() < max(_SETTLED, 1e-9 * last):
            break
    lines = tuple((int(before.path.lines[k]), why) for k, why in sorted(refused.items()))
    return Compensated(state.path, state, state.error[:, pose], lines)


def _undo(state: Along) -> Array:
    """Return the commanded tool poses (n, 6) shifted by the negative error."""
    back = Rotation.from_rotvec(-state.error[:, 3:]) * Rotation.from_rotvec(state.commanded[:, 3:])
    return np.concatenate([state.commanded[:, :3] - state.error[:, :3], back.as_rotvec()], axis=1)

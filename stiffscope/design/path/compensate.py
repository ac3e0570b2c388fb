"""Commands along a path such that the loaded tool is where it should be."""

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
    """Commands, what the loaded tool does with them, and what it is still off by.

    ``left`` (n, c): the error of the coordinates that are commanded, m and rad. ``refused``: line and reason of points
    whose command would be out of reach or of a drive's range; they keep their own.
    """

    path: ToolPath
    after: Along
    left: Array
    refused: tuple[tuple[int, str], ...]


def compensate(assembled: Assembled, before: Along, progress: Progress | None = None) -> Compensated:
    """Find commands that undo the error of the tool, by fixed-point steps; the robot yields as it does there.

    Parameters
    ----------
    assembled
        As `along` takes it.
    before
        What `along` gives for the job's own commands.
    progress
        Told how far it is.

    Returns
    -------
    Compensated
        Verified: what is left is predicted with the new commands. Coordinates that are not commanded are left as
        they are.

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
    """Tool poses (n, 6) that are off the commanded ones by the error, the other way."""
    back = Rotation.from_rotvec(-state.error[:, 3:]) * Rotation.from_rotvec(state.commanded[:, 3:])
    return np.concatenate([state.commanded[:, :3] - state.error[:, :3], back.as_rotvec()], axis=1)

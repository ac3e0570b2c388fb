"""Frames whose readings fit the robot only if mirrored or in another unit, or not at all."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.extremes import measure_robot
from stiffscope.gap.forward.instrument_state import Instruments

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.errors import InputError
    from stiffscope.gap.forward.robot_at_poses import RobotAtPoses
    from stiffscope.runtime.types import Array

_LARGE = 0.01  # of the sizes of robot and workspace: median residuals beyond are no errors of a robot
_WILD = 0.05  # of these sizes: median residuals refused whatever their cause
_RIGHT = (
    0.1  # largest residual of the right reading over that of the readings as they are
)
_MISREAD = {
    -1.0: "mirrored: mirrored axes",
    1e-3: "divided by 1000: mm",
    1e3: "multiplied by 1000: mm",
}


def find_misread(at: RobotAtPoses) -> Iterator[tuple[str, InputError]]:
    """Yield names of such frames with their errors, by the rigid robot as commanded."""
    c = at.campaign
    read = ~np.isnan(c.value[at.instruments.rows])
    if not read.any():
        return
    rows = at.instruments.rows[read]
    every = at.targets(at.rest)
    names = np.array([s.frame for s in c.sensors])[c.sensor[rows]]
    size = measure_robot(at.mechanism)[0] + float(
        np.linalg.norm(np.ptp(every[0], axis=0))
    )
    for name in np.unique(names).tolist():
        part = Instruments(c.select(rows[names == name]))
        targets = [values[read][names == name] for values in every]
        misfit = _misfit(part, targets, 1.0)
        if misfit < _LARGE * size:
            continue
        right, cause = min(
            (_misfit(part, targets, factor), cause)
            for factor, cause in _MISREAD.items()
        )
        fits = right < min(_RIGHT * misfit, _LARGE * size)
        if fits or misfit > _WILD * size:
            meant = (
                f"and {right:.2g} m if {cause}"
                if fits
                else "no error of a robot: wrong poses, rows or frame"
            )
            got = f"ones {misfit:.2g} m off it, {meant}?"
            yield (
                name,
                c.refuse(
                    ("frames", name), f"expected positions of the robot, got {got}"
                ),
            )


def _misfit(part: Instruments, targets: list[Array], factor: float) -> float:
    """Return the median residual, m, of the best fit to readings times a factor."""
    value = factor * part.measured_values
    tried = Instruments(replace(part.campaign, value=value, expected=None))
    return float(
        np.median(np.abs(value - tried.look(tried.start(*targets)[0], *targets)))
    )

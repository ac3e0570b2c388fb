"""Remarks of a robot model on its residuals: excess stiffness, mistaken kinds, weight."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.quantities import AXES, PUSH, STIFFNESS

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.gap.forward.forward_model import Noise
    from stiffscope.gap.forward.robot_readings import RobotReadings
    from stiffscope.runtime.types import Array

    Swap = Callable[[int, int], Array]

_SIGNIFICANT = 3.0  # standard deviations
_OVERTAKES = 0.25  # ratio of misfits below which stiffnesses and pushes seem swapped
_EVIDENT = 25.0  # least improvement of χ² by such a swap
_SWAPS = ((STIFFNESS, PUSH, "k", "p", "free"), (PUSH, STIFFNESS, "p", "k", "held"))


def find_remarks(
    nominal: RobotReadings, swap: Swap, noise: Noise, unexplained: Array, weight: Array
) -> tuple[str, ...]:
    """Return remarks on stiffness above the model's or of a mistaken kind, and on excluded gravity.

    Parameters
    ----------
    nominal
        The robot without effects.
    swap
        Function that predicts readings (n,) with one kind replaced by another.
    noise
        Noise of the readings.
    unexplained
        Residuals (n,) without effects, in standard deviations.
    weight
        Change (n,) of the readings by the robot's weight; zero if the model includes it.
    """
    gravity = _too_weak(weight, noise, unexplained)
    return (*_beyond_bounds(nominal, noise), *_mistaken(nominal, swap, noise), *gravity)


def _beyond_bounds(nominal: RobotReadings, noise: Noise) -> list[str]:
    """Return a remark if stiffnesses exceed the model's, which added compliance only lowers."""
    c = nominal.campaign
    stiff = np.flatnonzero((c.kind == STIFFNESS) & noise.used)
    if not len(stiff):
        return []
    limit = nominal.plain_readings[stiff]
    least = _SIGNIFICANT + np.sqrt(2.0 * np.log(len(stiff)))
    over = (c.value[stiff] - limit) / noise.sigma[stiff] > least
    if not over.any():
        return []
    axes = ", ".join(sorted({f"k{AXES[d]}" for d in c.direction[stiff[over]]}))
    worst = float((c.value[stiff] / limit)[over].max())
    times = f"up to {worst:.3g} times"
    return [
        f"{axes} exceed the model values {times}; added compliance cannot explain this"
    ]


def _mistaken(nominal: RobotReadings, swap: Swap, noise: Noise) -> list[str]:
    """Return a remark if stiffnesses fit far better as pushes, or vice versa."""
    c = nominal.campaign
    out: list[str] = []
    for kind, other, told, meant, held in _SWAPS:
        rows = np.flatnonzero((c.kind == kind) & noise.used)
        if not rows.size:
            continue
        left = (c.value - nominal.plain_readings, c.value - swap(kind, other))
        now, then = (
            float(np.sum((residual[rows] / noise.sigma[rows]) ** 2))
            for residual in left
        )
        if then < _OVERTAKES * now and now - then > _EVIDENT:
            better = f"fit far better as {meant}.., with all other motions {held}"
            out.append(
                f"the stiffnesses {told}.. {better}: χ² {then:.3g} instead of {now:.3g}"
            )
    return out


def _too_weak(step: Array, noise: Noise, unexplained: Array) -> list[str]:
    """Return a remark if gravity would have to be much stronger to explain the gap."""
    column = (step / noise.sigma)[noise.used]
    size = float(column @ column)
    if size <= 0.0:
        return []
    strength = float(column @ unexplained[noise.used]) / size
    if not abs(strength) > _SIGNIFICANT * max(1.0, 1.0 / np.sqrt(size)):
        return []
    times = f"{strength:.3g} times its value"
    return [f"gravity would have to be {times} to explain the gap: not the cause"]

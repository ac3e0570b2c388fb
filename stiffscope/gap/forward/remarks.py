"""What a robot model says of its own residuals: stiffness above the model's, other kinds of reading, its weight."""

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
_OVERTAKES = 0.25  # share of the misfit below which stiffnesses are better taken for pushes, or the other way round
_EVIDENT = 25.0  # χ² that such a change has to gain


def find_remarks(
    nominal: RobotReadings, swap: Swap, noise: Noise, unexplained: Array, weight: Array
) -> tuple[str, ...]:
    """Stiffness above the model's, taken for another kind; gravity where it cannot be the cause.

    Parameters
    ----------
    nominal
        The robot without effects.
    swap
        What the readings (n,) would be if those of one kind were of another.
    noise
        Their noise.
    unexplained
        Residuals (n,) without effects, in standard deviations.
    weight
        Change (n,) of the readings by the robot's weight; zero where the model has it.

    """
    return (*_beyond_bounds(nominal, noise), *_mistaken(nominal, swap, noise), *_too_weak(weight, noise, unexplained))


def _beyond_bounds(nominal: RobotReadings, noise: Noise) -> list[str]:
    """Readings of stiffness above the model's own, which more compliance only lowers."""
    c = nominal.campaign
    stiff = np.flatnonzero((c.kind == STIFFNESS) & noise.used)
    if not len(stiff):
        return []
    limit = nominal.plain_readings[stiff]
    over = (c.value[stiff] - limit) / noise.sigma[stiff] > _SIGNIFICANT + np.sqrt(2.0 * np.log(len(stiff)))
    if not over.any():
        return []
    axes = ", ".join(sorted({f"k{AXES[d]}" for d in c.direction[stiff[over]]}))
    worst = float((c.value[stiff] / limit)[over].max())
    return [f"{axes} exceed what the model has, up to {worst:.3g} times: no added compliance cures that"]


def _mistaken(nominal: RobotReadings, swap: Swap, noise: Noise) -> list[str]:
    """A word where stiffnesses with other motions held fit far better as pushes, or the other way round."""
    c = nominal.campaign
    out: list[str] = []
    for kind, other, told in ((STIFFNESS, PUSH, "k"), (PUSH, STIFFNESS, "p")):
        mine = np.flatnonzero((c.kind == kind) & noise.used)
        if not mine.size:
            continue
        swapped = swap(kind, other)
        now, then = (
            float(np.sum(((c.value - values)[mine] / noise.sigma[mine]) ** 2))
            for values in (nominal.plain_readings, swapped)
        )
        if then < _OVERTAKES * now and now - then > _EVIDENT:
            meant, held = ("p", "free") if told == "k" else ("k", "held")
            out.append(
                f"the stiffnesses {told}.. fit far better as {meant}.., with all other motions {held}: "
                f"χ² {then:.3g} instead of {now:.3g}"
            )
    return out


def _too_weak(step: Array, noise: Noise, unexplained: Array) -> list[str]:
    """Gravity of known size that would have to be many times stronger than it is."""
    column = (step / noise.sigma)[noise.used]
    size = float(column @ column)
    if size <= 0.0:
        return []
    strength = float(column @ unexplained[noise.used]) / size
    if not abs(strength) > _SIGNIFICANT * max(1.0, 1.0 / np.sqrt(size)):
        return []
    return [f"gravity would have to be {strength:.3g} times what it is to explain the gap best, so it is not the cause"]

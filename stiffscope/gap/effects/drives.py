"""Drive stiffness that differs from the stated value."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.effects.effect import (
    ADDED,
    FACTOR,
    FREE,
    STIFFNESS_FACTOR,
    Array,
    Candidates,
    Effect,
    Influence,
    Parameter,
    Setting,
)
from stiffscope.gap.effects.elements import (
    ElementEffect,
    along_drive,
    move_ends,
    soften,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.gap.effects.effect import Array, Changes, NominalRobot


@dataclass(frozen=True)
class ActuatorStiffness(ElementEffect):
    """Factor on the stiffness of drives along their driven directions."""

    word = "actuator-stiffness"
    precedence = 30
    parameters = (Parameter("factor", "1", 1.0, 0.02, 2.0),)
    conversion = STIFFNESS_FACTOR
    bounds = FACTOR
    blames = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at driven joints."""
        robot = setting.robot
        known = cls.parameters[0]
        for place in robot.places(robot.driven):
            factors = [robot.factor(name) for name in place.members]
            count = len(factors)
            within = max(factors)
            size = within - 1.0 if within > 1.0 else known.size
            low = min(known.low, 1.0 / within)
            high = max(known.high, within)
            prior = known._replace(size=size, low=low, high=high)
            yield cls(partial(soften, robot, place.members)).make_candidate(
                place, (prior,)
            )
            if count > 1 and min(factors) > 1.0:
                # with priors this wide each drive may have its own factor besides a common one
                each = tuple(
                    prior._replace(name=f"{name}.{known.name}")
                    for name in place.members
                )
                yield cls(partial(_soften_each, robot, place.members)).make_candidate(
                    place,
                    each,
                    scale=(size,) * (1 + count),
                    groups=(1, count),
                    bounds=FREE,
                    physical=_find_factors,
                    internal=_find_growth,
                )


def _grow(u: Array) -> Array:
    """Return compliance factors (k,): ``1 + e``, or ``1/(1 - e)`` if ``e = u[0] + u[1:] < 0``."""
    e: Array = u[0] + u[1:]
    return np.where(e < 0.0, 1.0 / (1.0 - np.minimum(e, 0.0)), 1.0 + e)


def _find_factors(u: Array) -> Array:
    return 1.0 / _grow(u)


def _find_growth(factors: Array) -> Array:
    """Return the internal parameters (1 + k,) of stiffness factors (k,)."""
    return np.append(0.0, np.where(factors > 1.0, 1.0 - factors, 1.0 / factors - 1.0))


def _soften_each(nominal: NominalRobot, names: Sequence[str], u: Array) -> Changes:
    """Scale the drive compliance of each joint by its own factor (see `_grow`)."""
    more = _grow(u) - 1.0
    return {
        name: soften(nominal, [name], more[k:])[name] for k, name in enumerate(names)
    }


@dataclass(frozen=True)
class Backlash(Effect):
    """Dead zone of a drive, which shifts from its middle towards the force that it carries."""

    word = "backlash"
    precedence = 140
    adoptable = True
    parameters = (Parameter("half_width", "m", 1e-5, 0.0, 1e-3),)
    bounds = ADDED
    blames = True

    drive: str

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at single drives."""
        driven = setting.robot.driven
        for place in setting.robot.places(driven):
            if place.sole:
                turns = driven[place.sole].turns
                own = (
                    cls.parameters if turns else setting.in_robots_units(cls.parameters)
                )
                yield cls(place.sole).make_candidate(
                    place, own, units=("rad" if turns else "m",)
                )

    def influence(self, values: Array) -> Influence:
        """Return the dead zone of the drive."""
        return Influence(dead_zones={self.drive: float(values[0])})


@dataclass(frozen=True)
class EncoderOffset(ElementEffect):
    """Common offset of drive positions from the commanded ones, along their joints' axes."""

    word = "encoder-offset"
    precedence = 110
    parameters = (Parameter("offset", "m", 2e-4, -5e-3, 5e-3),)

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at driven joints."""
        driven = setting.robot.driven
        for place in setting.robot.places(driven):
            directions = {name: along_drive(driven[name]) for name in place.members}
            turns = all(driven[name].turns for name in place.members)
            effect = cls(partial(move_ends, directions))
            own = cls.parameters if turns else setting.in_robots_units(cls.parameters)
            yield effect.make_candidate(place, own, units=("rad" if turns else "m",))

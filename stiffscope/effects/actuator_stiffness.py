"""Drives softer or stiffer than stated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from stiffscope.effects.effect import FACTOR, STIFFNESS_FACTOR, Candidates, Parameter, Setting
from stiffscope.effects.elements import ElementEffect, soften

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.effects.effect import Array, Changes, NominalRobot


@dataclass(frozen=True)
class ActuatorStiffness(ElementEffect):
    """Drives yield along what they drive by more, or less."""

    word = "actuator-stiffness"
    precedence = 30
    parameters = (Parameter("factor", "1", 1.0, 0.02, 2.0),)
    conversion = STIFFNESS_FACTOR
    bounds = FACTOR
    blames = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """At driven joints."""
        robot, known = setting.robot, cls.parameters[0]
        for place in robot.places(robot.driven):
            within = max(robot.factor(name) for name in place.members)
            size = within - 1.0 if within > 1.0 else known.size
            prior = known._replace(size=size, low=min(known.low, 1.0 / within), high=max(known.high, within))
            yield cls(partial(soften, robot, place.members)).make_candidate(place, (prior,))
            if (
                len(place.members) > 1 and min(robot.factor(name) for name in place.members) > 1.0
            ):  # known so little, each may be off by a factor of its own
                each = tuple(prior._replace(name=f"{name}.{known.name}") for name in place.members)
                yield cls(partial(_soften_each, robot, place.members)).make_candidate(place, each)


def _soften_each(nominal: NominalRobot, names: Sequence[str], u: Array) -> Changes:
    """Compliances of driven joints along their drives grow by ``u`` (k,) times their nominal."""
    return {name: change for k, name in enumerate(names) for name, change in soften(nominal, [name], u[k:]).items()}

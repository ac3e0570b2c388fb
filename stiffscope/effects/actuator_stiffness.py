"""Drives softer or stiffer than stated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from stiffscope.effects.effect import FACTOR, STIFFNESS_FACTOR, Candidates, Parameter, Setting
from stiffscope.effects.elements import ElementEffect, soften


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

"""Length errors of elastic bodies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from stiffscope.effects.effect import Candidates, Parameter, Setting
from stiffscope.effects.elements import ALONG, ElementEffect, move_ends


@dataclass(frozen=True)
class LinkLength(ElementEffect):
    """Length error of bodies, along their own axes."""

    word = "link-length"
    precedence = 120
    parameters = (Parameter("error", "m", 1e-4, -3e-3, 3e-3),)

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at elastic bodies with two ends."""
        for place in setting.robot.places(setting.robot.links):
            effect = cls(partial(move_ends, dict.fromkeys(place.members, ALONG)))
            yield effect.make_candidate(place, setting.in_robots_units(cls.parameters))

"""Zero errors of drives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from stiffscope.effects.effect import Candidates, Parameter, Setting
from stiffscope.effects.elements import ElementEffect, along_drive, move_ends


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
            turns = all(driven[name].kind == "revolute" for name in place.members)
            effect = cls(partial(move_ends, directions))
            own = cls.parameters if turns else setting.in_robots_units(cls.parameters)
            yield effect.make_candidate(place, own, units=("rad" if turns else "m",))

"""Backlash of drives."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import (
    ADDED,
    Array,
    Candidates,
    Effect,
    Influence,
    Parameter,
    Setting,
)


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
                turns = driven[place.sole].kind == "revolute"
                own = (
                    cls.parameters if turns else setting.in_robots_units(cls.parameters)
                )
                yield cls(place.sole).make_candidate(
                    place, own, units=("rad" if turns else "m",)
                )

    def influence(self, values: Array) -> Influence:
        """Return the dead zone of the drive."""
        return Influence(dead_zones={self.drive: float(values[0])})

"""Elastic bodies softer or stiffer than modelled, equally in all directions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

from stiffscope.effects.effect import (
    FACTOR,
    STIFFNESS_FACTOR,
    Candidates,
    Parameter,
    Setting,
)
from stiffscope.effects.elements import ElementEffect, soften
from stiffscope.effects.part_compliance import PartCompliance, yielding_bodies


@dataclass(frozen=True)
class LinkStiffness(ElementEffect):
    """Factor on the stiffness of bodies; that of `part-compliance` multiplies the compliance."""

    word = "link-stiffness"
    precedence = 50
    parameters = (Parameter("factor", "1", 1.0, 0.02, 2.0),)
    conversion = STIFFNESS_FACTOR
    bounds = FACTOR
    blames = True
    of_matrix = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at elastic bodies, except where `part-compliance` names the factor."""
        robot = setting.robot
        for place in robot.places(yielding_bodies(robot)):
            if place.name not in PartCompliance.named:
                found = cls(partial(soften, robot, place.members)).make_candidate(place)
                names = (
                    f"{PartCompliance.word} @ {name}"
                    for name in (place.name, *place.others)
                )
                yield replace(found, aliases=(*found.aliases, *names))

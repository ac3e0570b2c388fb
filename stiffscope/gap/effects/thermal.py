"""Thermal expansion of elastic bodies."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from stiffscope.gap.effects.effect import (
    Candidates,
    NominalRobot,
    Parameter,
    Place,
    Setting,
)
from stiffscope.gap.effects.elements import ElementEffect, move_ends

if TYPE_CHECKING:
    from collections.abc import Iterator


_ALL = "robot"


@dataclass(frozen=True)
class Thermal(ElementEffect):
    """Temperature rise of bodies, which expand according to their materials."""

    word = "thermal"
    precedence = 130
    parameters = (Parameter("temperature", "K", 10.0, -60.0, 100.0),)

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at elastic bodies of known material and at the whole robot."""
        robot = setting.robot
        bodies = robot.elastic_sources
        growth = {
            name: (robot.expansion(name) or 0.0) * robot.growth(name) for name in bodies
        }
        for place in _places(robot, [name for name in growth if growth[name].any()]):
            effect = cls(
                partial(move_ends, {name: growth[name] for name in place.members})
            )
            yield effect.make_candidate(place)


def _places(robot: NominalRobot, warm: list[str]) -> Iterator[Place]:
    """Yield the places of the bodies; the set of all is also called `robot`."""
    places = robot.places(warm)
    if len(warm) > 1 and not any(set(place.members) == set(warm) for place in places):
        yield Place(_ALL, tuple(warm))
    for place in places:
        whole = set(place.members) == set(warm) and place.name != _ALL
        yield replace(place, others=(*place.others, _ALL)) if whole else place

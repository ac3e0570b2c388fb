"""Compliance of linear guides across the slide and about its axes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from stiffscope.effects.effect import ADDED, Candidates, Parameter, Setting
from stiffscope.effects.elements import ROTATIONS, ElementEffect, add_diagonal

_ALIKE = np.array([np.eye(6)[1], np.eye(6)[2], ROTATIONS])
_APART = np.eye(6)[1:]
_SHIFTS = tuple(Parameter(name, "m/N", low=0.0) for name in ("lateral", "vertical"))
_TURNS = [
    Parameter(name, "rad/(N·m)", low=0.0)
    for name in ("angular", "roll", "pitch", "yaw")
]


@dataclass(frozen=True)
class GuideCompliance(ElementEffect):
    """Lateral, vertical and angular compliance of guides; angular per axis or common to all."""

    word = "guide-compliance"
    precedence = 80
    parameters = (*_SHIFTS, _TURNS[0])
    apart = (*_SHIFTS, *_TURNS[1:])
    bounds = ADDED
    blames = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at prismatic joints."""
        slides = [
            j.name for j in setting.robot.mechanism.joints if j.kind == "prismatic"
        ]
        for place in setting.robot.places(slides):
            for patterns, known in ((_ALIKE, cls.parameters), (_APART, cls.apart)):
                effect = cls(
                    partial(add_diagonal, dict.fromkeys(place.members, patterns))
                )
                yield effect.make_candidate(place, setting.in_robots_units(known))

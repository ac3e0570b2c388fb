"""Guides of slides that yield across the slide and about all axes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from stiffscope.effects.effect import ADDED, Candidates, Parameter, Setting
from stiffscope.effects.elements import ROTATIONS, ElementEffect, add_diagonal

_PATTERNS = np.array([np.eye(6)[1], np.eye(6)[2], ROTATIONS])


@dataclass(frozen=True)
class GuideCompliance(ElementEffect):
    """Guides yield sideways, up and down, and about all axes alike."""

    word = "guide-compliance"
    precedence = 80
    parameters = (
        Parameter("lateral", "m/N", low=0.0),
        Parameter("vertical", "m/N", low=0.0),
        Parameter("angular", "rad/(N·m)", low=0.0),
    )
    bounds = ADDED
    blames = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """At slides."""
        slides = [joint.name for joint in setting.robot.mechanism.joints if joint.kind == "prismatic"]
        for place in setting.robot.places(slides):
            effect = cls(partial(add_diagonal, dict.fromkeys(place.members, _PATTERNS)))
            yield effect.make_candidate(place, setting.in_robots_units(cls.parameters))

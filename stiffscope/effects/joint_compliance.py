"""Bearings of joints that yield along and about what they hold."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.effects.effect import ADDED, Array, Candidates, Parameter, Setting
from stiffscope.effects.elements import ALONG, ROTATIONS, ElementEffect, add_diagonal

if TYPE_CHECKING:
    from stiffscope.vjm.joints import Joint


_RADIAL = np.array([0.0, 1, 1, 0, 0, 0])


@dataclass(frozen=True)
class JointCompliance(ElementEffect):
    """Bearings yield across, along and about the axes of their joints; those of driven slides are guides."""

    word = "joint-compliance"
    precedence = 40
    parameters = (
        Parameter("radial", "m/N", low=0.0),
        Parameter("axial", "m/N", low=0.0),
        Parameter("tilting", "rad/(N·m)", low=0.0),
    )
    bounds = ADDED
    blames = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """At all joints but driven slides, with what some of them hold."""
        joints = {j.name: j for j in setting.robot.mechanism.joints}
        bearings = {n: held_patterns(j) for n, j in joints.items() if j.kind != "prismatic" or j.drive is None}
        for place in setting.robot.places(bearings):
            held = [p for p in cls.parameters if any(p.name in bearings[m] for m in place.members)]
            patterns = {m: np.array([bearings[m].get(p.name, np.zeros(6)) for p in held]) for m in place.members}
            effect = cls(partial(add_diagonal, patterns))
            yield effect.make_candidate(place, setting.in_robots_units(held))


def held_patterns(joint: Joint) -> dict[str, Array]:
    """What a joint's bearing yields along, (6,) in the joint's axes, by the words of `joint-compliance`."""
    held, turns = joint.held_components
    mask = np.zeros(6)
    mask[[*held, *(3 + k for k in turns)]] = 1.0
    axial = ALONG if joint.axis is not None else 0.0 * ALONG
    words = {"radial": _RADIAL + (ALONG - axial), "axial": axial, "tilting": ROTATIONS}
    return {word: pattern * mask for word, pattern in words.items() if (pattern * mask).any()}

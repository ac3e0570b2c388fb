"""Compliance of joint bearings in their constrained directions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.effects.effect import ADDED, Array, Candidates, Parameter, Setting
from stiffscope.effects.elements import (
    ALONG,
    ROTATIONS,
    ElementEffect,
    add_diagonal,
    pick_patterns,
)

if TYPE_CHECKING:
    from stiffscope.vjm.joints import Joint


_RADIAL = np.array([0.0, 1, 1, 0, 0, 0])


@dataclass(frozen=True)
class JointCompliance(ElementEffect):
    """Bearings yield across, along and about the axes of their joints, or across as much as along.

    Those of driven slides are guides.
    """

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
        """Yield candidates at all joints except driven slides, in their constrained directions."""
        joints = setting.robot.mechanism.joints
        own = setting.in_robots_units(cls.parameters)
        bearings = [j for j in joints if j.kind != "prismatic" or j.drive is None]
        held = {j.name: held_patterns(j) for j in bearings}
        for place in setting.robot.places(held):
            known, patterns = pick_patterns(held, place, own)
            yield cls(partial(add_diagonal, patterns)).make_candidate(place, known)
            if [p.name for p in known[:2]] == ["radial", "axial"]:
                alike = {
                    m: np.vstack([a + b, *rest])
                    for m, (a, b, *rest) in patterns.items()
                }
                yield cls(partial(add_diagonal, alike)).make_candidate(
                    place,
                    known,
                    scale=tuple(p.size for p in known[1:]),
                    physical=_tell_apart,
                    internal=itemgetter(slice(1, None)),
                )


def _tell_apart(values: Array) -> Array:
    """Return radial, axial and other values of a bearing that yields alike across and along."""
    return np.append(values[:1], values)


def held_patterns(joint: Joint) -> dict[str, Array]:
    """Return constrained directions (6,), joint axes, by parameter of `joint-compliance`."""
    held, turns = joint.held_components
    mask = np.zeros(6)
    mask[[*held, *(3 + k for k in turns)]] = 1.0
    axial = ALONG if joint.axis is not None else 0.0 * ALONG
    words = {"radial": _RADIAL + (ALONG - axial), "axial": axial, "tilting": ROTATIONS}
    return {
        word: pattern * mask
        for word, pattern in words.items()
        if (pattern * mask).any()
    }

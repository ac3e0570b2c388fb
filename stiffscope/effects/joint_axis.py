"""Axes of joints that are not where they are drawn."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.effects.effect import Candidates, Parameter, Setting
from stiffscope.effects.elements import ElementEffect
from stiffscope.vjm.joints import LED
from stiffscope.vjm.mechanism import Change

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stiffscope.effects.effect import Array, Changes
    from stiffscope.vjm.mechanism import Mechanism

ACROSS = {"y": 1, "z": 2, "ry": 4, "rz": 5}
"""Twists of an axis square to it, in the joint's axes, that change where it leads a body."""


@dataclass(frozen=True)
class JointAxis(ElementEffect):
    """A joint turns or slides along an axis that lies off the drawn one; bodies are as drawn at home.

    Where it turns, the robot stands elsewhere; its stiffness changes by its posture alone.
    """

    word = "joint-axis"
    precedence = 112
    parameters = (
        *(Parameter(name, "m", 2e-4, -1e-2, 1e-2) for name in ("y", "z")),
        *(Parameter(name, "rad", 1e-3, -0.05, 0.05) for name in ("ry", "rz")),
    )

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """At joints that lead a body about or along one axis."""
        twists = find_axis_twists(setting.robot.mechanism)
        for place in setting.robot.places(twists):
            axes = setting.in_robots_units(cls.parameters)
            known = [p for p in axes if any(p.name in twists[name] for name in place.members)]
            patterns = {n: np.array([twists[n].get(p.name, np.zeros(6)) for p in known]) for n in place.members}
            yield cls(partial(mislay_axes, patterns)).make_candidate(place, known)


def find_axis_twists(mechanism: Mechanism) -> dict[str, dict[str, Array]]:
    """By joint that leads a body, how its axis may lie off (6,), by name: that of a slide turned alone."""
    return {
        joint.name: {name: np.eye(6)[k] for name, k in ACROSS.items() if k > 2 or joint.kind != "prismatic"}
        for joint in mechanism.joints
        if joint.kind in LED
    }


def mislay_axes(patterns: Mapping[str, Array], values: Array) -> Changes:
    """Axes of joints lie off by their own twists (k, 6) times the parameters (k,)."""
    return {name: Change(astray=values @ pattern) for name, pattern in patterns.items()}

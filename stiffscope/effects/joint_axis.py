"""Position and direction errors of joint axes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.effects.effect import Candidates, Parameter, Setting
from stiffscope.effects.elements import ElementEffect, pick_patterns
from stiffscope.vjm.joints import LED
from stiffscope.vjm.mechanism import Change

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stiffscope.effects.effect import Array, Changes
    from stiffscope.vjm.mechanism import Mechanism

ACROSS = {"y": 1, "z": 2, "ry": 4, "rz": 5}
"""Component indices of axis errors perpendicular to the axis, in the joint's axes."""


@dataclass(frozen=True)
class JointAxis(ElementEffect):
    """Deviation of a joint's axis from the drawn one; bodies are as drawn in the home pose.

    Away from home it displaces the robot; the stiffness changes only through the posture.
    """

    word = "joint-axis"
    precedence = 112
    parameters = (
        *(Parameter(name, "m", 2e-4, -1e-2, 1e-2) for name in ("y", "z")),
        *(Parameter(name, "rad", 1e-3, -0.05, 0.05) for name in ("ry", "rz")),
    )

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at joints that guide a body about or along one axis."""
        twists = find_axis_twists(setting.robot.mechanism)
        for place in setting.robot.places(twists):
            axes = setting.in_robots_units(cls.parameters)
            known, patterns = pick_patterns(twists, place, axes)
            yield cls(partial(mislay_axes, patterns)).make_candidate(place, known)


def find_axis_twists(mechanism: Mechanism) -> dict[str, dict[str, Array]]:
    """Return axis error twists (6,) by joint and name; axes of slides can only be rotated."""
    return {
        j.name: {
            name: np.eye(6)[k]
            for name, k in ACROSS.items()
            if k > 2 or j.kind != "prismatic"
        }
        for j in mechanism.joints
        if j.kind in LED
    }


def mislay_axes(patterns: Mapping[str, Array], values: Array) -> Changes:
    """Displace joint axes by the parameters (k,) times their own twists (k, 6)."""
    return {name: Change(astray=values @ pattern) for name, pattern in patterns.items()}

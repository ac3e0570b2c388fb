"""Spring stiffness of passive joints, such as flexures, that differs from the stated value."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from stiffscope.effects.effect import (
    FACTOR,
    GROWTH,
    Array,
    Candidates,
    Changes,
    Parameter,
    Setting,
)
from stiffscope.effects.elements import ElementEffect
from stiffscope.vjm.joints import ALIKE
from stiffscope.vjm.mechanism import Change


@dataclass(frozen=True)
class JointStiffness(ElementEffect):
    """Factor on the spring stiffness of passive joints."""

    word = "joint-stiffness"
    precedence = 85
    parameters = (Parameter("factor", "1", 1.0, 0.02, 50.0),)
    conversion = GROWTH
    bounds = FACTOR
    blames = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at passive joints with a stated spring."""
        robot = setting.robot
        passive = [
            j for j in robot.mechanism.joints if j.drive is None and j.kind in ALIKE
        ]
        springs = {j.name: j.spring for j in passive if j.spring is not None}
        for place in robot.places(springs):
            action = cls(
                partial(_scale, {name: springs[name] for name in place.members})
            )
            yield action.make_candidate(place)


def _scale(springs: dict[str, float], u: Array) -> Changes:
    return {
        name: Change(spring=float(u[0]) * stiffness)
        for name, stiffness in springs.items()
    }

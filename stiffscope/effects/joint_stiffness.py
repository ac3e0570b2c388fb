"""Passive joints that resist their motion: flexures stiffer or softer than stated, hinges that are not free."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from stiffscope.effects.effect import ADDED, FACTOR, GROWTH, Array, Candidates, Changes, Parameter, Setting
from stiffscope.effects.elements import ElementEffect
from stiffscope.vjm.joints import ALIKE
from stiffscope.vjm.mechanism import Change

_SHARE = 0.01  # of the robot's own stiffness, that a joint which should be free has


@dataclass(frozen=True)
class JointStiffness(ElementEffect):
    """Springs in passive joints are other than stated, or are where none is."""

    word = "joint-stiffness"
    precedence = 85
    parameters = (Parameter("factor", "1", 1.0, 0.02, 50.0), Parameter("stiffness", "N·m/rad", low=0.0))
    blames = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """At passive joints: a factor on their springs, or a stiffness where they have none."""
        robot = setting.robot
        passive = [j for j in robot.mechanism.joints if j.drive is None and j.kind in ALIKE]
        springs = {j.name: j.spring for j in passive if j.spring is not None}
        for place in robot.places(springs):
            action = cls(partial(_scale, {name: springs[name] for name in place.members}))
            yield action.make_candidate(
                place, cls.parameters[:1], bounds=FACTOR, physical=GROWTH[0], internal=GROWTH[1]
            )
        for slides in (False, True):
            free = [j.name for j in passive if j.spring is None and (j.kind == "prismatic") == slides]
            size = _SHARE / setting.compliance[not slides]
            stiffness = Parameter("stiffness", "N/m" if slides else "N·m/rad", size, 0.0)
            for place in robot.places(free):
                yield cls(partial(_add, place.members)).make_candidate(place, (stiffness,), bounds=ADDED)


def _scale(springs: dict[str, float], u: Array) -> Changes:
    return {name: Change(spring=float(u[0]) * stiffness) for name, stiffness in springs.items()}


def _add(names: tuple[str, ...], u: Array) -> Changes:
    return {name: Change(spring=float(u[0])) for name in names}

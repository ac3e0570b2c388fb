"""Many small errors of joint axes and drive zeros as one cause."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.effects.effect import Candidates, Parameter, Place, Setting
from stiffscope.gap.effects.elements import ElementEffect, along_drive
from stiffscope.gap.effects.joints import find_axis_twists
from stiffscope.vjm.model.mechanism import Change

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from stiffscope.gap.effects.effect import Array, Changes, NominalRobot

_ALL = "robot"
_LEAST = 2  # joints that make a set


@dataclass(frozen=True)
class _Error:
    """A small error of a joint's axis or of its drive's zero."""

    joint: str
    name: str
    twist: Array
    """Twist (6,) in the joint's axes."""
    turns: bool


@dataclass(frozen=True)
class Geometry(ElementEffect):
    """Small errors of all axes and zeros, with one unknown size for lengths and one for angles.

    Internal parameters are the errors, lengths first; physical ones are their root mean squares.
    """

    word = "geometry"
    precedence = 115
    joins_noise = False  # it can fit almost anything
    linear = True
    parameters = (
        Parameter("offset", "m", 3e-4, 0.0, 1e-2),
        Parameter("angle", "rad", 1e-3, 0.0, 0.05),
    )

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates for the whole robot and for groups of joints."""
        robot = setting.robot
        twists = find_axis_twists(robot.mechanism)
        known = setting.in_robots_units(cls.parameters)
        for place in _places(robot, list(twists)):
            errors = sorted(
                _errors(robot, place.members), key=lambda error: error.turns
            )
            turns = [error.turns for error in errors]
            kinds = [known[turn] for turn in sorted(set(turns))]
            counts = tuple(turns.count(turn) for turn in sorted(set(turns)))
            yield cls(partial(_displace, _find_patterns(errors))).make_candidate(
                place,
                kinds,
                scale=tuple(known[t].size for t in turns),
                groups=counts,
                parts=tuple(f"{e.joint}.{e.name}" for e in errors),
                physical=partial(_rms, counts),
                part_units=tuple("rad" if t else "m" for t in turns),
                flexible=True,
            )


def _places(robot: NominalRobot, joints: Sequence[str]) -> Iterator[Place]:
    """Yield sets of joints; the set of all is called `robot`."""
    if len(joints) >= _LEAST:
        yield Place(_ALL, tuple(joints))
    for place in robot.places(joints):
        if _LEAST <= len(place.members) < len(joints):
            yield place


def _errors(robot: NominalRobot, joints: Sequence[str]) -> Iterator[_Error]:
    twists = find_axis_twists(robot.mechanism)
    for name in joints:
        for word, twist in twists[name].items():
            yield _Error(name, word, twist, word.startswith("r"))
        if name in robot.driven:
            joint = robot.driven[name]
            yield _Error(name, "zero", along_drive(joint), joint.turns)


def _find_patterns(errors: Sequence[_Error]) -> tuple[list[str], Array]:
    """Return joints and their twists (k, joints, 2, 6) of zero and axis per unit error (k,)."""
    joints = list(dict.fromkeys(error.joint for error in errors))
    out = np.zeros((len(errors), len(joints), 2, 6))
    for k, error in enumerate(errors):
        out[k, joints.index(error.joint), int(error.name != "zero")] = error.twist
    return joints, out


def _displace(patterns: tuple[list[str], Array], values: Array) -> Changes:
    """Return the changes of axes and zeros for errors (k,)."""
    joints, twists = patterns
    moved = zip(joints, np.tensordot(values, twists, 1), strict=True)
    return {
        joint: Change(offset=zero, misalignment=axis) for joint, (zero, axis) in moved
    }


def _rms(counts: Sequence[int], values: Array) -> Array:
    """Return the root mean square of each group of values (k,)."""
    ends = np.cumsum([0, *counts]).tolist()
    return np.array(
        [np.sqrt(np.mean(np.square(values[a:b]))) for a, b in pairwise(ends)]
    )

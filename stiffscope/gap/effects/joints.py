"""Compliance of joint bearings in their constrained directions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.effects.effect import (
    ADDED,
    FACTOR,
    GROWTH,
    Array,
    Candidates,
    Changes,
    Parameter,
    Setting,
)
from stiffscope.gap.effects.elements import (
    ALONG,
    ROTATIONS,
    ElementEffect,
    add_diagonal,
    pick_patterns,
)
from stiffscope.vjm.model.mechanism import Change

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stiffscope.gap.effects.effect import Array, Changes
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.mechanism import Mechanism


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
        parameters = setting.in_robots_units(cls.parameters)
        bearings = [j for j in joints if j.kind != "prismatic" or j.drive is None]
        held = {j.name: held_patterns(j) for j in bearings}
        for place in setting.robot.places(held):
            known, patterns = pick_patterns(held, place, parameters)
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
            j for j in robot.mechanism.joints if j.drive is None and j.type.is_uniform
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


ACROSS = {"y": 1, "z": 2, "ry": 4, "rz": 5}
"""Component indices of axis errors perpendicular to the axis, in the joint's axes."""


@dataclass(frozen=True)
class JointAxis(ElementEffect):
    """Deviation of a joint's axis from the drawn one; bodies are as drawn in the home pose.

    Away from home it displaces the robot; the stiffness changes only through the posture.
    """

    word = "joint-axis"
    precedence = 112
    gives_way = True  # axes of many joints fit almost anything
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
        if j.type.driven is not None
    }


def mislay_axes(patterns: Mapping[str, Array], values: Array) -> Changes:
    """Displace joint axes by the parameters (k,) times their own twists (k, 6)."""
    return {
        name: Change(misalignment=values @ pattern)
        for name, pattern in patterns.items()
    }

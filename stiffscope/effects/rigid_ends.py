"""Uniform bodies with rigid ends."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.effects.effect import (
    ADDED,
    Array,
    Candidates,
    Changes,
    NominalRobot,
    Parameter,
    Setting,
)
from stiffscope.effects.elements import ElementEffect
from stiffscope.effects.part_compliance import yielding_bodies
from stiffscope.fea.beam import cantilever
from stiffscope.vjm.mechanism import Change
from stiffscope.vjm.screws import shift

if TYPE_CHECKING:
    from collections.abc import Sequence


_UNIFORM = 0.02  # relative tolerance on the entries of a uniform beam
_LEAST = -0.2
_MOST = 0.45  # range of the clamped length over the body's length


@dataclass(frozen=True)
class RigidEnds(ElementEffect):
    """Length of rigid ends of bodies, which bend only in between."""

    word = "rigid-ends"
    precedence = 70
    parameters = (Parameter("length", "m", 0.02, 0.0, 0.15),)
    bounds = ADDED
    of_matrix = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at uniform elastic bodies."""
        robot = setting.robot
        links = [name for name in yielding_bodies(robot) if name in robot.links]
        for place in robot.places(name for name in links if _is_uniform(robot, name)):
            effect = cls(partial(_clamp_ends, robot, place.members))
            yield effect.make_candidate(place, setting.in_robots_units(cls.parameters))


def _is_uniform(robot: NominalRobot, name: str) -> bool:
    """Return whether a body's compliance (6, 6) is that of a uniform cantilever of its length."""
    c = robot.compliances[name]
    length = robot.length(name)
    bent = np.array([c[5, 5], -c[4, 4]]) * length / 2.0
    near = (
        bent.all()
        and (np.abs(c[(1, 2), (5, 4)] - bent) <= _UNIFORM * np.abs(bent)).all()
    )
    sheared = c[1, 1] - c[5, 5] * length**2 / 3.0, c[2, 2] - c[4, 4] * length**2 / 3.0
    return bool(near and min(sheared) >= -_UNIFORM * min(c[1, 1], c[2, 2]))


def _clamp_ends(nominal: NominalRobot, names: Sequence[str], values: Array) -> Changes:
    """Return the changes of uniform bodies that bend only between rigid ends, at the tip."""
    changes: Changes = {}
    for name in names:
        c = nominal.compliances[name]
        length = nominal.length(name)
        clamped = float(np.clip(values[0], _LEAST * length, _MOST * length))
        to_end = shift([clamped, 0.0, 0.0])
        rates = (
            np.diagonal(c) / length
        )  # of the section: axial, shear y, z, torsion, bending y, z
        rates[1] -= c[5, 5] * length / 3.0
        rates[2] -= c[4, 4] * length / 3.0
        short = cantilever(length - 2.0 * clamped, rates)
        full = cantilever(length, rates)
        changes[name] = Change(to_end @ short @ to_end.T - full)
    return changes

"""Masses of bodies that are not those stated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiffscope.effects.effect import (
    GROWTH,
    Array,
    Candidates,
    Effect,
    Influence,
    NominalRobot,
    Parameter,
    Payload,
    Setting,
)

_NONE = -1.0  # growth of a body that weighs nothing
_HEAVIEST = 50.0


@dataclass(frozen=True)
class Mass(Effect):
    """Bodies weigh a factor times what their file says, where their mass is."""

    word = "mass"
    precedence = 25
    parameters = (Parameter("factor", "1", 0.2, 0.3, 3.0),)
    conversion = GROWTH
    bounds = (_NONE, _HEAVIEST)
    blames = True

    stated: tuple[Payload, ...]
    """Masses of the bodies as their file has them."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """At bodies whose mass is stated at a point, and at sets of them; none where nothing is heavy."""
        robot = setting.robot
        if not robot.mechanism.gravity.any():
            return
        heavy = find_masses(robot)
        for place in robot.places(heavy):
            yield cls(tuple(part for name in place.members for part in heavy[name])).make_candidate(place)

    def influence(self, values: Array) -> Influence:
        """The masses that are more, or less."""
        growth = float(values[0])
        return Influence(payloads=tuple(Payload(p.body, p.at, growth * p.mass, 0.0 * p.moments) for p in self.stated))

    @classmethod
    def refusal(cls, robot: NominalRobot, place: str) -> str:
        """Nothing: a robot file can carry it."""
        del robot, place
        return ""


def find_masses(robot: NominalRobot) -> dict[str, tuple[Payload, ...]]:
    """Masses by body: of a rigid one at its centre, of an elastic one without mass data half at either end."""
    out: dict[str, tuple[Payload, ...]] = {}
    for body in robot.mechanism.bodies:
        if not body.mass or (body.elastic is not None and body.elastic.dynamics is not None):
            continue
        centre = np.zeros(3) if body.centre is None else body.centre
        places = [centre] if body.elastic is None else body.elastic.places
        nodes = [body.name] if body.elastic is None else body.nodes
        share = body.mass / len(places)
        out[body.name] = tuple(
            Payload(node, np.array(at), share, np.zeros(3)) for node, at in zip(nodes, places, strict=True)
        )
    return out

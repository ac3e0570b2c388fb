"""Masses of bodies that differ from the stated ones."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiffscope.effects.effect import (
    GROWTH,
    KNOWN,
    Array,
    Candidates,
    Effect,
    Influence,
    NominalRobot,
    Parameter,
    Payload,
    Setting,
)

_NONE = -1.0  # relative change to a massless body
_HEAVIEST = 50.0


@dataclass(frozen=True)
class Mass(Effect):
    """Factor on the stated mass of bodies, acting at its stated place."""

    word = "mass"
    precedence = 25
    adoptable = True
    parameters = (Parameter("factor", "1", 0.2, 0.3, 3.0),)
    conversion = GROWTH
    bounds = (_NONE, _HEAVIEST)
    blames = True

    stated: tuple[Payload, ...]
    """Masses of the bodies as stated in the robot file."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield point masses of bodies and sets, within tolerances; none without gravity."""
        robot = setting.robot
        if not robot.mechanism.gravity.any():
            return
        heavy = find_masses(robot)
        (known,) = cls.parameters
        (low, high) = cls.bounds
        bodies = [body for body in robot.mechanism.bodies if body.mass]
        stated = {body.name: robot.mass_sigma(body.name) / body.mass for body in bodies}
        for place in robot.places(heavy):
            most = KNOWN * max(stated[name] for name in place.members)
            size = min(known.size, most / KNOWN)
            least = max(known.low, 1.0 - most)
            prior = known._replace(
                size=size, low=least, high=min(known.high, 1.0 + most)
            )
            effect = cls(tuple(part for name in place.members for part in heavy[name]))
            bounds = max(low, -most), min(high, most)
            yield effect.make_candidate(
                place, (prior,), bounds=bounds, stated=most < np.inf
            )

    def influence(self, values: Array) -> Influence:
        """Return the changes of mass as payloads."""
        growth = float(values[0])
        return Influence(
            payloads=tuple(replace(p, mass=growth * p.mass) for p in self.stated)
        )


def find_masses(robot: NominalRobot) -> dict[str, tuple[Payload, ...]]:
    """Return masses by body: at the centre if rigid, half at each end if elastic (no mass data)."""
    out: dict[str, tuple[Payload, ...]] = {}
    for body in robot.mechanism.bodies:
        if not body.mass or (
            body.elastic is not None and body.elastic.dynamics is not None
        ):
            continue
        centre = np.zeros(3) if body.centre is None else body.centre
        places = [centre] if body.elastic is None else body.elastic.places
        nodes = [body.name] if body.elastic is None else body.nodes
        share = body.mass / len(places)
        ends = zip(nodes, places, strict=True)
        out[body.name] = tuple(
            Payload(node, np.array(at), share, np.zeros(3)) for node, at in ends
        )
    return out

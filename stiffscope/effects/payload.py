"""An unmodelled mass on a rigid body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.effects.effect import (
    ADDED,
    KNOWN,
    Array,
    Candidates,
    Effect,
    Influence,
    Parameter,
    Payload,
    Place,
    Setting,
)

if TYPE_CHECKING:
    from stiffscope.runtime.types import Indices
    from stiffscope.vjm.bodies import Body
    from stiffscope.vjm.mechanism import Mechanism


_LEAST = 1e-9  # kg: least mass by which a centre is computed


@dataclass(frozen=True)
class AddedMass(Effect):
    """An added mass with first moments along the axes that readings can show."""

    word = "payload"
    precedence = 20
    adoptable = True
    parameters = (
        Parameter("mass", "kg", 0.2, 0.0, 3.0),
        *(Parameter(x, "m", 0.25, -0.5, 0.5) for x in "xyz"),
    )
    bounds = ADDED

    body: str
    point: Array
    """Point (3,) in the home pose, m."""
    axes: Indices
    """Axes (of x, y, z at home) along which its centre may deviate from the point."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield masses on rigid bodies, with and without first moments; none without gravity.

        If a body's mass has a stated tolerance, only a point mass within that tolerance is yielded.
        """
        mechanism = setting.robot.mechanism
        level = np.sort(np.argsort(np.abs(mechanism.gravity), kind="stable")[:2])
        for body in mechanism.bodies if mechanism.gravity.any() else ():
            if body.elastic is None:
                axes = np.arange(3) if setting.turning.get(body.name, True) else level
                heavy = cls(body.name, _find_point(mechanism, body), axes)
                place = Place(body.name)
                sigma = setting.robot.mass_sigma(body.name)
                known = sigma < np.inf
                mass, *centre = setting.in_robots_units(cls.parameters)
                mass = mass._replace(
                    size=min(mass.size, sigma), high=min(mass.high, KNOWN * sigma)
                )
                if not known:
                    moments = (mass.size * centre[a].size for a in axes)
                    yield heavy.make_candidate(
                        place,
                        (mass, *centre),
                        scale=(mass.size, *moments),
                        couplings=len(axes),
                        physical=heavy.physical,
                        internal=heavy.internal,
                    )
                bounds = 0.0, KNOWN * sigma
                yield heavy.make_candidate(place, (mass,), bounds=bounds, stated=known)

    def influence(self, values: Array) -> Influence:
        """Return the mass, and its first moments if given."""
        moments = np.zeros(3)
        moments[self.axes[: len(values) - 1]] = values[1:]
        return Influence(
            payloads=(Payload(self.body, self.point, float(values[0]), moments),)
        )

    def physical(self, values: Array) -> Array:
        """Return mass and centre of mass (4,) for internal parameters."""
        out = np.zeros(4)
        out[0] = values[0]
        out[1 + self.axes] = values[1:] / (
            values[0] if abs(values[0]) > _LEAST else _LEAST
        )
        return out

    def internal(self, values: Array) -> Array:
        """Return mass and first moments for physical parameters (4,)."""
        return np.array([values[0], *(values[0] * values[1 + self.axes])])


def _find_point(mechanism: Mechanism, body: Body) -> Array:
    """Return a body's payload point (3,) at home: M, its centre, or the mean of its joints."""
    if mechanism.tool.body == body.name:
        return mechanism.tool.at
    if body.centre is not None:
        return body.centre
    joints = [j.at for j in mechanism.joints if body.name in (j.first, j.second)]
    return np.mean(joints, axis=0) if joints else np.zeros(3)

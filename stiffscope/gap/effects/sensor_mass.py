"""Mass of a sensor on the robot, which lowers what it measures."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.gap.effects.effect import (
    ADDED,
    Array,
    Candidates,
    Effect,
    Influence,
    Parameter,
    Place,
    Setting,
)

_UNSTATED = 10.0  # odds of a mass that the campaign calls unknown, over those of others


@dataclass(frozen=True)
class SensorMass(Effect):
    """Mass of what is screwed to a point of responses, beyond the stated one."""

    word = "sensor-mass"
    precedence = 28
    merges = False
    parameters = (Parameter("mass", "kg", 0.005, 0.0, 0.2),)
    bounds = ADDED

    point: str

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at the points of responses."""
        for point, stated in setting.points.items():
            yield cls(point).make_candidate(
                Place(point),
                setting.in_robots_units(cls.parameters),
                odds=1.0 if stated else _UNSTATED,
            )

    def influence(self, values: Array) -> Influence:
        """Return the further mass at the point."""
        return Influence(sensor_masses={self.point: float(values[0])})

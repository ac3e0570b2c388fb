"""The robot's own weight, if the nominal model lacks it."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import (
    Array,
    Candidates,
    Effect,
    Influence,
    Place,
    Setting,
)


@dataclass(frozen=True)
class Gravity(Effect):
    """Weight of the whole robot, without parameters."""

    word = "gravity"
    precedence = 10
    adoptable = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield one candidate for the whole robot."""
        del setting
        yield cls().make_candidate(Place("robot"))

    def influence(self, values: Array) -> Influence:
        """Return the robot's weight."""
        del values
        return Influence(weight=True)

"""The robot's own weight, where the nominal model lacks it."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import Array, Candidates, Effect, Influence, Place, Setting


@dataclass(frozen=True)
class Gravity(Effect):
    """The whole robot is heavy; nothing of it is unknown."""

    word = "gravity"
    precedence = 10
    adoptable = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """One, on the whole robot."""
        del setting
        yield cls().make_candidate(Place("robot"))

    def influence(self, values: Array) -> Influence:
        """The weight acts."""
        del values
        return Influence(weight=True)

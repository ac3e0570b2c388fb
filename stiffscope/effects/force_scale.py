"""Applied forces that differ from the stated ones."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import (
    FACTOR,
    GROWTH,
    Array,
    Candidates,
    Effect,
    Influence,
    Parameter,
    Place,
    Setting,
)
from stiffscope.effects.instruments import INSTRUMENT


@dataclass(frozen=True)
class ForceScale(Effect):
    """Ratio of the true wrench to the stated one."""

    word = "force-scale"
    precedence = 170
    parameters = (Parameter("factor", "1", 0.05, 0.7, 1.4),)
    conversion = GROWTH
    bounds = FACTOR

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield one candidate for all loads."""
        del setting
        yield cls().make_candidate(Place(INSTRUMENT))

    def influence(self, values: Array) -> Influence:
        """Return the relative excess of all loads."""
        return Influence(force_gain=float(values[0]))

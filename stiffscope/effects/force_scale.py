"""Applied forces that are not those stated."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import FACTOR, GROWTH, Array, Candidates, Effect, Influence, Parameter, Place, Setting
from stiffscope.effects.instruments import INSTRUMENT


@dataclass(frozen=True)
class ForceScale(Effect):
    """The true wrench is a factor times the stated one."""

    word = "force-scale"
    precedence = 170
    parameters = (Parameter("factor", "1", 0.05, 0.7, 1.4),)
    conversion = GROWTH
    bounds = FACTOR

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """One, of all loads."""
        del setting
        yield cls().make_candidate(Place(INSTRUMENT))

    def influence(self, values: Array) -> Influence:
        """All loads have another gain."""
        return Influence(force_gain=float(values[0]))

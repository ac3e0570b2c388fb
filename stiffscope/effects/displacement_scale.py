"""Instruments with a wrong gain."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import FACTOR, GROWTH, Array, Influence, Parameter
from stiffscope.effects.instruments import InstrumentEffect


@dataclass(frozen=True)
class DisplacementScale(InstrumentEffect):
    """What is shown is a factor times what is true."""

    word = "displacement-scale"
    precedence = 160
    parameters = (Parameter("factor", "1", 0.05, 0.7, 1.4),)
    conversion = GROWTH
    bounds = FACTOR

    def influence(self, values: Array) -> Influence:
        """Its instrument has another gain."""
        return Influence(gains={self.instrument: float(values[0])})

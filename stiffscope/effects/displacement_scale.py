"""Gain errors of instruments."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import FACTOR, GROWTH, Array, Influence, Parameter
from stiffscope.effects.instruments import InstrumentEffect


@dataclass(frozen=True)
class DisplacementScale(InstrumentEffect):
    """Factor by which an instrument multiplies the true displacement."""

    word = "displacement-scale"
    precedence = 160
    parameters = (Parameter("factor", "1", 0.05, 0.7, 1.4),)
    conversion = GROWTH
    bounds = FACTOR

    def influence(self, values: Array) -> Influence:
        """Return the relative gain error of the instrument."""
        return Influence(gains={self.instrument: float(values[0])})

"""Instruments with a reversed sign."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import Array, Candidates, Influence, Place, Setting
from stiffscope.effects.instruments import InstrumentEffect


@dataclass(frozen=True)
class SensorSign(InstrumentEffect):
    """Reversed sign of an instrument's readings."""

    word = "sensor-sign"
    precedence = 154

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at instruments suspected of a reversed sign."""
        for name in setting.doubts.signs:
            yield cls(name).make_candidate(Place(name), component=name)

    def influence(self, values: Array) -> Influence:
        """Return the factor -1 on the readings."""
        del values
        return Influence(factors={self.instrument: -1.0})

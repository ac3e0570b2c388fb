"""Instruments that count the wrong way."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import Array, Candidates, Influence, Place, Setting
from stiffscope.effects.instruments import InstrumentEffect


@dataclass(frozen=True)
class SensorSign(InstrumentEffect):
    """Numbers have the other sign."""

    word = "sensor-sign"
    precedence = 154

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """At instruments that are doubted for it."""
        for name in setting.doubts.signs:
            yield cls(name).make_candidate(Place(name), component=name)

    def influence(self, values: Array) -> Influence:
        """Its numbers are reversed."""
        del values
        return Influence(factors={self.instrument: -1.0})

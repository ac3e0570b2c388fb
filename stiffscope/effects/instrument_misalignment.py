"""Instruments that stand a little turned."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import Array, Influence, Parameter
from stiffscope.effects.instruments import InstrumentEffect


@dataclass(frozen=True)
class InstrumentMisalignment(InstrumentEffect):
    """What is shown is ``(I + S(r))`` times what is true."""

    word = "instrument-misalignment"
    precedence = 150
    parameters = tuple(Parameter(name, "rad", 0.01, -0.1, 0.1) for name in ("rx", "ry", "rz"))

    def influence(self, values: Array) -> Influence:
        """Its instrument is turned."""
        return Influence(turns={self.instrument: values})

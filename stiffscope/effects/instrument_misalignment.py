"""Small rotations of instruments."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import Array, Influence, Parameter
from stiffscope.effects.instruments import InstrumentEffect


@dataclass(frozen=True)
class InstrumentMisalignment(InstrumentEffect):
    """Small rotation r of an instrument, which shows ``(I + S(r))`` times the true motion."""

    word = "instrument-misalignment"
    precedence = 150
    parameters = tuple(
        Parameter(name, "rad", 0.01, -0.1, 0.1) for name in ("rx", "ry", "rz")
    )

    def influence(self, values: Array) -> Influence:
        """Return the rotation of the instrument."""
        return Influence(turns={self.instrument: values})

"""Instruments whose readings are not in the unit that their file states."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from stiffscope.effects.effect import (
    Array,
    Candidates,
    Influence,
    Parameter,
    Place,
    Setting,
)
from stiffscope.effects.instruments import InstrumentEffect


@dataclass(frozen=True)
class Unit(InstrumentEffect):
    """Known factor on the readings: a power of ten, or degrees for radians."""

    word = "unit"
    precedence = 152
    parameters = (Parameter("factor", "1"),)

    factor: float

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at suspected instruments, with their apparent factor."""
        for name, factor in setting.doubts.units.items():
            physical = partial(np.append, values=factor)
            yield cls(name, factor).make_candidate(
                Place(name), scale=(), physical=physical, component=name
            )

    def influence(self, values: Array) -> Influence:
        """Return the factor on the readings."""
        del values
        return Influence(factors={self.instrument: self.factor})

"""Instruments that slip during a campaign."""

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
    Row,
    Setting,
)
from stiffscope.effects.instruments import InstrumentEffect


@dataclass(frozen=True)
class SensorStep(InstrumentEffect):
    """Constant jump of an instrument's readings from one row on."""

    word = "sensor-step"
    precedence = 156
    parameters = (Parameter("jump", "m"), Parameter("row", "1"))

    first: Row
    """The first row after the jump."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at instruments suspected of a jump, at its apparent row."""
        for name, (row, size, turns) in setting.doubts.steps.items():
            yield cls(name, row).make_candidate(
                Place(name),
                scale=(size,),
                units=("rad" if turns else "m", "1"),
                component=name,
                physical=partial(np.append, values=row[1]),
            )

    def influence(self, values: Array) -> Influence:
        """Return the jump of later readings."""
        return Influence(jumps={self.instrument: (self.first, float(values[0]))})

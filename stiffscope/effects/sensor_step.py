"""Instruments that slip while a campaign goes on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from stiffscope.effects.effect import Array, Candidates, Influence, Parameter, Place, Row, Setting
from stiffscope.effects.instruments import InstrumentEffect


@dataclass(frozen=True)
class SensorStep(InstrumentEffect):
    """From one row on all numbers are larger by as much."""

    word = "sensor-step"
    precedence = 156
    parameters = (Parameter("jump", "m"), Parameter("row", "1"))

    first: Row
    """The first row behind the jump."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """At instruments that are doubted for it, from the row on where they seem to jump."""
        for name, (row, size, turns) in setting.doubts.steps.items():
            yield cls(name, row).make_candidate(
                Place(name), scale=(size,), units=("rad" if turns else "m", "1"), component=name,
                physical=partial(_add_line, row[1]),
            )  # fmt: skip

    def influence(self, values: Array) -> Influence:
        """Its later numbers are larger."""
        return Influence(jumps={self.instrument: (self.first, float(values[0]))})


def _add_line(line: int, values: Array) -> Array:
    return np.array([values[0], line])

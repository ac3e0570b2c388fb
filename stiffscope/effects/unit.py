"""Instruments whose numbers are in another unit than their file says."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from stiffscope.effects.effect import Array, Candidates, Influence, Parameter, Place, Setting
from stiffscope.effects.instruments import InstrumentEffect


@dataclass(frozen=True)
class Unit(InstrumentEffect):
    """Numbers are a known factor times what is shown: a power of ten, degrees for radians."""

    word = "unit"
    precedence = 152
    parameters = (Parameter("factor", "1"),)

    factor: float

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """At instruments that are doubted for it, by the factor that they seem to have."""
        for name, factor in setting.doubts.units.items():
            yield cls(name, factor).make_candidate(
                Place(name), scale=(), physical=partial(_keep, factor), component=name
            )

    def influence(self, values: Array) -> Influence:
        """Its numbers are multiplied."""
        del values
        return Influence(factors={self.instrument: self.factor})


def _keep(factor: float, _values: Array) -> Array:
    return np.array([factor])

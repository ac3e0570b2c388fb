"""Effects on instruments: the one at M and each sensor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from stiffscope.gap.effects.effect import (
    FACTOR,
    GROWTH,
    Array,
    Candidates,
    Effect,
    Influence,
    Parameter,
    Place,
    Row,
    Setting,
)

INSTRUMENT = "instrument"
"""The instrument at M, or all sensors if nothing is read at M."""
TRANSLATION = "translation"
ROTATION = "rotation"
"""Its parts that read displacements and rotations."""


@dataclass(frozen=True)
class InstrumentEffect(Effect):
    """An effect on the readings of one instrument."""

    instrument: str

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at the instrument at M, or all sensors together, and at each sensor."""
        together = (
            [INSTRUMENT] if setting.tool_is_read or len(setting.sensors) > 1 else []
        )
        for name in (
            *together,
            *(sensor for sensor, moves in setting.sensors.items() if moves),
        ):
            yield cls(name).make_candidate(Place(name), component=name)


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


@dataclass(frozen=True)
class ForceScale(Effect):
    """Ratio of the true wrench to the stated one."""

    word = "force-scale"
    precedence = 170
    parameters = (Parameter("factor", "1", 0.05, 0.7, 1.4),)
    conversion = GROWTH
    bounds = FACTOR

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield one candidate for all loads."""
        del setting
        yield cls().make_candidate(Place(INSTRUMENT))

    def influence(self, values: Array) -> Influence:
        """Return the relative excess of all loads."""
        return Influence(force_gain=float(values[0]))


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


@dataclass(frozen=True)
class SensorSign(InstrumentEffect):
    """Reversed sign of an instrument's readings."""

    word = "sensor-sign"
    precedence = 154
    assumed = True
    imitates = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at instruments suspected of a reversed sign."""
        for name in setting.doubts.signs:
            yield cls(name).make_candidate(Place(name), component=name)

    def influence(self, values: Array) -> Influence:
        """Return the factor -1 on the readings."""
        del values
        return Influence(factors={self.instrument: -1.0})


@dataclass(frozen=True)
class SensorStep(InstrumentEffect):
    """Constant jump of an instrument's readings from one row on."""

    word = "sensor-step"
    precedence = 156
    imitates = True
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


@dataclass(frozen=True)
class Unit(InstrumentEffect):
    """Known factor on the readings: a power of ten, or degrees for radians."""

    word = "unit"
    precedence = 152
    assumed = True
    imitates = True
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

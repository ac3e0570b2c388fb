"""Applied loads and columns of a table that differ from the stated ones."""

from __future__ import annotations

from dataclasses import dataclass

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
    Setting,
)

_FORCES = ("fx", "fy", "fz")
_SHARE = 0.05


@dataclass(frozen=True)
class ForceCrossTalk(Effect):
    """A force sensor shows shares of one component of the force in the other two."""

    word = "force-cross-talk"
    precedence = 172
    parameters = tuple(Parameter(name, "1", _SHARE, -0.5, 0.5) for name in _FORCES)

    source: int
    """Component of the force that leaks."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield the leak of each applied component into the other two."""
        for source, name in enumerate(_FORCES):
            if setting.forces[source]:
                others = [p for p in cls.parameters if p.name != name]
                yield cls(source).make_candidate(Place(name), others, component=name)

    def influence(self, values: Array) -> Influence:
        """Return shares (3, 3) of the true force's components that the sensor adds."""
        leak = np.zeros((3, 3))
        others = [k for k in range(3) if k != self.source]
        leak[others, self.source] = values
        return Influence(leak=leak)


@dataclass(frozen=True)
class LoadValue(Effect):
    """One weight of a set is lighter or heavier than stated."""

    word = "load-value"
    precedence = 174
    parameters = (Parameter("factor", "1", 0.05, 0.3, 1.5),)
    conversion = GROWTH
    bounds = FACTOR

    value: float
    """Size of the stated load, N or N·m."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield each size of load that occurs beside at least two others."""
        for value, unit in setting.load_values:
            name = f"{value:.6g} {unit}"
            yield cls(value).make_candidate(Place(name), component=name)

    def influence(self, values: Array) -> Influence:
        """Return the relative excess of loads of this size."""
        return Influence(load_gains={self.value: float(values[0])})


@dataclass(frozen=True)
class ColumnSwap(Effect):
    """Two columns of a table, or two channels, were exchanged."""

    word = "column-swap"
    precedence = 158
    assumed = True
    imitates = True

    columns: tuple[str, str]

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield the pairs of columns whose exchange would fit much better."""
        for pair in setting.doubts.swaps:
            name = "/".join(pair)
            yield cls(pair).make_candidate(Place(name), component=name)

    def influence(self, values: Array) -> Influence:
        """Return the exchanged columns."""
        del values
        return Influence(swaps=(self.columns,))

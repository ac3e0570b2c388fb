"""An effect's changes of elements, loads and instruments by small steps of its parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.gap.effects.effect import Effect, Influence
    from stiffscope.runtime.types import Array, Indices

    Step = tuple[Influence, Influence, float]

_FIELDS = ("spring", "compliance", "offset", "misalignment")
_UNCHANGED = np.zeros(0, dtype=np.int64), np.zeros(0)


@dataclass(frozen=True)
class Steps:
    """An effect's changes by small steps of each of its k parameters, ahead and behind."""

    each: tuple[Step, ...]
    """For each parameter: the changes ahead and behind, and their distance."""

    @classmethod
    def of(cls, action: Effect, here: Array, sizes: Array) -> Steps:
        """Return those of an effect from its internal parameters (k,), by steps (k,)."""
        steps = np.diag(sizes)
        return cls(
            tuple(
                (action.influence(here + step), action.influence(here - step), width)
                for step, width in zip(steps, 2.0 * sizes, strict=True)
            )
        )

    @property
    def elements(self) -> tuple[str, ...]:
        """Names of the changed elements."""
        return tuple(dict.fromkeys(name for name, _ in self._rates))

    def find_rates(self, name: str, field: str) -> tuple[Indices, Array]:
        """Return the parameters (m,) that change a field of an element, and derivatives (m, ...)."""
        return self._rates.get((name, field), _UNCHANGED)

    @cached_property
    def _rates(self) -> dict[tuple[str, str], tuple[Indices, Array]]:
        groups: dict[tuple[str, str], list[tuple[int, Array, Array, float]]] = {}
        for k, (ahead, behind, width) in enumerate(self.each):
            for name, more in ahead.elements.items():
                less = behind.elements[name]
                for field in _FIELDS:
                    values = getattr(more, field), getattr(less, field)
                    if values[0] is not None and values[1] is not None:
                        groups.setdefault((name, field), []).append((k, *values, width))
        out: dict[tuple[str, str], tuple[Indices, Array]] = {}
        for key, rows in groups.items():
            numbers, ahead, behind, width = (
                np.array(column) for column in zip(*rows, strict=True)
            )
            away = ahead - behind
            rates = away / width.reshape(-1, *(1,) * (away.ndim - 1))
            nonzero = rates.reshape(len(rates), -1).any(axis=1)
            if nonzero.any():
                out[key] = numbers[nonzero], rates[nonzero]
        return out

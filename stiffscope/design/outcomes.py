"""Outcomes of designs: objectives to minimize, violations of limits, and the Pareto front."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from stiffscope.runtime.types import Array, Flags, Indices

FEASIBLE = (
    1e-6  # tolerated relative violation of a limit, from rounding and local search
)


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Outcomes of n designs.

    Attributes
    ----------
    objectives : (n, g) values to minimize; NaN for failed designs.
    violations : (n, l) relative violations of limits, negative if met; NaN for failed designs.
    failed : (n,) whether the design failed.
    """

    objectives: Array
    violations: Array
    failed: Flags

    def __getitem__(self, index: Any) -> Outcomes:
        """Return the outcomes of selected designs."""
        return Outcomes(
            self.objectives[index], self.violations[index], self.failed[index]
        )

    @property
    def excess(self) -> Array:
        """Largest violation (n,), 0 if all limits hold; infinite for failed designs."""
        worst = self.violations.max(axis=1, initial=0.0)
        return np.where(self.failed, np.inf, np.maximum(worst, 0.0))

    @property
    def feasible(self) -> Flags:
        """Whether all limits hold (n,)."""
        return self.excess <= FEASIBLE

    @property
    def states(self) -> Any:
        """State of each design (n,): "feasible", "infeasible" or "failed"."""
        return np.where(
            self.failed, "failed", np.where(self.feasible, "feasible", "infeasible")
        )


def find_front(outcomes: Outcomes) -> Indices:
    """Return the indices of the non-dominated feasible designs.

    They are sorted by the first objective; without objectives there are none.
    """
    feasible = np.flatnonzero(outcomes.feasible)
    if not outcomes.objectives.shape[1] or not feasible.size:
        return np.zeros(0, dtype=np.int64)
    values, equal = np.unique(
        outcomes.objectives[feasible], axis=0, return_inverse=True
    )
    left = np.arange(len(values))
    chosen = np.zeros(len(values), dtype=bool)
    while left.size:  # the first one in this order is not dominated
        chosen[left[0]] = True
        left = left[(values[left] < values[left[0]]).any(axis=1)]
    equal = equal.reshape(-1)
    nondominated = np.flatnonzero(chosen[equal])
    return feasible[nondominated[np.argsort(equal[nondominated], kind="stable")]]

"""What became of designs: objectives to be made small, by how much limits are exceeded, and the best of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from stiffscope.runtime.types import Array, Flags, Indices

FEASIBLE = 1e-6  # relative violation of a limit that rounding and a local search may leave


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Outcomes of n designs.

    Attributes
    ----------
    objectives : (n, g) to be made small; NaN where the design failed.
    violations : (n, l) of the limits, relative, negative where one holds; NaN where the design failed.
    failed : (n,)
    """

    objectives: Array
    violations: Array
    failed: Flags

    def __len__(self) -> int:
        """Count the designs."""
        return len(self.failed)

    def __getitem__(self, some: Any) -> Outcomes:
        """Take those of some designs."""
        return Outcomes(self.objectives[some], self.violations[some], self.failed[some])

    @property
    def excess(self) -> Array:
        """Largest violation (n,), 0 where all limits hold; infinite for a failed design."""
        worst = self.violations.max(axis=1, initial=0.0)
        return np.where(self.failed, np.inf, np.maximum(worst, 0.0))

    @property
    def feasible(self) -> Flags:
        """Whether all limits hold (n,)."""
        return self.excess <= FEASIBLE

    @property
    def states(self) -> Any:
        """One of "feasible", "infeasible", "failed" for each design (n,)."""
        return np.where(self.failed, "failed", np.where(self.feasible, "feasible", "infeasible"))


def find_front(outcomes: Outcomes) -> Indices:
    """Find the feasible designs that no other is as good as in all objectives and better than in one.

    They come in the order of the first objective; none without objectives.
    """
    some = np.flatnonzero(outcomes.feasible)
    if not outcomes.objectives.shape[1] or not some.size:
        return np.zeros(0, dtype=np.int64)
    values, equal = np.unique(outcomes.objectives[some], axis=0, return_inverse=True)
    left, chosen = np.arange(len(values)), np.zeros(len(values), dtype=bool)
    while left.size:  # nothing dominates what comes first in this order
        chosen[left[0]] = True
        left = left[(values[left] < values[left[0]]).any(axis=1)]
    equal = equal.reshape(-1)
    kept = np.flatnonzero(chosen[equal])
    return some[kept[np.argsort(equal[kept], kind="stable")]]

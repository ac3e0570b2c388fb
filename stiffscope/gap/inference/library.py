"""Derivatives of all effects about one prediction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.gap.forward.forward_model import Candidate, Prediction
    from stiffscope.gap.inference.evidence import Errors, Projection
    from stiffscope.runtime.types import Array


@dataclass(frozen=True)
class Library:
    """Derivatives of all effects about one prediction, with inner products for scoring."""

    candidates: tuple[Candidate, ...]
    columns: tuple[slice, ...]
    """Columns of each candidate: derivatives, or the step if it has no parameters."""
    values: Array
    """Columns (n, c) in units of sigma."""
    projection: Projection
    blocks: tuple[Array, ...]
    """Inner products (q, k, k) of each candidate's columns."""

    @classmethod
    def of(
        cls,
        effects: tuple[Candidate, ...],
        prediction: Prediction,
        sigma: Array,
        errors: Errors,
    ) -> Library:
        """Return the derivatives of effects about a prediction; those that are not finite are zero.

        sigma: standard deviations (n,) of the readings.
        """
        parts = [
            prediction.columns(c) if c.scale else prediction.step(c)[:, None]
            for c in effects
        ]
        ends = np.cumsum([0, *(part.shape[1] for part in parts)])
        where = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
        values = np.hstack([np.zeros((len(sigma), 0)), *parts]) / sigma[:, None]
        values = np.where(np.isfinite(values), values, 0.0)
        projection = errors.project(values)
        whole = projection.stated, projection.scaled, projection.features
        parts = [type(projection)(*(part[:, here] for part in whole)) for here in where]
        return cls(
            effects,
            where,
            values,
            projection,
            tuple(errors.inner(part, part) for part in parts),
        )

    @cached_property
    def _by_candidate(self) -> dict[int, Array]:
        pairs = zip(self.candidates, self.columns, strict=True)
        return {id(candidate): self.values[:, here] for candidate, here in pairs}

    def differentiate(self, candidate: Candidate) -> Array:
        """Return a candidate's derivatives (n, k), or its step (n, 1)."""
        return self._by_candidate[id(candidate)]

"""A fitted set of effects, and the vectors of all its internal parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from stiffscope.gap.forward.forward_model import Candidate, Parameters
    from stiffscope.gap.inference.evidence import Posterior
    from stiffscope.runtime.types import Array, Flags


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A set of effects, fitted."""

    parameters: Parameters
    residual: Array
    """(n,) measured minus predicted, in units of the noise's sigma."""
    slopes: Array
    """(n, k) derivatives of the prediction in the same units."""
    evidence: float
    """ln of evidence times prior odds."""
    known: Posterior
    converged: bool = True
    """False where the fit was given up, far behind a better one."""
    short: float = 0.0
    """By how much χ² with the prior's stays above what first order promises, but nothing that can be assembled has."""
    local: bool = False
    """Whether only prior sizes near those of the fit count: what others promise to first order is not there."""

    @property
    def plain_score(self) -> float:
        """Ln of evidence times prior odds without a discrepancy."""
        return self.evidence - self.known.log_evidence + self.known.plain

    @cached_property
    def names(self) -> frozenset[str]:
        """Effects in it, as `effect @ place`."""
        return frozenset(candidate.name for candidate, _ in self.parameters)

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """Effects in it."""
        return tuple(candidate for candidate, _ in self.parameters)

    @property
    def words(self) -> tuple[Candidate, ...]:
        """Effects in it that the vocabulary has a word for."""
        return tuple(c for c in self.candidates if not c.is_nuisance)

    @property
    def values(self) -> Array:
        """All internal parameters (k,)."""
        return join_values(values for _, values in self.parameters)

    @property
    def prior_precision(self) -> Array:
        """(k,) of the internal parameters, in the likeliest prior scales."""
        return self.known.scales**-2.0

    @property
    def covariance(self) -> Array:
        """(k, k) of the internal parameters."""
        return self.known.covariance

    def widen_covariance(self, factor: float) -> Hypothesis:
        """The same with a covariance so many times as large."""
        return replace(self, known=replace(self.known, find_covariance=lambda: factor * self.covariance))

    @cached_property
    def linear(self) -> Array:
        """Readings (n,) minus the prediction extrapolated to internal parameters of zero."""
        return self.residual + self.slopes @ self.values


def forms_of(candidates: Iterable[Candidate]) -> frozenset[tuple[str, int]]:
    """What distinguishes sets of effects: their names, and the number of parameters of each."""
    return frozenset((c.name, len(c.scale)) for c in candidates)


def join_values(values: Iterable[Any]) -> Array:
    """One vector (k,) of several."""
    return np.concatenate([np.zeros(0), *(np.asarray(v, dtype=np.float64) for v in values)])


def positive_of(candidates: Sequence[Candidate]) -> Flags:
    """Which internal parameters (k,) cannot be negative."""
    return np.array([flag for c in candidates for flag in c.one_sided], dtype=np.bool_)


def bound_parameters(candidates: Sequence[Candidate], u: Array) -> Array:
    """Internal parameters (k,) within what can be computed."""
    counts = [len(c.scale) for c in candidates]
    low, high = (np.repeat([c.bounds[side] for c in candidates], counts) for side in (0, 1))
    low = np.where((low == 0.0) & ~positive_of(candidates), -np.inf, low)
    return np.clip(u, low, high)


def split(candidates: Sequence[Candidate], u: Array) -> Parameters:
    """Effects with their own share of all internal parameters (k,)."""
    ends = np.cumsum([len(c.scale) for c in candidates], dtype=int)
    return tuple((c, tuple(u[end - len(c.scale) : end].tolist())) for c, end in zip(candidates, ends, strict=True))

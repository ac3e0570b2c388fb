"""A fitted set of effects, and vectors of its internal parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from stiffscope.gap.forward.forward_model import Candidate, Parameters
    from stiffscope.gap.inference.evidence import Posterior
    from stiffscope.runtime.types import Array, Flags


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A fitted set of effects."""

    parameters: Parameters
    residual: Array
    """Measured minus predicted readings (n,), in units of sigma."""
    slopes: Array
    """Derivatives (n, k) of the prediction in the same units."""
    evidence: float
    """Ln of evidence times prior odds."""
    known: Posterior
    converged: bool = True
    """False if the fit was abandoned, far behind a better one."""
    short: float = 0.0
    """Excess of χ² (with prior) over its linear prediction, outside the assemblable range."""
    local: bool = False
    """Whether only prior sizes near those of the fit count, as linearization fails for others."""

    @property
    def plain_score(self) -> float:
        """Ln of evidence times prior odds without a discrepancy."""
        return self.evidence - self.known.log_evidence + self.known.plain

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of its effects, as `effect @ place`."""
        return frozenset(candidate.name for candidate, _ in self.parameters)

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """Its effects."""
        return tuple(candidate for candidate, _ in self.parameters)

    @property
    def words(self) -> tuple[Candidate, ...]:
        """Its effects without nuisance patterns."""
        return tuple(c for c in self.candidates if not c.is_nuisance)

    @property
    def values(self) -> Array:
        """All internal parameters (k,)."""
        return join_values(values for _, values in self.parameters)

    def mark(self, chosen: Callable[[Candidate], bool]) -> Flags:
        """Return flags (k,) of the internal parameters of chosen effects."""
        flags = np.array([chosen(c) for c in self.candidates], dtype=np.bool_)
        return np.repeat(flags, [len(values) for _, values in self.parameters])

    @property
    def covariance(self) -> Array:
        """Covariance (k, k) of the internal parameters."""
        return self.known.covariance

    def widen_covariance(self, factor: float) -> Hypothesis:
        """Return the hypothesis with its covariance multiplied by a factor."""
        wider = replace(self.known, find_covariance=lambda: factor * self.covariance)
        return replace(self, known=wider)

    @cached_property
    def linear(self) -> Array:
        """Readings (n,) minus the prediction extrapolated to internal parameters of zero."""
        return self.residual + self.slopes @ self.values


def forms_of(candidates: Iterable[Candidate]) -> frozenset[tuple[str, int]]:
    """Return the key of a set of effects: names and numbers of parameters."""
    return frozenset((c.name, len(c.scale)) for c in candidates)


def join_values(values: Iterable[Any]) -> Array:
    """Concatenate values to one vector (k,)."""
    return np.concatenate(
        [np.zeros(0), *(np.asarray(v, dtype=np.float64) for v in values)]
    )


def positive_of(candidates: Sequence[Candidate]) -> Flags:
    """Return flags (k,) of internal parameters that cannot be negative."""
    return np.array([flag for c in candidates for flag in c.one_sided], dtype=np.bool_)


def bound_parameters(candidates: Sequence[Candidate], u: Array) -> Array:
    """Clip internal parameters (k,) to their computable range."""
    counts = [len(c.scale) for c in candidates]
    low, high = (
        np.repeat([c.bounds[side] for c in candidates], counts) for side in (0, 1)
    )
    low = np.where((low == 0.0) & ~positive_of(candidates), -np.inf, low)
    return np.clip(u, low, high)


def at_bounds(candidates: Sequence[Candidate], u: Array) -> Flags:
    """Return which internal parameters (k,) are at a bound, except zero of non-negative ones."""
    inside = [
        c.bounds if not c.positive else (-np.inf, c.bounds[1]) for c in candidates
    ]
    counts = [len(c.scale) for c in candidates]
    low, high = (np.repeat([ends[side] for ends in inside], counts) for side in (0, 1))
    return (u <= low) | (u >= high)


def minimize_bounded(
    candidates: Sequence[Candidate], precision: Array, pull: Array, whole: Array
) -> Array:
    """Return the minimum (k,) of ``½ uᵀ P u - bᵀ u`` within bounds; ``whole`` is without them."""
    out = bound_parameters(candidates, whole)
    held = np.zeros(len(out), dtype=np.bool_)
    while ((now := held | at_bounds(candidates, out)) != held).any():
        held = now
        free = ~now & (out != 0.0)
        rest = pull[free] - precision[np.ix_(free, held)] @ out[held]
        out[free] = np.linalg.solve(precision[np.ix_(free, free)], rest)
        out = bound_parameters(candidates, out)
    return out


def split(candidates: Sequence[Candidate], u: Array) -> Parameters:
    """Return effects with their own parts of all internal parameters (k,)."""
    values = iter(u.tolist())
    return tuple((c, tuple(islice(values, len(c.scale)))) for c in candidates)

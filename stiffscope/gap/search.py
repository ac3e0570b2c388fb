"""Which effects explain a campaign: nonlinear fits of sets of effects, and the search over such sets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.evidence import constrained_minimum, posterior

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.evidence import Posterior
    from stiffscope.gap.forward_model import Candidate, ForwardModel, Noise, Parameters

    Array = NDArray[np.floating[Any]]
    Flags = NDArray[np.bool_]
    Progress = Callable[[str, float], None]

PRIOR_ODDS = 0.5  # of one effect more, shared by all candidates
UNNAMED_PENALTY = 3.0  # ln-odds by which a nuisance pattern is less likely than a word of the vocabulary
BEAM_WIDTH = 6  # hypotheses of each size that are extended
FITTED = 10  # nonlinear fits for each size; twice as many of single effects
SWAPPED = 4  # others that are fitted in the place of each effect of the best set
GAIN = 1.0  # ln-odds that one effect more must gain for the search to go on
_STEPS = 12  # of Gauss-Newton
_DAMPING = (1.0, 0.5, 0.25, 0.1, 0.02)


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects, fitted."""

    parameters: Parameters
    residual: Array
    """(n,) measured minus predicted, in units of the noise's sigma."""
    slopes: Array
    """(n, k) derivatives of the prediction in the same units."""
    evidence: float
    """ln of evidence times prior odds."""
    covariance: Array
    """(k, k) of the internal parameters."""
    noise_factor: float

    @cached_property
    def names(self) -> frozenset[str]:
        """Effects in it, as `effect @ place`."""
        return frozenset(candidate.name for candidate, _ in self.parameters)

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """Effects in it."""
        return tuple(candidate for candidate, _ in self.parameters)

    @property
    def values(self) -> Array:
        """All internal parameters (k,)."""
        return _joined(values for _, values in self.parameters)


@dataclass(frozen=True)
class Problem:
    """A forward model with its noise, and the prior of sets of effects."""

    model: ForwardModel
    noise: Noise

    @cached_property
    def _share(self) -> float:
        return float(np.log(PRIOR_ODDS / max(len({c.name for c in self.model.library}), 1)))

    def log_prior(self, candidates: Sequence[Candidate]) -> float:
        """Ln prior odds of a set of effects against none."""
        return sum(self._share - UNNAMED_PENALTY * c.unnamed for c in candidates)

    def posterior(self, candidates: Sequence[Candidate], y: Array, x: Array) -> Posterior:
        """Posterior of the parameters of ``y = X u + noise``, without the prior odds of the set."""
        return posterior(y, x, _scale(candidates), _positive(candidates), self.noise, self.model.prior_sizes)

    def weak_precision(self, candidates: Sequence[Candidate]) -> Array:
        """Precision (k,) of the widest prior of effects' internal parameters."""
        return (self.model.prior_sizes[-1] * _scale(candidates)) ** -2.0

    def fit(self, candidates: Sequence[Candidate], start: Array) -> Hypothesis:
        """Fit a set of effects from internal parameters (k,) on, by damped Gauss-Newton with a weak prior."""
        u, (residual, slopes) = self._start(candidates, start)
        known = self.posterior(candidates, residual + slopes @ u, slopes)
        if len(u):
            weights = self.noise.whitening(known.noise_factor) * self.noise.used
            u, residual, slopes = self._descend(candidates, u, residual, slopes, weights)
            known = self.posterior(candidates, residual + slopes @ u, slopes)
        log = known.log_evidence + self.log_prior(candidates)
        return Hypothesis(_split(candidates, u), residual, slopes, log, known.covariance, known.noise_factor)

    def _descend(
        self, candidates: Sequence[Candidate], u: Array, residual: Array, slopes: Array, weights: Array
    ) -> tuple[Array, Array, Array]:
        """Gauss-Newton steps, damped where the cost would grow."""
        weak = self.weak_precision(candidates)
        positive = _positive(candidates)

        def cost_of(residual: Array, u: Array) -> float:
            return float(np.sum((weights * residual) ** 2)) + float(u**2 @ weak)

        cost = cost_of(residual, u)
        for _ in range(_STEPS):
            x, y = slopes * weights[:, None], residual * weights
            step = constrained_minimum(x.T @ x + np.diag(weak), x.T @ (y + x @ u), positive)[0] - u
            for damping in _DAMPING:
                trial = _bounded(candidates, u + damping * step)
                try:
                    moved = self._linearized(candidates, trial)
                except (InputError, np.linalg.LinAlgError):
                    continue
                lower = cost_of(moved[0], trial)
                if lower < cost or np.isclose(lower, cost, rtol=1e-9):
                    break
            else:
                break
            gained = cost - lower
            u, cost, (residual, slopes) = trial, lower, moved
            if gained < 1e-3:
                break
        return u, residual, slopes

    def _start(self, candidates: Sequence[Candidate], u: Array) -> tuple[Array, tuple[Array, Array]]:
        """The first of u, u/4, u/16 at which the model can be assembled, else nothing."""
        for share in (1.0, 0.25, 0.0625):
            try:
                return share * u, self._linearized(candidates, share * u)
            except (InputError, np.linalg.LinAlgError):
                continue
        return 0.0 * u, self._linearized(candidates, 0.0 * u)

    def _linearized(self, candidates: Sequence[Candidate], u: Array) -> tuple[Array, Array]:
        """Residual (n,) and derivatives (n, k) in units of sigma. Raises InputError where they are not finite."""
        prediction, sigma = self.model.predict(_split(candidates, u)), self.noise.sigma
        residual = (self.model.campaign.value - prediction.values) / sigma
        slopes = np.hstack([np.zeros((len(sigma), 0)), *(prediction.columns(c) for c in candidates)]) / sigma[:, None]
        if not (np.isfinite(residual).all() and np.isfinite(slopes).all()):
            raise InputError("a parameter is outside the assemblable range")
        return residual, slopes

    def search(self, progress: Progress | None = None) -> list[Hypothesis]:
        """Fitted hypotheses, the best first: none, single effects, and larger sets as long as they gain."""
        found = [self.fit((), np.zeros(0))]
        frontier = found[:1]
        found += [self.fit(c, np.zeros(len(_scale(c)))) for c in self.model.tried]
        before = frontier[0].evidence
        for level in range(self.model.most_effects + 1):
            starts = self._extensions(frontier, self.model.library)
            fits: list[Hypothesis] = []
            for k, start in enumerate(starts):
                if progress:
                    progress(f"effects, {level + 1} at once", k / len(starts))
                fits.append(self.fit(*start))
            found += fits
            frontier = sorted(fits, key=lambda h: -h.evidence)[:BEAM_WIDTH]
            if not frontier or frontier[0].evidence < before + GAIN:
                break
            before = max(before, frontier[0].evidence)
        found += self._exchanged(max(found, key=lambda h: h.evidence))
        return sorted(found, key=lambda h: -h.evidence)

    def _exchanged(self, best: Hypothesis) -> list[Hypothesis]:
        """The best set with each of its effects in turn given up for others: what else could stand in its place."""
        words = [c for c in self.model.library if not c.unnamed]
        starts: list[tuple[tuple[Candidate, ...], Array]] = []
        for gone in best.candidates:
            rest = [(c, values) for c, values in best.parameters if c.name != gone.name]
            kept = self.fit([c for c, _ in rest], _joined(values for _, values in rest))
            starts += self._extensions([kept], words)[:SWAPPED]
        return [self.fit(*start) for start in starts if frozenset(c.name for c in start[0]) != best.names]

    def _extensions(
        self, frontier: Sequence[Hypothesis], library: Sequence[Candidate]
    ) -> list[tuple[tuple[Candidate, ...], Array]]:
        """The most promising sets of one effect more, by their evidence to first order, each with a start."""
        ranked: dict[frozenset[str], tuple[float, tuple[Candidate, ...], Array]] = {}
        sigma = self.noise.sigma
        for hypothesis in frontier:
            prediction = self.model.predict(hypothesis.parameters)
            y = hypothesis.residual + hypothesis.slopes @ hypothesis.values
            for candidate in library:
                candidates = (*hypothesis.candidates, candidate)
                if not self.model.admits(candidates):
                    continue
                x = np.hstack([hypothesis.slopes, prediction.columns(candidate) / sigma[:, None]])
                step = 0.0 if candidate.scale else prediction.step(candidate) / sigma
                known = self.posterior(candidates, y - step, x)
                log = known.log_evidence + self.log_prior(candidates)
                key = frozenset([*(c.name for c in candidates), str(len(known.mean))])
                if key not in ranked or log > ranked[key][0]:
                    ranked[key] = (log, candidates, known.mean)
        best = sorted(ranked.values(), key=lambda item: -item[0])
        count = FITTED if len(frontier) > 1 else 2 * FITTED
        return [(candidates, _bounded(candidates, start)) for _, candidates, start in best[:count]]


def _scale(candidates: Sequence[Candidate]) -> Array:
    """Prior sizes (k,) of the internal parameters of effects."""
    return _joined(c.scale for c in candidates)


def _joined(values: Any) -> Array:
    return np.concatenate([np.zeros(0), *(np.asarray(v, dtype=np.float64) for v in values)])


def _positive(candidates: Sequence[Candidate]) -> Flags:
    """Which internal parameters (k,) cannot be negative."""
    return np.repeat([c.positive for c in candidates], [len(c.scale) for c in candidates]).astype(np.bool_)


def _bounded(candidates: Sequence[Candidate], u: Array) -> Array:
    """Internal parameters (k,) within what can be computed."""
    counts = [len(c.scale) for c in candidates]
    low, high = (np.repeat([c.bounds[side] for c in candidates], counts) for side in (0, 1))
    return np.clip(u, low, high)


def _split(candidates: Sequence[Candidate], u: Array) -> Parameters:
    """Effects with their own share of all internal parameters (k,)."""
    ends = np.cumsum([len(c.scale) for c in candidates], dtype=int)
    return tuple((c, tuple(u[end - len(c.scale) : end].tolist())) for c, end in zip(candidates, ends, strict=True))

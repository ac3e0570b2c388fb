"""What a search has found: hypotheses with their probabilities, and their residuals in standard deviations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.residuals import percent_rms
from stiffscope.gap.search import Problem

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.gap.campaign import Campaign
    from stiffscope.gap.forward_model import Candidate, ForwardModel
    from stiffscope.gap.search import Hypothesis, Progress

    Array = NDArray[np.floating[Any]]
    Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Findings:
    """The search's hypotheses with their probabilities, the best first."""

    problem: Problem
    hypotheses: tuple[Hypothesis, ...]
    probability: tuple[float, ...]

    @property
    def model(self) -> ForwardModel:
        """The forward model that was searched."""
        return self.problem.model

    @property
    def campaign(self) -> Campaign:
        """The readings."""
        return self.problem.model.campaign

    @property
    def used(self) -> Flags:
        """(n,) False: a gross outlier."""
        return self.problem.noise.used

    @property
    def best(self) -> Hypothesis:
        """The most probable hypothesis."""
        return self.hypotheses[0]

    @cached_property
    def none(self) -> Hypothesis:
        """No effect at all."""
        return next(h for h in self.hypotheses if not h.names)

    @cached_property
    def _whitening(self) -> Array:
        return self.problem.noise.whitening(self.best.noise_factor)

    @cached_property
    def sigma(self) -> Array:
        """Standard deviations (n,) of the readings, an unknown factor as the best hypothesis leaves it."""
        return self.problem.noise.sigma / self._whitening

    def probability_of(self, names: frozenset[str]) -> float:
        """Probability that all these effects are at work."""
        return float(sum(p for h, p in zip(self.hypotheses, self.probability, strict=True) if names <= h.names))

    def alone(self, candidate: Candidate) -> Hypothesis:
        """The hypothesis of one effect alone."""
        known = next((h for h in self.hypotheses if h.names == frozenset([candidate.name])), None)
        return known or self.problem.fit([candidate], np.zeros(len(candidate.scale)))

    def predicted(self, hypothesis: Hypothesis) -> Array:
        """What a hypothesis says the readings (n,) are."""
        return self.campaign.value - hypothesis.residual * self.problem.noise.sigma

    def residual(self, hypothesis: Hypothesis) -> Array:
        """Residual (n,) in standard deviations."""
        return hypothesis.residual * self._whitening

    def slopes(self, hypothesis: Hypothesis) -> Array:
        """Derivatives (n, k) of a hypothesis's predictions in standard deviations."""
        return hypothesis.slopes * self._whitening[:, None]

    def chi2(self, hypothesis: Hypothesis) -> float:
        """χ² of the readings that are used."""
        return float(np.sum(self.residual(hypothesis)[self.used] ** 2))

    def percent_rms(self, hypothesis: Hypothesis) -> float:
        """The gap that a hypothesis leaves, % rms."""
        return percent_rms(self.campaign, self.predicted(hypothesis), self.sigma, self.used)

    def held_out_percent_rms(self, hypothesis: Hypothesis) -> float:
        """% rms at each pose by the effects fitted without it, mean over poses; one linear step from the full fit."""
        scores: list[float] = []
        for pose in range(len(self.campaign.pose_names)):
            here = self.used & (self.campaign.pose == pose)
            if here.any():
                moved = hypothesis.slopes @ self._change_without(hypothesis, here) * self.problem.noise.sigma
                scores.append(percent_rms(self.campaign, self.predicted(hypothesis) + moved, self.sigma, here))
        return float(np.mean(scores)) if scores else float("nan")

    def _change_without(self, hypothesis: Hypothesis, here: Flags) -> Array:
        """Change (k,) of the internal parameters when some readings (n,) take no part in the fit."""
        noise, x, r = self.problem.noise, hypothesis.slopes, hypothesis.residual
        if not x.shape[1]:
            return np.zeros(0)
        if noise.scaled.any():  # a noise of unknown size is estimated anew
            rest = Problem(self.model, replace(noise, used=noise.used & ~here))
            return rest.posterior(hypothesis.candidates, r + x @ hypothesis.values, x).mean - hypothesis.values
        left = x[self.used & ~here]
        weak = np.diag(self.problem.weak_precision(hypothesis.candidates))
        return -np.linalg.pinv(left.T @ left + weak, rcond=1e-12) @ (x[here].T @ r[here])


def find(model: ForwardModel, progress: Progress | None = None) -> Findings:
    """Search a model's effects and nuisance patterns for those that explain its campaign."""
    problem = Problem(model, model.noise())
    distinct: dict[frozenset[str], Hypothesis] = {}
    for hypothesis in problem.search(progress):  # the best fit of every set of effects
        distinct.setdefault(hypothesis.names, hypothesis)
    hypotheses = tuple(distinct.values())
    log = np.array([h.evidence for h in hypotheses])
    weight = np.exp(log - log.max())
    return Findings(problem, hypotheses, tuple((weight / weight.sum()).tolist()))

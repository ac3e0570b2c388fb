"""What a search has found: hypotheses with their probabilities, and their residuals in standard deviations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.inference.fitting import Problem
from stiffscope.gap.inference.hypothesis import forms_of, join_values
from stiffscope.gap.inference.residuals import percent_rms
from stiffscope.gap.inference.search import Search

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.forward.forward_model import Candidate, ForwardModel, Noise
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array, Flags, Progress


CONFUSED = 2  # other effects at most that one is said to be confused with
COMPETING = 0.02  # probability, over that of the best, from which a hypothesis still competes with it
IMITATING = 3.0  # ln of evidence behind the best set, without prior odds, up to which a pattern is worth a word
NEAR = 40.0  # ln-odds up to which another prior may change the order
COPIES = 0.9  # share of the repeated readings that repeat the value as well, from which they are copies


@dataclass(frozen=True)
class Group:
    """An effect with what these readings cannot tell from it."""

    others: tuple[str, ...]
    probability: float
    """That the effect or one of the others is at work; of names for the same effect some may be left out."""
    known: float
    """The same of those that the vocabulary has a word for."""
    doubted: float
    """The same as ``probability`` if all effects were equally likely, and the noise as large as what is left."""
    elsewhere: bool
    """Whether the same fault where it has no word would explain the readings nearly as well."""


@dataclass(frozen=True)
class Findings:
    """The search's hypotheses with their probabilities, the best first."""

    problem: Problem
    hypotheses: tuple[Hypothesis, ...]
    probability: tuple[float, ...]
    fitted: dict[frozenset[tuple[str, int]], Hypothesis]
    """All that were fitted, by `forms_of` their effects; under other priors they count as they are."""

    @property
    def model(self) -> ForwardModel:
        """The forward model that was searched."""
        return self.problem.model

    @property
    def campaign(self) -> Campaign:
        """The readings."""
        return self.problem.model.campaign

    @property
    def used_readings(self) -> Flags:
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
    def _residual_weights(self) -> Array:
        return self.problem.noise.weigh_residuals(self.best.known.noise_factor)

    @cached_property
    def sigma(self) -> Array:
        """Standard deviations (n,) of the readings, an unknown factor as the best hypothesis leaves it."""
        return self.problem.noise.sigma / self._residual_weights

    def evidence(self, hypothesis: Hypothesis) -> float:
        """Ln of what the readings say for a hypothesis, without its prior odds."""
        return hypothesis.evidence - self.problem.log_odds(hypothesis)

    def misfit(self, hypothesis: Hypothesis) -> float:
        """χ² per degree of freedom of a hypothesis's residuals, under the noise and discrepancy that go with it."""
        errors = self.problem.errors
        residual = errors.project(hypothesis.residual[:, None])
        total = float(hypothesis.known.settings @ errors.inner(residual, residual)[:, 0, 0])
        return total / max(int(self.used_readings.sum()) - len(hypothesis.values), 1)

    def under(self, problem: Problem) -> Findings:
        """The same hypotheses under another prior."""
        near = [h for h in self.hypotheses if not h.names or h.evidence > self.best.evidence - NEAR]
        return _rank_hypotheses(problem, [(h, problem.reweigh(h)) for h in near], self.fitted)

    @cached_property
    def _canonical(self) -> dict[str, str]:
        """One name for all names of an effect at a place, that with the fewest parameters."""
        known: dict[str, str] = {}
        for c in sorted({id(c): c for h in self.hypotheses for c in h.words}.values(), key=lambda c: len(c.scale)):
            name = known.setdefault(c.name, c.name)
            for alias in c.aliases:
                known.setdefault(alias, name)
        return known

    def _find_canonical(self, name: str) -> str:
        return self._canonical.get(name, name)

    def _shares(self, candidate: Candidate) -> dict[str, float]:
        """How likely an effect and each of its twins are if one of them is at work, by name."""
        odds = self.problem.odds_of(candidate)
        return dict(zip(candidate.signature_of, (odds / odds.sum()).tolist(), strict=True))

    def _sum_missed(self, hypothesis: Hypothesis, names: Iterable[str]) -> float:
        """Probability that none of these effects is at work if a hypothesis is true."""
        listed = {self._find_canonical(name) for name in names}
        missed = 1.0
        for c in hypothesis.candidates:
            missed *= 1.0 - sum(
                share for name, share in self._shares(c).items() if self._find_canonical(name) in listed
            )
        return missed

    def compute_probability(self, name: str) -> float:
        """Probability that an effect is at work; indistinguishable effects share theirs."""
        pairs = zip(self.hypotheses, self.probability, strict=True)
        return float(sum(p * self._shares(c).get(name, 0.0) for h, p in pairs for c in h.candidates))

    def group(self, name: str) -> Group:
        """An effect of the best hypothesis with the most probable ones that may stand in its place.

        Nuisance patterns come last, and of these what is less probable but the same fault elsewhere. Other names of
        what is in the group have no place of their own in it, and stand where one is left.
        """
        listed, own = [name], next(c for c in self.best.candidates if c.name == name)
        self._add_rivals(listed, own, [h.words for h in self.hypotheses])
        known = self.at_work(listed)
        self._add_rivals(listed, own, [h.candidates for h in self.hypotheses])
        elsewhere = [c.name for c in self.imitating_patterns.get(name, ()) if c.like == own.effect]
        listed = list(dict.fromkeys([*listed, *elsewhere]))[: CONFUSED + 1]
        same = {self._find_canonical(each) for each in listed}
        aliases = [a for a in (*own.aliases, *self._canonical) if self._find_canonical(a) in same and a not in listed]
        others = tuple(dict.fromkeys([*listed[1:], *aliases]))[:CONFUSED]
        whole = self.at_work([name, *others])  # what there is no place for is not part of it
        doubted = self.doubted.at_work([name, *others])
        return Group(others, whole, min(known, whole), min(doubted, whole), bool(elsewhere))

    @cached_property
    def doubted(self) -> Findings:
        """The same hypotheses, ranked by what the readings say for them, no louder than what is left allows."""
        alike, left = replace(self.problem, even=True), max(self.misfit(self.best), 1.0)
        return _rank_hypotheses(
            alike, [(h, self.evidence(h) / left + alike.log_odds(h)) for h in self.hypotheses], self.fitted
        )

    def find_instead(self, name: str) -> str:
        """What fits about as well without an effect and all of its group, as `effect @ place`, joined by "and"."""
        group = {name, *self.group(name).others}
        for hypothesis in self.doubted.hypotheses:
            if self._sum_missed(hypothesis, group) == 1.0:
                return " and ".join(sorted(hypothesis.names - self.best.names)) or "no effect"
        return "no effect"

    @cached_property
    def imitating_patterns(self) -> dict[str, list[Candidate]]:
        """By effect of the best hypothesis, the nuisance patterns that explain the readings nearly as well instead."""
        found: dict[str, list[Candidate]] = {}
        for name, other, hypothesis, _ in self._exchange_effects():
            if other.is_nuisance and self.evidence(self.best) - self.evidence(hypothesis) < IMITATING:
                found.setdefault(name, []).append(other)
        return found

    @cached_property
    def _in_place_of(self) -> dict[str, set[str]]:
        """For each effect of the best hypothesis what competing ones have in its place, all others being the same."""
        found: dict[str, set[str]] = {}
        for name, other, _, p in self._exchange_effects():
            if p > COMPETING * self.probability[0]:
                found.setdefault(name, set()).add(other.name)
        return found

    def _exchange_effects(self) -> Iterator[tuple[str, Candidate, Hypothesis, float]]:
        """Each effect of the best hypothesis, what another has in its place, that hypothesis, and its probability."""
        for hypothesis, p in zip(self.hypotheses, self.probability, strict=True):
            gone = self.best.names - hypothesis.names
            new = [c for c in hypothesis.candidates if c.name not in self.best.names]
            if len(gone) == len(new) == 1:
                yield next(iter(gone)), new[0], hypothesis, p

    def at_work(self, names: Iterable[str]) -> float:
        """Probability that one of these effects is at work."""
        pairs = zip(self.hypotheses, self.probability, strict=True)
        return min(float(sum(p * (1.0 - self._sum_missed(h, names)) for h, p in pairs)), 1.0)

    def _add_rivals(self, listed: list[str], own: Candidate, rivals: Iterable[Sequence[Candidate]]) -> None:
        """Add to a group what is most probable in the place of one of the best hypothesis's effects.

        rivals: of each hypothesis those that may be; not what is known to stand in the place of another effect.
        """
        rest, pools = self.best.names - {own.name}, list(rivals)
        elsewhere = {name for other in rest for name in self._in_place_of.get(other, ())}
        elsewhere -= {*self._in_place_of.get(own.name, ()), *own.signature_of}
        while len(listed) <= CONFUSED:
            known = {self._find_canonical(each) for each in listed}
            gains: dict[str, float] = {}
            for hypothesis, p, pool in zip(self.hypotheses, self.probability, pools, strict=True):
                missed = self._sum_missed(hypothesis, listed)
                if missed <= 0.0:
                    continue
                alone = rest <= hypothesis.names and len(hypothesis.names - rest) == 1
                for other in pool:
                    if other.name in rest | elsewhere:
                        continue
                    for each, share in self._shares(other).items():
                        if (same := self._find_canonical(each)) not in known:
                            gains[same] = gains.get(same, 0.0) + p * missed * share * (1.0 if alone else 0.5)
            best = max(gains, key=lambda n: gains[n], default="")
            if not best or gains[best] <= COMPETING * self.probability[0]:
                break
            listed.append(best)

    def fit_effects(self, candidates: Iterable[Candidate]) -> Hypothesis:
        """The hypothesis of some effects of the best one, fitted."""
        chosen = forms_of(candidates)
        if chosen not in self.fitted:
            kept = [(c, values) for c, values in self.best.parameters if forms_of([c]) <= chosen]
            self.fitted[chosen] = self.problem.fit([c for c, _ in kept], join_values(values for _, values in kept))
        return self.fitted[chosen]

    def predict_readings(self, hypothesis: Hypothesis) -> Array:
        """What a hypothesis says the readings (n,) are."""
        return self.campaign.value - hypothesis.residual * self.problem.noise.sigma

    def residual(self, hypothesis: Hypothesis) -> Array:
        """Residual (n,) in standard deviations."""
        return hypothesis.residual * self._residual_weights

    def slopes(self, hypothesis: Hypothesis) -> Array:
        """Derivatives (n, k) of a hypothesis's predictions in standard deviations."""
        return hypothesis.slopes * self._residual_weights[:, None]

    def chi2(self, hypothesis: Hypothesis) -> float:
        """χ² of the readings that are used."""
        return float(np.sum(self.residual(hypothesis)[self.used_readings] ** 2))

    def percent_rms(self, hypothesis: Hypothesis) -> float:
        """The gap that a hypothesis leaves, % rms."""
        return percent_rms(self.campaign, self.predict_readings(hypothesis), self.sigma, self.used_readings)

    def held_out_residual(self, hypothesis: Hypothesis) -> Array:
        """Residuals (n,) in standard deviations by the effects fitted without each pose, one linear step away."""
        out = self.residual(hypothesis).copy()
        for pose in range(len(self.campaign.pose_names)):
            here = self.used_readings & (self.campaign.pose == pose)
            if here.any():
                change = self._change_without(hypothesis, here)
                out[here] -= self.slopes(hypothesis)[here] @ change
        return out

    def percent_rms_by_pose(self, residual: Array) -> float:
        """% rms of residuals (n,) in standard deviations, mean over poses with readings other than zero."""
        model = self.campaign.value - residual * self.sigma
        told = self.used_readings & (self.campaign.value != 0.0)
        scores = [
            percent_rms(self.campaign, model, self.sigma, self.used_readings & here)
            for pose in range(len(self.campaign.pose_names))
            if (told & (here := self.campaign.pose == pose)).any()
        ]
        return float(np.mean(scores)) if scores else float("nan")

    def _change_without(self, hypothesis: Hypothesis, here: Flags) -> Array:
        """Change (k,) of the internal parameters when some readings (n,) take no part in the fit."""
        noise, x, r = self.problem.noise, hypothesis.slopes, hypothesis.residual
        if not x.shape[1]:
            return np.zeros(0)
        if noise.scaled.any():  # a noise of unknown size is estimated anew
            rest = Problem(self.model, replace(noise, used=noise.used & ~here))
            return rest.posterior(hypothesis.candidates, hypothesis.linear, x).mean - hypothesis.values
        unit = hypothesis.prior_precision**-0.5  # parameters have units from 1e-9 m/N to kg
        left, out = unit * x[self.used_readings & ~here], unit * x[here]
        return -unit * np.linalg.solve(left.T @ left + np.eye(len(unit)), out.T @ r[here])


def find(model: ForwardModel, progress: Progress | None = None) -> Findings:
    """Search a model's effects and nuisance patterns for those that explain its campaign."""
    problem = Problem(model, _without_copies(model.campaign, model.noise()))
    distinct: dict[frozenset[str], Hypothesis] = {}
    for hypothesis in Search(problem, progress).hypotheses():  # the best fit of every set of effects
        distinct.setdefault(hypothesis.names, hypothesis)
    fitted = {forms_of(h.candidates): h for h in distinct.values() if h.converged}
    return _rank_hypotheses(problem, [(h, h.evidence) for h in distinct.values()], fitted)


def _rank_hypotheses(
    problem: Problem, scored: list[tuple[Hypothesis, float]], fitted: dict[frozenset[tuple[str, int]], Hypothesis]
) -> Findings:
    """Hypotheses with their share of all evidence, the best first."""
    order = sorted(scored, key=lambda item: -item[1])
    log = np.array([evidence for _, evidence in order])
    weight = np.exp(log - log.max())
    return Findings(problem, tuple(h for h, _ in order), tuple((weight / weight.sum()).tolist()), fitted)


def _without_copies(c: Campaign, noise: Noise) -> Noise:
    """The noise with readings left out that are copies of others: a table twice says no more than once."""
    once, remark = copies(c)
    if not remark:
        return noise
    return replace(noise, used=noise.used & once, remarks=(*noise.remarks, remark))


def copies(c: Campaign) -> tuple[Flags, str]:
    """Which readings (n,) are not copies of others, and a line that names the copies; empty where there are none."""
    words = [c.pose, c.quantity, c.sensor, c.load, c.session]
    cell = np.column_stack([*words, np.nan_to_num(c.wrench), np.nan_to_num(c.sigma)])
    read = np.flatnonzero(~np.isnan(c.value))  # a plan's empty cells are no readings
    whole = np.column_stack([cell, c.value])[read]
    repeated = len(read) - len(np.unique(cell[read], axis=0))
    first = np.unique(whole, axis=0, return_index=True)[1]
    count = len(read) - len(first)
    once = np.ones(len(c), dtype=np.bool_)
    if not count or count < COPIES * repeated:
        return once, ""
    once[read] = False
    once[read[first]] = True
    k = int(np.flatnonzero(~once[read])[0])
    same = first[int(np.flatnonzero((whole[first] == whole[k]).all(axis=1))[0])]
    where, other = c.where(int(read[k])), c.where(int(read[same]))
    return once, f"{count} readings repeat others to the last digit and count once: {where} is {other}"

"""Results of a search: hypotheses with probabilities, and residuals in standard deviations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.copies import find_copies
from stiffscope.gap.inference.fitting import Problem
from stiffscope.gap.inference.hypothesis import (
    bound_parameters,
    forms_of,
    join_values,
    split,
)
from stiffscope.gap.inference.plausibility import implausible
from stiffscope.gap.inference.residuals import percent_rms
from stiffscope.gap.inference.search import ROUGH, Effort, Search
from stiffscope.gap.inference.settings import FIT, GROUPS, VERDICT

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.forward.forward_model import (
        Candidate,
        ForwardModel,
        Noise,
        Parameters,
    )
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array, Flags, Progress

    Fitted = dict[frozenset[tuple[str, int]], Hypothesis]


@dataclass(frozen=True)
class Group:
    """An effect with the effects that these readings cannot distinguish from it."""

    others: tuple[str, ...]
    probability: float
    """Probability of the effect or one of the others; some aliases may be omitted."""
    known: float
    """The same for named effects only."""
    doubted: float
    """``probability`` if all effects were equally likely and the noise as the residuals."""
    elsewhere: bool
    """Whether a like unnamed fault at another place explains the readings nearly as well."""


@dataclass(frozen=True)
class Findings:
    """Hypotheses of the search with their probabilities, the best first."""

    problem: Problem
    hypotheses: tuple[Hypothesis, ...]
    probability: tuple[float, ...]
    fitted: Fitted
    """All fitted hypotheses, in all forms, by `forms_of` their effects; also used under other priors."""

    @property
    def model(self) -> ForwardModel:
        """The forward model that was searched."""
        return self.problem.model

    @property
    def campaign(self) -> Campaign:
        """The campaign with its readings."""
        return self.problem.model.campaign

    @property
    def used_readings(self) -> Flags:
        """(n,) False for gross outliers."""
        return self.problem.noise.used

    @property
    def ranked(self) -> Iterator[tuple[Hypothesis, float]]:
        """Hypotheses with their probabilities, the best first."""
        return zip(self.hypotheses, self.probability, strict=True)

    @property
    def best(self) -> Hypothesis:
        """The most probable hypothesis."""
        return self.hypotheses[0]

    @cached_property
    def none(self) -> Hypothesis:
        """The hypothesis of no effect."""
        return next(h for h in self.hypotheses if not h.names)

    @cached_property
    def _residual_weights(self) -> Array:
        return np.where(
            self.problem.noise.scaled, 1.0 / self.best.known.noise_factor, 1.0
        )

    @cached_property
    def sigma(self) -> Array:
        """Standard deviations (n,) of the readings, with the best hypothesis's noise factor."""
        return self.problem.noise.sigma / self._residual_weights

    def evidence(self, hypothesis: Hypothesis) -> float:
        """Return the ln evidence of a hypothesis without its prior odds."""
        return hypothesis.evidence - self.problem.log_odds(hypothesis)

    def misfit(self, hypothesis: Hypothesis) -> float:
        """Return χ² per degree of freedom of a hypothesis, with its noise and discrepancy."""
        errors = self.problem.errors
        residual = errors.project(hypothesis.residual[:, None])
        total = float(
            hypothesis.known.settings @ errors.inner(residual, residual)[:, 0, 0]
        )
        return total / max(int(self.used_readings.sum()) - len(hypothesis.values), 1)

    def under(self, problem: Problem) -> Findings:
        """Return the same hypotheses ranked under another prior."""
        near = [
            h
            for h in self.hypotheses
            if not h.names or h.evidence > self.best.evidence - GROUPS.near
        ]
        return _rank(problem, [(h, problem.reweigh(h)) for h in near], self.fitted)

    @cached_property
    def _shares(self) -> dict[int, list[dict[str, float]]]:
        """Probabilities of each effect and its twins if one is present, by hypothesis and name."""
        return {
            id(h): [
                dict(zip(c.signature_of, (odds / odds.sum()).tolist(), strict=True))
                for c in h.candidates
                for odds in [self.problem.weigh_twins(c, h)]
            ]
            for h in self.hypotheses
        }

    def _find_missed(self, hypothesis: Hypothesis, names: Iterable[str]) -> list[float]:
        """Return, of each effect of a hypothesis, the probability that it is none of these."""
        listed = {self.problem.find_cause(name) for name in names}
        cause = self.problem.find_cause
        own = self._shares[id(hypothesis)]
        return [
            1.0 - sum(p for name, p in shares.items() if cause(name) in listed)
            for shares in own
        ]

    def _sum_missed(self, hypothesis: Hypothesis, names: Iterable[str]) -> float:
        """Return the probability that none of these effects is present, given a hypothesis."""
        return prod(self._find_missed(hypothesis, names))

    def compute_probability(self, name: str) -> float:
        """Return the probability of an effect; indistinguishable effects share theirs."""
        found = ((shares, p) for h, p in self.ranked for shares in self._shares[id(h)])
        return float(sum(p * shares.get(name, 0.0) for shares, p in found))

    def group(self, name: str) -> Group:
        """Return an effect of the best hypothesis with its most probable substitutes.

        Where these are certain by prior odds alone, the likeliest of equal odds follow.
        Nuisance patterns come last, and of these the same fault elsewhere if it is less probable.
        Other names of what is in the group are added if there is place.
        """
        listed = [name]
        own = next(c for c in self.best.candidates if c.name == name)
        self._add_rivals(listed, own, self)
        self._add_rivals(listed, own, self.doubted, GROUPS.confident)
        known = self.probability_of_any(listed)
        self._add_rivals(listed, own, self, patterns=True)
        elsewhere = [
            c.name
            for c in self.imitating_patterns.get(name, ())
            if c.like == own.effect
        ]
        most = max(len(listed), GROUPS.confused + 1)
        listed = list(dict.fromkeys([*listed, *elsewhere]))[:most]
        same = {self.problem.find_cause(each) for each in listed}
        aliases = (
            a
            for a in (*own.aliases, *self.problem.causes)
            if self.problem.find_cause(a) in same
        )
        others = tuple(dict.fromkeys([*listed, *aliases]))[1:most]
        whole = self.probability_of_any(
            [name, *others]
        )  # what there is no place for is not part of it
        doubted = self.doubted.probability_of_any([name, *others])
        return Group(
            others, whole, min(known, whole), min(doubted, whole), bool(elsewhere)
        )

    @cached_property
    def doubted(self) -> Findings:
        """The same hypotheses, ranked by evidence tempered by the remaining misfit."""
        alike = replace(self.problem, even=True)
        left = max(self.misfit(self.best), 1.0)
        scored = [
            (h, self.evidence(h) / left + alike.log_odds(h)) for h in self.hypotheses
        ]
        return _rank(alike, scored, self.fitted)

    def find_instead(self, name: str) -> str:
        """Return what fits about as well without an effect and its group, joined by "and"."""
        group = {name, *self.group(name).others}
        without = (
            h for h in self.doubted.hypotheses if self._sum_missed(h, group) == 1.0
        )
        return (
            " and ".join(sorted(next(without, self.none).names - self.best.names))
            or "no effect"
        )

    @cached_property
    def imitating_patterns(self) -> dict[str, list[Candidate]]:
        """Nuisance patterns that fit nearly as well in place of each effect of the best."""
        found: dict[str, list[Candidate]] = {}
        best = self.evidence(self.best)
        for name, other, hypothesis, _ in self._exchange_effects():
            if (
                other.is_nuisance
                and best - self.evidence(hypothesis) < GROUPS.imitating
            ):
                found.setdefault(name, []).append(other)
        return found

    @cached_property
    def _in_place_of(self) -> dict[str, set[str]]:
        """Substitutes of each effect in competing hypotheses that are otherwise the same."""
        found: dict[str, set[str]] = {}
        for name, other, _, p in self._exchange_effects():
            if p > GROUPS.competing * self.probability[0]:
                found.setdefault(name, set()).add(other.name)
        return found

    def _exchange_effects(self) -> Iterator[tuple[str, Candidate, Hypothesis, float]]:
        """Yield effects of the best hypothesis, substitutes, their hypotheses and probabilities."""
        for hypothesis, p in self.ranked:
            gone = self.best.names - hypothesis.names
            new = [c for c in hypothesis.candidates if c.name not in self.best.names]
            if len(gone) == len(new) == 1:
                yield next(iter(gone)), new[0], hypothesis, p

    def probability_of_any(self, names: Iterable[str]) -> float:
        """Return the probability that one of these effects is present."""
        return min(
            float(sum(p * (1.0 - self._sum_missed(h, names)) for h, p in self.ranked)),
            1.0,
        )

    def _add_rivals(
        self,
        listed: list[str],
        own: Candidate,
        by: Findings,
        enough: float = 1.0,
        *,
        patterns: bool = False,
    ) -> None:
        """Add the most probable substitutes of an effect, except known ones of other effects.

        by: ranking that tells how probable they are; enough: probability of the group at which
        none is missing; patterns: whether nuisance patterns may be added.
        """
        rest = self.best.names - {own.name}
        elsewhere = {
            name for other in rest for name in self._in_place_of.get(other, ())
        }
        elsewhere -= {*self._in_place_of.get(own.name, ()), *own.signature_of}
        while len(listed) < VERDICT.listed and by.probability_of_any(listed) < enough:
            if (
                len(listed) > GROUPS.confused
                and by.probability_of_any(listed) >= GROUPS.confident
            ):
                break  # more than three only where three are not certain
            known = {self.problem.find_cause(each) for each in listed}
            gains: dict[str, float] = {}
            for h, p in by.ranked:
                weight = p * (
                    1.0 if rest <= h.names and len(h.names - rest) == 1 else 0.5
                )
                missed = by._find_missed(h, listed)
                for k, (other, shares) in enumerate(
                    zip(h.candidates, by._shares[id(h)], strict=True)
                ):
                    if other.name in rest | elsewhere or (
                        other.is_nuisance and not patterns
                    ):
                        continue
                    beside = weight * prod(
                        missed[:k] + missed[k + 1 :]
                    )  # its names exclude each other
                    for each, share in shares.items():
                        same = self.problem.find_cause(each)
                        if same not in known:
                            gains[same] = gains.get(same, 0.0) + beside * share
            best = max(gains, key=lambda n: gains[n], default="")
            if not best or gains[best] <= GROUPS.competing * by.probability[0]:
                break
            listed.append(best)

    def fit_effects(self, candidates: Iterable[Candidate]) -> Hypothesis:
        """Return the fitted hypothesis of some effects, from their parameters in the best one."""
        candidates = tuple(candidates)
        chosen = forms_of(candidates)
        if chosen not in self.fitted:
            known = {
                key: values
                for c, values in self.best.parameters
                for key in forms_of([c])
            }
            each = (
                known.get(key, np.zeros(len(c.scale)))
                for c in candidates
                for key in forms_of([c])
            )
            self.fitted[chosen] = self.problem.fit(candidates, join_values(each))
        return self.fitted[chosen]

    def fit_named(self, candidates: Iterable[Candidate]) -> Hypothesis:
        """Return the likeliest fitted hypothesis of some effects of the best one, in any of their forms."""
        own = self.fit_effects(candidates)
        alike = (
            h for h in self.fitted.values() if h.names == own.names and h.converged
        )
        return max((own, *alike), key=lambda h: h.evidence)

    def fit_plainly(self, hypothesis: Hypothesis) -> Hypothesis:
        """Return a hypothesis fitted without a discrepancy, by which the rest is least.

        A fit beside a large discrepancy follows details, and may leave more than no effect does.
        """
        widens = self.chi2(hypothesis) > self.chi2(self.none)
        if (
            not widens
            and not self.problem.errors.sizes[np.argmax(hypothesis.known.settings)]
        ):
            return hypothesis
        here = hypothesis.values
        starts = (here, 0.0 * here) if widens else (here,)
        fits = (self._plainly.fit(hypothesis.candidates, start) for start in starts)
        return min(fits, key=self.chi2)

    @cached_property
    def _plainly(self) -> Problem:
        """The problem without a discrepancy, with noise of a known factor: one, or the best's."""
        noise = self.problem.noise
        scaled = noise.scaled | (not noise.scaled.any())
        factor = np.array([self.best.known.noise_factor])
        return replace(
            self.problem, noise=replace(noise, scaled=scaled, factors=factor)
        )

    def predict_readings(self, hypothesis: Hypothesis) -> Array:
        """Return the readings (n,) predicted by a hypothesis."""
        return self.campaign.value - hypothesis.residual * self.problem.noise.sigma

    def residual(self, hypothesis: Hypothesis) -> Array:
        """Return residuals (n,) in standard deviations."""
        return hypothesis.residual * self._residual_weights

    def slopes(self, hypothesis: Hypothesis) -> Array:
        """Return derivatives (n, k) of a hypothesis's predictions in standard deviations."""
        return hypothesis.slopes * self._residual_weights[:, None]

    def whiten(self, columns: Array) -> Array:
        """Return derivatives (n, k) over the stated sigma in standard deviations."""
        return columns * self._residual_weights[:, None]

    def chi2(self, hypothesis: Hypothesis) -> float:
        """Return χ² over the readings used."""
        return float(np.sum(self.residual(hypothesis)[self.used_readings] ** 2))

    def percent_rms(self, hypothesis: Hypothesis) -> float:
        """Return the gap that a hypothesis leaves, % rms."""
        model = self.predict_readings(hypothesis)
        return percent_rms(self.campaign, model, self.sigma, self.used_readings)

    def held_out_residual(self, hypothesis: Hypothesis) -> Array:
        """Return residuals (n,) over sigma with each pose held out, by one linear step.

        NaN at one pose, which nothing predicts.
        """
        out = self.residual(hypothesis).copy()
        if len(self.campaign.pose_names) == 1:
            return np.full(len(out), np.nan)
        for pose in range(len(self.campaign.pose_names)):
            here = self.used_readings & (self.campaign.pose == pose)
            if here.any():
                change = self._change_without(hypothesis, here)
                out[here] -= self.slopes(hypothesis)[here] @ change
        return out

    def find_parameters_without(
        self, hypothesis: Hypothesis, pose: int
    ) -> Parameters | None:
        """Return the parameters without the readings of a pose, by one linear step; None if nothing is left."""
        here = self.used_readings & (self.campaign.pose == pose)
        if not (self.used_readings & ~here).any():
            return None
        values = hypothesis.values
        if here.any():
            values = values + self._change_without(hypothesis, here)
        candidates = hypothesis.candidates
        return split(candidates, bound_parameters(candidates, values))

    def percent_rms_by_pose(self, residual: Array) -> float:
        """Return % rms of residuals (n,) over sigma, averaged over poses with non-zero readings."""
        model = self.campaign.value - residual * self.sigma
        told = self.used_readings & (self.campaign.value != 0.0)
        scores = list[float]()
        for pose in range(len(self.campaign.pose_names)):
            here = self.campaign.pose == pose
            if (told & here).any() and not np.isnan(residual).all():
                used = self.used_readings & here
                scores.append(percent_rms(self.campaign, model, self.sigma, used))
        return float(np.mean(scores)) if scores else float("nan")

    def _change_without(self, hypothesis: Hypothesis, here: Flags) -> Array:
        """Return the change (k,) of the internal parameters if readings (n,) are not fitted."""
        noise = self.problem.noise
        x = hypothesis.slopes
        r = hypothesis.residual
        if not x.shape[1]:
            return np.zeros(0)
        discrepancy = self.problem.errors.sizes[
            int(np.argmax(hypothesis.known.settings))
        ]
        if noise.scaled.any() or discrepancy:  # both are estimated again
            rest = Problem(self.model, replace(noise, used=noise.used & ~here))
            near = hypothesis.known.scales
            known = rest.posterior(hypothesis.candidates, hypothesis.linear, x, near)
            return known.mean - hypothesis.values
        unit = hypothesis.known.scales  # parameter units range from 1e-9 m/N to kg
        left = unit * x[self.used_readings & ~here]
        out = unit * x[here]
        return -unit * np.linalg.solve(
            left.T @ left + np.eye(len(unit)), out.T @ r[here]
        )


def search_once(
    model: ForwardModel, progress: Progress | None = None, effort: Effort | None = None
) -> Findings:
    """Search for the sets of effects and nuisance patterns that explain a model's campaign."""
    problem = Problem(model, _without_copies(model.campaign, model.noise()))
    distinct: dict[frozenset[str], Hypothesis] = {}
    seeds = _find_starts(problem, progress)
    hypotheses = Search(problem, progress, seeds, effort or Effort()).hypotheses()
    for hypothesis in hypotheses:  # the best fit of every set
        distinct.setdefault(hypothesis.names, hypothesis)
    fitted = {forms_of(h.candidates): h for h in hypotheses if h.converged}
    return _rank(problem, [(h, h.evidence) for h in distinct.values()], fitted)


def _find_starts(problem: Problem, progress: Progress | None) -> Sequence[Hypothesis]:
    """Return hypotheses of a coarser model, if the problem's needs them, the best first.

    What that one cannot fit is sought in a yet coarser one, whose minima are wider.
    """
    coarse = problem.model.coarse
    if coarse is None or not _needs_start(problem):
        return ()
    rough = Problem(coarse, _without_copies(coarse.campaign, coarse.noise()))
    found = Search(rough, progress, (), ROUGH).hypotheses()
    if rough.measure_rest(found[0].residual) < ROUGH.enough:
        return found
    wider = _find_starts(rough, progress)
    if not wider:
        return found
    again = Search(rough, progress, wider, ROUGH).hypotheses()
    return sorted([*found, *again], key=lambda h: -h.evidence)


def _needs_start(problem: Problem) -> bool:
    """Return whether the readings are far from the nominal model, whose derivatives tell little."""
    return problem.measure_rest(problem.nominal_residual) > FIT.near


def _rank(
    problem: Problem, scored: list[tuple[Hypothesis, float]], fitted: Fitted
) -> Findings:
    """Return hypotheses ranked by their share of all evidence, the best first."""
    order = sorted(_yield_to_plausible(problem, scored), key=lambda item: -item[1])
    log = np.array([evidence for _, evidence in order])
    weight = np.exp(log - log.max())
    probability = tuple((weight / weight.sum()).tolist())
    return Findings(problem, tuple(h for h, _ in order), probability, fitted)


def _yield_to_plausible(
    problem: Problem, scored: list[tuple[Hypothesis, float]]
) -> list[tuple[Hypothesis, float]]:
    """Return evidences, below that of a plausible hypothesis where an implausible one fits alike.

    A mass many times the stated one has fewer parameters than a payload, but is no cause.
    """
    top = max(log for _, log in scored)
    used = problem.noise.used
    close = [(h, log) for h, log in scored if log > top - GROUPS.near]
    chi2 = {id(h): float(np.sum(h.residual[used] ** 2)) for h, _ in close}
    strange = {
        id(h)
        for h, _ in close
        if any(implausible(c, h) for c in h.words if not c.flexible)
    }
    out: list[tuple[Hypothesis, float]] = []
    for h, log in scored:
        if id(h) in strange:
            least = chi2[id(h)] + VERDICT.alike
            fits = [
                other
                for plain, other in close
                if id(plain) not in strange and plain.words and chi2[id(plain)] <= least
            ]
            limit = max(fits, default=np.inf) + np.log(GROUPS.competing)
            log = min(log, float(limit))  # noqa: PLW2901
        out.append((h, log))
    return out


def _without_copies(c: Campaign, noise: Noise) -> Noise:
    """Return the noise with duplicated readings excluded."""
    once, remark = find_copies(c)
    once |= c.in_blocks
    if not remark:
        return noise
    return replace(noise, used=noise.used & once, remarks=(*noise.remarks, remark))

"""Beam search over sets of effects, by adding and exchanging effects."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from stiffscope.gap.inference.evidence import log_evidences, log_sum, marginalize
from stiffscope.gap.inference.hypothesis import (
    Hypothesis,
    bound_parameters,
    forms_of,
    join_values,
    positive_of,
    split,
)
from stiffscope.gap.inference.settings import FIT, SEARCH

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from stiffscope.gap.forward.forward_model import Candidate
    from stiffscope.gap.inference.evidence import Errors
    from stiffscope.gap.inference.fitting import Problem
    from stiffscope.gap.inference.library import Library
    from stiffscope.runtime.types import Array, Flags, Progress

    Forms = frozenset[tuple[str, int]]
    Heights = tuple[float, float]

_Set = TypeVar("_Set", "Start", Hypothesis)


@dataclass(frozen=True)
class Effort:
    """How much a search tries.

    Attributes
    ----------
    single, fitted, plain
        Most nonlinear fits of single effects, of each larger size, and of the best without a
        discrepancy.
    sketches
        Whether sets of simple effects are also sought jointly.
    flexible
        Whether effects that can fit almost anything are tried.
    enough
        χ² per reading at which a search ends.
    """

    single: int = 2 * SEARCH.fitted
    fitted: int = SEARCH.fitted
    plain: int = SEARCH.fitted_plain
    sketches: bool = True
    flexible: bool = True
    enough: float = 0.0


ROUGH = Effort(single=8, fitted=5, plain=2, sketches=False, flexible=False, enough=1.0)
"""Of a search in a coarser model, whose hypotheses are only starts."""


@dataclass(frozen=True, eq=False)
class Start:
    """A promising set of effects, with its first-order score."""

    candidates: tuple[Candidate, ...]
    values: Array
    """Internal parameters (k,)."""
    origin: Array
    """Feasible internal parameters (k,): those of the set without its last effect."""
    evidence: float = np.inf
    """Ln of evidence times prior odds."""
    plain_score: float = np.inf
    """The same without a discrepancy."""


@dataclass(frozen=True)
class Search:
    """Search over a problem's sets of effects."""

    problem: Problem
    progress: Progress | None = None
    seeds: Sequence[Hypothesis] = ()
    """Hypotheses of a coarser model, the best first, from which the search starts."""
    effort: Effort = field(default_factory=Effort)

    @cached_property
    def _most_parameters(self) -> float:
        """Most parameters of a set: where the noise is found with them, the rest must tell it."""
        noise = self.problem.noise
        readings = int(noise.used.sum())
        return SEARCH.share * readings if noise.scaled.any() else np.inf

    def hypotheses(self) -> list[Hypothesis]:
        """Return fitted hypotheses, the best first: none, single effects, and larger sets."""
        none = self.problem.fit((), np.zeros(0))
        fitted = _Fitted(self.problem, {frozenset(): none}, self.progress)
        base = _heights([none])
        fit = fitted.fit
        found = fitted.found
        counts = (
            (each, sum(len(c.scale) for c in each)) for each in self.problem.model.tried
        )
        tried = [
            Start(each, np.zeros(count), np.zeros(count)) for each, count in counts
        ]
        fit(tried, base, "effects", len(tried))
        seeds = self._find_seeds()
        grown = fit(seeds, base, "effects of the coarser model", len(seeds))
        self._grow(_without_idle(grown)[: SEARCH.width] or [none], fitted)
        fixed: tuple[
            Candidate, ...
        ] = ()  # what has no parameters changes the derivatives of all others
        for candidate in self.problem.model.library:
            if not candidate.scale and self.problem.model.admits((*fixed, candidate)):
                fixed = (*fixed, candidate)
        if fixed:
            self._grow(
                fit([Start(fixed, np.zeros(0), np.zeros(0))], base, "instruments", 1),
                fitted,
            )
        if self.effort.sketches and not self.seeds:  # far from these, first order fails
            self._sketch(fitted, base)
        for _ in range(SEARCH.rounds):
            if self._is_enough(fitted):
                break
            best = fitted.best
            rivals = _sort(found.values())[: SEARCH.rivals]
            close = (h for h in rivals if h.evidence > best.evidence - SEARCH.close)
            starts = _sort(start for h in close for start in self._exchanges(h))
            exchanged = fit(starts, base, "effects exchanged", len(starts))
            if not exchanged or exchanged[0].evidence < best.evidence + SEARCH.gain:
                break
            self._grow(exchanged[:1], fitted)
        if self._is_enough(fitted):
            starts = self._simplify(fitted.best)
            fit(starts, base, "fewer effects", len(starts))
        return _sort(found.values())

    def _simplify(self, whole: Hypothesis) -> list[Start]:
        """Return parts of a set that a coarse model may fit as well: one effect, or one fewer.

        A single effect is tried in all its forms, from nothing: beside others it may be elsewhere.
        """
        if len(whole.candidates) < 2:
            return []
        alone = (c for c in self.problem.model.library if c.name in whole.names)
        starts = [
            Start((c,), np.zeros(len(c.scale)), np.zeros(len(c.scale))) for c in alone
        ]
        for gone in whole.candidates if len(whole.candidates) > 2 else ():
            rest = [(c, v) for c, v in whole.parameters if c is not gone]
            values = join_values(v for _, v in rest)
            starts.append(Start(tuple(c for c, _ in rest), values, values))
        return starts

    def _is_enough(self, fitted: _Fitted) -> bool:
        """Return whether the best hypothesis leaves as little as is sought."""
        if not self.effort.enough:
            return False
        left = self.problem.measure_rest(fitted.best.residual)
        return left < self.effort.enough

    def _sketch(self, fitted: _Fitted, base: Heights) -> None:
        """Fit sets of simple effects that only fit jointly, where the best set is not obvious."""
        best = fitted.best
        if len(best.candidates) > SEARCH.obvious or not all(
            c.simple for c in best.candidates
        ):
            complex_ones = tuple(c for c in best.words if not c.simple)
            for core in [complex_ones, ()] if complex_ones else [()]:
                for starts in self._sketches(core):
                    new = [
                        start
                        for start in starts
                        if forms_of(start.candidates) not in fitted.found
                    ]
                    stage = f"simple effects, {len(starts[0].candidates)} at once"
                    fitted.fit(new, base, stage, SEARCH.sketched)
                if fitted.best is not best:
                    self._grow([fitted.best], fitted)
                    break

    def _find_seeds(self) -> list[Start]:
        """Return the best hypotheses of the coarser model as starts."""
        some = [h for h in self.seeds if h.names][: SEARCH.seeded]
        least = some[0].evidence - SEARCH.seeded_within if some else 0.0
        chosen = [
            h
            for k, h in enumerate(some)
            if k < SEARCH.seeded_least or h.evidence > least
        ]
        return [Start(h.candidates, h.values, h.values) for h in chosen]

    def _sketches(self, core: tuple[Candidate, ...]) -> Iterable[list[Start]]:
        """Yield the best first-order sets with more simple effects, two or more, while they gain.

        `_grow` keeps few sets, and flexible or ambiguous effects crowd out sets whose effects only
        fit jointly. These sets are not fitted before the next step, so that many can be kept.
        """
        fixed = tuple(c for c in core if not c.scale)
        nominal = self.problem.nominal
        library = self.problem.library_at(self._first_order(fixed, nominal))
        kept = [self._first_order(core, library)]
        while len(kept[0].candidates) < self.problem.model.most_effects:
            starts = self._extensions(kept, library, simple=True)
            plain = sorted(starts, key=lambda start: -start.plain_score)
            if not starts or not _gains(_heights(starts), _heights(kept)):
                return
            pairs = zip(starts, plain, strict=True)
            starts = list(dict.fromkeys(start for pair in pairs for start in pair))
            starts = starts[: SEARCH.wide[bool(core)]]
            if kept[0].names:
                yield [
                    replace(start, origin=np.zeros(len(start.origin)))
                    for start in starts
                ]
            kept = _sort(
                self._first_order(start.candidates, library) for start in starts
            )

    def _grow(self, frontier: Sequence[Hypothesis], fitted: _Fitted) -> None:
        """Fit larger and larger sets while they gain."""
        before = _heights(frontier)
        while len(frontier[0].candidates) < self.problem.model.most_effects:
            if self._is_enough(fitted):
                return
            stage = f"effects, {len(frontier[0].candidates) + 1} at once"
            base = _heights(frontier)
            starts = self._extensions(frontier)
            if not starts:
                return
            most = self.effort.fitted if frontier[0].names else self.effort.single
            plain = sorted(starts, key=lambda s: -s.plain_score)
            if not _gains(_heights(starts), base):
                most = SEARCH.least_fitted
                plain = []  # the first-order error is as small
            fits = fitted.fit(starts, base, stage, most)
            fits += fitted.fit(plain, base, stage, self.effort.plain)
            fits = _sort({id(h): h for h in fits}.values())
            if not fits:
                return
            height, plain_height = _heights(fits)
            if not _gains((height, plain_height), before):
                return
            before = max(height, before[0]), max(plain_height, before[1])
            plain = sorted(fits, key=lambda h: -h.plain_score)[: SEARCH.width_plain]
            frontier = [
                *fits[: SEARCH.width],
                *(h for h in plain if h not in fits[: SEARCH.width]),
            ]

    def _exchanges(self, whole: Hypothesis) -> list[Start]:
        """Return sets without each effect, or with a substitute, if they may compete."""
        library = self.problem.library_at(whole)
        starts: list[Start] = []
        for gone in whole.candidates:
            rest = self._without(whole, gone)
            limit = (
                whole.evidence
                - FIT.margin
                - FIT.doubt * (whole.evidence - rest.evidence)
            )
            scored = (
                s for s in self.score_extensions(rest, library) if s.evidence > limit
            )
            known = (s for s in scored if not s.candidates[-1].is_nuisance)
            starts += _sort(s for s in known if s.candidates[-1] is not gone)[
                : SEARCH.swapped
            ]
            if rest.evidence > whole.evidence - FIT.margin:
                origin = join_values(v for c, v in whole.parameters if c is not gone)
                values = bound_parameters(rest.candidates, rest.known.mean)
                starts.append(Start(rest.candidates, values, origin))
        return starts

    def _without(self, hypothesis: Hypothesis, gone: Candidate) -> Hypothesis:
        """Return a hypothesis without one of its effects, linearized about it."""
        kept = hypothesis.mark(lambda c: c is not gone)
        y = hypothesis.linear
        candidates = tuple(c for c in hypothesis.candidates if c is not gone)
        if not gone.scale:
            others = tuple((c, v) for c, v in hypothesis.parameters if c is not gone)
            before = self.problem.find_residual(self.problem.model.predict(others))
            y = y + before - hypothesis.residual
        return self._linear(candidates, y, hypothesis.slopes[:, kept])

    def _first_order(
        self, candidates: tuple[Candidate, ...], library: Library
    ) -> Hypothesis:
        """Return a set of effects to first order, with the derivatives of a library."""
        y = self.problem.nominal_residual
        columns: list[Array] = [np.zeros((len(y), 0))]
        for candidate in candidates:
            if candidate.scale:
                columns.append(library.differentiate(candidate))
            else:
                y = y - self.problem.nominal.differentiate(candidate)[:, 0]
        return self._linear(candidates, y, np.hstack(columns))

    def _linear(
        self, candidates: tuple[Candidate, ...], y: Array, slopes: Array
    ) -> Hypothesis:
        """Return the hypothesis for readings (n,) linear in the effects, with slopes (n, k)."""
        known = self.problem.posterior(candidates, y, slopes)
        log = known.log_evidence + self.problem.log_prior(candidates)
        parameters = split(candidates, known.mean)
        return Hypothesis(
            parameters, y - slopes @ known.mean, slopes, log, known, converged=False
        )

    def _tries(self, candidate: Candidate, *, simple: bool) -> bool:
        """Return whether the search tries an effect, optionally a simple one."""
        if simple and not candidate.simple:
            return False
        return self.effort.flexible or not candidate.flexible

    def _extensions(
        self,
        frontier: Sequence[Hypothesis],
        library: Library | None = None,
        *,
        simple: bool = False,
    ) -> list[Start]:
        """Return sets with one more (optionally simple) effect, by first-order evidence.

        library: derivatives; default: those about the first hypothesis with the same fixed effects.
        """
        ranked: dict[Forms, Start] = {}
        about: dict[frozenset[str], Library] = {}
        for hypothesis in frontier:
            fixed = frozenset(c.name for c in hypothesis.candidates if not c.scale)
            if fixed not in about:
                about[fixed] = library or self.problem.library_at(hypothesis)
            for start in self.score_extensions(hypothesis, about[fixed], simple=simple):
                key = forms_of(start.candidates)
                if key not in ranked or start.plain_score > ranked[key].plain_score:
                    ranked[key] = start
        return _sort(ranked.values())

    def score_extensions(
        self, hypothesis: Hypothesis, library: Library, *, simple: bool = False
    ) -> Iterable[Start]:
        """Yield a hypothesis with each admitted (optionally simple) effect, to first order."""
        known_good = bound_parameters(hypothesis.candidates, hypothesis.values)
        products = _Products.of(self.problem.errors, hypothesis, library)
        k = int(products.kept.sum())
        inner = products.inner
        across = products.across
        log_weight = self.problem.errors.log_weight + products.log_weight
        without = self.problem.errors.sizes == 0.0
        alike: dict[tuple[bool, ...], list[int]] = {}
        for number, candidate in enumerate(library.candidates):
            if not self._tries(candidate, simple=simple):
                continue
            if len(hypothesis.values) + len(candidate.scale) > self._most_parameters:
                continue
            if self.problem.model.admits((*hypothesis.candidates, candidate)):
                alike.setdefault(candidate.one_sided, []).append(number)
        base = hypothesis.known.scales[products.kept]
        kept = products.kept
        prior = hypothesis.known.averaging + self.problem.log_prior(
            hypothesis.candidates
        )
        for one_sided, numbers in alike.items():
            m = len(one_sided)
            shape = (len(numbers), len(self.problem.errors.sizes))
            grams = np.empty((*shape, k + m, k + m))
            pulls = np.empty((*shape, k + m))
            grams[..., :k, :k] = inner[:, :k, :k]
            pulls[..., :k] = inner[:, :k, k]
            totals = np.tile(inner[:, k, k], (len(numbers), 1))
            for at, number in enumerate(numbers):
                mixed = across[:, library.columns[number]]
                block = products.block(library, number)
                if m:
                    grams[at, :, k:, :k] = mixed[..., :k]
                    grams[at, :, :k, k:] = mixed[..., :k].mT
                    pulls[at, :, k:] = mixed[..., k]
                    grams[at, :, k:, k:] = block
                else:
                    pulls[at] -= mixed[:, 0, :k]
                    totals[at] += block[:, 0, 0] - 2.0 * mixed[:, 0, k]
            added = [library.candidates[number] for number in numbers]
            priors = [self.problem.rough_spreads_of(candidate) for candidate in added]
            scales = np.empty((len(numbers), len(priors[0].scales), k + m))
            scales[..., :k] = base
            scales[..., k:] = [prior.scales for prior in priors]
            before = positive_of(hypothesis.candidates)[kept]
            positive = np.array([*before, *one_sided], dtype=np.bool_)
            logs, means, _ = log_evidences(
                grams=grams,
                pulls=pulls,
                totals=totals,
                log_weight=log_weight,
                scales=scales,
                positive=positive,
            )
            for candidate, prior_of, rough, mean in zip(
                added, priors, logs, means, strict=True
            ):
                log = rough + prior_of.log_weight
                best = np.unravel_index(np.argmax(log), log.shape)
                if (
                    m and not mean[best][k:].any()
                ):  # a discrepancy absorbed the one-sided effect
                    sound = np.where(without[:, None], log, -np.inf)
                    best = np.unravel_index(np.argmax(sound), log.shape)
                odds = prior + self.problem.log_prior([candidate])
                candidates = (*hypothesis.candidates, candidate)
                heights = (float(log_sum(part)) + odds for part in (log, log[without]))
                start = np.append(hypothesis.values, mean[best][k:])
                start[: len(kept)][kept] = mean[best][:k]
                origin = np.append(known_good, np.zeros(m))
                yield Start(
                    candidates, bound_parameters(candidates, start), origin, *heights
                )


@dataclass(frozen=True)
class _Products:
    """Inner products of hypothesis and effect columns, with many small errors marginalized."""

    kept: Flags
    """Flags (k,) of the parameters that are kept."""
    inner: Array
    """Inner products (q, l+1, l+1) of these and the readings."""
    across: Array
    """Inner products (q, c, l+1) of all effects with them."""
    log_weight: Array
    """Contribution (q,) of the others to ln evidence, except through the readings."""
    share: Array
    """What the others take (q, c, m) from all effects."""

    @classmethod
    def of(cls, errors: Errors, hypothesis: Hypothesis, library: Library) -> _Products:
        """Return the products of a library about a hypothesis, with its prior scales."""
        own = errors.project(np.column_stack([hypothesis.slopes, hypothesis.linear]))
        inner = errors.inner(own, own)
        across = errors.inner(library.projection, own)
        many = hypothesis.mark(lambda c: bool(c.parts))
        left = np.append(~many, np.ones(1, dtype=np.bool_))
        log = np.zeros(len(inner))
        if not many.any():
            return cls(
                ~many, inner, across, log, np.zeros((len(inner), across.shape[1], 0))
            )
        gone = np.flatnonzero(many)
        find_share, log = marginalize(
            inner[:, gone[:, None], gone], hypothesis.known.scales[many]
        )
        mine = find_share(inner[:, left][:, :, gone])
        share = find_share(across[:, :, gone])
        inner = inner[:, left][:, :, left] - mine @ mine.mT
        across = across[:, :, left] - share @ mine.mT
        return cls(~many, inner, across, log, share)

    def block(self, library: Library, number: int) -> Array:
        """Return inner products (q, k, k) of one effect's columns."""
        share = self.share[:, library.columns[number]]
        return library.blocks[number] - share @ share.mT


@dataclass(frozen=True)
class _Fitted:
    """Hypotheses fitted so far by a search."""

    problem: Problem
    found: dict[Forms, Hypothesis]
    progress: Progress | None

    @property
    def best(self) -> Hypothesis:
        """The best hypothesis so far."""
        return max(self.found.values(), key=lambda h: h.evidence)

    def fit(
        self, starts: Sequence[Start], base: Heights, stage: str, most: int
    ) -> list[Hypothesis]:
        """Fit the starts that may compete with the best fitted hypothesis, in order."""
        fits: list[Hypothesis] = []
        strikes: Counter[int] = Counter()
        for start in starts:
            if len(fits) >= most:
                break
            promised = start.evidence, start.plain_score
            if len(fits) >= SEARCH.least_fitted and all(
                map(_hopeless, promised, _heights(fits), base)
            ):
                continue
            if any(strikes[id(c)] >= SEARCH.strikes for c in start.candidates):
                continue
            if self.progress:
                self.progress(stage, len(fits) / most)
            key = forms_of(start.candidates)
            if key not in self.found or not self.found[key].converged:
                target = max((h.plain_score for h in fits), default=-np.inf)
                own = start.candidates, start.values, target, start.origin
                self.found[key] = self.problem.fit(*own)
            if self.found[key].short > FIT.margin:
                strikes.update(id(c) for c in start.candidates if c.flexible)
            fits.append(self.found[key])
        return _sort(fits)


def _without_idle(found: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return hypotheses, the best first, without those that add effects to a better one."""
    out: list[Hypothesis] = []
    for hypothesis in found:
        if not any(better.names <= hypothesis.names for better in out):
            out.append(hypothesis)
    return out


def _sort(sets: Iterable[_Set]) -> list[_Set]:
    """Return sets of effects, the best first."""
    return sorted(sets, key=lambda each: -each.evidence)


def _heights(sets: Sequence[Start | Hypothesis]) -> Heights:
    """Return the best evidence with and without a discrepancy."""
    return max(each.evidence for each in sets), max(each.plain_score for each in sets)


def _gains(now: Heights, before: Heights) -> bool:
    """Return whether one more effect is worthwhile, with or without a discrepancy."""
    return any(a >= b + SEARCH.gain for a, b in zip(now, before, strict=True))


def _hopeless(promised: float, best: float, base: float) -> bool:
    """Return whether a set is too far behind the best fit, given relative first-order errors."""
    return promised < best - max(FIT.margin, FIT.doubt * (best - base))

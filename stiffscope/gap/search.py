"""Which effects explain a campaign: nonlinear fits of sets of effects, and the search over such sets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.evidence import constrained_minima, errors_of, log_evidences, posterior

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.evidence import Errors, Posterior, Projection
    from stiffscope.gap.forward_model import Candidate, ForwardModel, Noise, Parameters, Prediction

    Array = NDArray[np.floating[Any]]
    Codes = NDArray[np.int64]
    Flags = NDArray[np.bool_]
    Progress = Callable[[str, float], None]

PRIOR_ODDS = 0.5  # of one effect more, shared by all candidates
UNNAMED_PENALTY = 3.0  # ln-odds by which a nuisance pattern is less likely than a word of the vocabulary
BEAM_WIDTH = 10  # hypotheses of each size that are extended, the best,
BEAM_PLAIN = 4  # and the best without a discrepancy, which takes up what several effects leave only together
FITTED = 10  # nonlinear fits for each size at most; twice as many of single effects,
FITTED_PLAIN = 6  # and the best without a discrepancy
LEAST_FITTED = 4  # however far behind to first order
MARGIN = 30.0  # ln-odds behind the best to first order up to which a set is fitted,
DOUBT = 0.2  # or this share of the best one's gain, since first order errs by a share of it
SWAPPED = 4  # others that are fitted in the place of each effect of the best set
STRIKES = 2  # fits of a size that a flexible effect may leave at what cannot be assembled
ROUNDS = 3  # of growing and exchanging
GAIN = 1.0  # ln-odds that one effect more must gain for the search to go on
CURVED = 0.1  # error of the linear prediction, over the change predicted, from which derivatives are taken anew
_STEPS = 12  # of Gauss-Newton
_CONVERGED = 1e-3  # of the cost, χ² with the weak prior
_DAMPING = (1.0, 0.5, 0.25, 0.1, 0.02)


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
    stuck: bool = False
    """Whether first order promises what cannot be assembled."""

    @property
    def plain(self) -> float:
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
        return tuple(c for c in self.candidates if not c.unnamed)

    @property
    def values(self) -> Array:
        """All internal parameters (k,)."""
        return _joined(values for _, values in self.parameters)

    @property
    def covariance(self) -> Array:
        """(k, k) of the internal parameters."""
        return self.known.covariance

    @property
    def noise_factor(self) -> float:
        """The common unknown factor on the noise."""
        return self.known.noise_factor

    @cached_property
    def linear(self) -> Array:
        """Readings (n,) minus the prediction extrapolated to internal parameters of zero."""
        return self.residual + self.slopes @ self.values


@dataclass(frozen=True, eq=False)
class Start:
    """A set of effects that is worth fitting, with what it promises to first order."""

    candidates: tuple[Candidate, ...]
    values: Array
    """(k,) internal parameters."""
    origin: Array
    """(k,) internal parameters that are known to be possible: those of the set without its last effect."""
    heights: tuple[float, float] = (np.inf, np.inf)
    """Ln of evidence times prior odds, and the same without a discrepancy."""


@dataclass(frozen=True)
class Library:
    """Derivatives of all effects about one prediction, with the inner products that scoring a further effect needs."""

    candidates: tuple[Candidate, ...]
    columns: tuple[slice, ...]
    """Where each candidate's stand; of one without parameters, its step."""
    values: Array
    """(n, c) in units of sigma."""
    projection: Projection
    blocks: tuple[Array, ...]
    """Inner products (q, k, k) of each candidate's columns."""


@dataclass(frozen=True)
class Problem:
    """A forward model with its noise, and the prior of sets of effects."""

    model: ForwardModel
    noise: Noise
    odds: float = PRIOR_ODDS
    widening: float = 1.0
    """Factor on all prior sizes."""

    @cached_property
    def _share(self) -> float:
        return float(np.log(self.odds / max(len({n for c in self.model.library for n in c.signature_of}), 1)))

    @cached_property
    def errors(self) -> Errors:
        """Distribution of the readings about a hypothesis; a discrepancy is as likely as a nuisance pattern."""
        return errors_of(self.model.campaign, self.noise, self._share - UNNAMED_PENALTY)

    @cached_property
    def sizes(self) -> Array:
        """Multiples (s,) of the candidates' prior sizes."""
        return self.widening * self.model.prior_sizes

    def log_prior(self, candidates: Sequence[Candidate]) -> float:
        """Ln prior odds of a set of effects against none."""
        return sum(self._share + np.log1p(len(c.twins)) - UNNAMED_PENALTY * c.unnamed for c in candidates)

    def posterior(self, candidates: Sequence[Candidate], y: Array, x: Array) -> Posterior:
        """Posterior of the parameters of ``y = X u + errors``, without the prior odds of the set."""
        scale, owner = _scale(candidates), _owner(candidates)
        return posterior(self.errors, y, x, scale, owner, _positive(candidates), self.sizes)

    def reweighted(self, hypothesis: Hypothesis) -> float:
        """Ln of evidence times prior odds of a hypothesis that was fitted under another prior."""
        known = self.posterior(hypothesis.candidates, hypothesis.linear, hypothesis.slopes)
        return known.log_evidence + self.log_prior(hypothesis.candidates)

    def weak_precision(self, candidates: Sequence[Candidate]) -> Array:
        """Precision (k,) of the widest prior of effects' internal parameters."""
        return (self.sizes[-1] * _scale(candidates)) ** -2.0

    def fit(
        self, candidates: Sequence[Candidate], start: Array, target: float = -np.inf, origin: Array | None = None
    ) -> Hypothesis:
        """Fit a set of effects by damped Gauss-Newton with a weak prior.

        Parameters
        ----------
        candidates
            The effects.
        start, origin
            (k,) internal parameters from which the fit starts, and those from which it starts where that leads nowhere;
            none by default.
        target
            Ln of evidence times prior; the fit is given up where the evidence about its start is far below.

        """
        safe = np.zeros(len(start)) if origin is None else origin
        u, (residual, slopes) = self._start(candidates, start, safe)
        known = self.posterior(candidates, residual + slopes @ u, slopes)
        log = known.log_evidence + self.log_prior(candidates)
        if not len(u):
            return Hypothesis((*((c, ()) for c in candidates),), residual, slopes, log, known)
        if log < target - MARGIN - DOUBT * abs(log - self._nominal_evidence):
            return Hypothesis(_split(candidates, u), residual, slopes, log, known, converged=False)
        setting = int(np.argmax(known.settings))
        u, residual, slopes, short = self._descend(candidates, u, residual, slopes, setting)
        if short > MARGIN:
            u_safe, there = self._start(candidates, safe, safe)
            again = self._descend(candidates, u_safe, *there, setting)
            if again[3] < short:
                u, residual, slopes, short = again
        known = self.posterior(candidates, residual + slopes @ u, slopes)
        log = known.log_evidence + self.log_prior(candidates) - 0.5 * short
        return Hypothesis(_split(candidates, u), residual, slopes, log, known, stuck=short > MARGIN)

    @cached_property
    def _nominal_evidence(self) -> float:
        return self.posterior((), self._nominal_residual, np.zeros((len(self.noise.sigma), 0))).log_evidence

    def _descend(
        self, candidates: Sequence[Candidate], u: Array, residual: Array, slopes: Array, setting: int
    ) -> tuple[Array, Array, Array, float]:
        """Gauss-Newton steps in one setting of the errors, damped where the cost would grow.

        The last number is by how much the cost stays above what the last derivatives promise: where a fit comes to
        the end of what can be assembled, its evidence must not count what lies beyond.
        """
        weak, positive, k = self.weak_precision(candidates), _positive(candidates), len(u)

        def inner_of(residual: Array, slopes: Array) -> Array:
            return self.errors.inner_at(setting, np.column_stack([slopes, residual]))

        inner = inner_of(residual, slopes)
        cost, short = float(inner[k, k] + u**2 @ weak), 0.0
        for _ in range(_STEPS):
            gram = inner[:k, :k]
            precision = gram + np.diag(weak)
            step = constrained_minima(precision, inner[:k, k] + gram @ u, positive)[0] - u
            short = float(step @ precision @ step)
            if short < _CONVERGED:
                break
            for damping in _DAMPING:
                trial = _bounded(candidates, u + damping * step)
                try:
                    moved = self._linearized(candidates, trial)
                except (InputError, np.linalg.LinAlgError):
                    continue
                after = inner_of(*moved)
                lower = float(after[k, k] + trial**2 @ weak)
                if lower < cost or np.isclose(lower, cost, rtol=1e-9):
                    break
            else:
                break
            gained = cost - lower
            u, cost, inner, (residual, slopes) = trial, lower, after, moved
            if gained < _CONVERGED and damping == _DAMPING[0]:
                short = 0.0
                break
        return u, residual, slopes, short

    def _start(self, candidates: Sequence[Candidate], u: Array, safe: Array) -> tuple[Array, tuple[Array, Array]]:
        """Internal parameters as near to a start as the model can be assembled, from a safe point on."""
        for tried in (*(safe + share * (u - safe) for share in (1.0, 0.25, 0.0625)), safe):
            try:
                return tried, self._linearized(candidates, tried)
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

    @cached_property
    def nominal(self) -> Library:
        """Derivatives of all effects about the model as it is."""
        return self._library(self.model.predict())

    def _library(self, prediction: Prediction) -> Library:
        candidates = tuple(self.model.library)
        parts = [prediction.columns(c) if c.scale else prediction.step(c)[:, None] for c in candidates]
        ends = np.cumsum([0, *(part.shape[1] for part in parts)])
        where = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
        values = np.hstack([np.zeros((len(self.noise.sigma), 0)), *parts]) / self.noise.sigma[:, None]
        values = np.where(np.isfinite(values), values, 0.0)
        projection = self.errors.project(values)
        parts = (_cut(projection, here) for here in where)
        return Library(candidates, where, values, projection, tuple(self.errors.inner(p, p) for p in parts))

    def _library_at(self, hypothesis: Hypothesis) -> Library:
        """Derivatives about a hypothesis: the nominal ones where its prediction is nearly linear in its parameters."""
        known = {id(c): here for c, here in zip(self.nominal.candidates, self.nominal.columns, strict=True)}
        moved = self._nominal_residual - hypothesis.residual
        linear = np.zeros(len(moved))
        for candidate, values in hypothesis.parameters:
            columns = self.nominal.values[:, known[id(candidate)]]
            linear = linear + columns @ (np.array(values) if values else np.ones(1))
        used = self.noise.used
        if np.linalg.norm((moved - linear)[used]) <= CURVED * np.linalg.norm(moved[used]):
            return self.nominal
        return self._library(self.model.predict(hypothesis.parameters))

    @cached_property
    def _nominal_residual(self) -> Array:
        return (self.model.campaign.value - self.model.predict().values) / self.noise.sigma

    def search(self, progress: Progress | None = None) -> list[Hypothesis]:
        """Fitted hypotheses, the best first: none, single effects, and larger sets as long as they gain."""
        none = self.fit((), np.zeros(0))
        fitted = _Fitted(self, {(): none}, progress)
        fit, found = fitted.fit, fitted.found
        tried = [Start(c, np.zeros(len(_scale(c))), np.zeros(len(_scale(c)))) for c in self.model.tried]
        fit(tried, _heights([none]), "effects", len(tried))
        frontier = [none]
        for _ in range(ROUNDS):
            before = _heights(frontier)
            while len(frontier[0].candidates) < self.model.most_effects:
                stage = f"effects, {len(frontier[0].candidates) + 1} at once"
                base, starts = _heights(frontier), self._extensions(frontier)
                most = FITTED if frontier[0].names else 2 * FITTED
                fits = fit(starts, base, stage, most)
                fits += fit(sorted(starts, key=lambda s: -s.heights[1]), base, stage, FITTED_PLAIN)
                fits = sorted({id(h): h for h in fits}.values(), key=lambda h: -h.evidence)
                if not fits or all(now < then + GAIN for now, then in zip(_heights(fits), before, strict=True)):
                    break
                before = tuple(max(pair) for pair in zip(_heights(fits), before, strict=True))
                plain = sorted(fits, key=lambda h: -h.plain)[:BEAM_PLAIN]
                frontier = [*fits[:BEAM_WIDTH], *(h for h in plain if h not in fits[:BEAM_WIDTH])]
            best = max(found.values(), key=lambda h: h.evidence)
            starts = self._exchanges(best)
            exchanged = fit(starts, _heights([best]), "effects exchanged", len(starts))
            if not exchanged or exchanged[0].evidence < best.evidence + GAIN:
                break
            frontier = exchanged[:1]
        return sorted(found.values(), key=lambda h: -h.evidence)

    def _exchanges(self, best: Hypothesis) -> list[Start]:
        """The best set without each of its effects, and with another in its place, where that may compete."""
        library = self._library_at(best)
        starts: list[Start] = []
        for gone in best.candidates:
            rest = self._without(best, gone)
            limit = best.evidence - MARGIN - DOUBT * (best.evidence - rest.evidence)
            scored = [
                start
                for start in self._scored(rest, library)
                if not start.candidates[-1].unnamed and start.candidates[-1] is not gone and start.heights[0] > limit
            ]
            starts += sorted(scored, key=lambda start: -start.heights[0])[:SWAPPED]
            if rest.evidence > best.evidence - MARGIN:
                origin = _joined(v for c, v in best.parameters if c is not gone)
                starts.append(Start(rest.candidates, _bounded(rest.candidates, rest.known.mean), origin))
        return starts

    def _without(self, hypothesis: Hypothesis, gone: Candidate) -> Hypothesis:
        """A hypothesis without one of its effects, to first order about it."""
        keep = np.repeat([c is not gone for c in hypothesis.candidates], [len(v) for _, v in hypothesis.parameters])
        slopes, y = hypothesis.slopes[:, keep.astype(np.bool_)], hypothesis.linear
        candidates = tuple(c for c in hypothesis.candidates if c is not gone)
        if not gone.scale:
            others = tuple((c, v) for c, v in hypothesis.parameters if c is not gone)
            before = (self.model.campaign.value - self.model.predict(others).values) / self.noise.sigma
            y = y + before - hypothesis.residual
        known = self.posterior(candidates, y, slopes)
        log = known.log_evidence + self.log_prior(candidates)
        parameters = _split(candidates, known.mean)
        return Hypothesis(parameters, y - slopes @ known.mean, slopes, log, known, converged=False)

    def _extensions(self, frontier: Sequence[Hypothesis]) -> list[Start]:
        """The most promising sets of one effect more, by their evidence to first order, each with a start."""
        ranked: dict[tuple[str, ...], Start] = {}
        derivatives = self._library_at(frontier[0])
        for hypothesis in frontier:
            for start in self._scored(hypothesis, derivatives):
                key = _key(start.candidates)
                if key not in ranked or start.heights[1] > ranked[key].heights[1]:
                    ranked[key] = start
        return sorted(ranked.values(), key=lambda start: -start.heights[0])

    def _scored(self, hypothesis: Hypothesis, library: Library) -> Iterable[Start]:
        """A hypothesis with every admitted effect more, to first order."""
        k, known_good = len(hypothesis.values), _bounded(hypothesis.candidates, hypothesis.values)
        own = self.errors.project(np.column_stack([hypothesis.slopes, hypothesis.linear]))
        inner = self.errors.inner(own, own)  # (q, k+1, k+1)
        across = self.errors.inner(library.projection, own)  # (q, c, k+1)
        without = self.errors.sizes == 0.0
        alike: dict[tuple[int, bool], list[int]] = {}
        for number, candidate in enumerate(library.candidates):
            if self.model.admits((*hypothesis.candidates, candidate)):
                alike.setdefault((len(candidate.scale), candidate.positive), []).append(number)
        base = hypothesis.known.sizes * _scale(hypothesis.candidates)
        prior = hypothesis.known.averaging + self.log_prior(hypothesis.candidates)
        for (m, bounded), numbers in alike.items():
            shape = (len(numbers), len(self.errors.sizes))
            grams, pulls = np.empty((*shape, k + m, k + m)), np.empty((*shape, k + m))
            grams[..., :k, :k], pulls[..., :k] = inner[:, :k, :k], inner[:, :k, k]
            totals = np.tile(inner[:, k, k], (len(numbers), 1))
            for at, number in enumerate(numbers):
                mixed, block = across[:, library.columns[number]], library.blocks[number]
                if m:
                    grams[at, :, k:, :k], grams[at, :, :k, k:] = mixed[..., :k], np.swapaxes(mixed[..., :k], 1, 2)
                    grams[at, :, k:, k:], pulls[at, :, k:] = block, mixed[..., k]
                else:
                    pulls[at] -= mixed[:, 0, :k]
                    totals[at] += block[:, 0, 0] - 2.0 * mixed[:, 0, k]
            scales = np.empty((len(numbers), len(self.sizes) if m else 1, k + m))
            scales[..., :k] = base
            for at, number in enumerate(numbers):
                scales[at, :, k:] = self.sizes[: scales.shape[1], None] * np.array(library.candidates[number].scale)
            positive = np.concatenate([_positive(hypothesis.candidates), np.full(m, bounded)])
            logs, means, _ = log_evidences(grams, pulls, totals, self.errors.log_weight, scales, positive)
            for number, log, mean in zip(numbers, logs, means, strict=True):
                candidate = library.candidates[number]
                best = np.unravel_index(np.argmax(log), log.shape)
                odds = prior + self.log_prior([candidate]) - float(np.log(log.shape[1]))
                total, plain = (float(np.logaddexp.reduce(part.ravel())) for part in (log, log[without]))
                candidates = (*hypothesis.candidates, candidate)
                heights = (total + odds, plain + odds)
                yield Start(candidates, _bounded(candidates, mean[best]), np.append(known_good, np.zeros(m)), heights)


@dataclass(frozen=True)
class _Fitted:
    """Hypotheses that a search has fitted so far."""

    problem: Problem
    found: dict[tuple[str, ...], Hypothesis]
    progress: Progress | None

    def fit(self, starts: Sequence[Start], base: tuple[float, float], stage: str, most: int) -> list[Hypothesis]:
        """Fit what promises to compete with the best that was fitted, in the order of promise."""
        fits: list[Hypothesis] = []
        strikes: dict[int, int] = {}
        for start in starts:
            if len(fits) >= most:
                break
            if len(fits) >= LEAST_FITTED and all(map(_hopeless, start.heights, _heights(fits), base)):
                continue
            if any(strikes.get(id(c), 0) >= STRIKES for c in start.candidates):
                continue
            if self.progress:
                self.progress(stage, len(fits) / most)
            key = _key(start.candidates)
            if key not in self.found or not self.found[key].converged:
                target = max((h.plain for h in fits), default=-np.inf)
                self.found[key] = self.problem.fit(start.candidates, start.values, target, start.origin)
            if self.found[key].stuck:
                strikes.update({id(c): strikes.get(id(c), 0) + 1 for c in start.candidates if c.flexible})
            fits.append(self.found[key])
        return sorted(fits, key=lambda h: -h.evidence)


def _heights(fits: Sequence[Hypothesis]) -> tuple[float, float]:
    """The best evidence, and the best without a discrepancy."""
    return max(h.evidence for h in fits), max(h.plain for h in fits)


def _hopeless(promised: float, best: float, base: float) -> bool:
    """Whether a set is too far behind the best that was fitted, of which first order may miss a share of the gain."""
    return promised < best - max(MARGIN, DOUBT * (best - base))


def _key(candidates: Sequence[Candidate]) -> tuple[str, ...]:
    """What tells sets of effects apart: some effects come with fewer or more parameters."""
    return tuple(sorted(f"{c.name} {len(c.scale)}" for c in candidates))


def _cut(projection: Projection, columns: slice) -> Projection:
    return type(projection)(*(part[:, columns] for part in (projection.stated, projection.scaled, projection.features)))


def _scale(candidates: Sequence[Candidate]) -> Array:
    """Prior sizes (k,) of the internal parameters of effects."""
    return _joined(c.scale for c in candidates)


def _owner(candidates: Sequence[Candidate]) -> Codes:
    """Number (k,) of the effect that each internal parameter belongs to, counting those that have any."""
    counts = [len(c.scale) for c in candidates if c.scale]
    return np.repeat(np.arange(len(counts)), counts).astype(np.int64)


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

"""Nonlinear fits of sets of effects, and the prior of such sets."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.effects.vocabulary import word_of
from stiffscope.gap.forward.forward_model import join_columns
from stiffscope.gap.inference.evidence import (
    constrained_minima,
    errors_of,
    log_sum,
    posterior,
)
from stiffscope.gap.inference.hypothesis import (
    Hypothesis,
    at_bounds,
    bound_parameters,
    join_values,
    minimize_bounded,
    positive_of,
    split,
)
from stiffscope.gap.inference.library import Library
from stiffscope.gap.inference.plausibility import find_plausible, implausible
from stiffscope.gap.inference.priors import choose_near, spread_groups, spread_priors
from stiffscope.gap.inference.settings import FIT, PLAUSIBLE

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stiffscope.gap.forward.forward_model import (
        Candidate,
        ForwardModel,
        Noise,
        Prediction,
    )
    from stiffscope.gap.inference.evidence import Errors, Posterior
    from stiffscope.gap.inference.priors import Spreads
    from stiffscope.runtime.types import Array

    Effects = Sequence[Candidate]


_UNASSEMBLABLE = "a parameter is outside the assemblable range"


@dataclass(frozen=True)
class _Point:
    """A prediction linearized about internal parameters (k,)."""

    u: Array
    residual: Array
    """Measured minus predicted readings (n,), over sigma."""
    slopes: Array
    """Derivatives (n, k), over sigma."""
    short: float = 0.0
    """Excess of the cost over its linear prediction, which is no evidence if a fit ends at the
    limit of the assemblable range."""
    hopeless: bool = False
    """Whether the fit was given up, as its prediction falls ever further behind."""

    @property
    def linear(self) -> Array:
        """Readings (n,) minus the prediction extrapolated to internal parameters of zero."""
        return self.residual + self.slopes @ self.u


def _is_hopeless(expected: Sequence[float], spare: float) -> bool:
    """Return whether a fit ends too far behind, by the costs that each linearization expects.

    The last one errs by no more than it differs from the one before.
    """
    if len(expected) < 2:
        return False
    lost = 0.5 * (expected[-1] - expected[0])
    return lost - 0.5 * abs(expected[-1] - expected[-2]) > spare


@dataclass(frozen=True)
class _Quadratic:
    """Quadratic approximation of the cost about u (k,), least at ``end`` (k,) within bounds."""

    u: Array
    precision: Array
    pull: Array
    end: Array

    def find_end(self, candidates: Effects, damping: float) -> Array:
        """Return where (k,) a step ends; weakly determined directions are shortened first.

        damping: of the diagonal of the precision, added to it for distances from u.
        """
        if not damping:
            return self.u + (self.end - self.u)
        more = damping * np.diagonal(self.precision)
        held = self.precision + np.diag(more)
        drawn = self.pull + more * self.u
        whole = constrained_minima(held, drawn, positive_of(candidates))[0]
        return minimize_bounded(candidates, held, drawn, whole)


@dataclass(frozen=True)
class _Step:
    """A step to u (k,), with what is predicted there, and the notch of its damping."""

    u: Array
    prediction: Prediction
    residual: Array
    cost: float
    notch: int


@dataclass(frozen=True)
class Problem:
    """A forward model with its noise and the prior of sets of effects."""

    model: ForwardModel
    noise: Noise
    odds: float = FIT.odds
    widening: float = 1.0
    """Factor on all prior sizes."""
    sizes: Array = field(default_factory=lambda: np.array(FIT.sizes))
    """Prior sizes (s,) of effects in their own units, on a geometric grid."""
    even: bool = False
    """Whether all effects have the same odds, independent of the number of places."""

    @cached_property
    def _known(self) -> list[Candidate]:
        """All known effects at all places, with their twins."""
        known = (c for c in self.model.library if not c.is_nuisance)
        return [each for c in known for each in (c, *(twin for twin, _ in c.twins))]

    @cached_property
    def _place_counts(self) -> Counter[str]:
        """Number of places of each effect of the vocabulary."""
        return Counter(word_of(name) for name in {c.name for c in self._known})

    @cached_property
    def causes(self) -> dict[str, str]:
        """Cause that each name means: the name of an effect at a place with the fewest parameters."""
        known: dict[str, str] = {}
        for c in sorted(self._known, key=lambda c: len(c.scale)):
            name = known.setdefault(c.name, c.name)
            for alias in c.aliases:
                known.setdefault(alias, name)
        return known

    def find_cause(self, name: str) -> str:
        """Return the cause that a name means, or a name itself that no effect bears."""
        return self.causes.get(name, name)

    @cached_property
    def _form_counts(self) -> Counter[str]:
        """Number of forms of each cause: a part's factor and its matrix are two."""
        return Counter(
            self.find_cause(name)
            for name, _ in {(c.name, c.flexible) for c in self._known}
        )

    @cached_property
    def _unknown(self) -> Counter[str]:
        """Number of places of each kind of nuisance pattern, including the discrepancy."""
        return Counter(["", *(c.pattern for c in self.model.library if c.is_nuisance)])

    def odds_of(self, candidate: Candidate) -> Array:
        """Return prior odds (t,) of an effect and its twins, equal for effects and their places.

        Forms of one cause share them, whatever they are called. Guesses are expected to differ.
        """
        if candidate.is_nuisance:
            return np.array([self._odds_of_pattern(candidate.pattern)])
        if candidate.guessed:
            odds = FIT.guessed * self.odds / FIT.odds
            return np.full(len(candidate.signature_of), odds)
        counts = self._place_counts
        words = map(word_of, candidate.signature_of)
        places = np.array([max(counts[word], 1) for word in words], dtype=float)
        places[:] = counts.total() / len(counts) if self.even else places
        places *= [
            max(self._form_counts[self.find_cause(name)], 1)
            for name in candidate.signature_of
        ]
        return candidate.odds * self.odds / len(counts) / places

    def weigh_twins(self, candidate: Candidate, hypothesis: Hypothesis) -> Array:
        """Return odds (t,) of an effect and its twins, given the parameters of a hypothesis.

        Relative to `odds_of`, a twin that must have a less usual size is less likely.
        """
        odds = self.odds_of(candidate)
        for k, (other, rate) in enumerate(((candidate, 1.0), *candidate.twins)):
            if not other.is_nuisance and implausible(
                candidate, hypothesis, other, rate
            ):
                odds[k] *= FIT.strange
            if k > 0:
                (value,) = hypothesis.values[hypothesis.mark(lambda c: c is candidate)]
                ahead = self._log_density(other, rate * value) - self._log_density(
                    candidate, value
                )
                odds[k] *= abs(rate) * np.exp(ahead)
        return odds

    def _log_density(self, candidate: Candidate, value: float) -> float:
        """Return the ln prior density of the only internal parameter of a candidate."""
        (prior,) = self.spreads_of(candidate)
        scale = prior.scales[:, 0]
        return float(
            log_sum(prior.log_weight - np.log(scale) - 0.5 * (value / scale) ** 2)
        )

    def _odds_of_pattern(self, pattern: str) -> float:
        return (
            FIT.unknown
            * self.odds
            / len(self._unknown)
            / max(self._unknown[pattern], 1)
        )

    @cached_property
    def errors(self) -> Errors:
        """Distribution of readings about a hypothesis; a discrepancy counts as a pattern."""
        return errors_of(
            self.model.campaign, self.noise, float(np.log(self._odds_of_pattern("")))
        )

    def spreads_of(self, candidate: Candidate) -> list[Spreads]:
        """Return the prior of each group of a candidate's parameters that shares a size."""
        if id(candidate) not in self._spreads:
            (unit, sizes) = self._scales_of(candidate)
            positive = positive_of([candidate])
            found = spread_groups(unit, positive, candidate.groups, sizes)
            self._spreads[id(candidate)] = candidate, found
        return self._spreads[id(candidate)][1]

    def rough_spreads_of(self, candidate: Candidate) -> Spreads:
        """Return a coarser prior for scoring: a common size, half the grid and no subsets."""
        unit, sizes = self._scales_of(candidate)
        return spread_priors(unit, np.zeros(len(unit), dtype=np.bool_), sizes[::2])

    def _scales_of(self, candidate: Candidate) -> tuple[Array, Array]:
        """Return a candidate's units (k,) and sizes (s,); all sizes are one if stated."""
        unit = np.array(candidate.scale)
        ones = np.ones(len(self.sizes))
        return (unit, ones) if candidate.stated else (self.widening * unit, self.sizes)

    @cached_property
    def _spreads(self) -> dict[int, tuple[Candidate, list[Spreads]]]:
        return {}

    def log_prior(self, candidates: Effects) -> float:
        """Return the ln prior odds of a set of effects against none."""
        return float(sum(np.log(self.odds_of(c).sum()) for c in candidates))

    def log_odds(self, hypothesis: Hypothesis) -> float:
        """Return the ln prior odds of a hypothesis, including those of the sizes found."""
        odds = (self.weigh_twins(c, hypothesis) for c in hypothesis.candidates)
        return float(sum(np.log(each.sum()) for each in odds))

    def posterior(
        self, candidates: Effects, y: Array, x: Array, near: Array | None = None
    ) -> Posterior:
        """Return the posterior of u in ``y = X u + errors``, without prior odds of the set.

        near: prior scales (k,) to which the search is restricted.
        """
        priors = [
            spread for c in candidates if c.scale for spread in self.spreads_of(c)
        ]
        return posterior(
            self.errors, y, x, choose_near(priors, near), positive_of(candidates)
        )

    def reweigh(self, hypothesis: Hypothesis) -> float:
        """Return ln of evidence times prior odds of a hypothesis fitted under another prior."""
        near = hypothesis.known.scales if hypothesis.local else None
        known = self.posterior(
            hypothesis.candidates, hypothesis.linear, hypothesis.slopes, near
        )
        return known.log_evidence - 0.5 * hypothesis.short + self.log_odds(hypothesis)

    def fit(
        self,
        candidates: Effects,
        start: Array,
        target: float = -np.inf,
        origin: Array | None = None,
    ) -> Hypothesis:
        """Fit effects by damped Gauss-Newton, with the widest prior first, then the likeliest.

        Parameters
        ----------
        candidates
            The effects.
        start, origin
            Internal parameters (k,) at which the fit starts, and those used if that start fails
            (default: zero).
        target
            Ln of evidence times prior; a fit of several effects is abandoned if it starts far off.
            A single one may far exceed its first-order score, e.g. a compliant foundation.
        """
        safe = np.zeros(len(start)) if origin is None else origin
        at = self._start(candidates, start, safe)
        known = self.posterior(candidates, at.linear, at.slopes)
        log = known.log_evidence + self.log_prior(candidates)
        least = target - FIT.margin - FIT.doubt * abs(log - self._nominal_evidence)
        far = len(start) > 0 and len(candidates) > 1 and log < least
        if far or not len(start):
            return self._leave(candidates, at, known, converged=not far)
        spare = log - target + FIT.margin if len(candidates) > 1 else np.inf
        setting = int(np.argmax(known.settings))
        scales = join_values(
            sizes[-1] * unit for unit, sizes in map(self._scales_of, candidates)
        )
        many = np.repeat(
            [bool(c.parts) for c in candidates], [len(c.scale) for c in candidates]
        )
        scales = np.where(many, known.scales, scales)  # not all errors are observable
        at = self._descend(candidates, at, setting, scales, spare)
        if at.hopeless:
            known = self.posterior(candidates, at.linear, at.slopes)
            return self._leave(candidates, at, known, converged=False)
        if at.short > FIT.margin and not at_bounds(candidates, at.u).any():
            again = self._descend(
                candidates, self._start(candidates, safe, safe), setting, scales
            )
            at = again if again.short < at.short else at
        known = self.posterior(candidates, at.linear, at.slopes)
        states = [(at, scales)]
        seen = [(setting, np.log(scales))]
        for _ in range(
            FIT.repeated
        ):  # what the start left may have looked like a larger discrepancy
            setting = int(np.argmax(known.settings))
            scales = known.scales
            here = np.log(scales)
            behind = (
                known.log_evidence + self.log_prior(candidates) < target - FIT.margin
            )
            alike = (sizes for before, sizes in seen if before == setting)
            if behind or any(np.abs(sizes - here).max() < FIT.alike for sizes in alike):
                break
            seen.append((setting, here))
            at = self._descend(candidates, at, setting, scales)
            states.append((at, scales))
            known = self.posterior(candidates, at.linear, at.slopes)
        local = self._find_distance(known, at) > FIT.far
        if local:  # the linearization is not valid at such distant prior sizes
            tried = [
                (self.posterior(candidates, p.linear, p.slopes, near), p)
                for p, near in states
            ]
            known, at = max(
                tried, key=lambda item: item[0].log_evidence - 0.5 * item[1].short
            )
        log = known.log_evidence - 0.5 * at.short
        whole = split(candidates, at.u), at.residual, at.slopes, log, known
        found = Hypothesis(*whole, short=at.short, local=local)
        near = find_plausible(found)
        if near:
            found = self._move(found, near[0])
            log = log - near[1]
        return replace(found, evidence=log + self.log_odds(found))

    def _leave(
        self, candidates: Effects, at: _Point, known: Posterior, *, converged: bool
    ) -> Hypothesis:
        """Return a hypothesis at the point where its fit is left."""
        log = known.log_evidence + self.log_prior(candidates)
        own = split(candidates, at.u)
        return Hypothesis(own, at.residual, at.slopes, log, known, converged=converged)

    def _move(self, hypothesis: Hypothesis, u: Array) -> Hypothesis:
        """Return a hypothesis at other internal parameters (k,), where it is as linear as they were chosen by."""
        try:
            at = self._linearize(hypothesis.candidates, u)
        except (InputError, np.linalg.LinAlgError):
            return hypothesis
        setting = int(np.argmax(hypothesis.known.settings))
        both = (hypothesis.residual, at.residual)
        before, after = (
            float(self.errors.inner_at(setting, each[:, None])[0, 0]) for each in both
        )
        if after > before + PLAUSIBLE.significant**2:
            return hypothesis
        return replace(
            hypothesis,
            parameters=split(hypothesis.candidates, u),
            residual=at.residual,
            slopes=at.slopes,
        )

    def _find_distance(self, known: Posterior, at: _Point) -> float:
        """Return the squared distance, in sigmas, of a posterior mean from its linearization."""
        gram = self.errors.inner_at(int(np.argmax(known.settings)), at.slopes)
        away = known.mean - at.u
        return float(away @ (gram + np.diag(known.scales**-2.0)) @ away)

    @cached_property
    def _nominal_evidence(self) -> float:
        none = np.zeros((len(self.noise.sigma), 0))
        return self.posterior((), self.nominal_residual, none).log_evidence

    def _descend(
        self,
        candidates: Effects,
        at: _Point,
        setting: int,
        scales: Array,
        spare: float = np.inf,
    ) -> _Point:
        """Take steps of Levenberg and Marquardt in one setting of the errors.

        Parameters
        ----------
        candidates, at
            The effects, and where the descent starts.
        setting
            Number of the setting of the errors.
        scales
            Prior scales (k,).
        spare
            Ln of evidence that the prediction at the start may lose before the fit is given up.
        """
        prior = scales**-2.0
        positive = positive_of(candidates)
        k = len(at.u)

        def find_cost(u: Array, residual: Array) -> float:
            fit = self.errors.inner_at(setting, residual[:, None])[0, 0]
            return float(fit + u**2 @ prior)

        cost = find_cost(at.u, at.residual)
        expected: list[float] = []
        least = 0
        for _ in range(FIT.steps):
            columns = np.column_stack([at.slopes, at.residual])
            inner = self.errors.inner_at(setting, columns)
            gram = inner[:k, :k]
            # prior and noise may differ by more
            rounding = FIT.rounding * np.diagonal(gram)
            precision = gram + np.diag(prior + rounding)
            pull = inner[:k, k] + gram @ at.u
            whole = constrained_minima(precision, pull, positive)[0]
            at = replace(at, short=float((whole - at.u) @ precision @ (whole - at.u)))
            end = minimize_bounded(candidates, precision, pull, whole)
            near = float((end - at.u) @ precision @ (end - at.u))
            expected.append(cost - near)
            if near < FIT.converged:
                break
            if _is_hopeless(expected, spare):
                return replace(at, hopeless=True)
            notches = range(least, len(FIT.damping))
            step = self._take_step(
                candidates,
                _Quadratic(at.u, precision, pull, end),
                notches if near > FIT.slight else notches[:2],
                find_cost,
                cost,
            )
            if step is None:
                break
            gained = cost - step.cost
            before = at
            try:
                slopes = self._differentiate(candidates, step.prediction)
            except InputError:
                break
            cost = step.cost
            at = _Point(step.u, step.residual, slopes, before.short)
            if step.notch and gained < FIT.slight:
                break
            if not step.notch and (gained < FIT.converged or near < FIT.settled):
                is_whole = np.array_equal(step.u, before.u + (whole - before.u))
                return replace(at, short=0.0) if is_whole else at
            least = max(step.notch - 1, 0)
        return at

    def _take_step(
        self,
        candidates: Effects,
        quadratic: _Quadratic,
        notches: Sequence[int],
        find_cost: Callable[[Array, Array], float],
        cost: float,
    ) -> _Step | None:
        """Return the least damped step that does not raise the cost; None if all do."""
        for notch in notches:
            u = bound_parameters(
                candidates, quadratic.find_end(candidates, FIT.damping[notch])
            )
            try:
                prediction, residual = self._evaluate(candidates, u)
            except (InputError, np.linalg.LinAlgError):
                continue
            lower = find_cost(u, residual)
            if lower < cost or np.isclose(lower, cost, rtol=1e-9):
                return _Step(u, prediction, residual, lower, notch)
        return None

    def _start(self, candidates: Effects, u: Array, safe: Array) -> _Point:
        """Return the assemblable point nearest to a start, on the way from a safe one."""
        for tried in (
            *(safe + share * (u - safe) for share in (1.0, 0.25, 0.0625)),
            safe,
        ):
            try:
                return self._linearize(candidates, tried)
            except (InputError, np.linalg.LinAlgError):
                continue
        return self._linearize(candidates, 0.0 * u)

    def _linearize(self, candidates: Effects, u: Array) -> _Point:
        """Return the linearization about parameters (k,). Raises InputError if not finite."""
        prediction, residual = self._evaluate(candidates, u)
        return _Point(u, residual, self._differentiate(candidates, prediction))

    def find_residual(self, prediction: Prediction) -> Array:
        """Return the residual (n,) of a prediction, over sigma."""
        return (self.model.campaign.value - prediction.values) / self.noise.sigma

    def measure_rest(self, residual: Array) -> float:
        """Return χ² per used reading of a residual (n,) over sigma."""
        return float(np.mean(residual[self.noise.used] ** 2))

    def _evaluate(self, candidates: Effects, u: Array) -> tuple[Prediction, Array]:
        """Return prediction and residual (n,) over sigma. Raises InputError if not finite."""
        prediction = self.model.predict(split(candidates, u))
        residual = self.find_residual(prediction)
        if not np.isfinite(residual).all():
            raise InputError(_UNASSEMBLABLE)
        return prediction, residual

    def _differentiate(self, candidates: Effects, prediction: Prediction) -> Array:
        """Return derivatives (n, k) over sigma. Raises InputError if not finite."""
        slopes = join_columns(prediction, candidates) / self.noise.sigma[:, None]
        if not np.isfinite(slopes).all():
            raise InputError(_UNASSEMBLABLE)
        return slopes

    @cached_property
    def nominal(self) -> Library:
        """Derivatives of all effects about the nominal model."""
        return Library.of(
            self.model.library, self.model.predict(), self.noise.sigma, self.errors
        )

    def library_at(self, hypothesis: Hypothesis) -> Library:
        """Return derivatives about a hypothesis, or the nominal ones if it is nearly linear."""
        moved = self.nominal_residual - hypothesis.residual
        linear = np.zeros(len(moved))
        for candidate, values in hypothesis.parameters:
            linear = linear + self.nominal.differentiate(candidate) @ np.array(
                values or (1.0,)
            )
        error, change = (
            np.linalg.norm(each[self.noise.used]) for each in (moved - linear, moved)
        )
        fixed = any(
            not c.scale for c in hypothesis.candidates
        )  # a unit also changes derivatives
        if not fixed and error <= FIT.curved * change:
            return self.nominal
        prediction = self.model.predict(hypothesis.parameters)
        return Library.of(self.model.library, prediction, self.noise.sigma, self.errors)

    @cached_property
    def nominal_residual(self) -> Array:
        """Residual (n,) without effects in units of sigma."""
        return self.find_residual(self.model.predict())

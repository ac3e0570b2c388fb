"""Which effects explain a campaign: nonlinear fits, evidence, and the search over sets of effects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.effects import UNKNOWN
from stiffscope.gap.vocabulary import STIFFNESS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.effects import Effect
    from stiffscope.gap.noise import Data
    from stiffscope.gap.state import Bench, Setting

    Array = NDArray[np.floating[Any]]
    Flags = NDArray[np.bool_]

SIZES = np.geomspace(0.03, 10.0, 6)  # multiples of a parameter's prior size, equally likely
PRIOR_EFFECT = 0.5  # prior odds of one effect more, shared by all that it could be
WIDTH = 6  # hypotheses that are carried on to one effect more
SWAPPED = 4  # others that are fitted in the place of each effect of the best set
TRIED = 10  # nonlinear fits at every level
LEVELS = 3  # effects at once
UNNAMED = 3.0  # ln-odds by which a pattern without a name stands behind a word of the vocabulary
ENOUGH = 1.0  # ln-odds that one effect more must gain for the search to go on


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects, fitted: residual (n,) measured minus model in sigmas, derivatives (n, k), evidence."""

    setting: Setting
    residual: Array
    slopes: Array
    evidence: float
    chi2: float
    covariance: Array

    @property
    def names(self) -> frozenset[str]:
        """Effects in it, as `effect @ place`."""
        return frozenset(effect.name for effect, _ in self.setting)

    @property
    def inner(self) -> Array:
        """All inner parameters (k,)."""
        return np.concatenate([np.zeros(0), *(np.array(values) for _, values in self.setting)])


def log_prior(setting: Setting, count: int) -> float:
    """Ln prior odds of a set of effects against none, of ``count`` that could be; patterns without a name come last."""
    return sum(_log_prior_of(effect, count) for effect, _ in setting)


def _log_prior_of(effect: Effect, count: int) -> float:
    return float(np.log(PRIOR_EFFECT / count)) - (UNNAMED if effect.effect == UNKNOWN else 0.0)


def evidence(y: Array, x: Array, prior: Array, positive: Flags) -> tuple[float, Array, Array]:
    """Ln evidence of y = X u + unit noise with u ~ N(0, (m prior)²), averaged over m; and the posterior of u.

    ``positive`` (k,): parameters that cannot be negative; their prior is the half above zero. The density of the noise
    itself is left out: it is the same for all hypotheses. Laplace's approximation at the constrained optimum.
    """
    gram, pull, total = x.T @ x, x.T @ y, float(y @ y)
    if not len(prior):
        return -0.5 * total, np.zeros(0), np.zeros((0, 0))
    logs: list[float] = []
    posteriors: list[tuple[Array, Array]] = []
    for size in SIZES:
        scale = size * prior
        core = scale[:, None] * gram * scale[None, :]
        core += np.eye(len(prior)) * (1.0 + 1e-12 * float(np.trace(core)))
        factor = cast("Array", np.linalg.cholesky(core))
        unit, free = constrained(core, scale * pull, positive)
        fit = 2.0 * float(unit @ (scale * pull)) - float(unit @ core @ unit)
        halves = float(np.log(2.0)) * int((positive & free).sum())
        pivots = np.diagonal(factor)
        logs.append(-0.5 * (total - fit) - float(np.log(pivots).sum()) + halves)
        inverse = cast("Array", np.linalg.inv(core))
        posteriors.append((scale * unit, scale[:, None] * inverse * scale[None, :]))
    log = np.array(logs)
    highest = float(log.max())
    return highest + float(np.log(np.exp(log - highest).sum() / len(SIZES))), *posteriors[int(log.argmax())]


def constrained(matrix: Array, pull: Array, positive: Flags) -> tuple[Array, Flags]:
    """Minimum of ``½ uᵀ A u - bᵀ u`` with some u ≥ 0, the most negative dropped one at a time; and which are free."""
    free = np.ones(len(pull), dtype=np.bool_)
    u = np.zeros(len(pull))
    while free.any():
        u = np.zeros(len(pull))
        u[free] = np.linalg.solve(matrix[np.ix_(free, free)], pull[free])
        wrong = np.where(positive & free, u * np.sqrt(np.diagonal(matrix)), 0.0)
        if wrong.min() >= 0.0:
            break
        free[int(np.argmin(wrong))] = False
        u[~free] = 0.0
    return u, free


def fitted(
    bench: Bench, data: Data, effects: Sequence[tuple[Effect, Array]], count: int, steps: int = 12
) -> Hypothesis:
    """Fit effects, from these inner parameters on, by damped Gauss-Newton with a weak prior."""
    prior = np.concatenate([np.zeros(0), *(np.array(e.scale) for e, _ in effects)])
    u = np.concatenate([np.zeros(0), *(np.asarray(v, dtype=np.float64) for _, v in effects)])
    positive = _positive([e for e, _ in effects])
    u, (residual, slopes) = _start(bench, data, effects, u)
    cost = _cost(residual, data, u, prior)
    for _ in range(steps if len(u) else 0):
        x, y = slopes[data.good], residual[data.good]
        weak = 1.0 / (SIZES[-1] * prior) ** 2
        gram = x.T @ x + np.diag(weak)
        step = constrained(gram, x.T @ y + x.T @ (x @ u), positive)[0] - u
        for damping in (1.0, 0.5, 0.25, 0.1, 0.02):
            trial = _bounded(effects, u + damping * step)
            try:
                moved = _linearized(bench, data, _split(effects, trial))
            except (InputError, np.linalg.LinAlgError):
                continue
            lower = _cost(moved[0], data, trial, prior)
            if lower < cost or np.isclose(lower, cost, rtol=1e-9):
                break
        else:
            break
        gained = cost - lower
        u, cost, (residual, slopes) = trial, lower, moved
        if gained < 1e-3:
            break
    setting = _split(effects, u)
    return weighed(Hypothesis(setting, residual, slopes, 0.0, 0.0, np.zeros((len(u), len(u)))), data, count)


def _start(
    bench: Bench, data: Data, effects: Sequence[tuple[Effect, Array]], u: Array
) -> tuple[Array, tuple[Array, Array]]:
    """The first of u, u/4, u/16 and nothing at which the robot stands."""
    for share in (1.0, 0.25, 0.0625):
        try:
            return share * u, _linearized(bench, data, _split(effects, share * u))
        except (InputError, np.linalg.LinAlgError):
            continue
    return 0.0 * u, _linearized(bench, data, _split(effects, 0.0 * u))


def weighed(hypothesis: Hypothesis, data: Data, count: int) -> Hypothesis:
    """The hypothesis with its evidence (prior odds included), χ² and covariance on the good readings."""
    prior = np.concatenate([np.zeros(0), *(np.array(e.scale) for e, _ in hypothesis.setting)])
    x, r = hypothesis.slopes[data.good], hypothesis.residual[data.good]
    positive = _positive([e for e, _ in hypothesis.setting])
    log, _, covariance = evidence(r + x @ hypothesis.inner, x, prior, positive)
    log += log_prior(hypothesis.setting, count)
    return replace(hypothesis, evidence=log, chi2=float(r @ r), covariance=covariance)


def search(
    bench: Bench, data: Data, library: Sequence[Effect], progress: Callable[[str, float], None] | None = None
) -> list[Hypothesis]:
    """Fitted hypotheses, the best first: none, every effect that helps, and sets as long as they gain."""
    usable = [e for e in library if not (e.effect == "gravity" and bench.gravity)]
    count = len({e.name for e in usable})
    found = [fitted(bench, data, (), count)]
    frontier = found[:1]
    for level in range(LEVELS):
        trials = _next_level(bench, data, frontier, usable, count)
        level_found: list[Hypothesis] = []
        for k, effects in enumerate(trials):
            if progress:
                progress(f"effects, {level + 1} at once", k / len(trials))
            level_found.append(fitted(bench, data, effects, count))
        before = max(h.evidence for h in found)
        found += level_found
        frontier = sorted(level_found, key=lambda h: -h.evidence)[:WIDTH]
        if not frontier or frontier[0].evidence < before + ENOUGH:
            break
    found += _exchanged(bench, data, max(found, key=lambda h: h.evidence), usable, count)
    return sorted(found, key=lambda h: -h.evidence)


def _exchanged(bench: Bench, data: Data, best: Hypothesis, usable: Sequence[Effect], count: int) -> list[Hypothesis]:
    """The best set with each of its effects in turn given up for others: who else could stand in its place."""
    trials: list[list[tuple[Effect, Array]]] = []
    words = [e for e in usable if e.effect != UNKNOWN]
    for gone, _ in best.setting:
        rest = [(e, np.array(v)) for e, v in best.setting if e.name != gone.name]
        kept = fitted(bench, data, rest, count)
        trials += _next_level(bench, data, [kept], words, count)[:SWAPPED]
    others = [effects for effects in trials if frozenset(e.name for e, _ in effects) != best.names]
    return [fitted(bench, data, effects, count) for effects in others]


def _next_level(
    bench: Bench, data: Data, frontier: Sequence[Hypothesis], usable: Sequence[Effect], count: int
) -> list[list[tuple[Effect, Array]]]:
    """The most promising sets of one effect more, by their evidence to first order."""
    ranked: dict[frozenset[str], tuple[float, list[tuple[Effect, Array]]]] = {}
    for hypothesis in frontier:
        state = bench.state(hypothesis.setting)
        own, r = hypothesis.slopes[data.good], hypothesis.residual[data.good]
        own_prior = np.concatenate([np.zeros(0), *(np.array(e.scale) for e, _ in hypothesis.setting)])
        own_positive = _positive([e for e, _ in hypothesis.setting])
        for effect in usable:
            if effect.name in hypothesis.names:
                continue
            if effect.effect == "gravity":
                column = (state.weight_column() / data.sigma)[data.good]
                log, start, _ = evidence(r - column + own @ hypothesis.inner, own, own_prior, own_positive)
                pieces = [*_pairs(hypothesis, start), (effect, np.zeros(0))]
            else:
                x = np.hstack([own, (state.columns(effect) / data.sigma[:, None])[data.good]])
                prior = np.concatenate([own_prior, effect.scale])
                positive = np.concatenate([own_positive, _positive([effect])])
                log, start, _ = evidence(r + own @ hypothesis.inner, x, prior, positive)
                pieces = [*_pairs(hypothesis, start), (effect, start[len(own_prior) :])]
            log += log_prior(hypothesis.setting, count) + _log_prior_of(effect, count)
            key = frozenset([*hypothesis.names, effect.name]) | {f"{len(start)}"}
            if key not in ranked or log > ranked[key][0]:
                ranked[key] = (log, pieces)
    best = sorted(ranked.values(), key=lambda item: -item[0])
    return [[(e, _inside(e, v)) for e, v in pieces] for _, pieces in best[: TRIED if len(frontier) > 1 else 2 * TRIED]]


def _positive(effects: Sequence[Effect]) -> Flags:
    """Which inner parameters of these effects cannot be negative."""
    return np.concatenate([np.zeros(0, dtype=np.bool_), *(np.full(len(e.scale), e.positive) for e in effects)])


def _pairs(hypothesis: Hypothesis, start: Array) -> list[tuple[Effect, Array]]:
    out: list[tuple[Effect, Array]] = []
    at = 0
    for effect, values in hypothesis.setting:
        out.append((effect, start[at : at + len(values)]))
        at += len(values)
    return out


def _inside(effect: Effect, values: Array) -> Array:
    """Inner parameters within what can be computed: nothing becomes infinitely stiff."""
    if effect.outer is not None and effect.effect in {"actuator-stiffness", "link-stiffness"}:
        return np.clip(values, -0.8, 50.0)
    if effect.effect in {"displacement-scale", "force-scale"} or effect.names == ("factor",):
        return np.clip(values, -0.8, 50.0)
    return np.clip(values, 0.0, None) if effect.positive else values


def _bounded(effects: Sequence[tuple[Effect, Array]], u: Array) -> Array:
    at, out = 0, u.copy()
    for effect, values in effects:
        out[at : at + len(values)] = _inside(effect, u[at : at + len(values)])
        at += len(values)
    return out


def _split(effects: Sequence[tuple[Effect, Array]], u: Array) -> Setting:
    at = 0
    out: list[tuple[Effect, tuple[float, ...]]] = []
    for effect, values in effects:
        out.append((effect, tuple(float(v) for v in u[at : at + len(values)])))
        at += len(values)
    return tuple(out)


def _linearized(bench: Bench, data: Data, setting: Setting) -> tuple[Array, Array]:
    """Residual (n,) and derivatives (n, k) in sigmas."""
    state = bench.state(setting)
    residual = (bench.campaign.value - state.prediction) / data.sigma
    if any(effect.effect == "gravity" for effect, _ in setting):
        stiff = bench.campaign.kind == STIFFNESS
        residual = residual - np.where(stiff, state.weight_column(), 0.0) / data.sigma
    blocks = [state.columns(effect) / data.sigma[:, None] for effect, values in setting if values]
    slopes = np.hstack(blocks) if blocks else np.zeros((len(residual), 0))
    if not (np.isfinite(residual).all() and np.isfinite(slopes).all()):
        raise InputError("a parameter has left the range in which the robot stands")
    return residual, slopes


def _cost(residual: Array, data: Data, u: Array, prior: Array) -> float:
    good = residual[data.good]
    return float(good @ good) + float(np.sum((u / (SIZES[-1] * prior)) ** 2))

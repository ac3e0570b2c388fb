"""A diagnosis without a mechanism: which rival of the model, or which scale on it, explains the difference best."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.chances import chi_square_tail
from stiffscope.gap.diagnosis import Alternative, Diagnosis, Effect, Gap, NextMeasurement, Parameter, Where
from stiffscope.gap.linear import Fit, fit
from stiffscope.gap.residuals import by_direction, by_pose, percent_noise, percent_rms
from stiffscope.gap.vocabulary import AXES, QUANTITIES, STIFFNESS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.gap.readings import Campaign

    Array = NDArray[np.float64]
    Flags = NDArray[np.bool_]

PRIOR_SCALE = 0.2  # 1 σ of a scale's distance from one before the data
PRIOR_EFFECT = 0.25  # prior odds of one effect more, shared by all that it could be
NOISES = np.geomspace(1e-4, 0.5, 120)  # grid of the unknown noise: 0.01 to 50 % of a reading's size
CONFIDENT = 0.9
_GROUPS = {"all": AXES, "translation": AXES[:3], "rotation": AXES[3:]} | {axis: (axis,) for axis in AXES}


@dataclass(frozen=True)
class Hypothesis:
    """A model under test (its column) times scales on groups of directions."""

    column: str
    scales: tuple[str, ...]

    @property
    def terms(self) -> tuple[tuple[str, str], ...]:
        """Effects and places."""
        rival = () if self.column == "value" else (("rival", self.column),)
        return (*rival, *(("scale", place) for place in self.scales))


@dataclass(frozen=True)
class Weighed:
    """A hypothesis after the data."""

    hypothesis: Hypothesis
    fit: Fit
    log_prior: float
    model: Array
    """(n,) its best values."""
    probability: float = 0.0


def _mask(campaign: Campaign, place: str) -> Array:
    chosen = np.array([axis in _GROUPS[place] for axis in AXES], dtype=np.float64)
    return chosen[campaign.direction]


def _places(campaign: Campaign) -> tuple[list[str], dict[str, list[str]]]:
    """Return scales that these readings can tell apart, and for each the ones that look the same."""
    kept: list[str] = []
    twins: dict[str, list[str]] = {}
    for place in _GROUPS:
        mask = _mask(campaign, place)
        if not mask.any():
            continue
        same = next((p for p in kept if np.array_equal(_mask(campaign, p), mask)), None)
        if same is None:
            kept.append(place)
            twins[place] = []
        else:
            twins[same].append(place)
    return kept, twins


def hypotheses(campaign: Campaign) -> list[Hypothesis]:
    """Return every column with no scale, one, two, and one for each direction."""
    places, _ = _places(campaign)
    axes = tuple(p for p in places if p in AXES)
    groups: list[tuple[str, ...]] = [(), *((p,) for p in places)]
    for pair in combinations(places, 2):
        if np.linalg.matrix_rank(np.stack([_mask(campaign, p) for p in pair])) == 2:
            groups.append(pair)  # noqa: PERF401
    if len(axes) > 2:
        groups.append(axes)
    return [Hypothesis(column, scales) for column in campaign.predictions for scales in groups]


def _units(campaign: Campaign) -> tuple[Array, Flags]:
    """Return each reading's unit of noise (n,), and whether its size is unknown.

    Unknown noise is a common factor times the reading for stiffness, times the rms of its like otherwise.
    """
    unknown: Flags = np.isnan(campaign.sigma)
    like = campaign.kind * 2 + campaign.direction // 3
    mean = np.sqrt(np.bincount(like, campaign.value**2) / np.maximum(np.bincount(like), 1))
    own = np.where(campaign.kind == STIFFNESS, np.abs(campaign.value), mean[like])
    own = np.where(own > 0, own, max(float(np.abs(campaign.value).max()), 1e-300))
    return np.where(unknown, own, campaign.sigma), unknown


def _weigh(campaign: Campaign, hypothesis: Hypothesis, unit: Array, unknown: Flags, chosen: Flags) -> Weighed:
    base = campaign.predictions[hypothesis.column]
    X = (
        np.stack([base * _mask(campaign, p) / unit for p in hypothesis.scales], axis=1, dtype=np.float64)
        if (hypothesis.scales)
        else np.zeros((len(base), 0))
    )
    y = (campaign.value - base) / unit
    prior = np.full(X.shape[1], PRIOR_SCALE)
    result = fit(y[chosen], X[chosen], prior, unknown[chosen], NOISES)
    count = len(hypothesis.terms)
    return Weighed(hypothesis, result, count * np.log(PRIOR_EFFECT), base + (X @ result.mean) * unit)


def _share(all_weighed: list[Weighed]) -> list[Weighed]:
    """Return the hypotheses with their probabilities, best first; as many as alike share one prior."""
    sizes = [len(w.hypothesis.terms) for w in all_weighed]
    logs = np.array(
        [w.fit.evidence + w.log_prior - np.log(sizes.count(k)) for w, k in zip(all_weighed, sizes, strict=True)]
    )
    share = np.exp(logs - logs.max())
    share /= share.sum()
    weighed = [
        Weighed(w.hypothesis, w.fit, w.log_prior, w.model, float(p)) for w, p in zip(all_weighed, share, strict=True)
    ]
    return sorted(weighed, key=lambda w: -w.probability)


def _outliers(campaign: Campaign, unit: Array, unknown: Flags) -> Flags:
    """Return readings that no hypothesis reaches: beyond six robust sigmas, at most one in twenty."""
    best = np.full(len(campaign), np.inf)
    spread = 1.0
    for base in campaign.predictions.values():
        rest = (campaign.value - base) / unit
        for axis in range(6):
            pick = campaign.direction == axis
            ratio = base[pick] / unit[pick]
            if pick.any() and np.any(ratio):
                rest[pick] -= ratio * np.median(rest[pick][ratio != 0] / ratio[ratio != 0])
        best = np.minimum(best, np.abs(rest))
    if unknown.any():
        spread = 1.4826 * float(np.median(best))
    far: Flags = best > 6 * max(spread, 1e-12)
    return far if far.sum() <= len(far) / 20 else np.zeros_like(far)


def diagnose_predictions(campaign: Campaign) -> Diagnosis:
    """Return what can be said of a campaign with predictions: which rival or scale, at what cost, what it leaves."""
    unit, unknown = _units(campaign)
    outlier = _outliers(campaign, unit, unknown)
    used = ~outlier
    weighed = _share([_weigh(campaign, h, unit, unknown, used) for h in hypotheses(campaign)])
    best = weighed[0]
    sigma = np.where(unknown, unit * best.fit.noise, unit)
    nominal = campaign.predictions["value"]
    before, after = (((model - campaign.value) / sigma) for model in (nominal, best.model))
    held_out = _held_out(campaign, best.hypothesis, unit, unknown, used, sigma)
    gap = Gap(
        nominal=percent_rms(campaign, nominal, sigma, used),
        explained=percent_rms(campaign, best.model, sigma, used),
        held_out=held_out,
        noise=percent_noise(campaign, sigma, used),
        chi2_per_reading=(float(np.mean(before[used] ** 2)), float(np.mean(after[used] ** 2))),
    )
    effects = _effects(campaign, weighed, sigma, used)
    misfit = not unknown.all() and _rejected(after[used & ~unknown], len(best.hypothesis.scales))
    where = Where(
        direction=by_direction(campaign, np.where(used, before, 0.0)),
        pose_names=campaign.pose_names,
        pose=by_pose(campaign, np.where(used, before, 0.0)),
        unexplained=by_pose(campaign, np.where(used, after, 0.0)),
    )
    verdict = _verdict(weighed, effects, misfit=misfit)
    alternatives = _alternatives(campaign, weighed, sigma, used)
    step = _next(campaign, weighed, sigma) if verdict == "ambiguous" else None
    remarks = _remarks(campaign, weighed, unknown, outlier)
    return Diagnosis(verdict, gap, effects, alternatives, where, step, remarks)


def _rejected(whitened: Array, parameters: int) -> bool:
    """Whether stated noise alone leaves so much in fewer than one case in a thousand."""
    freedom = max(len(whitened) - parameters, 1)
    return chi_square_tail(float(np.sum(whitened**2)), freedom) < 1e-3


def _held_out(
    campaign: Campaign, hypothesis: Hypothesis, unit: Array, unknown: Flags, used: Flags, sigma: Array
) -> float:
    """Return the mean over poses of the gap of a pose that took no part in the fit."""
    left: list[float] = []
    for pose in range(len(campaign.pose_names)):
        here = campaign.pose == pose
        if (used & ~here).any() and (used & here).any():
            model = _weigh(campaign, hypothesis, unit, unknown, used & ~here).model
            left.append(percent_rms(campaign, model, sigma, used & here))
    return float(np.mean(left)) if left else float("nan")


def _probability(weighed: list[Weighed], term: tuple[str, str]) -> float:
    return float(min(1.0, sum(w.probability for w in weighed if term in w.hypothesis.terms)))


def _alone(weighed: list[Weighed], term: tuple[str, str]) -> Weighed | None:
    return next((w for w in weighed if w.hypothesis.terms == (term,)), None)


def _parameters(w: Weighed, place: str) -> dict[str, Parameter]:
    at = w.hypothesis.scales.index(place)
    change, sigma = float(w.fit.mean[at]), float(np.sqrt(w.fit.covariance[at, at]))
    wider = [k for k, p in enumerate(w.hypothesis.scales) if set(_GROUPS[place]) < set(_GROUPS[p])]
    below = 1.0 + sum(float(w.fit.mean[k]) for k in wider)
    factor = (below + change) / below
    return {"factor": Parameter(factor, sigma / abs(below), "1", plausible=0.5 < factor < 2.0)}


def _effects(campaign: Campaign, weighed: list[Weighed], sigma: Array, used: Flags) -> tuple[Effect, ...]:
    best = weighed[0]
    _, twins = _places(campaign)
    out: list[Effect] = []
    for effect, place in best.hypothesis.terms:
        alone = _alone(weighed, (effect, place)) or best
        left = percent_rms(campaign, alone.model, sigma, used)
        parameters = _parameters(best, place) if effect == "scale" else {}
        same = tuple(f"scale @ {p}" for p in twins.get(place, [])) if effect == "scale" else ()
        probability = _probability(weighed, (effect, place))
        out.append(Effect(effect, place, probability, left, parameters, same))
    return tuple(out)


def _verdict(weighed: list[Weighed], effects: tuple[Effect, ...], *, misfit: bool) -> str:
    if misfit:
        return "unexplained"
    if not effects:
        return "no-gap" if weighed[0].probability > 0.5 else "ambiguous"
    return "identified" if all(e.probability >= CONFIDENT for e in effects) else "ambiguous"


def _alternatives(
    campaign: Campaign, weighed: list[Weighed], sigma: Array, used: Flags, count: int = 6
) -> tuple[Alternative, ...]:
    """Return the strongest effects that the answer leaves out, and every rival, each as it would do alone."""
    best = weighed[0]
    scales = [("scale", p) for p in _places(campaign)[0]]
    rivals = [("rival", column) for column in campaign.predictions if column != "value"]
    singles = [w for t in (*rivals, *scales) if t not in best.hypothesis.terms and (w := _alone(weighed, t))]
    singles.sort(key=lambda w: (w.hypothesis.column == "value", -w.fit.evidence))
    out: list[Alternative] = []
    for w in singles[: count + len(rivals)]:
        ((effect, place),) = w.hypothesis.terms
        left = percent_rms(campaign, w.model, sigma, used)
        behind = best.fit.evidence - w.fit.evidence
        cost = f"{len(w.hypothesis.scales)} free parameters"
        why = f"alone, with {cost}, it leaves {left:.2f} % rms; ln-evidence {behind:.1f} below the answer"
        out.append(Alternative(effect, place, _probability(weighed, (effect, place)), left, why))
    return tuple(out)


def _next(campaign: Campaign, weighed: list[Weighed], sigma: Array) -> NextMeasurement | None:
    """Return the reading whose repetition best separates the two leading hypotheses."""
    first, second = weighed[:2]
    gain = 0.5 * ((first.model - second.model) / sigma) ** 2
    at = int(np.argmax(gain))
    names = tuple(" + ".join(f"{e} @ {p}" for e, p in w.hypothesis.terms) or "no effect" for w in (first, second))
    pose = campaign.pose_names[int(campaign.pose[at])]
    quantity = QUANTITIES[int(campaign.quantity[at])]
    return NextMeasurement(names, float(gain[at]), pose=pose, quantity=quantity)


def _remarks(campaign: Campaign, weighed: list[Weighed], unknown: Flags, outlier: Flags) -> tuple[str, ...]:
    best = weighed[0]
    n, k = len(campaign) - int(outlier.sum()), len(best.hypothesis.scales)
    out = [f"{n} readings, {k} free parameter{'s' if k != 1 else ''}"]
    if unknown.any():
        size = 100 * best.fit.noise
        out.append(f"{int(unknown.sum())} readings state no uncertainty; what is left suggests {size:.2g} % (1 σ)")
    nothing = next(w for w in weighed if not w.hypothesis.terms)
    out.append(f"ln-evidence over no effect: {best.fit.evidence - nothing.fit.evidence:.1f}")
    out.extend(f"left out as an outlier: {campaign.where(int(i))}" for i in np.flatnonzero(outlier))
    return tuple(out)

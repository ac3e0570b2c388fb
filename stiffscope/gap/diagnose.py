"""Diagnosis of a campaign: location of the gap, its causes, and the gap left with them."""

from __future__ import annotations

from dataclasses import replace
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, say_count
from stiffscope.gap.campaign.response_lines import place_at_responses
from stiffscope.gap.drive_table import list_drives
from stiffscope.gap.forward.column_model import ColumnModel
from stiffscope.gap.forward.joint_model import JointModel
from stiffscope.gap.forward.misread_frames import find_misread
from stiffscope.gap.forward.robot_at_poses import RobotAtPoses
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.inference.averaging import (
    TAILS,
    average_over,
    mix_intervals,
    quantiles,
)
from stiffscope.gap.inference.diagnosis import (
    Adoptable,
    Alternative,
    Diagnosis,
    Effect,
    Gap,
    HeldOut,
    Parameter,
    Possible,
    Sensitivity,
)
from stiffscope.gap.inference.find import find
from stiffscope.gap.inference.hypothesis import forms_of, positive_of
from stiffscope.gap.inference.lack_of_fit import correlation
from stiffscope.gap.inference.location import locate_residuals, signature_correlation
from stiffscope.gap.inference.plausibility import (
    implausible,
    impossible,
    own_part,
    physical_sigma,
    plausible,
)
from stiffscope.gap.inference.posterior_samples import draw_internal, draw_samples
from stiffscope.gap.inference.residuals import percent_rms, rms_by_kind
from stiffscope.gap.inference.settings import GROUPS, VERDICT
from stiffscope.gap.inference.verdict import (
    adds_little,
    doubtful,
    judge_findings,
    settle_verdict,
    shares,
)
from stiffscope.gap.planning.next_reading import find_next
from stiffscope.gap.response_modes import describe_responses
from stiffscope.runtime.threads import in_one_thread

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.campaign.measured_responses import MeasuredResponses
    from stiffscope.gap.forward.forward_model import Candidate, ForwardModel
    from stiffscope.gap.inference.averaging import Averaged
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.gap.inference.verdict import Judgement
    from stiffscope.robot.nominal import NominalRobot
    from stiffscope.runtime.types import Array, Progress

COMPARED = 50.0  # ln-odds within which an alternative's parameters are checked
FACTOR = 10.0  # change of the prior, either way, to test the verdict
_DRAWS = (
    1000  # for the interval of a parameter that is no linear function of internal ones
)
_LISTED = 12  # alternatives, possible effects
_LEFT = (
    0.9  # share of its prior variance: with more left, readings do not show an error
)


def diagnose_campaign(
    campaign: Campaign,
    robot: NominalRobot | None = None,
    progress: Progress | None = None,
    responses: Sequence[MeasuredResponses] = (),
) -> Diagnosis:
    """Diagnose the gap between a campaign's readings and their model.

    Parameters
    ----------
    campaign
        The readings, with the model's predictions if there is no robot.
    robot
        The nominal robot without the effects to be found. Its weight counts only if the campaign's
        header lists it as modelled.
    progress
        Called with a stage's name and its fraction done.
    responses
        Frequency responses of the campaign, read by `load_responses`.

    Raises
    ------
    InputError
        For unreachable poses, frames read in mirrored axes or another unit, or if there is neither
        a robot nor predictions.
    """
    if robot is not None and len(campaign):
        read = RobotModel(campaign, robot).campaign
        for _, error in find_misread(RobotAtPoses(robot, read)):
            raise error
    model = forward_model(campaign, robot, responses)
    return conclude(find(model, progress))


@in_one_thread
def forward_model(
    campaign: Campaign,
    robot: NominalRobot | None,
    responses: Sequence[MeasuredResponses] = (),
    *,
    without: str = "",
) -> ForwardModel:
    """Return a campaign's forward model. Raises InputError without robot or predictions.

    without: an effect that its library lacks.
    """
    if campaign.predictions:
        return ColumnModel(campaign)
    if robot is None:
        raise InputError("campaign: expected a robot or predictions, got neither")
    if responses and not len(campaign):
        campaign = place_at_responses(campaign, responses)
    readings = RobotModel(campaign, robot, without=without)
    return JointModel(readings, tuple(responses)) if responses else readings


@in_one_thread
def conclude(found: Findings) -> Diagnosis:
    """Return the diagnosis of a search: the verdict with all its numbers."""
    others = {
        prior: (other, judge_findings(other).verdict)
        for prior, other in _under_other_priors(found).items()
    }
    judgement = settle_verdict(found, judge_findings(found), others)
    reported = judgement.hypothesis
    joint = (
        found.best
        if forms_of(reported.words) <= forms_of(found.best.words)
        and (
            judgement.verdict == "partly"  # of a likely cause that is not named, too
            or not adds_little(found, reported, found.best)
        )
        else reported
    )
    unseen = tuple(_unseen(found, joint, judgement.effects))
    left = (
        max(found.misfit(joint), 1.0) if judgement.verdict == "partly" else 1.0
    )  # shows in the values, too
    averaged = [
        (h.widen_covariance(left), w)
        for h, w in average_over(found, joint, judgement.effects)
    ]
    effects = _effects(found, judgement, joint, averaged)
    residual = found.held_out_residual(reported)
    check, held_out = _check(found, reported, residual)
    gap = _gap(found, reported, residual)
    responses, gaps = describe_responses(found, reported)
    gap = replace(gap, absolute={**gap.absolute, **gaps})
    beyond = judgement.verdict in {"partly", "unexplained"}
    together = correlation(found, reported)
    listed = 1.0 - VERDICT.unlisted if judgement.verdict == "unexplained" else 1.0
    open_ones = [
        (name, listed * p) for name, p in doubtful(found, judgement.effects)[:_LISTED]
    ]
    widened = f"{together}: intervals are widened by a discrepancy"
    remarks = (
        *found.problem.noise.remarks,
        *found.model.remarks(found.problem.noise, found.residual(found.none)),
        *judgement.remarks,
        *_displaced(found, judgement.remarks),
        *([widened] if together and not beyond else []),
        *unseen,
        *_counts(found, reported),
    )
    names = [c.name for c in judgement.effects]
    beside = [c for c in joint.candidates if names and c.name not in names]
    sensitivity = tuple(
        Sensitivity(prior, verdict, {n: o.compute_probability(n) for n in names})
        for prior, (o, verdict) in others.items()
    )
    return Diagnosis(
        judgement.verdict,
        gap,
        effects,
        tuple(
            replace(each, probability=listed * each.probability)
            for each in _alternatives(found, reported if effects else None)
        ),
        locate_residuals(found, reported, beyond=beyond),
        *find_next(found, effects, is_open=judgement.verdict == "ambiguous"),
        remarks,
        _steps(gap, effects),
        signature_correlation(found),
        tuple(Possible(*name.split(" @ "), p) for name, p in open_ones),  # type: ignore[arg-type]
        sensitivity=sensitivity,
        held_out_check=check,
        samples=draw_samples(
            found,
            averaged if effects else [(reported, 1.0)],
            judgement.effects,
            held_out,
            reported,
        ),
        beside=tuple(
            _describe(found, joint, reported, c, [(joint, 1.0)]) for c in beside
        ),
        responses=responses,
        drives=list_drives(found, joint if effects else found.none, left),
        adoptable=_find_adoptable(found, joint, reported, effects, left),
    )


def _displaced(found: Findings, said: Sequence[str]) -> list[str]:
    """Return remarks on instruments that the gap before any effect has elsewhere than stated."""
    texts = found.model.find_displaced().remarks
    return [f"without effects, {text}" for text in texts if text not in said]


def _find_adoptable(
    found: Findings,
    joint: Hypothesis,
    reported: Hypothesis,
    effects: tuple[Effect, ...],
    left: float,
) -> Adoptable:
    """Return the certain effects of the joint fit, fitted anew where others are left out.

    effects: the named ones; left: factor on covariances, as of the reported parameters.
    """
    named = {f"{e.effect} @ {e.place}": e for e in effects}
    sure = [
        c
        for c in joint.candidates
        if c.name in named or found.compute_probability(c.name) >= GROUPS.confident
    ]
    alone = joint if len(sure) == len(joint.candidates) else found.fit_effects(sure)
    wide = [(alone.widen_covariance(left), 1.0)]

    def describe(c: Candidate) -> Effect:
        own = _describe(found, alone, reported, c, wide)
        if c.name not in named:
            return own
        if alone is joint:
            return named[c.name]
        new = {"parameters": own.parameters, "errors": own.errors}
        return replace(named[c.name], **new)

    uncertain = (c for c in joint.candidates if c not in sure) if named else ()
    return Adoptable(
        tuple(map(describe, sure)) if named else (),
        list_drives(found, alone, left),
        tuple(_describe(found, joint, reported, c, [(joint, 1.0)]) for c in uncertain),
    )


def _effects(
    found: Findings, judgement: Judgement, joint: Hypothesis, averaged: Averaged
) -> tuple[Effect, ...]:
    """Return named effects by descending share, with parameters fitted jointly with likely ones."""
    share = shares(found, judgement.hypothesis)
    out: list[Effect] = []
    for candidate in sorted(judgement.effects, key=lambda c: -share[c.name]):
        group = found.group(candidate.name)
        effect = _describe(found, joint, judgement.hypothesis, candidate, averaged)
        alike = judgement.alike.get(candidate.name, ())
        names = tuple(dict.fromkeys([*group.others, *alike]))
        shared = effect.probability / (1.0 + len(alike))
        effect = replace(effect, probability=shared)
        own = {"confused_with": names, "group_probability": group.probability}
        out.append(replace(effect, share=share[candidate.name], **own))
    return tuple(out)


def _describe(
    found: Findings,
    joint: Hypothesis,
    reported: Hypothesis,
    c: Candidate,
    averaged: Averaged,
) -> Effect:
    """Return an effect with its probability, the gap that it leaves alone, and its parameters."""
    probability = found.compute_probability(c.name)
    alone = found.fit_effects([c])
    left = found.percent_rms(alone if alone is reported else found.fit_plainly(alone))
    parameters = {} if c.is_nuisance else _average_parameters(c.name, joint, averaged)
    errors = _errors(c, *own_part(joint, c.name))
    if _is_open(c, parameters):
        if not impossible(c, joint):
            errors = parameters  # one of the values that make up these sums
        own = joint.mark(lambda other: other.name == c.name)
        parameters = _sums(c, *own_part(joint, c.name), joint.known.scales[own])
    return Effect(c.effect, c.place, probability, left, parameters, errors=errors)


def _is_open(candidate: Candidate, parameters: dict[str, Parameter]) -> bool:
    """Return whether readings show sums of parameters, but not these within their range."""
    if not candidate.sums or not parameters:
        return False
    ends = zip(parameters.values(), candidate.plausible, strict=True)
    return any(
        not (low <= p.interval[0] and p.interval[1] <= high)
        for p, (low, high) in ends
        if p.unit == "m"
    )


def _sums(
    candidate: Candidate, values: Array, covariance: Array, scales: Array
) -> dict[str, Parameter]:
    """Return the sums of an effect's internal parameters with intervals.

    Those that readings do not show more exactly than the prior, of scales (k,), have no value.
    """
    out: dict[str, Parameter] = {}
    for name, unit, coefficients in candidate.sums:
        along = np.array(coefficients)
        value = float(along @ values)
        sigma = float(np.sqrt(max(along @ covariance @ along, 0.0)))
        if sigma**2 > _LEFT * float(along**2 @ scales**2):
            out[name] = Parameter(np.nan, np.nan, unit, nominal=0.0)
            continue
        low, high = (value + sigma * end for end in quantiles(0.0, 1.0).tolist())
        out[name] = Parameter(value, sigma, unit, interval=(low, high), nominal=0.0)
    return out


def _average_parameters(
    name: str, joint: Hypothesis, averaged: Averaged
) -> dict[str, Parameter]:
    """Return an effect's parameters in one hypothesis, with uncertainties over all averaged ones."""
    known = _parameters(name, joint)
    weights = np.array([weight for _, weight in averaged])
    fits = [_parameters(name, hypothesis) for hypothesis, _ in averaged]
    for key, own in known.items():
        each = [fit[key] for fit in fits]
        value, sigma = np.array([(p.value, p.sigma) for p in each]).T
        spread = float(np.sqrt(weights @ (sigma**2 + (value - own.value) ** 2)))
        known[key] = replace(
            own,
            sigma=spread,
            interval=mix_intervals(np.array([p.interval for p in each]), weights),
        )
    return known


def _errors(
    candidate: Candidate, values: Array, covariance: Array
) -> dict[str, Parameter]:
    """Return individual small errors, the largest first, with 1 rad equal to 1 m."""
    sigma = np.sqrt(np.diagonal(covariance))
    out = dict[str, Parameter]()
    reach = float(quantiles(0.0, 1.0)[1]) * sigma
    for k in map(int, np.argsort(-np.abs(values))[: len(candidate.parts)]):
        ends = float(values[k] - reach[k]), float(values[k] + reach[k])
        known = float(values[k]), float(sigma[k]), candidate.part_units[k]
        out[candidate.parts[k]] = Parameter(*known, interval=ends, nominal=0.0)
    return out


def _parameters(name: str, hypothesis: Hypothesis) -> dict[str, Parameter]:
    """Return an effect's physical parameters with standard uncertainties and intervals."""
    candidate = next(c for c in hypothesis.candidates if c.name == name)
    internal, covariance = own_part(hypothesis, name)
    if not candidate.scale:  # e.g. a unit, which is discrete
        exact: list[float] = candidate.physical(internal).tolist()
        fixed = zip(candidate.names, candidate.units, exact, strict=True)
        return {
            n: Parameter(v, 0.0, u, interval=(v, v), nominal=1.0) for n, u, v in fixed
        }
    values = candidate.physical(internal)
    sigma = physical_sigma(candidate, internal, covariance)
    intervals = _intervals(candidate, internal, covariance, values, sigma)
    fine = plausible(candidate, values, sigma)
    model = candidate.physical(np.zeros(len(internal)))
    known = [float(value) if np.isfinite(value) and value else None for value in model]
    fitted = values.tolist(), sigma.tolist(), candidate.units
    rows = zip(*fitted, fine, intervals, known, strict=True)
    return {
        name: Parameter(*row) for name, row in zip(candidate.names, rows, strict=True)
    }


def _intervals(
    candidate: Candidate,
    internal: Array,
    covariance: Array,
    values: Array,
    sigma: Array,
) -> list[tuple[float, float]]:
    """Return 95 % intervals: by quantiles for one parameter or couplings, else by standard uncertainties."""
    if candidate.couplings:  # such as a centre of mass, a ratio
        positive = positive_of([candidate])
        rng = np.random.default_rng(0)
        draws = draw_internal(internal, covariance, positive, _DRAWS, rng)
        low, high = np.quantile(
            [candidate.physical(row) for row in draws], TAILS, axis=0
        )
        return list(zip(low.tolist(), high.tolist(), strict=True))
    deviation = np.sqrt(np.diagonal(covariance).clip(min=1e-300))
    lowest = [0.0 if one_sided else -np.inf for one_sided in candidate.one_sided]
    ends = [
        quantiles(m, s, low)
        for m, s, low in zip(internal, deviation, lowest, strict=True)
    ]
    if len(values) == 1:
        low, high = sorted(
            float(candidate.physical(np.array([end]))[0]) for end in ends[0]
        )
        return [(low, high)]
    if candidate.positive:
        sides = [
            candidate.physical(np.array([end[side] for end in ends])) for side in (0, 1)
        ]
        return [
            (float(min(a, b)), float(max(a, b))) for a, b in zip(*sides, strict=True)
        ]
    least = 0.0 if candidate.parts else -np.inf  # no root mean square is below zero
    ends = [
        quantiles(value, deviation, least)
        for value, deviation in zip(values, sigma.clip(min=1e-300), strict=True)
    ]
    return [(float(low), float(high)) for low, high in ends]


def _under_other_priors(found: Findings) -> dict[str, Findings]:
    """Return the hypotheses under prior odds or sizes that are ten times larger or smaller."""
    problem = found.problem
    others = {
        "odds of an effect × 10": replace(problem, odds=problem.odds * FACTOR),
        "odds of an effect / 10": replace(problem, odds=problem.odds / FACTOR),
        "prior sizes × 10": replace(problem, widening=FACTOR),
        "prior sizes / 10": replace(problem, widening=1.0 / FACTOR),
    }
    return {prior: found.under(other) for prior, other in others.items()}


def _check(
    found: Findings, known: Hypothesis, residual: Array
) -> tuple[HeldOut | None, Array]:
    """Check held-out readings against their predictive distribution; return residuals (n,) too."""
    x = found.slopes(known)
    spread = np.einsum("ni,ij,nj->n", x, known.covariance, x).clip(min=0.0)
    z: Array = residual / np.sqrt(1.0 + spread)
    seen = z[found.used_readings]
    if not len(seen) or np.isnan(seen).any():
        return None, z
    widest = float(quantiles(0.0, 1.0)[1])
    inside = float(np.mean(np.abs(seen) <= widest))
    check = HeldOut(inside, float(np.mean(np.square(seen))))
    return check, np.where(found.used_readings, z, np.nan)


def _alternatives(found: Findings, best: Hypothesis | None) -> tuple[Alternative, ...]:
    """Return other single effects and competing sets, with the reasons against each."""
    out: list[Alternative] = []
    for h, p in found.ranked:
        whole = best is not None and h.names >= best.names
        if len(out) == _LISTED:
            break
        if not h.names or whole or any(c.is_nuisance for c in h.candidates):
            continue
        if len(h.names) > 1 and p < GROUPS.competing:
            continue
        behind = found.best.evidence - h.evidence
        alone = found.fit_plainly(h)
        chi2 = found.chi2(alone) / max(int(found.used_readings.sum()), 1)
        far = f"ln-odds {behind:.1f} behind, χ² per reading {chi2:.3g}"
        wrong = (
            [t for c in h.candidates for t in implausible(c, h)]
            if behind < COMPARED
            else []
        )
        why = "; ".join([far if behind > 0.05 else "as good", *wrong])
        effect = " + ".join(c.effect for c in h.candidates)
        place = " + ".join(c.place for c in h.candidates)
        out.append(Alternative(effect, place, p, found.percent_rms(alone), why))
    return tuple(out)


def _gap(found: Findings, reported: Hypothesis, held_out: Array) -> Gap:
    none = found.none
    count = max(int(found.used_readings.sum()), 1)
    c = found.campaign
    explained = found.percent_rms(reported)
    noise = percent_rms(c, c.value + found.sigma, found.sigma, found.used_readings)
    residuals = (
        found.residual(none),
        found.residual(reported),
        held_out,
        np.ones(len(held_out)),
    )
    sizes = (found.sigma * each for each in residuals)
    return Gap(
        nominal=found.percent_rms(none),
        explained=explained,
        held_out=found.percent_rms_by_pose(held_out),
        noise=noise,
        chi2_per_reading=(found.chi2(none) / count, found.chi2(reported) / count),
        left=float(np.sqrt(max(explained**2 - noise**2, 0.0))),
        discrepancy=100.0 * reported.known.discrepancy,
        absolute=rms_by_kind(c, found.used_readings, *sizes),
    )


def _steps(gap: Gap, effects: tuple[Effect, ...]) -> tuple[tuple[str, float], ...]:
    """Return the gap before, after each effect alone, after all, held out, and by noise alone."""
    alone = [(f"{e.effect} @ {e.place}", e.gap_after) for e in effects]
    together = [("together", gap.explained)] if len(alone) > 1 else []
    held_out = [("held out", gap.held_out)] if np.isfinite(gap.held_out) else []
    return (
        ("nominal", gap.nominal),
        *alone,
        *together,
        *held_out,
        ("noise", gap.noise),
    )


def _unseen(
    found: Findings, joint: Hypothesis, effects: tuple[Candidate, ...]
) -> Iterator[str]:
    """A line for each effect of many errors of which readings show some combinations alone."""
    for c in joint.candidates:
        if c.parts and c in effects:
            here = joint.mark(lambda other, c=c: other is c)
            count = len(c.parts)
            own = (
                found.slopes(joint)[found.used_readings][:, here]
                * joint.known.scales[here]
            )
            left = np.linalg.inv(np.eye(count) + own.T @ own)
            seen = int(np.sum(np.linalg.eigvalsh(left) < _LEFT))
            alone = list(compress(c.parts, np.diagonal(left) >= _LEFT))
            nothing = f", and nothing of {', '.join(alone)}" if alone else ""
            if seen < count:
                yield f"{c.name}: readings show {seen} combinations of its {count} errors{nothing}"


def _counts(found: Findings, reported: Hypothesis) -> list[str]:
    """Return remarks on the numbers of readings and parameters, the noise and the evidence."""
    count = int(found.used_readings.sum())
    parameters = len(reported.values)
    factor = found.best.known.noise_factor
    scaled = bool(found.problem.noise.scaled.any())
    gain = found.best.evidence - found.none.evidence
    return [
        f"{say_count(count, 'reading')}, {say_count(parameters, 'free parameter')}",
        *(
            [f"estimated noise: {100 * factor:.2g} % of a reading (1 σ)"]
            if scaled
            else []
        ),
        *([f"ln-odds over no effect: {gain:.1f}"] if found.best.names else []),
    ]

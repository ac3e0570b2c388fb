"""Diagnosis of a campaign: where the gap lies, which effects cause it, and how far it shrinks once they are added."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.column_model import ColumnModel
from stiffscope.gap.diagnosis import Alternative, Diagnosis, Effect, Gap, Parameter
from stiffscope.gap.experiment_design import next_measurement
from stiffscope.gap.findings import find
from stiffscope.gap.forward_model import UNNAMED
from stiffscope.gap.lack_of_fit import lack_of_fit
from stiffscope.gap.location import located, signature_correlation
from stiffscope.gap.residuals import percent_noise
from stiffscope.gap.robot_model import RobotModel

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from stiffscope.gap.campaign import Campaign
    from stiffscope.gap.diagnosis import NextMeasurement
    from stiffscope.gap.findings import Findings
    from stiffscope.gap.forward_model import Candidate, ForwardModel
    from stiffscope.gap.search import Hypothesis
    from stiffscope.robot.effects import NominalRobot

    Array = NDArray[np.floating[Any]]
    Progress = Callable[[str, float], None]

CONFIDENT = 0.9  # probability from which effects are identified
MAJORITY = 0.5  # probability from which there is no gap
COMPETING = 0.02  # probability, over that of the best, from which a hypothesis still competes with it
CONFUSED = 2  # other effects at most that one is said to be confused with
FEW = 3  # readings a parameter below which nothing is identified
SIGNIFICANT = 3.0  # standard deviations by which a parameter must leave its plausible range to count
COMPARED = 50.0  # ln-odds up to which an alternative's parameters are looked at
_LISTED = 12  # alternatives
_NEAR = 8  # hypotheses, of which the first that is no extension of the best is to be separated from it


def diagnose(campaign: Campaign, robot: NominalRobot | None = None, progress: Progress | None = None) -> Diagnosis:
    """Diagnose the gap between a campaign's readings and their model.

    Parameters
    ----------
    campaign
        The readings, with the model's predictions where there is no robot.
    robot
        The nominal robot, without the effects that are looked for. Its weight counts only if the campaign's header
        says that it is modelled.
    progress
        Called with a stage's name and its fraction done.

    Raises
    ------
    InputError
        For poses that the robot cannot reach, and without robot or predictions.

    """
    return conclude(find(forward_model(campaign, robot), progress))


def forward_model(campaign: Campaign, robot: NominalRobot | None) -> ForwardModel:
    """The forward model that a campaign calls for. Raises InputError without robot or predictions."""
    if campaign.predictions:
        return ColumnModel(campaign)
    if robot is None:
        raise InputError("campaign: expected a robot or predictions, got neither")
    return RobotModel(campaign, robot)


def conclude(found: Findings) -> Diagnosis:
    """The verdict on a search, with every number that goes with it."""
    best = found.best
    objections = _objections(found)
    remarks = [
        *found.problem.noise.remarks,
        *found.model.remarks(found.problem.noise, found.residual(found.none)),
        *objections,
    ]
    verdict, doubt = _verdict(found, objections)
    effects = tuple(_effects(found, best)) if verdict in {"identified", "ambiguous"} else ()
    gap = _gap(found)
    return Diagnosis(
        verdict,
        gap,
        effects,
        _alternatives(found, best if effects else None),
        located(found),
        _next(found),
        (*remarks, *doubt, *_counts(found)),
        _steps(gap, effects),
        signature_correlation(found),
    )


def _verdict(found: Findings, objections: list[str]) -> tuple[str, list[str]]:
    """The verdict, and what keeps it from being a better one."""
    best = found.best
    if objections:
        return "unexplained", []
    if not best.names:
        return ("no-gap" if found.probability[0] > MAJORITY else "ambiguous"), []
    count, parameters = int(found.used.sum()), len(best.values)
    if count < FEW * (parameters + 1):
        return "ambiguous", [f"{count} readings are too few to identify {parameters} parameters"]
    return ("identified" if found.probability_of(best.names) >= CONFIDENT else "ambiguous"), []


def _objections(found: Findings) -> list[str]:
    """Why the best hypothesis explains nothing."""
    best = found.best
    unnamed = sorted(n.removeprefix(f"{UNNAMED} @ ") for n in best.names if n.startswith(UNNAMED))
    out = [f"the readings follow {', '.join(unnamed)}, for which the vocabulary has no word"] if unnamed else []
    out += [text for effect in _effects(found, best) for text in _implausible(effect)]
    lacking = lack_of_fit(found, best)
    out += [lacking] if lacking else []
    if sum(bool(c.scale) for c in best.candidates) > found.model.most_effects and not unnamed:
        out.append(f"the readings need {' and '.join(sorted(best.names))} jointly; no smaller set fits")
    return out


def _implausible(effect: Effect) -> list[str]:
    return [
        f"{effect.effect} @ {effect.place}: {name} of {p.value:.3g} {p.unit} is not plausible"
        for name, p in effect.parameters.items()
        if not p.plausible
    ]


def _effects(found: Findings, hypothesis: Hypothesis) -> list[Effect]:
    out: list[Effect] = []
    at = 0
    for candidate, values in hypothesis.parameters:
        own = slice(at, at + len(values))
        at += len(values)
        out.append(
            Effect(
                candidate.effect,
                candidate.place,
                found.probability_of(frozenset([candidate.name])),
                found.percent_rms(found.alone(candidate)),
                _parameters(candidate, np.array(values), hypothesis.covariance[own, own]),
                (*candidate.twins, *_confused(found, hypothesis, candidate.name)),
            )
        )
    return out


def _parameters(candidate: Candidate, internal: Array, covariance: Array) -> dict[str, Parameter]:
    """Physical parameters with their standard uncertainties, by the derivatives of the conversion."""
    if not candidate.scale:
        return {}
    steps = 1e-6 * np.array(candidate.scale)
    slopes = [
        (candidate.physical(internal + d) - candidate.physical(internal - d)) / (2.0 * step)
        for d, step in zip(np.diag(steps), steps, strict=True)
    ]
    jacobian = np.stack(slopes, axis=1)
    sigma = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian).clip(min=0.0))
    rows = zip(candidate.names, candidate.units, candidate.physical(internal), sigma, candidate.plausible, strict=True)
    return {
        name: Parameter(float(v), float(s), unit, bool(low - SIGNIFICANT * s <= v <= high + SIGNIFICANT * s))
        for name, unit, v, s, (low, high) in rows
    }


def _confused(found: Findings, hypothesis: Hypothesis, name: str) -> list[str]:
    """The most probable effects that could stand in this one's place, where that is worth naming."""
    rest = hypothesis.names - {name}
    own = found.probability[found.hypotheses.index(hypothesis)]
    others: dict[str, float] = {}
    for other, p in zip(found.hypotheses, found.probability, strict=True):
        swapped = other.names - rest
        if rest <= other.names and len(swapped) == 1 and name not in swapped and p > COMPETING * own:
            others[next(iter(swapped))] = p
    ranked = sorted((n for n in others if not n.startswith(UNNAMED)), key=lambda n: -others[n])
    return ranked[:CONFUSED]


def _alternatives(found: Findings, best: Hypothesis | None) -> tuple[Alternative, ...]:
    """Other single effects, and other sets where they compete, with what speaks against each."""
    out: list[Alternative] = []
    for hypothesis, p in zip(found.hypotheses, found.probability, strict=True):
        names, candidates = hypothesis.names, hypothesis.candidates
        if not names or (best is not None and names >= best.names) or (len(names) > 1 and p < COMPETING):
            continue
        if any(c.unnamed for c in candidates):
            continue
        behind = found.best.evidence - hypothesis.evidence
        chi2 = found.chi2(hypothesis) / max(int(found.used.sum()), 1)
        why = f"ln-odds {behind:.1f} behind, χ² per reading {chi2:.3g}" if behind > 0.05 else "as good"
        wrong = [t for e in _effects(found, hypothesis) for t in _implausible(e)] if behind < COMPARED else []
        effect, place = (" + ".join(words) for words in zip(*((c.effect, c.place) for c in candidates), strict=True))
        out.append(Alternative(effect, place, p, found.percent_rms(hypothesis), "; ".join([why, *wrong])))
    return tuple(out[:_LISTED])


def _gap(found: Findings) -> Gap:
    best, none = found.best, found.none
    count = max(int(found.used.sum()), 1)
    return Gap(
        found.percent_rms(none),
        found.percent_rms(best),
        found.held_out_percent_rms(best),
        percent_noise(found.campaign, found.sigma, found.used),
        (found.chi2(none) / count, found.chi2(best) / count),
    )


def _steps(gap: Gap, effects: tuple[Effect, ...]) -> tuple[tuple[str, float], ...]:
    """The waterfall: the gap before, after each effect alone, after all, held out, and what noise alone leaves."""
    alone = [(f"{e.effect} @ {e.place}", e.gap_after) for e in effects]
    together = [("together", gap.explained)] if len(alone) > 1 else []
    return (("nominal", gap.nominal), *alone, *together, ("held out", gap.held_out), ("noise", gap.noise))


def _next(found: Findings) -> NextMeasurement | None:
    """What separates the best hypothesis from the next one that is no extension of it."""
    best = found.best
    near = [h for h in found.hypotheses[1:_NEAR] if h.names and not best.names <= h.names]
    return next_measurement(found.model, found.sigma, best, near[0]) if near and best.names else None


def _counts(found: Findings) -> list[str]:
    """Readings, parameters and evidence in figures."""
    count, parameters = int(found.used.sum()), len(found.best.values)
    factor = found.best.noise_factor
    scaled = bool(found.problem.noise.scaled.any())
    gain = found.best.evidence - found.none.evidence
    return [
        f"{count} readings, {parameters} free parameter{'s' if parameters != 1 else ''}",
        *([f"estimated noise: {100 * factor:.2g} % of a reading (1 σ)"] if scaled else []),
        *([f"ln-odds over no effect: {gain:.1f}"] if found.best.names else []),
    ]

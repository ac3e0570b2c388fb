"""Where the gap between model and machine lies, which effect causes it, and how far it shrinks once that is added."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from stiffscope.gap.chances import chi_square_tail
from stiffscope.gap.diagnosis import Alternative, Diagnosis, Effect, Gap, Parameter, Where
from stiffscope.gap.effects import UNKNOWN, library
from stiffscope.gap.experiment_design import next_measurement
from stiffscope.gap.noise import Data, noise_of
from stiffscope.gap.nuisance import rivals
from stiffscope.gap.residuals import by_direction, by_pose, percent_noise, percent_rms
from stiffscope.gap.search import SIZES, Hypothesis, fitted, search
from stiffscope.gap.state import Bench
from stiffscope.gap.vocabulary import AXES, STIFFNESS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.effects import Effect as Term
    from stiffscope.gap.readings import Campaign
    from stiffscope.vjm.biglide import Biglide

    Array = NDArray[np.floating[Any]]
    Progress = Callable[[str, float], None]

CONFIDENT = 0.9
UNLIKELY = 1e-3  # chance below which the residuals are not the noise alone
SIZEABLE = 1.03  # χ² per reading below which a lack of fit is of no account
GROUP = 2  # others at most that an effect is said to be confused with
TOGETHER = 2  # effects at most, beside gravity, that an answer names: three can follow almost anything
RIVALRY = 0.02  # probability from which an alternative is reported as one that cannot be told apart
_SEEN = 0.05  # share of a group mean that the fit has left to be seen
FEW = 3  # readings a parameter below which nothing is identified
TRIFLE = 0.002  # share of the χ² that is explained, below which what is left is of no account
STRONG = 3.0  # standard deviations by which a parameter must leave its plausible range to count


@dataclass(frozen=True)
class Findings:
    """The search's hypotheses with their probabilities, the best first."""

    bench: Bench
    data: Data
    hypotheses: tuple[Hypothesis, ...]
    probability: tuple[float, ...]

    @property
    def best(self) -> Hypothesis:
        """The most probable one."""
        return self.hypotheses[0]

    @property
    def none(self) -> Hypothesis:
        """No effect at all."""
        return next(h for h in self.hypotheses if not h.names)

    def chance(self, names: frozenset[str]) -> float:
        """Probability that all these effects are at work."""
        return float(sum(p for h, p in zip(self.hypotheses, self.probability, strict=True) if names <= h.names))

    def model(self, hypothesis: Hypothesis) -> Array:
        """What a hypothesis says the readings are, (n,)."""
        return self.bench.campaign.value - hypothesis.residual * self.data.sigma


def diagnose(campaign: Campaign, robot: Biglide, progress: Progress | None = None) -> Diagnosis:
    """Diagnose a campaign against its nominal robot, which carries no gravity unless the campaign says so.

    Raises InputError for poses that the robot cannot reach.
    """
    return answer(find(campaign, robot, progress))


def find(
    campaign: Campaign, robot: Biglide, progress: Progress | None = None, terms: Sequence[Term] | None = None
) -> Findings:
    """Search over the effects of the vocabulary (or ``terms``) and over patterns that it has no word for."""
    bench = Bench(campaign, robot)
    everything = [*(library() if terms is None else terms), *rivals()]
    data = noise_of(bench, everything)
    hypotheses = _distinct(search(bench, data, everything, progress))
    log = np.array([h.evidence for h in hypotheses])
    weight = np.exp(log - log.max())
    return Findings(bench, data, tuple(hypotheses), tuple((weight / weight.sum()).tolist()))


def _distinct(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The best fit of every set of effects."""
    seen: dict[frozenset[str], Hypothesis] = {}
    for hypothesis in hypotheses:
        seen.setdefault(hypothesis.names, hypothesis)
    return list(seen.values())


def answer(found: Findings) -> Diagnosis:
    """The verdict on a search, with every number that goes with it."""
    best = found.best
    remarks = [*found.data.remarks, *_bounds(found), *_too_weak(found)]
    strange = sorted(n.removeprefix(f"{UNKNOWN} @ ") for n in best.names if n.startswith(UNKNOWN))
    implausible = [text for e in _effects(found, best) for text in _implausible(e)]
    lacking = lack_of_fit(found, best)
    if strange:
        remarks.append(f"the readings follow {', '.join(strange)}, for which the vocabulary has no word")
    remarks += implausible
    if lacking:
        remarks.append(lacking)
    many = len(best.names - {"gravity @ robot"}) > TOGETHER
    if many and not strange:
        remarks.append(f"it takes {' and '.join(sorted(best.names))} together, which no two effects replace")
    known = found.chance(best.names) if best.names else found.probability[0]
    if not best.names and not lacking:
        verdict = "no-gap" if found.probability[0] > 0.5 else "ambiguous"
    elif strange or implausible or lacking or many or not best.names:
        verdict = "unexplained"
    else:
        few = int(found.data.good.sum()) < FEW * (len(best.inner) + 1)
        if few:
            remarks.append(f"{int(found.data.good.sum())} readings are too few to tell {len(best.inner)} parameters")
        verdict = "identified" if known >= CONFIDENT and not few else "ambiguous"
    shown = () if verdict in {"no-gap", "unexplained"} else tuple(_effects(found, best))
    others = _alternatives(found, best if shown else None)
    rivals_left = [h for h in found.hypotheses[1:8] if h.names and not best.names <= h.names]
    following = next_measurement(found.bench, found.data, best, rivals_left[0]) if rivals_left and best.names else None
    return Diagnosis(
        verdict,
        _gap(found, best),
        shown,
        others,
        _where(found, best),
        following,
        tuple(remarks),
        _steps(found, best),
        _likeness(found),
    )


def lack_of_fit(found: Findings, hypothesis: Hypothesis) -> str:
    """What the residuals of a hypothesis show beyond the noise, in all and by direction, pose, load and session; or "".

    What is a trifle of the gap that the hypothesis closes is left to the model's own small errors.
    """
    c, good = found.bench.campaign, found.data.good
    r = hypothesis.residual[good]
    freedom = max(len(r) - len(hypothesis.inner), 1)
    trifle = TRIFLE * max(found.none.chi2 - freedom, 0.0)
    excess = hypothesis.chi2 - freedom
    if excess > max((SIZEABLE - 1.0) * freedom, trifle) and chi_square_tail(hypothesis.chi2, freedom) < UNLIKELY:
        return f"the residuals are {np.sqrt(hypothesis.chi2 / freedom):.2g} times the noise"
    if len(r) < 60 or np.isnan(c.sigma).any():
        return ""
    loads = np.unique(np.nan_to_num(c.wrench[good]), axis=0, return_inverse=True)[1].ravel()
    axis, kind = c.direction[good], c.kind[good]
    groups = {
        "direction": kind * 6 + axis,
        "pose and direction": c.pose[good] * 6 + axis,
        "load and direction": loads * 6 + axis,
        "session and direction": c.session[good] * 6 + axis,
    }
    x = hypothesis.slopes[good]
    for name, group in groups.items():
        total, count = _grouped(r, group, x)
        chance = chi_square_tail(total, count)
        if chance * len(groups) < UNLIKELY and total - count > trifle:
            return f"the residuals go together by {name}, which noise does not (chance {chance:.1g})"
    return ""


def _grouped(r: Array, group: NDArray[np.int64], x: Array) -> tuple[float, int]:
    """χ² of the groups' mean residuals, the fit's own freedom projected out of them, and its degrees of freedom."""
    _, index, count = np.unique(group, return_inverse=True, return_counts=True)
    sums = np.bincount(index.ravel(), r) / np.sqrt(count)
    design = np.zeros((len(count), x.shape[1]))
    for k in range(x.shape[1]):
        design[:, k] = np.bincount(index.ravel(), x[:, k]) / np.sqrt(count)
    covariance = np.eye(len(count)) - design @ np.linalg.pinv(x.T @ x, rcond=1e-10) @ design.T
    values, vectors = np.linalg.eigh(covariance)
    keep = values > _SEEN
    return float(np.sum((vectors[:, keep].T @ sums) ** 2 / values[keep])), int(keep.sum())


def _effects(found: Findings, hypothesis: Hypothesis) -> list[Effect]:
    out: list[Effect] = []
    at = 0
    nominal = found.bench.nominal
    for term, values in hypothesis.setting:
        inner = np.array(values)
        covariance = hypothesis.covariance[at : at + len(inner), at : at + len(inner)]
        at += len(inner)
        step = 1e-6 * np.array(term.scale)
        here = term.outside(inner, nominal)
        slopes = [
            (term.outside(inner + d, nominal) - term.outside(inner - d, nominal)) / (2 * s)
            for d, s in zip(np.diag(step), step, strict=True)
        ]
        jacobian = np.stack(slopes, axis=1) if slopes else np.zeros((0, 0))
        sigma = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian).clip(min=0.0))
        parameters = {
            name: Parameter(float(v), float(s), unit, bool(low - STRONG * s <= v <= high + STRONG * s))
            for name, unit, v, s, low, high in zip(
                term.names, term.units, here, sigma, term.low, term.high, strict=True
            )
        }
        alone = _alone(found, term)
        out.append(
            Effect(
                term.effect,
                term.place,
                found.chance(frozenset([term.name])),
                _percent(found, alone),
                parameters,
                tuple(_confused(found, hypothesis, term.name)),
            )
        )
    return out


def _alone(found: Findings, term: Term) -> Hypothesis:
    known = next((h for h in found.hypotheses if h.names == frozenset([term.name])), None)
    if known is not None:
        return known
    start = np.zeros(len(term.scale))
    return fitted(found.bench, found.data, [(term, start)], len(found.hypotheses))


def _confused(found: Findings, hypothesis: Hypothesis, name: str) -> list[str]:
    """The most probable effects that could stand in this one's place, where that is worth naming."""
    rest = hypothesis.names - {name}
    own = found.probability[found.hypotheses.index(hypothesis)]
    chances: dict[str, float] = {}
    for other, p in zip(found.hypotheses, found.probability, strict=True):
        swapped = other.names - rest
        if rest <= other.names and len(swapped) == 1 and name not in swapped and p > RIVALRY * own:
            chances[next(iter(swapped))] = p
    ranked = sorted((n for n in chances if not n.startswith(UNKNOWN)), key=lambda n: -chances[n])
    return ranked[:GROUP]


def _implausible(effect: Effect) -> list[str]:
    return [
        f"{effect.effect} @ {effect.place}: {name} of {p.value:.3g} {p.unit} is not plausible"
        for name, p in effect.parameters.items()
        if not p.plausible
    ]


def _alternatives(found: Findings, best: Hypothesis | None) -> tuple[Alternative, ...]:
    """Other single words, and other sets where they are near, with what speaks against each."""
    out: list[Alternative] = []
    top = found.hypotheses[0]
    for hypothesis, p in zip(found.hypotheses, found.probability, strict=True):
        names = hypothesis.names
        if not names or (best is not None and names >= best.names) or (len(names) > 1 and p < RIVALRY):
            continue
        if any(n.startswith(UNKNOWN) for n in names):
            continue
        terms = [e for e, _ in hypothesis.setting]
        behind = top.evidence - hypothesis.evidence
        chi2 = hypothesis.chi2 / max(int(found.data.good.sum()), 1)
        why = f"ln-odds {behind:.1f} behind, χ² per reading {chi2:.3g}" if behind > 0.05 else "as good"
        wrong = [text for e in _effects(found, hypothesis) for text in _implausible(e)] if behind < 50.0 else []
        out.append(
            Alternative(
                " + ".join(e.effect for e in terms),
                " + ".join(e.place for e in terms),
                p,
                _percent(found, hypothesis),
                "; ".join([why, *wrong]),
            )
        )
    return tuple(out[:12])


def _percent(found: Findings, hypothesis: Hypothesis) -> float:
    return percent_rms(found.bench.campaign, found.model(hypothesis), found.data.sigma, found.data.good)


def _gap(found: Findings, best: Hypothesis) -> Gap:
    c, data = found.bench.campaign, found.data
    count = max(int(data.good.sum()), 1)
    return Gap(
        _percent(found, found.none),
        _percent(found, best),
        held_out(found, best),
        percent_noise(c, data.sigma, data.good),
        (found.none.chi2 / count, best.chi2 / count),
    )


def held_out(found: Findings, hypothesis: Hypothesis) -> float:
    """% rms at each pose by the effects fitted without it, mean over poses: one exact linear step from the full fit."""
    c, data = found.bench.campaign, found.data
    x, r = hypothesis.slopes, hypothesis.residual
    gram = x[data.good].T @ x[data.good]
    weak = np.diag(
        (SIZES[-1] * np.concatenate([np.ones(0), *(np.array(e.scale) for e, _ in hypothesis.setting)])) ** -2.0
    )
    scores: list[float] = []
    for pose in range(len(c.pose_names)):
        here = data.good & (c.pose == pose)
        if not here.any():
            continue
        prediction = found.model(hypothesis)
        if x.shape[1]:
            left = gram - x[here].T @ x[here] + weak
            change = -np.linalg.pinv(left, rcond=1e-12) @ (x[here].T @ r[here])
            prediction = prediction + (x @ change) * data.sigma
        scores.append(percent_rms(c, prediction, data.sigma, here))
    return float(np.mean(scores)) if scores else float("nan")


def _where(found: Findings, best: Hypothesis) -> Where:
    c, data = found.bench.campaign, found.data
    nominal = np.where(data.good, found.none.residual, 0.0)
    return Where(
        by_direction(c, nominal),
        _components(found),
        c.pose_names,
        by_pose(c, nominal),
        by_pose(c, np.where(data.good, best.residual, 0.0)),
    )


def _components(found: Findings) -> dict[str, float]:
    """Each component's share of the misfit: the mix of what their signatures take of it alone that comes nearest."""
    from scipy.optimize import nnls  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

    state = found.bench.state()
    good, r = found.data.good, found.none.residual[found.data.good]
    parts: dict[str, Array] = {}
    for term in [*library(), *rivals()]:
        component = _component_of(term)
        if not component or not term.scale:
            continue
        x = (state.columns(term) / found.data.sigma[:, None])[good] * np.array(term.scale)
        gram = x.T @ x
        ridge = np.eye(len(gram)) * (1e-9 * float(np.trace(gram)) + 1e-12)
        part = x @ np.linalg.solve(gram + ridge, x.T @ r)
        if component not in parts or part @ part > parts[component] @ parts[component]:
            parts[component] = part
    mix = cast("Array", nnls(np.stack(list(parts.values()), axis=1), r)[0])
    taken = {name: float(m * (part @ part)) for (name, part), m in zip(parts.items(), mix, strict=True)}
    total = sum(taken.values())
    return {name: gain / total for name, gain in taken.items() if gain > 1e-3 * total} if total > 0.0 else {}


def _component_of(term: Term) -> str:
    if term.effect == "actuator-stiffness" and term.place != "limbs":
        return f"{term.place}.actuator"
    if term.effect == "link-stiffness" and term.place != "links":
        return term.place
    if term.place.startswith("one slider alone"):
        return f"{term.place.split(', ')[1]}.slider"
    if term.effect in {"joint-compliance", "guide-compliance", "base-compliance", "platform-compliance"}:
        return term.place
    return "instrument" if term.effect in {"displacement-scale", "instrument-misalignment"} else ""


def _steps(found: Findings, best: Hypothesis) -> tuple[tuple[str, float], ...]:
    """The waterfall: the gap before, after each effect alone, after all, held out, and what noise alone leaves."""
    gap = _gap(found, best)
    alone = [(f"{e.effect} @ {e.place}", e.gap_after) for e in _effects(found, best)]
    together = [("together", gap.explained)] if len(alone) > 1 else []
    return (("nominal", gap.nominal), *alone, *together, ("held out", gap.held_out), ("noise", gap.noise))


def _likeness(found: Findings) -> tuple[tuple[str, ...], tuple[tuple[float, ...], ...]]:
    """How alike the signatures of single-parameter effects are in these readings: |cosine|."""
    state = found.bench.state()
    terms = [e for e in library() if len(e.scale) == 1]
    x = np.hstack([state.columns(e) for e in terms]) / found.data.sigma[:, None]
    size = np.linalg.norm(x, axis=0)
    x = x / np.where(size > 0.0, size, 1.0)
    return tuple(e.name for e in terms), tuple(tuple(float(v) for v in row) for row in np.abs(x.T @ x))


def _too_weak(found: Findings) -> list[str]:
    """Effects of known size that would have to be many times stronger than they are."""
    if found.bench.gravity:
        return []
    column = (found.bench.state().weight_column() / found.data.sigma)[found.data.good]
    size = float(column @ column)
    if size <= 0.0:
        return []
    strength = float(column @ found.none.residual[found.data.good]) / size
    error = 1.0 / np.sqrt(size)
    if abs(strength) > 3.0 and abs(strength) > 3.0 * error:
        return [
            f"gravity would have to be {strength:.3g} times what it is to explain the gap best, so it is not the cause"
        ]
    return []


def _bounds(found: Findings) -> list[str]:
    """Readings of stiffness above what any such machine can have."""
    from stiffscope.vjm.biglide import link_angle
    from stiffscope.vjm.bounds import stiffness_bounds

    c = found.bench.campaign
    stiff = np.flatnonzero((c.kind == STIFFNESS) & found.data.good)
    if not len(stiff):
        return []
    robot = found.bench.robot
    bounds = stiffness_bounds(robot, link_angle(robot.geometry, c.poses))
    limit = bounds[c.pose[stiff], c.direction[stiff]]
    over = (c.value[stiff] - limit) / found.data.sigma[stiff] > STRONG
    axes = sorted({f"k{AXES[d]}" for d in c.direction[stiff[over]]})
    if not axes:
        return []
    worst = float((c.value[stiff] / limit)[over].max())
    over = f"{', '.join(axes)} exceed what the machine can have, up to {worst:.3g} times"
    return [f"{over}: no added compliance or weight cures that"]

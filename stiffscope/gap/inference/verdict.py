"""Verdict on a search: certain effects, remaining gap and open questions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, permutations
from typing import TYPE_CHECKING

from stiffscope.gap.inference.findings import CONFIDENT
from stiffscope.gap.inference.lack_of_fit import lack_of_fit, model_errors
from stiffscope.gap.inference.plausibility import implausible

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.gap.forward.forward_model import Candidate
    from stiffscope.gap.inference.findings import Findings, Group
    from stiffscope.gap.inference.hypothesis import Hypothesis

MAJORITY = 0.5  # least probability of no gap, and of known effects in a group
FEW = 3  # least readings per parameter for an identification
POSSIBLE = 0.02  # least probability of an effect listed as possible
MENTIONED = 3  # most patterns mentioned as substitutes of an effect


@dataclass(frozen=True)
class Judgement:
    """A verdict, its named effects, and the hypothesis whose gap is reported."""

    verdict: str
    """identified, partly, ambiguous, unexplained or no-gap."""
    effects: tuple[Candidate, ...]
    hypothesis: Hypothesis
    """Hypothesis of exactly these effects."""
    remarks: tuple[str, ...]


def judge_findings(found: Findings) -> Judgement:
    """Return the verdict.

    An effect is certain if it, or its group of at most three, has the probability `CONFIDENT`,
    mostly by known effects and by the readings rather than prior odds, and plausible parameters.
    None is if the likeliest set, or its certain effects, leave a greater χ² than no effect. With
    certain effects the verdict is "identified" if they reduce the gap to the noise, and "partly"
    if not or if a nuisance pattern is also certain; without, "no-gap" or "unexplained", if the gap
    is within the noise or not. It is "ambiguous" if known effects reduce the gap to the noise but
    the main one is open, because a pattern or a like unnamed fault may replace it.
    """
    best = found.best
    none = found.none
    wrong = {c.name: implausible(c, found.best) for c in best.words}
    strange = [text for texts in wrong.values() for text in texts]
    unnamed = sorted(c.describe(v) for c, v in best.parameters if c.is_nuisance)
    if unnamed:
        strange.append(
            f"the readings follow {', '.join(unnamed)}, outside the known effects"
        )
    groups = {c.name: found.group(c.name) for c in best.words}
    certain = [c for c in best.words if not wrong[c.name] and _certain(groups[c.name])]
    favoured = [
        n
        for n, group in groups.items()
        if group.doubted < CONFIDENT <= group.probability
    ]
    unsettled = [
        f"{found.find_instead(name)} fits about as well as {name}" for name in favoured
    ]
    kept = found.fit_effects(certain)
    before = found.chi2(none)
    other = found.fit_named(certain)
    if other is not kept and lack_of_fit(found, kept) and not lack_of_fit(found, other):
        kept = other  # beside others another form was likelier, by a hair
    if (
        certain and max(found.chi2(kept), found.chi2(best)) >= before
    ):  # they fit details only
        certain = []
        kept = none
    count = int(found.used_readings.sum())
    parameters = len(kept.values)
    few = count < FEW * (parameters + 1)
    if few:
        unsettled.append(
            f"{count} readings are too few to identify {parameters} parameters"
        )
    if certain and not few:
        return _judge(found, kept, strange, unsettled)
    gap = lack_of_fit(found, none)
    if gap:
        known = found.fit_effects(best.words)
        rest = lack_of_fit(found, known)
        if not best.words or strange or rest:
            left = rest if best.words else gap
            return Judgement(
                "unexplained", (), none, (*strange, *([left] if left else []))
            )
        return Judgement("ambiguous", known.words, known, tuple(unsettled))
    alone = sum(p for h, p in found.ranked if not h.words)
    if alone > MAJORITY or not best.words or strange:
        return Judgement("no-gap", (), none, tuple(strange))
    known = found.fit_effects(best.words)
    return Judgement("ambiguous", known.words, known, tuple(unsettled))


def settle_verdict(
    found: Findings, judgement: Judgement, others: dict[str, Findings]
) -> Judgement:
    """Return the verdict, or "ambiguous" if an effect is replaced under another prior.

    Parameters
    ----------
    found, judgement
        A search and its verdict.
    others
        The same hypotheses under other priors, by description of the prior.
    """
    for prior, other in others.items() if judgement.verdict == "identified" else ():
        names = [c.name for c in judgement.effects]
        lost = [
            name
            for name in names
            if not other.best.names & {name, *found.group(name).others}
        ]
        if lost:
            instead = " and ".join(sorted(other.best.names)) or "no effect"
            text = (
                f"not {' and '.join(lost)} but {instead} is most probable with {prior}"
            )
            return replace(
                judgement, verdict="ambiguous", remarks=(*judgement.remarks, text)
            )
    return judgement


def _judge(
    found: Findings, kept: Hypothesis, strange: list[str], unsettled: list[str]
) -> Judgement:
    """Return the verdict if some effects are certain.

    kept: exactly these; strange: implausible or unnamed causes; unsettled: equally good ones.
    """
    rest = lack_of_fit(found, kept)
    names = [c.name for c in kept.words]
    if rest and not strange:
        known = found.fit_effects(found.best.words)
        if not lack_of_fit(found, known) and _main(found, known) not in names:
            open_ones = ", ".join(c.name for c in known.words if c.name not in names)
            text = f"certain: {', '.join(names)}; uncertain: {open_ones}"
            return Judgement("ambiguous", known.words, known, (text, *unsettled))
    if rest or _pattern_beside(found, kept):
        verdict = "partly"
    else:
        main = found.group(_main(found, kept))
        verdict = (
            "identified"
            if main.known >= CONFIDENT and not main.elsewhere
            else "ambiguous"
        )
    remarks = (
        *strange,
        *unsettled,
        *([rest] if rest else []),
        *_imitations(found, kept.names),
    )
    return Judgement(verdict, kept.words, kept, remarks)


def _certain(group: Group) -> bool:
    """Return whether a group is certain, and known effects are more likely than not."""
    return group.doubted >= CONFIDENT and group.known > MAJORITY


def _pattern_beside(found: Findings, kept: Hypothesis) -> bool:
    """Return whether a nuisance pattern is also certain and exceeds small model errors."""
    unnamed = sum(p for h, p in found.ranked if len(h.words) < len(h.candidates))
    excess = found.chi2(kept) - found.chi2(found.best)
    return unnamed >= CONFIDENT and excess > model_errors(found, kept)


def _imitations(found: Findings, names: frozenset[str]) -> Iterator[str]:
    """Yield remarks on nuisance patterns that fit nearly as well as named effects."""
    for name, patterns in found.imitating_patterns.items():
        if name in names:
            places = " or ".join(c.place for c in patterns[:MENTIONED])
            yield f"{places} would explain the readings nearly as well as {name}"


def _main(found: Findings, hypothesis: Hypothesis) -> str:
    """Return the effect that alone explains the most; of two, it also has the larger share."""
    return min(
        hypothesis.candidates, key=lambda c: found.chi2(found.fit_effects([c]))
    ).name


def shares(found: Findings, hypothesis: Hypothesis) -> dict[str, float]:
    """Return each effect's Shapley share of the explained χ²: its mean gain over all orders.

    Every subset of the effects is fitted like any hypothesis, so an effect that fits the readings
    only with impossible or unlikely values explains nothing alone. The shares sum to 1.

    References
    ----------
    Shapley, A value for n-person games (1953); Lipovetsky, Conklin, Appl. Stoch. Models 17 (2001).
    """
    names = [c.name for c in hypothesis.candidates]
    if len(names) < 2:
        return dict.fromkeys(names, 1.0)
    left = {frozenset[str](): found.chi2(found.none)}
    for count in range(1, len(names) + 1):
        for chosen in map(frozenset, combinations(names, count)):
            own = found.fit_effects(
                c for c in hypothesis.candidates if c.name in chosen
            )
            left[chosen] = min(
                found.chi2(own), *(left[chosen - {name}] for name in chosen)
            )
    value = dict.fromkeys(names, 0.0)
    for order in permutations(names):
        for k, name in enumerate(order):
            value[name] += left[frozenset(order[:k])] - left[frozenset(order[: k + 1])]
    positive = {name: max(v, 0.0) for name, v in value.items()}
    total = sum(positive.values())
    return {
        name: v / total if total > 0.0 else 1.0 / len(names)
        for name, v in positive.items()
    }


def doubtful(found: Findings, named: tuple[Candidate, ...]) -> list[tuple[str, float]]:
    """Return possible effects, `effect @ place`, besides the named groups, with probabilities.

    Each has a probability, given or with equal odds of all effects, of at least `POSSIBLE`.
    """
    groups: list[Group] = [found.group(c.name) for c in named]
    known = {c.name for c in named} | {
        other for group in groups for other in group.others
    }
    names = {n for h in found.hypotheses for c in h.words for n in c.signature_of}
    likely = {n: found.compute_probability(n) for n in names - known}
    even = found.doubted.compute_probability
    open_ones = (n for n, p in likely.items() if max(p, even(n)) >= POSSIBLE)
    return sorted(
        ((n, likely[n]) for n in open_ones), key=lambda item: (-item[1], item[0])
    )

"""The verdict on a search: which effects are certain, whether they bring the gap to the noise, what is left."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, permutations
from typing import TYPE_CHECKING

from stiffscope.gap.inference.lack_of_fit import lack_of_fit, model_errors
from stiffscope.gap.inference.plausibility import implausible

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from stiffscope.gap.forward.forward_model import Candidate
    from stiffscope.gap.inference.findings import Findings, Group
    from stiffscope.gap.inference.hypothesis import Hypothesis

CONFIDENT = 0.9  # probability from which an effect, or its group, is certain
MAJORITY = 0.5  # probability from which there is no gap, and a group has a word
FEW = 3  # readings a parameter below which nothing is identified
POSSIBLE = 0.02  # probability from which an effect is worth naming as possible
MENTIONED = 3  # patterns at most that would do in the place of an effect


@dataclass(frozen=True)
class Judgement:
    """A verdict, the effects that it names, and the hypothesis whose gap is reported."""

    verdict: str
    """identified, partly, ambiguous, unexplained or no-gap."""
    effects: tuple[Candidate, ...]
    hypothesis: Hypothesis
    """These effects and no others."""
    remarks: tuple[str, ...]


def judge_findings(found: Findings) -> Judgement:
    """The verdict.

    An effect is certain when it, or its group of at most three, has a probability of `CONFIDENT`, most of it with a
    word, by what the readings say and not by its prior odds alone, and plausible parameters; none is where the
    likeliest set, or what is certain of it, leaves a greater χ² than no effect at all.
    With certain effects the verdict is "identified" where they bring the gap to the noise and "partly" where they do
    not, or where a nuisance pattern is certain beside them; without, "no-gap" or "unexplained", as the gap is within
    the noise or beyond. It is "ambiguous" where known effects bring the gap to the noise of which the main one is not
    settled, be it that a pattern may stand in its place, or that it may be the same fault where it has no word.
    """
    best, none = found.best, found.none
    wrong = {c.name: implausible(c, found.best) for c in best.words}
    strange = [text for texts in wrong.values() for text in texts]
    unnamed = sorted(c.place for c in best.candidates if c.is_nuisance)
    if unnamed:
        strange.append(f"the readings follow {', '.join(unnamed)}, for which the vocabulary has no word")
    groups = {c.name: found.group(c.name) for c in best.words}
    certain = [c for c in best.words if not wrong[c.name] and _certain(groups[c.name])]
    favoured = [name for name, group in groups.items() if group.doubted < CONFIDENT <= group.probability]
    unsettled = [f"{found.find_instead(name)} fits about as well as {name}" for name in favoured]
    kept, before = found.fit_effects(certain), found.chi2(none)
    if certain and max(found.chi2(kept), found.chi2(best)) >= before:  # beside a discrepancy they follow details alone
        certain, kept = [], none
    count, parameters = int(found.used_readings.sum()), len(kept.values)
    few = count < FEW * (parameters + 1)
    if few:
        unsettled.append(f"{count} readings are too few to identify {parameters} parameters")
    if certain and not few:
        return _judge_named(found, kept, strange, unsettled)
    gap = lack_of_fit(found, none)
    if gap:
        known = found.fit_effects(best.words)
        rest = lack_of_fit(found, known)
        if not best.words or strange or rest:
            left = rest if best.words else gap
            return Judgement("unexplained", (), none, (*strange, *([left] if left else [])))
        return Judgement("ambiguous", known.words, known, tuple(unsettled))
    alone = sum(p for h, p in zip(found.hypotheses, found.probability, strict=True) if not h.words)
    if alone > MAJORITY or not best.words or strange:
        return Judgement("no-gap", (), none, tuple(strange))
    known = found.fit_effects(best.words)
    return Judgement("ambiguous", known.words, known, tuple(unsettled))


def settle_verdict(found: Findings, judgement: Judgement, others: Mapping[str, Findings]) -> Judgement:
    """A verdict that its own checks carry: "ambiguous" where under another prior an effect loses its place.

    Parameters
    ----------
    found, judgement
        A search and its verdict.
    others
        The same hypotheses under other priors, by what these are.

    """
    for prior, other in others.items() if judgement.verdict == "identified" else ():
        names = [c.name for c in judgement.effects]
        lost = [name for name in names if not other.best.names & {name, *found.group(name).others}]
        if lost:
            instead = " and ".join(sorted(other.best.names)) or "no effect"
            text = f"not {' and '.join(lost)} but {instead} is likeliest with {prior}"
            return replace(judgement, verdict="ambiguous", remarks=(*judgement.remarks, text))
    return judgement


def _judge_named(found: Findings, kept: Hypothesis, strange: Sequence[str], unsettled: Sequence[str]) -> Judgement:
    """The verdict where some effects are certain.

    kept: these and no others; strange: what is implausible, or has no word; unsettled: what fits as well as others.
    """
    rest, names = lack_of_fit(found, kept), [c.name for c in kept.words]
    if rest and not strange:
        known = found.fit_effects(found.best.words)
        if not lack_of_fit(found, known) and _main(found, known) not in names:
            open_ones = ", ".join(c.name for c in known.words if c.name not in names)
            text = f"certain: {', '.join(names)}; not settled: {open_ones}"
            return Judgement("ambiguous", known.words, known, (text, *unsettled))
    if rest or _pattern_beside(found, kept):
        verdict = "partly"
    else:
        main = found.group(_main(found, kept))
        verdict = "identified" if main.known >= CONFIDENT and not main.elsewhere else "ambiguous"
    remarks = (*strange, *unsettled, *([rest] if rest else []), *_imitations(found, kept.names))
    return Judgement(verdict, kept.words, kept, remarks)


def _certain(group: Group) -> bool:
    """Whether it is certain that one of a group is at work, and more likely than not one with a word."""
    return group.doubted >= CONFIDENT and group.known > MAJORITY


def _pattern_beside(found: Findings, kept: Hypothesis) -> bool:
    """Whether a nuisance pattern is certain beside effects, and explains more than the model's own small errors."""
    pairs = zip(found.hypotheses, found.probability, strict=True)
    unnamed = sum(p for h, p in pairs if len(h.words) < len(h.candidates))
    return unnamed >= CONFIDENT and found.chi2(kept) - found.chi2(found.best) > model_errors(found, kept)


def _imitations(found: Findings, names: frozenset[str]) -> Iterator[str]:
    """A line for each effect that is named: which nuisance patterns would do nearly as well in its place."""
    for name, patterns in found.imitating_patterns.items():
        if name in names:
            places = " or ".join(c.place for c in patterns[:MENTIONED])
            yield f"{places} would explain the readings nearly as well as {name}"


def _main(found: Findings, hypothesis: Hypothesis) -> str:
    """The effect of a hypothesis that explains the most alone: of two that with the greater share, too."""
    return min(hypothesis.candidates, key=lambda c: found.chi2(found.fit_effects([c]))).name


def shares(found: Findings, hypothesis: Hypothesis) -> dict[str, float]:
    """Share of every effect in the explained χ², by Shapley's value: its gain, averaged over all orders of adding.

    Every subset of the effects is fitted by itself, as any hypothesis is: what follows the readings only with values
    that it cannot have, or that are not likely, explains nothing alone. The shares add up to 1.

    References
    ----------
    Shapley, A value for n-person games (1953); Lipovetsky and Conklin, Appl. Stoch. Models Bus. Ind. 17 (2001) 319.

    """
    names = [c.name for c in hypothesis.candidates]
    if len(names) < 2:
        return dict.fromkeys(names, 1.0)
    left = {frozenset[str](): found.chi2(found.none)}
    for count in range(1, len(names) + 1):
        for chosen in map(frozenset, combinations(names, count)):
            own = found.fit_effects(c for c in hypothesis.candidates if c.name in chosen)
            left[chosen] = min(found.chi2(own), *(left[chosen - {name}] for name in chosen))
    value = dict.fromkeys(names, 0.0)
    for order in permutations(names):
        for k, name in enumerate(order):
            value[name] += left[frozenset(order[:k])] - left[frozenset(order[: k + 1])]
    positive = {name: max(v, 0.0) for name, v in value.items()}
    total = sum(positive.values())
    return {name: v / total if total > 0.0 else 1.0 / len(names) for name, v in positive.items()}


def doubtful(found: Findings, named: tuple[Candidate, ...]) -> list[tuple[str, float]]:
    """Effects, `effect @ place`, that may be at work beside the named ones and their groups, with probability.

    They are worth a word by it, or by what it would be if all effects were equally likely.
    """
    groups: list[Group] = [found.group(c.name) for c in named]
    known = {c.name for c in named} | {other for group in groups for other in group.others}
    names = {n for h in found.hypotheses for c in h.words for n in c.signature_of}
    likely = {n: found.compute_probability(n) for n in names - known}
    open_ones = (n for n, p in likely.items() if max(p, found.doubted.compute_probability(n)) >= POSSIBLE)
    return sorted(((n, likely[n]) for n in open_ones), key=lambda item: (-item[1], item[0]))

"""Verdict on a search: certain effects, remaining gap and open questions."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import combinations, permutations
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.inference.lack_of_fit import (
    agrees,
    lack_of_fit,
    misses_lines,
    model_errors,
)
from stiffscope.gap.inference.plausibility import (
    implausible,
    impossible,
    own_part,
    physical_sigma,
)
from stiffscope.gap.inference.settings import GROUPS, PLAUSIBLE, VERDICT

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from stiffscope.gap.forward.forward_model import Candidate
    from stiffscope.gap.inference.findings import Findings, Group
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array


@dataclass(frozen=True)
class Judgement:
    """A verdict, its named effects, and the hypothesis whose gap is reported."""

    verdict: str
    """identified, partly, ambiguous, unexplained or no-gap."""
    effects: tuple[Candidate, ...]
    hypothesis: Hypothesis
    """Hypothesis of exactly these effects."""
    remarks: tuple[str, ...]
    alike: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, Any])
    """Causes along the line of an effect, by its name, that fit the readings as well."""


def judge_findings(found: Findings) -> Judgement:
    """Return the verdict.

    An effect is certain if it, or its group, has the probability `GROUPS.confident`, mostly by known effects
    and by the readings rather than prior odds, plausible parameters, and explains part of the gap.
    None is if the likeliest set, or its certain effects, leave a greater χ² than no effect. With
    certain effects the verdict is "identified" if they reduce the gap to the noise, and "partly"
    if not, if a nuisance pattern is also certain, if a cause is that explains too little to be
    named, or if an instrument is found elsewhere than stated; without, "no-gap" or "unexplained",
    if the gap is within the noise or not. It is "ambiguous" if known effects reduce the gap to the noise but
    the main one is open, because a pattern or a like unnamed fault may replace it.
    """
    none = found.none
    sifted = _sift(found)
    certain = sifted.certain
    kept = found.fit_effects(certain)
    other = found.fit_named(certain)
    if other is not kept and lack_of_fit(found, kept) and not lack_of_fit(found, other):
        kept = other  # beside others another form was likelier, by a hair
    left = max(found.chi2(kept), found.chi2(found.best))
    if certain and left >= found.chi2(none):  # they fit details only
        certain = []
        kept = none
    count = int(found.used_readings.sum())
    parameters = _count_shown(found, kept)
    few = count < VERDICT.few * (parameters + 1)
    if few:
        sifted.unsettled.append(
            f"{count} readings are too few to identify {parameters:.0f} parameters"
        )
    if certain and not few:
        return _judge(found, kept, sifted)
    return _judge_uncertain(found, sifted)


def _judge_uncertain(found: Findings, sifted: _Sifted) -> Judgement:
    """Return the verdict if no effect is certain."""
    best = found.best
    none = found.none
    strange = sifted.strange
    refused = (*strange, *sifted.reasons)
    if gap := lack_of_fit(found, none):
        known = found.fit_effects(best.words)
        rest = lack_of_fit(found, known)
        if not best.words or strange or rest:
            left = rest if best.words else gap
            remarks = (*refused, *([left] if left else []))
            return Judgement("unexplained", (), none, remarks)
        return Judgement("ambiguous", known.words, known, tuple(sifted.unsettled))
    alone = sum(p for h, p in found.ranked if not h.words)
    guessed = found.problem.noise.scaled.any() and alone <= VERDICT.majority and strange
    if guessed or sifted.displaced:  # of unknown noise, or against what is stated
        return Judgement("unexplained", (), none, refused)
    if alone > VERDICT.majority or not best.words or strange:
        return Judgement("no-gap", (), none, tuple(strange))
    known = found.fit_effects(best.words)
    return Judgement("ambiguous", known.words, known, tuple(sifted.unsettled))


@dataclass(frozen=True)
class _Sifted:
    """The effects of the likeliest set that are certain, and why others are not."""

    certain: list[Candidate]
    strange: list[str]
    """Remarks on what no known effect explains."""
    unsettled: list[str]
    """Remarks on what is open."""
    little: list[str]
    """Names of probable effects that explain too little to be certain."""
    reasons: list[str]
    """Why nothing can be certain."""
    displaced: bool
    """Whether instruments are found elsewhere than stated without any effect."""


def _sift(found: Findings) -> _Sifted:
    """Return the certain effects; none if responses or the places of instruments refuse them."""
    sifted = _find_certain(found)
    missed = find_missed_lines(found, sifted.certain)
    moved = found.model.find_displaced()
    if missed:
        sifted.unsettled.append(missed)
        sifted = replace(sifted, certain=[], reasons=[missed])
    if moved.left is not None and moved.remarks and agrees(found, moved.left):
        # without what is stated of these instruments there is no gap
        strange = [*moved.remarks, *sifted.strange]
        sifted = replace(sifted, certain=[], strange=strange)
    return replace(sifted, displaced=bool(moved.remarks))


def find_missed_lines(found: Findings, certain: Sequence[Candidate]) -> str:
    """Return why no effect is certain by lines that the likeliest set or the certain ones leave.

    Effects beside these, too small to be certain, may be what follows an unknown cause.
    """
    if not certain:
        return ""
    missed = misses_lines(found, found.best)
    return missed or misses_lines(found, found.fit_effects(certain))


def _count_shown(found: Findings, hypothesis: Hypothesis) -> float:
    """Return how many parameters of a hypothesis readings determine, of which the prior tells less."""
    columns = found.slopes(hypothesis)[found.used_readings] * hypothesis.known.scales
    gram = columns.T @ columns
    return float(np.trace(np.linalg.solve(gram + np.eye(len(gram)), gram)))


def _find_certain(found: Findings) -> _Sifted:
    """Return the certain effects of the likeliest set, by their probabilities and sizes."""
    best = found.best
    wrong = {c.name: impossible(c, found.best) for c in best.words}
    strange = [text for texts in wrong.values() for text in texts]
    unnamed = sorted(c.describe(v) for c, v in best.parameters if c.is_nuisance)
    if unnamed:
        strange.append(
            f"the readings follow {', '.join(unnamed)}, outside the known effects"
        )
    groups = {c.name: found.group(c.name) for c in best.words}
    unsettled = [
        f"{found.find_instead(name)} fits about as well as {name}"
        for name, group in groups.items()
        if group.doubted < GROUPS.confident <= group.probability
    ]
    probable = [
        c
        for c in best.words
        if not wrong[c.name] and _certain(groups[c.name]) and not _bends(found, c)
    ]
    resting = {c.name: _find_play(found, c) for c in probable}
    unsettled += [
        f"{name} is no larger than {play}: it may be where the drive rests in its gap"
        for name, play in resting.items()
        if play
    ]
    probable = [c for c in probable if not resting[c.name]]
    certain, little = _keep_explaining(found, probable)
    if little:
        unsettled.append(
            f"{' and '.join(little)} would explain less than "
            f"{100.0 * VERDICT.explains:.0f} % of the gap: not certain"
        )
    return _Sifted(certain, strange, unsettled, little, [], displaced=False)


def _find_play(found: Findings, candidate: Candidate) -> str:
    """Return the dead zone within which an offset of the same drive may be its rest; else "".

    An unloaded drive with play rests anywhere in its gap, which readings take for an offset.
    """
    for other in found.best.words if candidate.rests_in else ():
        if other.effect != candidate.rests_in or other.members != candidate.members:
            continue
        values: list[float] = []
        variance = 0.0
        for each in (candidate, other):
            internal, covariance = own_part(found.best, each.name)
            values.append(float(np.abs(each.physical(internal)[0])))
            variance += float(physical_sigma(each, internal, covariance)[0]) ** 2
        offset, half_width = values
        if offset <= half_width + PLAUSIBLE.significant * np.sqrt(variance):
            return other.name
    return ""


def settle_verdict(
    found: Findings, judgement: Judgement, others: dict[str, tuple[Findings, str]]
) -> Judgement:
    """Return the verdict, or "ambiguous" if it rests on the prior, or on the number of parameters.

    Parameters
    ----------
    found, judgement
        A search and its verdict.
    others
        The same hypotheses under other priors and their verdicts, by description of the prior.
    """
    if judgement.verdict == "partly":
        plainer = find_plainer(found, judgement.hypothesis)
        return replace(judgement, alike=plainer, remarks=_remark(judgement, plainer))
    if judgement.verdict != "identified":
        return judgement
    for prior, (other, verdict) in others.items():
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
        elif verdict in {"ambiguous", "unexplained", "no-gap"}:
            text = f"with {prior} the verdict is {verdict}"
        else:
            continue
        remarks = (*judgement.remarks, text)
        return replace(judgement, verdict="ambiguous", remarks=remarks)
    alike = find_alike(found, judgement.hypothesis)
    for name, plain in find_plainer(found, judgement.hypothesis).items():
        alike[name] = tuple(dict.fromkeys([*alike.get(name, ()), *plain]))
    if not alike:
        return judgement
    remarks = _remark(judgement, alike)
    return replace(judgement, verdict="ambiguous", remarks=remarks, alike=alike)


def _remark(
    judgement: Judgement, alike: Mapping[str, tuple[str, ...]]
) -> tuple[str, ...]:
    """Return the remarks of a verdict, and those on causes that fit as well."""
    texts = (
        f"{' or '.join(others)} fits as well as {name}"
        for name, others in alike.items()
    )
    return (*judgement.remarks, *texts)


def _judge(found: Findings, kept: Hypothesis, sifted: _Sifted) -> Judgement:
    """Return the verdict if some effects are certain; kept: the hypothesis of exactly these."""
    strange = sifted.strange
    unsettled = sifted.unsettled
    rest = lack_of_fit(found, kept)
    moved = found.model.find_displaced(kept.parameters).remarks
    names = [c.name for c in kept.words]
    if rest and not strange:
        known = found.fit_effects(found.best.words)
        if not lack_of_fit(found, known) and _main(found, known) not in names:
            open_ones = ", ".join(c.name for c in known.words if c.name not in names)
            text = f"certain: {', '.join(names)}; uncertain: {open_ones}"
            return Judgement("ambiguous", known.words, known, (text, *unsettled))
    if rest or sifted.little or moved or _pattern_beside(found, kept):
        verdict = "partly"
    else:
        main = found.group(_main(found, kept))
        verdict = (
            "identified"
            if main.known >= GROUPS.confident and not main.elsewhere
            else "ambiguous"
        )
    remarks = (
        *strange,
        *unsettled,
        *moved,
        *([rest] if rest else []),
        *_imitations(found, kept.names),
    )
    return Judgement(verdict, kept.words, kept, remarks)


def _keep_explaining(
    found: Findings, certain: Sequence[Candidate]
) -> tuple[list[Candidate], list[str]]:
    """Return effects that explain part of the gap, possibly, and names of what explains too little."""
    left = list(certain)
    little: list[str] = []
    while left:
        whole = found.fit_effects(left)
        part = _explained_parts(found, whole)
        weak = [
            c for c in left if part[c.name] < VERDICT.explains or impossible(c, whole)
        ]
        if not weak:
            break
        least = min(weak, key=lambda c: part[c.name])
        left.remove(least)
        if not impossible(least, whole):
            little.append(least.name)
    return left, little


def _explained_parts(found: Findings, whole: Hypothesis) -> dict[str, float]:
    """Return the part of the gap beyond the noise that each effect of a hypothesis explains.

    It is what is left without it: of two effects that change the readings alike, one may have a
    share and yet add nothing. Where errors of the model are left, which anything fits in part, it
    is no more than what its share of all that they explain would add to this rest. Shares add up in
    χ², of which the gap is the root. A reading in a wrong unit or with a wrong sign makes the gap any
    number of times as large: the parts of others, of such faults too, are those of the gap that is
    left where it is put right.
    """
    misread = [c for c in whole.candidates if c.assumed]
    left = _excess(found, whole)
    share = shares(found, whole) if lack_of_fit(found, whole) else {}
    out: dict[str, float] = {}
    for c in whole.candidates:
        put_right = [each for each in misread if each is not c]
        beside = found.fit_effects(put_right) if put_right else found.none
        gap = max(_excess(found, beside), 1e-300)
        rest = found.fit_effects(each for each in whole.candidates if each is not c)
        own = 1.0
        if share:
            names = [each.name for each in whole.candidates if each not in put_right]
            among = sum(share[name] for name in names)
            own = share[c.name] / among if among > 0.0 else 1.0 / len(names)
        # of what is left without its share, squares add up: E² = L² + share (G² − L²)
        without = np.sqrt((1.0 - own) * left**2 + own * gap**2)
        out[c.name] = (min(without, _excess(found, rest)) - left) / gap
    return out


def adds_little(found: Findings, fewer: Hypothesis, more: Hypothesis) -> bool:
    """Return whether effects that agree with the noise gain little by others: less than counts."""
    gained = _excess(found, fewer) - _excess(found, more)
    small = gained < VERDICT.explains * _excess(found, found.none)
    return small and not lack_of_fit(found, fewer)


def _excess(found: Findings, hypothesis: Hypothesis) -> float:
    """Return the gap beyond the noise, in standard deviations of all readings."""
    count = int(found.used_readings.sum())
    return float(np.sqrt(max(found.chi2(hypothesis) - count, 0.0)))


def find_alike(found: Findings, kept: Hypothesis) -> dict[str, tuple[str, ...]]:
    """Return known causes along the line of each effect of a hypothesis that fit as well, by name.

    A drive and the guide, screw or bearing in series with it yield at every pose in proportion:
    one parameter of the other changes the readings as the effect does, and fewer parameters are
    no reason to prefer it.
    """
    out: dict[str, tuple[str, ...]] = {}
    library = found.problem.library_at(kept)
    used = found.used_readings
    for c in kept.words:
        own = kept.mark(lambda other, c=c: other is c)
        if not own.any() or c.flexible:
            continue
        beside = found.slopes(kept)[used][:, ~own]
        basis = np.linalg.qr(beside)[0] if beside.shape[1] else beside
        change = found.slopes(kept)[used][:, own] @ kept.values[own]
        change = change - basis @ (basis.T @ change)
        names: list[str] = []
        grouped = found.group(c.name).others
        for other in library.candidates:
            if other.name in grouped or not _may_replace(found, kept, c, other):
                continue
            columns = found.whiten(library.differentiate(other))[used]
            columns = columns - basis @ (basis.T @ columns)
            if _left_by_one(change, columns, other) > VERDICT.alike:
                continue
            instead = [other if each is c else each for each in kept.candidates]
            fitted = found.fit_effects(instead)
            ahead = found.chi2(fitted) - found.chi2(kept)
            if ahead <= VERDICT.alike and not implausible(other, fitted):
                names.append(other.name)
        if names:
            out[c.name] = tuple(dict.fromkeys(names))
    return out


def find_plainer(found: Findings, kept: Hypothesis) -> dict[str, tuple[str, ...]]:
    """Return known causes of the same elements with fewer parameters that do nearly as well, by name.

    What an effect has beyond a plainer one, such as a knee beyond a softer drive, is certain only
    if it explains as much of the gap as any effect must. Errors of a model look like such details.
    """
    out: dict[str, tuple[str, ...]] = {}
    misses = bool(lack_of_fit(found, kept))
    for c in kept.words:
        grouped = found.group(c.name).others
        names = [
            other.name
            for other in found.model.library
            if other.members == c.members
            and c.members
            and len(other.scale) < len(c.scale)
            and other.name not in grouped
            and _may_replace(found, kept, c, other)
            and _does_nearly_as_well(found, kept, c, other, misses=misses)
        ]
        if names:
            out[c.name] = tuple(dict.fromkeys(names))
    return out


def _does_nearly_as_well(
    found: Findings, kept: Hypothesis, c: Candidate, other: Candidate, *, misses: bool
) -> bool:
    """Return whether another effect in the place of one adds less to what is left than counts."""
    instead = (other if each is c else each for each in kept.candidates)
    fitted = found.fit_effects(instead)
    more = _excess(found, fitted) - _excess(found, kept)
    small = more < VERDICT.explains * _excess(found, found.none)
    fits = misses or not lack_of_fit(found, fitted)
    return small and fits and not implausible(other, fitted)


def _may_replace(
    found: Findings, kept: Hypothesis, candidate: Candidate, other: Candidate
) -> bool:
    """Return whether another known effect, of parameters that act alone, may stand in its place."""
    if other.is_nuisance or other.flexible or not other.scale or other.groups:
        return False
    same = found.problem.find_cause(other.name) == found.problem.find_cause(
        candidate.name
    )
    if same or other.name in {*candidate.signature_of, *kept.names}:
        return False
    rest = [c for c in kept.candidates if c is not candidate]
    return found.model.admits((*rest, other))


def _left_by_one(change: Array, columns: Array, other: Candidate) -> float:
    """Return the least χ² that one parameter of an effect leaves of a change (n,) of readings."""
    square = np.einsum("nk,nk->k", columns, columns)
    along = change @ columns
    if other.positive:
        along = np.maximum(along, 0.0)
    taken = np.divide(along**2, square, out=np.zeros(len(square)), where=square > 0.0)
    return float(change @ change - taken.max(initial=0.0))


def _certain(group: Group) -> bool:
    """Return whether a group is certain, and known effects are more likely than not."""
    return group.doubted >= GROUPS.confident and group.known > VERDICT.majority


def _bends(found: Findings, candidate: Candidate) -> bool:
    """Return whether what an effect changes also follows a pattern, and that explains as much as counts."""
    own = set(candidate.members)
    patterns = [c for c in found.best.candidates if c.is_nuisance]
    beside = [c for c in patterns if own & set(c.members)]
    if not beside:
        return False
    rest = found.fit_effects(c for c in found.best.candidates if c not in beside)
    gap = max(_excess(found, found.none), 1e-300)
    added = _excess(found, rest) - _excess(found, found.best)
    return added >= VERDICT.explains * gap


def _pattern_beside(found: Findings, kept: Hypothesis) -> bool:
    """Return whether a nuisance pattern is also certain and exceeds small model errors."""
    unnamed = sum(p for h, p in found.ranked if len(h.words) < len(h.candidates))
    excess = found.chi2(kept) - found.chi2(found.best)
    return unnamed >= GROUPS.confident and excess > model_errors(found, kept)


def _imitations(found: Findings, names: frozenset[str]) -> Iterator[str]:
    """Yield remarks on nuisance patterns that fit nearly as well as named effects."""
    for name, patterns in found.imitating_patterns.items():
        if name in names:
            places = " or ".join(c.place for c in patterns[: VERDICT.mentioned])
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

    Each has a probability, given or with equal odds of all effects, of at least `VERDICT.possible`.
    """
    groups: list[Group] = [found.group(c.name) for c in named]
    known = {c.name for c in named} | {
        other for group in groups for other in group.others
    }
    names = {n for h in found.hypotheses for c in h.words for n in c.signature_of}
    likely = {n: found.compute_probability(n) for n in names - known}
    even = found.doubted.compute_probability
    open_ones = (n for n, p in likely.items() if max(p, even(n)) >= VERDICT.possible)
    return sorted(
        ((n, likely[n]) for n in open_ones), key=lambda item: (-item[1], item[0])
    )

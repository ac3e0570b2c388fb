"""Scores of a blind check: which diagnoses are right, what intervals and stated probabilities are worth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stiffscope.gap.blind.cases import BlindCase

    Same = Callable[[str], str]

GROUP = 3  # a diagnosis may name the truth in a group of at most so many
EVIDENT = 10.0  # ln-odds against no effect from which a single effect must be found
HONEST = 1.2  # times the noise floor, held out
TENTHS = 10
EFFECTS = ("single", "pair", "triple")
"""Kinds of campaigns whose effects the library has."""


@dataclass(frozen=True)
class Outcome:
    """One campaign: what was withheld, what was diagnosed, and whether that is right."""

    number: int
    kind: str
    truth: tuple[str, ...]
    verdict: str
    named: tuple[str, ...]
    """Diagnosed effects, `effect @ place`."""
    groups: tuple[tuple[str, ...], ...]
    """What these readings cannot distinguish from each of them."""
    evidence: float
    """Ln-odds of the best hypothesis against no effect."""
    gap: tuple[float, float, float, float]
    """% rms before, after, held out, noise."""
    covered: tuple[bool, ...]
    """Whether each 95 % interval of a rightly named effect holds the true parameter."""
    left_out: str = ""
    """The effect that was taken out of the library, in a leave-one-effect-out check."""
    robot: str = ""
    style: str = "tool"
    """What was measured."""
    stated: tuple[tuple[float, bool], ...] = ()
    """Probability of each effect that is named or possible, and whether it is true."""
    imitated: bool = False
    """Whether a few effects of the library do the same to the readings as an outside one."""

    @property
    def right(self) -> bool:
        """Whether the diagnosis is the truth, each effect itself or in its group of at most three."""
        if self.kind == "none":
            return self.verdict == "no-gap"
        if self.kind == "outside":
            return not self.confident
        if self.left_out:  # an honest neighbour leaves nothing to be explained
            return not self.confident or self.gap[2] <= HONEST * self.gap[3]
        return len(self.named) == len(self.truth) and _match_effects(
            set(self.truth), list(zip(self.named, self.groups, strict=True))
        )

    @property
    def confident(self) -> bool:
        """Whether an effect was named with confidence."""
        return self.verdict == "identified"


def _match_effects(truth: set[str], named: list[tuple[str, tuple[str, ...]]]) -> bool:
    """Whether every true effect has a diagnosed effect of its own that names it, or a small group that does."""
    if not named:
        return not truth
    name, group = named[0]
    fits = {name, *(group if len(group) < GROUP else ())} & truth
    return any(_match_effects(truth - {effect}, named[1:]) for effect in fits)


def outcome_of(
    number: int, case: BlindCase, found: dict[str, Any], same: Same, *, left_out: str = "", robot: str = "",
    imitated: bool = False,
) -> Outcome:  # fmt: skip
    """The outcome of a campaign.

    Parameters
    ----------
    number, case
        The campaign, and what was withheld of it.
    found
        Its diagnosis.json, and `evidence` where that is known.
    same
        One name for all names of an effect at a place: a set may have several.
    left_out, robot, imitated
        See `Outcome`.

    """
    named = tuple(same(f"{e['effect']} @ {e['place']}") for e in found["effects"])
    confused = [dict.fromkeys(same(n) for n in e["confused_with"]) for e in found["effects"]]
    groups = tuple(tuple(n for n in each if n != own) for own, each in zip(named, confused, strict=True))
    gap = [
        float("nan") if found["gap"][k] is None else found["gap"][k]
        for k in ("nominal", "explained", "held_out", "noise")
    ]
    truth = tuple(same(fault.name) for fault in case.faults)
    return Outcome(
        number,
        case.kind,
        truth,
        found["verdict"],
        named,
        groups,
        float(found.get("evidence") or 0.0),
        (gap[0], gap[1], gap[2], gap[3]),
        () if left_out else _check_covered(case, found, same),
        left_out,
        robot,
        case.style,
        () if left_out or case.kind == "outside" else _collect_stated(set(truth), found, same),
        imitated,
    )


def _collect_stated(truth: set[str], found: dict[str, Any], same: Same) -> tuple[tuple[float, bool], ...]:
    """Probabilities of the effects that are named or possible, and whether each is true."""
    listed = [*found["effects"], *found.get("possible", ())]
    return tuple((float(e["probability"]), same(f"{e['effect']} @ {e['place']}") in truth) for e in listed)


def _check_covered(case: BlindCase, found: dict[str, Any], same: Same) -> tuple[bool, ...]:
    """For every parameter of a rightly named effect, whether its 95 % interval holds the truth."""
    if found["verdict"] == "unexplained" or len(found["effects"]) != len(case.faults):
        return ()
    truth = {same(fault.name): fault.parameters for fault in case.faults}
    out: list[bool] = []
    for effect in found["effects"]:
        planted = truth.get(same(f"{effect['effect']} @ {effect['place']}"))
        if planted is None:
            return ()
        for name, fit in effect["parameters"].items():
            if fit["sigma"] and name in planted and not (effect["effect"] == "payload" and name == "z"):
                low, high = fit.get("interval") or (
                    fit["value"] - 1.96 * fit["sigma"],
                    fit["value"] + 1.96 * fit["sigma"],
                )
                out.append(low <= planted[name] <= high)
    return tuple(out)


@dataclass(frozen=True)
class Scores:
    """The score of a blind check; shares are None where nothing of the kind was drawn."""

    outcomes: tuple[Outcome, ...]
    singles: float | None
    """Share of right diagnoses among single effects with evidence beyond `EVIDENT`."""
    pairs: float | None
    triples: float | None
    false_alarms: float | None
    """Share of no-effect campaigns in which an effect was named."""
    outside: float | None
    """Share of outside effects for which an effect was identified."""
    distinguishable: float | None
    """The same among those that are distinguishable from known effects: no few of the library imitate them."""
    left_out: float | None
    """Share of campaigns, their effect out of the library, without a confident name that leaves something over."""
    coverage: float | None
    """Share of 95 % intervals that hold the true parameter."""
    held_out: float | None
    """Largest held-out gap over the noise floor where an effect was identified rightly."""

    def confusion(self) -> tuple[tuple[str, ...], tuple[str, ...], tuple[tuple[int, ...], ...]]:
        """What was injected alone against what was diagnosed: rows, columns, counts."""
        alone = [o for o in self.outcomes if len(o.truth) <= 1 and not o.left_out]
        rows = sorted({_word(o.truth) for o in alone})
        columns = sorted({_summarize_answer(o) for o in alone})
        table = tuple(
            tuple(sum(_word(o.truth) == row and _summarize_answer(o) == column for o in alone) for column in columns)
            for row in rows
        )
        return tuple(rows), tuple(columns), table

    def calibration(self) -> tuple[tuple[float, float, int], ...]:
        """Reliability of stated probabilities, tenth by tenth where any was stated: mean stated, share true, count."""
        pairs = [pair for o in self.outcomes for pair in o.stated]
        out: list[tuple[float, float, int]] = []
        for tenth in range(TENTHS):
            here = [(p, true) for p, true in pairs if min(int(p * TENTHS), TENTHS - 1) == tenth]
            if here:
                stated, true = np.array(here, dtype=float).T
                out.append((float(stated.mean()), float(true.mean()), len(here)))
        return tuple(out)

    def by_robot(self) -> dict[str, Scores]:
        """The same of each robot."""
        robots = dict.fromkeys(o.robot for o in self.outcomes)
        return {name: score([o for o in self.outcomes if o.robot == name]) for name in robots}


def _word(truth: Sequence[str]) -> str:
    return truth[0].split(" @ ")[0] if truth else "none"


def _summarize_answer(outcome: Outcome) -> str:
    if outcome.verdict in {"no-gap", "unexplained"}:
        return outcome.verdict
    return " + ".join(sorted({n.split(" @ ")[0] for n in outcome.named}))


def score(outcomes: Sequence[Outcome]) -> Scores:
    """Shares of right diagnoses by kind."""
    first = [o for o in outcomes if not o.left_out]
    evident = [o for o in first if o.kind == "single" and o.evidence > EVIDENT]
    held = [o.gap[2] / o.gap[3] for o in first if o.right and o.confident and o.kind in EFFECTS]
    return Scores(
        tuple(outcomes),
        _share([o.right for o in evident]),
        _share([o.right for o in first if o.kind == "pair"]),
        _share([o.right for o in first if o.kind == "triple"]),
        _share([bool(o.named) for o in first if o.kind == "none"]),
        _share([o.confident for o in first if o.kind == "outside"]),
        _share([o.confident for o in first if o.kind == "outside" and not o.imitated]),
        _share([o.right for o in outcomes if o.left_out]),
        _share([c for o in first for c in o.covered]),
        max(held) if held else None,
    )


def _share(flags: Sequence[bool]) -> float | None:
    return float(np.mean(flags)) if flags else None

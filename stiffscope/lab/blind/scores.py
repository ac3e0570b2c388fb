"""Scores of a blind check: right diagnoses, and calibration of intervals and probabilities."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stiffscope.lab.blind.cases import BlindCase

    Same = Callable[[str], str]

GROUP = 6  # largest group that a diagnosis lists: beyond, it does not name the truth
EVIDENT = 10.0  # ln-odds over no effect above which a single effect must be found
HONEST = 1.2  # largest held-out gap over the noise floor
TENTHS = 10
EFFECTS = ("single", "pair", "triple")
"""Kinds of campaigns with effects of the library."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of one campaign: withheld and diagnosed effects."""

    number: int
    kind: str
    truth: tuple[str, ...]
    verdict: str
    named: tuple[str, ...]
    """Diagnosed effects, as `effect @ place`."""
    groups: tuple[tuple[str, ...], ...]
    """Effects that these readings cannot distinguish from each of them."""
    evidence: float
    """Ln-odds of the best hypothesis over no effect."""
    gap: tuple[float, float, float, float]
    """Gap, % rms: before, after, held out and noise."""
    covered: tuple[bool, ...]
    """Whether each 95 % interval of a correctly named effect contains the true parameter."""
    left_out: str = ""
    """Effect excluded from the library in a leave-one-effect-out check."""
    robot: str = ""
    style: str = "tool"
    """Style of the measurements."""
    stated: tuple[tuple[float, bool], ...] = ()
    """Probability of each named or possible effect, and whether it is true."""
    imitated: bool = False
    """Whether a few effects of the library mimic an outside one."""
    redrawn: tuple[str, ...] = ()
    """Effects drawn before, with which the mechanics that measures found no equilibrium."""

    @property
    def right(self) -> bool:
        """Whether the diagnosis is correct, each effect itself or in a group of at most six."""
        if self.kind == "none":
            return self.verdict == "no-gap"
        if self.kind == "outside":
            return not self.confident
        if self.left_out:  # an equivalent effect explains all
            return not self.confident or self.gap[2] <= HONEST * self.gap[3]
        return len(self.named) == len(self.truth) and _match_effects(
            set(self.truth), list(zip(self.named, self.groups, strict=True))
        )

    @property
    def confident(self) -> bool:
        """Whether an effect was identified."""
        return self.verdict == "identified"


def _match_effects(truth: set[str], named: list[tuple[str, tuple[str, ...]]]) -> bool:
    """Return whether every true effect is matched by its own diagnosed effect or small group."""
    if not named:
        return not truth
    name, group = named[0]
    fits = {name, *(group if len(group) < GROUP else ())} & truth
    return any(_match_effects(truth - {effect}, named[1:]) for effect in fits)


def outcome_of(
    number: int,
    case: BlindCase,
    found: dict[str, Any],
    same: Same,
    *,
    left_out: str = "",
    robot: str = "",
    imitated: bool = False,
    redrawn: tuple[str, ...] = (),
) -> Outcome:
    """Return the outcome of a campaign.

    Parameters
    ----------
    number, case
        The campaign's number, and its withheld faults.
    found
        Its diagnosis.json, and `evidence` if known.
    same
        Function to the canonical name of an effect at a place.
    left_out, robot, imitated, redrawn
        See `Outcome`.
    """
    truth = {same(fault.name): fault.parameters for fault in case.faults}
    listed = [*found["effects"], *found.get("possible", ())]
    names = [same(f"{e['effect']} @ {e['place']}") for e in listed]
    named = tuple(names[: len(found["effects"])])
    confused = [dict.fromkeys(map(same, e["confused_with"])) for e in found["effects"]]
    sizes = (found["gap"][k] for k in ("nominal", "explained", "held_out", "noise"))
    a, b, c, d = (float("nan") if size is None else size for size in sizes)
    stated = [
        (float(e["probability"]), n in truth)
        for e, n in zip(listed, names, strict=True)
    ]
    return Outcome(
        number=number,
        kind=case.kind,
        truth=tuple(truth),
        verdict=found["verdict"],
        named=named,
        groups=tuple(
            tuple(n for n in each if n != own)
            for own, each in zip(named, confused, strict=True)
        ),
        evidence=float(found.get("evidence") or 0.0),
        gap=(a, b, c, d),
        covered=() if left_out else _check_covered(truth, named, found),
        left_out=left_out,
        robot=robot,
        style=case.style,
        stated=() if left_out or case.kind == "outside" else tuple(stated),
        imitated=imitated,
        redrawn=redrawn,
    )


def _check_covered(
    truth: dict[str, dict[str, float]], named: Sequence[str], found: dict[str, Any]
) -> tuple[bool, ...]:
    """Return whether the 95 % interval of each parameter of right effects contains the truth."""
    if found["verdict"] == "unexplained" or sorted(named) != sorted(truth):
        return ()
    out: list[bool] = []
    for name, effect in zip(named, found["effects"], strict=True):
        for parameter, fit in effect["parameters"].items():
            if effect["effect"] == "payload" and parameter == "z":
                continue
            if fit["sigma"] and parameter in truth[name]:
                reach = 1.96 * fit["sigma"]
                ends = fit.get("interval") or (
                    fit["value"] - reach,
                    fit["value"] + reach,
                )
                out.append(ends[0] <= truth[name][parameter] <= ends[1])
    return tuple(out)


@dataclass(frozen=True)
class Scores:
    """Scores of a blind check; shares are None if no case of the kind was drawn."""

    outcomes: tuple[Outcome, ...]
    singles: float | None
    """Share of right diagnoses among single effects with evidence above `EVIDENT`."""
    pairs: float | None
    triples: float | None
    false_alarms: float | None
    """Share of no-effect campaigns in which an effect was named."""
    outside: float | None
    """Share of outside effects for which an effect was identified."""
    distinguishable: float | None
    """The same among those that a few known effects cannot mimic."""
    left_out: float | None
    """Share of campaigns with excluded effect that have no confident name with a gap left."""
    coverage: float | None
    """Share of 95 % intervals that contain the true parameter."""
    held_out: float | None
    """Largest ratio of held-out gap to noise floor among correctly identified effects."""

    def confusion(
        self,
    ) -> tuple[tuple[str, ...], tuple[str, ...], tuple[tuple[int, ...], ...]]:
        """Return the confusion matrix of single effects: injected, diagnosed, counts."""
        alone = [o for o in self.outcomes if len(o.truth) <= 1 and not o.left_out]
        rows = sorted({_word(o.truth) for o in alone})
        columns = sorted({_summarize_answer(o) for o in alone})
        counts = Counter((_word(o.truth), _summarize_answer(o)) for o in alone)
        table = tuple(tuple(counts[row, column] for column in columns) for row in rows)
        return tuple(rows), tuple(columns), table

    def calibration(self) -> tuple[tuple[float, float, int], ...]:
        """Return mean stated probability, true share and count for each non-empty tenth."""
        pairs = [pair for o in self.outcomes for pair in o.stated]
        out: list[tuple[float, float, int]] = []
        for tenth in range(TENTHS):
            here = [
                (p, true)
                for p, true in pairs
                if min(int(p * TENTHS), TENTHS - 1) == tenth
            ]
            if here:
                stated, true = np.array(here, dtype=float).T
                out.append((float(stated.mean()), float(true.mean()), len(here)))
        return tuple(out)

    def by_robot(self) -> dict[str, Scores]:
        """Return the scores of each robot."""
        robots = dict.fromkeys(o.robot for o in self.outcomes)
        return {
            name: score([o for o in self.outcomes if o.robot == name])
            for name in robots
        }


def _word(truth: Sequence[str]) -> str:
    return truth[0].split(" @ ")[0] if truth else "none"


def _summarize_answer(outcome: Outcome) -> str:
    if outcome.verdict in {"no-gap", "unexplained"}:
        return outcome.verdict
    return " + ".join(sorted({n.split(" @ ")[0] for n in outcome.named}))


def score(outcomes: Sequence[Outcome]) -> Scores:
    """Return the shares of right diagnoses by kind."""
    first = [o for o in outcomes if not o.left_out]
    evident = [o for o in first if o.kind == "single" and o.evidence > EVIDENT]
    held = [
        o.gap[2] / o.gap[3]
        for o in first
        if o.right and o.confident and o.kind in EFFECTS
    ]
    return Scores(
        outcomes=tuple(outcomes),
        singles=_share([o.right for o in evident]),
        pairs=_share([o.right for o in first if o.kind == "pair"]),
        triples=_share([o.right for o in first if o.kind == "triple"]),
        false_alarms=_share([bool(o.named) for o in first if o.kind == "none"]),
        outside=_share([o.confident for o in first if o.kind == "outside"]),
        distinguishable=_share(
            [o.confident for o in first if o.kind == "outside" and not o.imitated]
        ),
        left_out=_share([o.right for o in outcomes if o.left_out]),
        coverage=_share([c for o in first for c in o.covered]),
        held_out=max(held) if held else None,
    )


def _share(flags: Sequence[bool]) -> float | None:
    return float(np.mean(flags)) if flags else None

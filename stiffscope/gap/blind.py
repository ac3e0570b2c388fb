"""The blind check: campaigns with withheld effects are diagnosed, the seal is opened, the answers are scored."""

from __future__ import annotations

import json
import multiprocessing
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.blind_cases import Lot, draw, seal, unseal, write_lot
from stiffscope.gap.diagnose import answer, find
from stiffscope.gap.effects import effect_named, library
from stiffscope.gap.readings import load_campaign

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from stiffscope.gap.diagnosis import Diagnosis
    from stiffscope.vjm.biglide import Biglide

    Progress = Callable[[str, float], None]

GROUP = 3  # an answer may name the truth in a group of at most so many
EVIDENT = 10.0  # ln-odds against no effect from which a single effect must be found
HONEST = 1.2  # times the noise floor, held out


@dataclass(frozen=True)
class Outcome:
    """One campaign: what was withheld, what was answered, and whether that was right."""

    number: int
    kind: str
    truth: tuple[str, ...]
    verdict: str
    named: tuple[str, ...]
    """Effects of the answer, `effect @ place`."""
    groups: tuple[tuple[str, ...], ...]
    """What each of them cannot be told apart from."""
    evidence: float
    """Ln-odds of the answer against no effect."""
    gap: tuple[float, float, float, float]
    """% rms before, after, held out, noise."""
    covered: tuple[bool, ...]
    """Whether each 95 % interval of a rightly named effect holds the true parameter."""
    left_out: str = ""
    """The effect that was taken out of the library, in a leave-one-effect-out check."""

    @property
    def right(self) -> bool:
        """Whether the answer is the truth, each effect itself or in its group of at most three."""
        if self.kind == "none":
            return self.verdict == "no-gap"
        if self.kind == "outside":
            return not self.confident
        if self.left_out:  # an honest neighbour leaves nothing to be explained
            return not self.confident or self.gap[2] <= HONEST * self.gap[3]
        return len(self.named) == len(self.truth) and _matched(
            set(self.truth), list(zip(self.named, self.groups, strict=True))
        )

    @property
    def confident(self) -> bool:
        """Whether an effect was named with confidence."""
        return self.verdict == "identified"


@dataclass(frozen=True)
class Scores:
    """The score of a blind check; shares are None where nothing of the kind was drawn."""

    outcomes: tuple[Outcome, ...]
    singles: float | None
    """Share of right answers among single effects with evidence beyond `EVIDENT`."""
    pairs: float | None
    false_alarms: float | None
    """Share of no-effect campaigns in which an effect was named."""
    abstentions: float | None
    """Share of outside effects that were not named with confidence."""
    left_out: float | None
    """Share of campaigns, their effect out of the library, without a confident name that leaves something over."""
    coverage: float | None
    """Share of 95 % intervals that hold the true parameter."""
    held_out: float | None
    """Largest held-out gap over the noise floor where an effect was identified rightly."""

    def confusion(self) -> tuple[tuple[str, ...], tuple[str, ...], tuple[tuple[int, ...], ...]]:
        """What was planted alone against what was answered: rows, columns, counts."""
        alone = [o for o in self.outcomes if len(o.truth) <= 1 and not o.left_out]
        rows = sorted({_word(o.truth) for o in alone})
        columns = sorted({_answered(o) for o in alone})
        table = tuple(
            tuple(sum(_word(o.truth) == row and _answered(o) == column for o in alone) for column in columns)
            for row in rows
        )
        return tuple(rows), tuple(columns), table


def _word(truth: Sequence[str]) -> str:
    return truth[0].split(" @ ")[0] if truth else "none"


def _answered(outcome: Outcome) -> str:
    if outcome.verdict in {"no-gap", "unexplained"}:
        return outcome.verdict
    return " + ".join(sorted({n.split(" @ ")[0] for n in outcome.named}))


def _matched(truth: set[str], named: list[tuple[str, tuple[str, ...]]]) -> bool:
    """Whether every true effect has an answer of its own that names it, or a small group that does."""
    if not named:
        return not truth
    name, group = named[0]
    fits = {name, *(group if len(group) < GROUP else ())} & truth
    return any(_matched(truth - {effect}, named[1:]) for effect in fits)


def run_blind(
    folder: Path, robot: Biglide, campaigns: int, seed: int, progress: Progress | None = None, workers: int = 2
) -> Scores:
    """Draw, seal, diagnose in parallel, open the seal, score. Campaigns and answers are left in ``folder``."""
    lots = [draw(k, seed) for k in range(campaigns)]
    for k, lot in enumerate(lots):
        if progress:
            progress("measuring", k / campaigns)
        write_lot(_place(folder, k), k, lot)
    seal(folder, lots)
    answers = _diagnosed(folder, robot, campaigns, progress, workers)
    opened = unseal(folder)
    outcomes = [_outcome(k, opened[k], found) for k, found in enumerate(answers)]
    outcomes += _without_one(folder, robot, opened, progress, workers)
    return score(outcomes)


def _place(folder: Path, number: int) -> Path:
    return folder / f"campaign-{number:03d}"


def _diagnosed(
    folder: Path, robot: Biglide, campaigns: int, progress: Progress | None, workers: int
) -> list[dict[str, Any]]:
    jobs = [(str(_place(folder, k)), "") for k in range(campaigns)]
    return _all(jobs, robot, progress, workers, "diagnosing")


def _without_one(
    folder: Path, robot: Biglide, lots: list[Lot], progress: Progress | None, workers: int
) -> list[Outcome]:
    """Diagnose single effects again with their own word taken out of the library."""
    chosen = [k for k, lot in enumerate(lots) if lot.kind == "single"]
    jobs = [(str(_place(folder, k)), lots[k].planted[0].effect) for k in chosen]
    answers = _all(jobs, robot, progress, workers, "leaving one effect out")
    return [_outcome(k, lots[k], found, lots[k].planted[0].effect) for k, found in zip(chosen, answers, strict=True)]


def _all(
    jobs: list[tuple[str, str]], robot: Biglide, progress: Progress | None, workers: int, stage: str
) -> list[dict[str, Any]]:
    out: list[dict[str, Any]] = [{} for _ in jobs]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_one_thread) as pool:
        running = {pool.submit(_one, robot, path, left_out): k for k, (path, left_out) in enumerate(jobs)}
        for done, future in enumerate(as_completed(running)):
            out[running[future]] = future.result()
            if progress:
                progress(stage, (done + 1) / len(jobs))
    return out


def _one_thread() -> None:
    """Two processes on two cores: each keeps to its own."""
    from threadpoolctl import threadpool_limits  # pyright: ignore[reportMissingTypeStubs]

    threadpool_limits(1)


def _one(robot: Biglide, folder: str, left_out: str) -> dict[str, Any]:
    """Diagnose one campaign; plain data, since it crosses a process."""
    from pathlib import Path

    terms = [e for e in library() if e.effect != left_out]
    found = find(load_campaign(Path(folder)), robot, None, terms)
    diagnosis = answer(found)
    gained = found.best.evidence - found.none.evidence
    text = _plain(diagnosis) | {"evidence": gained}
    name = "diagnosis.json" if not left_out else "diagnosis-without.json"
    (Path(folder) / name).write_text(json.dumps(text, indent=1), encoding="utf-8")
    return text


def _plain(diagnosis: Diagnosis) -> dict[str, Any]:
    from stiffscope.gap.diagnosis import to_json

    return to_json(diagnosis)


def _outcome(number: int, lot: Lot, found: dict[str, Any], left_out: str = "") -> Outcome:
    named = tuple(f"{e['effect']} @ {e['place']}" for e in found["effects"])
    groups = tuple(tuple(e["confused_with"]) for e in found["effects"])
    gap = found["gap"]
    numbers = tuple(float("nan") if gap[k] is None else gap[k] for k in ("nominal", "explained", "held_out", "noise"))
    return Outcome(
        number,
        lot.kind,
        tuple(p.name for p in lot.planted),
        found["verdict"],
        named,
        groups,
        float(found["evidence"]),
        (numbers[0], numbers[1], numbers[2], numbers[3]),
        () if left_out else _covered(lot, found),
        left_out,
    )


def _covered(lot: Lot, found: dict[str, Any]) -> tuple[bool, ...]:
    """For every parameter of a rightly named effect, whether value ± 1.96 σ holds the truth."""
    if found["verdict"] == "unexplained" or len(found["effects"]) != len(lot.planted):
        return ()
    truth = {p.name: p.parameters for p in lot.planted}
    out: list[bool] = []
    for effect in found["effects"]:
        planted = truth.get(f"{effect['effect']} @ {effect['place']}")
        if planted is None:
            return ()
        term = effect_named(effect["effect"], effect["place"], tuple(effect["parameters"]))
        if len(term.names) > 6:
            continue
        for name, fit in effect["parameters"].items():
            if fit["sigma"] and not (effect["effect"] == "payload" and name == "z"):
                out.append(abs(fit["value"] - planted.get(name, 0.0)) <= 1.96 * fit["sigma"])
    return tuple(out)


def score(outcomes: Sequence[Outcome]) -> Scores:
    """Shares of right answers by kind."""
    first = [o for o in outcomes if not o.left_out]
    evident = [o for o in first if o.kind == "single" and o.evidence > EVIDENT]
    held = [o.gap[2] / o.gap[3] for o in first if o.right and o.confident and o.kind in {"single", "pair"}]
    intervals = [c for o in first for c in o.covered]
    return Scores(
        tuple(outcomes),
        _share([o.right for o in evident]),
        _share([o.right for o in first if o.kind == "pair"]),
        _share([bool(o.named) for o in first if o.kind == "none"]),
        _share([not o.confident for o in first if o.kind == "outside"]),
        _share([o.right for o in outcomes if o.left_out]),
        _share(intervals),
        max(held) if held else None,
    )


def _share(flags: Sequence[bool]) -> float | None:
    return float(np.mean(flags)) if flags else None

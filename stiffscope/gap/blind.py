"""The blind check: campaigns with withheld effects are diagnosed, the seal is opened, the diagnoses are scored."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.blind_cases import BlindCase, draw, seal, unseal, write_case
from stiffscope.gap.diagnose import conclude
from stiffscope.gap.diagnosis import to_json
from stiffscope.gap.findings import find
from stiffscope.gap.readings import load_campaign
from stiffscope.gap.robot_model import RobotModel

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from stiffscope.robot.effects import NominalRobot

    Progress = Callable[[str, float], None]

GROUP = 3  # a diagnosis may name the truth in a group of at most so many
EVIDENT = 10.0  # ln-odds against no effect from which a single effect must be found
HONEST = 1.2  # times the noise floor, held out
MANY = 6  # parameters of an effect beyond which its intervals are not scored: the entries of a matrix


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

    @property
    def right(self) -> bool:
        """Whether the diagnosis is the truth, each effect itself or in its group of at most three."""
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
    """Share of right diagnoses among single effects with evidence beyond `EVIDENT`."""
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
        """What was injected alone against what was diagnosed: rows, columns, counts."""
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
    """Whether every true effect has a diagnosed effect of its own that names it, or a small group that does."""
    if not named:
        return not truth
    name, group = named[0]
    fits = {name, *(group if len(group) < GROUP else ())} & truth
    return any(_matched(truth - {effect}, named[1:]) for effect in fits)


def run_blind(
    folder: Path, robot: NominalRobot, campaigns: int, seed: int, progress: Progress | None = None, workers: int = 2
) -> Scores:
    """Draw, seal, diagnose in parallel, open the seal, score.

    Parameters
    ----------
    folder
        Campaigns and diagnoses are left here.
    robot
        The nominal robot of all campaigns.
    campaigns, seed
        How many are drawn, and the seed that they repeat with.
    progress
        Called with a stage's name and its fraction done.
    workers
        Processes.

    """
    drawn = [draw(k, seed) for k in range(campaigns)]
    for k, case in enumerate(drawn):
        if progress:
            progress("measuring", k / campaigns)
        write_case(_place(folder, k), k, case)
    seal(folder, drawn)
    everything = [(_place(folder, k), "") for k in range(campaigns)]
    answers = _diagnosed(everything, robot, progress, workers, "diagnosing")
    cases = unseal(folder)
    outcomes = [_outcome(k, cases[k], found) for k, found in enumerate(answers)]
    single = [(k, case.faults[0].effect) for k, case in enumerate(cases) if case.kind == "single"]
    jobs = [(_place(folder, k), effect) for k, effect in single]
    answers = _diagnosed(jobs, robot, progress, workers, "leaving one effect out")
    outcomes += [_outcome(k, cases[k], found, effect) for (k, effect), found in zip(single, answers, strict=True)]
    return score(outcomes)


def _place(folder: Path, number: int) -> Path:
    return folder / f"campaign-{number:03d}"


def _diagnosed(
    jobs: list[tuple[Path, str]], robot: NominalRobot, progress: Progress | None, workers: int, stage: str
) -> list[dict[str, Any]]:
    """Diagnose campaigns side by side, each without the effect that its job leaves out of the library."""
    out: list[dict[str, Any]] = [{} for _ in jobs]
    others = multiprocessing.active_children()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_start_worker) as pool:
        try:
            running = {pool.submit(_diagnose, robot, *job): k for k, job in enumerate(jobs)}
            for done, future in enumerate(as_completed(running)):
                out[running[future]] = future.result()
                if progress:
                    progress(stage, (done + 1) / len(jobs))
        except BaseException:  # Ctrl-C too: the pool would otherwise finish what is queued
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in set(multiprocessing.active_children()) - set(others):
                worker.terminate()
            raise
    return out


def _start_worker() -> None:
    """Keep to one core, leave Ctrl-C to the parent, and end when the parent is gone, which a pool does not do."""
    from threadpoolctl import threadpool_limits  # pyright: ignore[reportMissingTypeStubs]

    threadpool_limits(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _diagnose(robot: NominalRobot, folder: Path, left_out: str) -> dict[str, Any]:
    """Diagnose one campaign; plain data, since it crosses a process."""
    found = find(RobotModel(load_campaign(folder), robot, without=left_out))
    data = to_json(conclude(found)) | {"evidence": found.best.evidence - found.none.evidence}
    name = "diagnosis.json" if not left_out else "diagnosis-without.json"
    (folder / name).write_text(json.dumps(data, indent=1), encoding="utf-8")
    return data


def _outcome(number: int, case: BlindCase, found: dict[str, Any], left_out: str = "") -> Outcome:
    named = tuple(f"{e['effect']} @ {e['place']}" for e in found["effects"])
    groups = tuple(tuple(e["confused_with"]) for e in found["effects"])
    gap = found["gap"]
    numbers = tuple(float("nan") if gap[k] is None else gap[k] for k in ("nominal", "explained", "held_out", "noise"))
    return Outcome(
        number,
        case.kind,
        tuple(p.name for p in case.faults),
        found["verdict"],
        named,
        groups,
        float(found["evidence"]),
        (numbers[0], numbers[1], numbers[2], numbers[3]),
        () if left_out else _covered(case, found),
        left_out,
    )


def _covered(case: BlindCase, found: dict[str, Any]) -> tuple[bool, ...]:
    """For every parameter of a rightly named effect, whether value ± 1.96 σ holds the truth."""
    if found["verdict"] == "unexplained" or len(found["effects"]) != len(case.faults):
        return ()
    truth = {p.name: p.parameters for p in case.faults}
    out: list[bool] = []
    for effect in found["effects"]:
        planted = truth.get(f"{effect['effect']} @ {effect['place']}")
        if planted is None:
            return ()
        if len(effect["parameters"]) > MANY:
            continue
        for name, fit in effect["parameters"].items():
            if fit["sigma"] and not (effect["effect"] == "payload" and name == "z"):
                out.append(abs(fit["value"] - planted.get(name, 0.0)) <= 1.96 * fit["sigma"])
    return tuple(out)


def score(outcomes: Sequence[Outcome]) -> Scores:
    """Shares of right diagnoses by kind."""
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

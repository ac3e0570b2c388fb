"""Blind check: campaigns with withheld effects are diagnosed, unsealed and scored."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError
from stiffscope.gap.campaign.measured_responses import load_responses
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.diagnose import conclude, forward_model
from stiffscope.gap.inference.diagnosis import to_json
from stiffscope.gap.inference.find import find
from stiffscope.lab.blind.cases import SEAL, seal, unseal
from stiffscope.lab.blind.drawing import draw_case, is_imitated, write_case
from stiffscope.lab.blind.laboratory import Lab
from stiffscope.lab.blind.scores import Outcome, outcome_of, score
from stiffscope.lab.machine import NoEquilibriumError
from stiffscope.runtime.executor import Shared, work_through
from stiffscope.runtime.output import scratch_folder, write_bytes
from stiffscope.runtime.reading import describe_cause, read_text
from stiffscope.runtime.scheduler import workers

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from stiffscope.lab.blind.cases import BlindCase
    from stiffscope.lab.blind.laboratory import BlindRobot
    from stiffscope.lab.blind.scores import Scores

    Progress = Callable[[str, float], None]
    Files = dict[str, bytes]

OUTCOME = "outcome.json"
DIAGNOSES = ("diagnosis.json", "diagnosis-without.json")
_RUN = "run.json"
_DRAWN = 8  # cases drawn, at most, for one with an equilibrium
_APART = 1_000_003  # between their seeds
_labs: dict[str, Lab] = {}


@dataclass(frozen=True)
class Task:
    """A case to draw, measure, diagnose and score."""

    robot: str
    number: int
    seed: int

    @property
    def folder(self) -> str:
        """Folder of the case in that of the check."""
        return f"{self.robot}/campaign-{self.number:03d}"


def run_blind(
    folder: Path,
    robots: Sequence[BlindRobot],
    campaigns: int,
    seed: int,
    progress: Progress | None = None,
    *,
    workers: int = 2,
    scheduler: str | None = None,
) -> Scores:
    """Draw and seal cases, diagnose them in parallel, open the seal and score.

    Every case is stored when finished; a call with the same folder resumes the check.

    Parameters
    ----------
    folder
        Folder for campaigns, diagnoses and outcomes, with one folder per case.
    robots
        Robots whose campaigns are drawn.
    campaigns, seed
        Number of campaigns for each robot, and the seed that reproduces them.
    progress
        Called with a stage's name and its fraction done.
    workers
        Number of processes on this machine.
    scheduler
        Address of a Dask scheduler to use instead.

    Raises
    ------
    InputError
        The folder contains another check, or the scheduler does not answer.
    """
    check = _check(robots, seed)
    check_cases(folder)
    file = folder / _RUN
    if (
        os.path.lexists(file)
        and read_text(file, "a list of the cases of a check") != check
    ):
        expected = f"{folder}: expected the cases of this check"
        raise InputError(f"{expected}, got those of another; delete them to start anew")
    tasks = [
        Task(robot.name, number, seed)
        for robot in robots
        for number in range(campaigns)
    ]
    left = [task for task in tasks if not os.path.lexists(folder / task.folder)]
    for task in set(tasks).difference(left):  # before any work
        _read_stored(folder / task.folder)
    if left:
        _work(folder, robots, left, check, progress, workers, scheduler)
    for robot in robots:
        at = folder / robot.name
        seal(
            at,
            [
                unseal(folder / task.folder)[0]
                for task in tasks
                if task.robot == robot.name
            ],
        )
    return score(
        [outcome for task in tasks for outcome in _read_stored(folder / task.folder)]
    )


def _check(robots: Sequence[BlindRobot], seed: int) -> str:
    """Return the text that identifies a check."""
    texts = {robot.name: robot.nominal.robot.source for robot in robots}
    check: dict[str, Any] = {
        "seed": seed,
        "robots": {
            name: [source.text, *source.overrides] for name, source in texts.items()
        },
        "components": {robot.name: robot.components for robot in robots},
    }
    others = [robot.mechanics for robot in robots if robot.mechanics != "own"]
    if others:
        check["machine"] = others[0]
    if any(robot.hammered for robot in robots):
        check["with"] = "hammer"
    return _text(check)


def _text(content: Any) -> str:
    return json.dumps(content, indent=1)


def check_cases(folder: Path) -> None:
    """Raise InputError if a folder for the cases of a check contains other files."""
    got = ""
    if os.path.lexists(folder) and not folder.is_dir():
        got = "a file"
    elif folder.is_dir() and not (folder / _RUN).is_file() and any(folder.iterdir()):
        got = "one with other files"
    if got:
        raise InputError(
            f"{folder}: expected a folder for finished cases, got {got}; move it away"
        )


def case_files(
    folder: Path, robots: Sequence[BlindRobot], campaigns: int, seed: int
) -> list[str]:
    """Return the names of all files of a finished check, relative to its folder."""
    tasks = [
        Task(robot.name, number, seed)
        for robot in robots
        for number in range(campaigns)
    ]
    written = ("campaign.toml", "readings.csv", SEAL, *DIAGNOSES, OUTCOME)
    taps = [f"tap{k}.uff" for k in (1, 2)]
    written = (*written, *taps)
    names = [_RUN, *(f"{robot.name}/{SEAL}" for robot in robots)]
    names += [f"{task.folder}/{name}" for task in tasks for name in written]
    return [name for name in names if (folder / name).is_file()]


def _work(
    folder: Path,
    robots: Sequence[BlindRobot],
    tasks: list[Task],
    check: str,
    progress: Progress | None,
    count: int,
    scheduler: str | None,
) -> None:
    with workers(scheduler, min(count, len(tasks))) as executor:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            write_bytes(folder / _RUN, check.encode())
        except InputError:
            with contextlib.suppress(OSError):  # a folder that is not empty is kept
                folder.rmdir()
            raise
        known = {robot.name: Shared(robot) for robot in robots}
        jobs = ((task, (known[task.robot], task)) for task in tasks)
        for done, (task, future) in enumerate(work_through(executor, _solve, jobs), 1):
            _store(folder, task, future.result())
            if progress:
                progress(f"cases, {done} of {len(tasks)}", done / len(tasks))


def _store(folder: Path, task: Task, files: Files) -> None:
    """Write a finished case in one step. Raises InputError if that fails."""
    goal = folder / task.folder
    try:
        goal.parent.mkdir(parents=True, exist_ok=True)
        with scratch_folder(folder) as scratch:
            aside = scratch / goal.name
            aside.mkdir()
            for name, text in files.items():
                (aside / name).write_bytes(text)
            aside.rename(goal)
    except OSError as error:
        reason = describe_cause(error, goal)
        message = f"the case cannot be kept ({reason}); finished ones are"
        raise InputError(f"{goal}: {message}") from error


def _read_stored(folder: Path) -> list[Outcome]:
    """Return the stored outcomes of a finished case. Raises InputError if they are invalid."""
    from pydantic import TypeAdapter

    file = folder / OUTCOME
    text = read_text(file, "the outcome of a case")
    try:
        return TypeAdapter(list[Outcome]).validate_json(text)
    except ValueError as error:
        message = "expected the outcome of a case, got something else"
        raise InputError(
            f"{file}: {message}; delete its folder to work it out anew"
        ) from error


def _solve(robot: Shared, task: Task) -> Files:
    return solve(robot.value, task)


def solve(robot: BlindRobot, task: Task) -> Files:
    """Draw and diagnose a case, a single effect also without it in the library; return files."""
    lab = _labs.get(robot.name)
    if lab is None or lab.robot is not robot:
        lab = _labs[robot.name] = Lab(robot)
    with scratch_folder() as folder:
        case, redrawn = _measure(folder, task, lab)
        found = {"": _diagnose(robot, folder, "")}
        if case.kind == "single":
            effect = case.faults[0].effect
            found[effect] = _diagnose(robot, folder, effect)
        alike = case.kind == "outside" and is_imitated(case, task.number, lab)
        outcomes = [
            outcome_of(
                task.number,
                case,
                data,
                lab.canonical,
                left_out=effect,
                robot=robot.name,
                imitated=alike,
                redrawn=redrawn,
            )
            for effect, data in found.items()
        ]
        seal(folder, [case])
        files = {file.name: file.read_bytes() for file in sorted(folder.iterdir())}
    for effect, data in found.items():
        files[DIAGNOSES[bool(effect)]] = _text(data).encode()
    files[OUTCOME] = _text([asdict(outcome) for outcome in outcomes]).encode()
    return files


def _measure(folder: Path, task: Task, lab: Lab) -> tuple[BlindCase, tuple[str, ...]]:
    """Draw and measure a case; return it with the effects of those that have no equilibrium."""
    redrawn: list[str] = []
    for attempt in range(_DRAWN):
        case = draw_case(task.number, task.seed + attempt * _APART, lab)
        try:
            write_case(folder, task.number, case, lab)
        except NoEquilibriumError:
            redrawn.append(" + ".join(fault.name for fault in case.faults) or "none")
            continue
        return case, tuple(redrawn)
    raise InputError(
        f"{task.folder}: expected a machine with an equilibrium under its loads, got none in "
        f"{_DRAWN} drawn: {'; '.join(redrawn)}"
    )


def _diagnose(robot: BlindRobot, folder: Path, left_out: str) -> dict[str, Any]:
    """Diagnose a campaign with an effect excluded from the library; return plain data."""
    campaign = load_campaign(folder)
    nominal = robot.nominal
    responses = load_responses(folder, campaign, nominal.robot, nominal.mechanism)
    found = find(forward_model(campaign, nominal, responses, without=left_out))
    return to_json(conclude(found)) | {
        "evidence": found.best.evidence - found.none.evidence
    }

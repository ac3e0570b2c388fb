"""The blind check: campaigns with withheld effects are diagnosed, the seal is opened, the diagnoses are scored."""

from __future__ import annotations

import json
import shutil
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiffscope.cluster import cluster, finished
from stiffscope.errors import InputError
from stiffscope.gap.blind_cases import Lab, draw, seal, unseal, write_case
from stiffscope.gap.blind_scores import Outcome, outcome_of, score
from stiffscope.gap.diagnose import conclude
from stiffscope.gap.diagnosis import to_json
from stiffscope.gap.findings import find
from stiffscope.gap.readings import load_campaign
from stiffscope.gap.robot_model import RobotModel

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stiffscope.gap.blind_cases import BlindRobot
    from stiffscope.gap.blind_scores import Scores

    Progress = Callable[[str, float], None]
    Files = dict[str, str]

OUTCOME = "outcome.json"
_RUN = "run.json"
_labs: dict[str, Lab] = {}


@dataclass(frozen=True)
class Task:
    """A case to be drawn, measured, diagnosed and scored."""

    robot: str
    number: int
    seed: int

    @property
    def folder(self) -> str:
        """Its folder in that of the check."""
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
    """Draw, seal, diagnose in parallel, open the seal, score.

    Every case is stored as soon as it is finished; called again with the same folder, the check goes on where it was.

    Parameters
    ----------
    folder
        Campaigns, diagnoses and outcomes are left here, a folder each.
    robots
        Whose campaigns are drawn.
    campaigns, seed
        How many of each robot, and the seed that they repeat with.
    progress
        Called with a stage's name and its fraction done.
    workers
        Processes on this machine.
    scheduler
        Address of a Dask scheduler whose workers run the cases instead.

    Raises
    ------
    InputError
        The folder holds another check, or no scheduler answers.

    """
    _open(folder, robots, seed)
    tasks = [Task(robot.name, number, seed) for robot in robots for number in range(campaigns)]
    left = [task for task in tasks if not (folder / task.folder / OUTCOME).is_file()]
    if left:
        _work(folder, robots, left, progress, workers, scheduler)
    for robot in robots:
        at = folder / robot.name
        seal(at, [unseal(folder / task.folder)[0] for task in tasks if task.robot == robot.name])
    return score([outcome for task in tasks for outcome in _stored(folder / task.folder)])


def _open(folder: Path, robots: Sequence[BlindRobot], seed: int) -> None:
    """Note which check this folder holds. Raises InputError where it is another one."""
    texts = {robot.name: robot.nominal.robot.source for robot in robots}
    check = {
        "seed": seed,
        "robots": {name: [source.text, *source.overrides] for name, source in texts.items()},
        "components": {robot.name: robot.components for robot in robots},
    }
    file = folder / _RUN
    if file.is_file():
        if json.loads(file.read_text(encoding="utf-8")) != check:
            raise InputError(
                f"{folder}: expected the cases of this check, got those of another; delete them to start anew"
            )
        return
    folder.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(check, indent=1), encoding="utf-8")


def _work(
    folder: Path, robots: Sequence[BlindRobot], tasks: list[Task], progress: Progress | None, workers: int,
    scheduler: str | None,
) -> None:  # fmt: skip
    with cluster(scheduler, min(workers, len(tasks))) as client:
        known = {robot.name: client.scatter(robot, broadcast=True, hash=False) for robot in robots}
        running = {client.submit(solve, known[task.robot], task, pure=False, retries=1): task for task in tasks}
        for done, (task, future) in enumerate(finished(client, running), 1):
            _store(folder, task, future.result())
            if progress:
                progress(f"cases, {done} of {len(tasks)}", done / len(tasks))


def _store(folder: Path, task: Task, files: Files) -> None:
    """Write a finished case in one step."""
    goal = folder / task.folder
    goal.parent.mkdir(parents=True, exist_ok=True)
    if goal.exists():
        shutil.rmtree(goal)
    aside = Path(tempfile.mkdtemp(prefix=".case-", dir=folder))
    for name, text in files.items():
        (aside / name).write_text(text, encoding="utf-8", newline="")
    aside.chmod(0o755)
    aside.rename(goal)


def _stored(folder: Path) -> list[Outcome]:
    """Outcomes of a finished case, as they were stored."""
    listed: list[dict[str, Any]] = json.loads((folder / OUTCOME).read_text(encoding="utf-8"))
    out: list[Outcome] = []
    for o in listed:
        groups = tuple(tuple(group) for group in o["groups"])
        stated = tuple((p, true) for p, true in o["stated"])
        lists = {name: tuple(o[name]) for name in ("truth", "named", "gap", "covered")}
        fields: dict[str, Any] = {**o, **lists, "groups": groups, "stated": stated}
        out.append(Outcome(**fields))
    return out


def solve(robot: BlindRobot, task: Task) -> Files:
    """Draw a case, diagnose it with its whole library and, a single effect, without that effect; files by name."""
    lab = _labs.get(robot.name)
    if lab is None or lab.robot is not robot:
        lab = _labs[robot.name] = Lab(robot)
    case = draw(task.number, task.seed, lab)
    with tempfile.TemporaryDirectory(prefix="stiffscope-case-") as scratch:
        folder = Path(scratch)
        write_case(folder, task.number, case, lab)
        found = {"": _diagnose(robot, folder, "")}
        if case.kind == "single":
            effect = case.faults[0].effect
            found[effect] = _diagnose(robot, folder, effect)
        same = lab.canonical
        outcomes = [
            outcome_of(task.number, case, data, same, left_out=effect, robot=robot.name)
            for effect, data in found.items()
        ]
        seal(folder, [case])
        files = {file.name: file.read_text(encoding="utf-8") for file in sorted(folder.iterdir())}
    for effect, data in found.items():
        files["diagnosis-without.json" if effect else "diagnosis.json"] = json.dumps(data, indent=1)
    files[OUTCOME] = json.dumps([asdict(outcome) for outcome in outcomes], indent=1)
    return files


def _diagnose(robot: BlindRobot, folder: Path, left_out: str) -> dict[str, Any]:
    """Diagnose one campaign without an effect of the library, as plain data."""
    found = find(RobotModel(load_campaign(folder), robot.nominal, without=left_out))
    return to_json(conclude(found)) | {"evidence": found.best.evidence - found.none.evidence}

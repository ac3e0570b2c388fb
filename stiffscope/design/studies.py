"""Studies: designs made side by side, each stored as soon as it is finished, and the table of all of them."""

from __future__ import annotations

import io
import math
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from threadpoolctl import threadpool_limits

from stiffscope.design.responses import mass_of_solids, of_modes, quantities
from stiffscope.design.search import Outcome, Point, front, search
from stiffscope.design.study_file import StudyFile, Value, load_study
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.experiments.orders import LIBRARIES
from stiffscope.robot.file.part_sections import StepPart
from stiffscope.runtime import output
from stiffscope.runtime.cache import code_version, digest
from stiffscope.runtime.executor import Here, Shared, WorkerError, work_through, workers
from stiffscope.runtime.reading import file_digest
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.kinematics import configure

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from concurrent.futures import Future

    import pandas as pd

    from stiffscope.robot.file.description import RobotFile

    Values = tuple[Value, ...]
    Report = Callable[[str, float], None]

CODE = ("stiffscope.cad", "stiffscope.fea", "stiffscope.robot", "stiffscope.vjm")
_ENDED = "its worker ended before it did; the same study makes it again"
_alone = threading.Lock()  # CAD is one at a time in a process


@dataclass(frozen=True)
class Design:
    """A finished design: values of the variables and of the responses, SI, in the study's order; why it failed.

    ``again``: whether the same study is to make it again, since it failed for no reason of its own.
    """

    values: Values
    responses: tuple[float, ...]
    reason: str = ""
    seconds: float = 0.0
    again: bool = False


if TYPE_CHECKING:
    Make = Callable[[Sequence[Values]], Iterable[Design]]


@dataclass(frozen=True, eq=False)
class Study:
    """A finished study.

    Attributes
    ----------
    file : what was asked for.
    designs : in the order of the method, each once; ``origins``: what of the method asked for it.
    outcomes : objectives and violations of each.
    best : indexes of the best designs: the optimum, or the Pareto front in the order of the first objective.
    """

    file: StudyFile
    designs: tuple[Design, ...]
    origins: tuple[str, ...]
    outcomes: tuple[Outcome, ...]
    best: tuple[int, ...]

    @property
    def table(self) -> pd.DataFrame:
        """A row for each design; SI, units in the names of the columns."""
        import pandas as pd

        columns: dict[str, Any] = {
            "design": range(1, len(self.designs) + 1),
            "from": self.origins,
            "state": [state(each) for each in self.outcomes],
        }
        for k, v in enumerate(self.file.variables):
            columns[v.column] = [design.values[k] for design in self.designs]
        for k, response in enumerate(self.file.responses):
            columns[response.column] = [design.responses[k] for design in self.designs]
        chosen = set(self.best)
        columns["best"] = [k in chosen for k in range(len(self.designs))]
        columns["reason"] = [design.reason for design in self.designs]
        return pd.DataFrame(columns)

    def robot(self, index: int) -> RobotFile:
        """The robot of a design."""
        return self.file.design(self.designs[index].values)


def state(outcome: Outcome) -> str:
    """One of "feasible", "infeasible", "failed"."""
    return "failed" if outcome.objectives is None else "feasible" if outcome.feasible else "infeasible"


def study(
    path: str | Path, *, folder: str | Path | None = None, workers: int = 0, scheduler: str | None = None
) -> Study:
    """Make the designs that a study's file asks for.

    Parameters
    ----------
    path
        The file: see the guide to studies.
    folder
        Where finished designs are stored, one by one; the same study goes on where it was. By default nowhere.
    workers
        Processes on this machine; 0: one design after another in this process. Processes import the main module anew,
        so that a script needs ``if __name__ == "__main__"``.
    scheduler
        Address of a Dask scheduler whose workers make the designs instead: "tcp://10.0.0.5:8786".

    Returns
    -------
    Study
        ``table`` (a pandas DataFrame), ``best``, ``robot(index)``.

    Raises
    ------
    InputError
        The file is none, or no scheduler answers.

    """
    return run_study(load_study(path), None if folder is None else Path(folder), workers=workers, scheduler=scheduler)


def run_study(
    file: StudyFile, folder: Path | None, report: Report | None = None, *, workers: int, scheduler: str | None = None
) -> Study:
    """As `study`, of a file that was read; ``report`` is called with the count done and its share."""
    with _makers(file, workers, scheduler) as made:
        desk = _Desk(file, folder, made, report or (lambda _stage, _share: None))
        search(file, desk.evaluate)
    order = desk.order()
    designs = [desk.known[values] for values, _ in order]
    outcomes = [_outcome(file, design) for design in designs]
    return Study(file, tuple(designs), tuple(origin for _, origin in order), tuple(outcomes), _best(outcomes))


def _best(outcomes: Sequence[Outcome]) -> tuple[int, ...]:
    some = [k for k, chosen in enumerate(front(outcomes)) if chosen and outcomes[k].objectives]
    return tuple(sorted(some, key=lambda k: outcomes[k].objectives or ()))


def _outcome(file: StudyFile, design: Design) -> Outcome:
    if design.reason:
        return Outcome(None)
    found = {response.name: value for response, value in zip(file.responses, design.responses, strict=True)}
    objectives = tuple(goal.sign * found[goal.response] for goal in file.goals)
    return Outcome(objectives, tuple(limit.violation(found[limit.response]) for limit in file.limits))


class _Desk:
    """Designs by their values: those stored before, and those made now, stored at once. Used from several threads."""

    def __init__(self, file: StudyFile, folder: Path | None, made: Make, report: Report) -> None:
        self.file, self.folder, self.made, self.report = file, folder, made, report
        self.known: dict[Values, Design] = {}
        self.asked: dict[str, list[Values]] = {}
        self.lock = threading.Lock()
        self.identity = _identity(file)

    def evaluate(self, points: Sequence[Point], origin: str) -> list[Outcome]:
        """Outcomes of points of the unit cube, in order."""
        values = [tuple(v.at(share) for v, share in zip(self.file.variables, p, strict=True)) for p in points]
        with self.lock:
            self.asked.setdefault(origin, []).extend(values)
            missing = [each for each in dict.fromkeys(values) if each not in self.known and not self._take(each)]
        for design in self.made(missing) if missing else ():
            self._keep(design)
        self._tell()
        return [_outcome(self.file, self.known[each]) for each in values]

    def order(self) -> list[tuple[Values, str]]:
        """Values of every design that was asked for, and what asked for it first, in the method's order."""
        first: dict[Values, str] = {}
        for origin in sorted(self.asked, key=_origin_rank):
            for values in self.asked[origin]:
                first.setdefault(values, origin)
        return list(first.items())

    def _tell(self) -> None:
        done, total = len(self.known), self.file.designs
        self.report(f"designs, {done} of {total}", done / total)

    def _keep(self, design: Design) -> None:
        if self.folder is not None and not design.again:
            self.folder.mkdir(parents=True, exist_ok=True)
            output.write_bytes(self.folder / self._name(design.values), _parquet(self.file, design))
        with self.lock:
            self.known[design.values] = design
        self._tell()

    def _name(self, values: Values) -> str:
        return f"{digest({'study': self.identity, 'values': values})[:32]}.parquet"

    def _take(self, values: Values) -> bool:
        """Take a design that was stored before. What is no such file is made again."""
        if self.folder is None or not (path := self.folder / self._name(values)).is_file():
            return False
        import pandas as pd

        try:
            row = pd.read_parquet(path).iloc[0]
            found = tuple(float(row[response.column]) for response in self.file.responses)
            self.known[values] = Design(values, found, str(row["reason"]), float(row["seconds"]))
        except (OSError, ValueError, KeyError, IndexError):
            return False
        return True


def _origin_rank(origin: str) -> tuple[bool, int]:
    """Local searches run side by side: they come after what they start from, by their number."""
    word, _, number = origin.rpartition(" ")
    return (True, int(number)) if word and number.isdigit() else (False, 0)


def _identity(file: StudyFile) -> str:
    """What designs depend on but for their values: the robot, the responses and the code."""
    source = file.robot.source
    responses = [
        {
            "of": r.expression.text,
            "unit": r.unit,
            "name": r.name,
            "take": r.take,
            "poses": [file.poses[k] for k in r.poses],
        }
        for r in file.responses
    ]
    solids = {
        name: file_digest(source.path.parent / part.file)
        for name, part in file.robot.parts.items()
        if isinstance(part, StepPart)
    }
    return digest(
        {
            "robot": source.text, "set": source.overrides, "solids": solids,
            "components": file.components, "tolerance": file.tolerance,
            "variables": [v.name for v in file.variables], "responses": responses,
            "code": code_version(CODE, LIBRARIES),
        }
    )  # fmt: skip


def _parquet(file: StudyFile, design: Design) -> bytes:
    import pandas as pd

    row: dict[str, Any] = {
        f"{v.name} [{v.unit}]": value for v, value in zip(file.variables, design.values, strict=True)
    }
    row |= {response.column: value for response, value in zip(file.responses, design.responses, strict=True)}
    out = io.BytesIO()
    pd.DataFrame([{**row, "reason": design.reason, "seconds": design.seconds}]).to_parquet(out, index=False)
    return out.getvalue()


@contextmanager
def _makers(file: StudyFile, count: int, scheduler: str | None) -> Iterator[Make]:
    """What makes designs: this process, or others."""
    known = Shared(file)
    here = not count and scheduler is None
    with Here() if here else workers(scheduler, min(count, file.designs)) as executor:

        def made(missing: Iterable[Values]) -> Iterator[Design]:
            for values, future in work_through(executor, _make, ((each, (known, each)) for each in missing)):
                yield _answer(values, future, len(file.responses))

        yield made


def _make(file: Shared, values: Values) -> Design:
    return make_design(file.value, values)


def _answer(values: Values, future: Future[Design], count: int) -> Design:
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, WorkerError) or type(error).__name__ == "KilledWorker":
        return Design(values, (math.nan,) * count, _ENDED, again=True)
    raise error


def make_design(file: StudyFile, values: Values) -> Design:
    """Make a design: read the robot with its values, test its parts, compute its responses. May run on any machine.

    Whatever goes wrong is the design's reason: one that cannot be is not to end the others.
    """
    begun, again = time.perf_counter(), False
    with _alone, threadpool_limits(1):  # sums in one order, whatever the machine's threads
        try:
            found, reason = _responses(file, values), ""
        except InputError as error:
            found, reason = (math.nan,) * len(file.responses), str(error)
        except Exception as error:  # noqa: BLE001
            found, reason, again = (math.nan,) * len(file.responses), f"{type(error).__name__}: {error}", True
    return Design(values, found, " ".join(reason.split()), time.perf_counter() - begun, again)


def _responses(file: StudyFile, values: Values) -> tuple[float, ...]:
    robot = file.design(values)
    names = dict.fromkeys(name for response in file.responses for name in response.expression.names)
    with workshop() as shop:
        whole = any(of_modes(name) for name in names)
        made = assemble_robots({"design": robot}, file.components, shop, whole=whole)["design"]
        found = configure(made.mechanism, file.poses_of(robot)).require_valid()
        mass = mass_of_solids(robot, file.components, made.results) if "mass" in names else 0.0
        known = quantities(names, made.mechanism, found, made.matrices, mass)
    answers = tuple(response.value(known) for response in file.responses)
    for response, value in zip(file.responses, answers, strict=True):
        if not np.isfinite(value):
            raise InputError(
                f"{response.name}: expected a finite value, got none: the tool moves freely, or has no mode"
            )
    return answers

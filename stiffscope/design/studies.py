"""Studies: designs computed in parallel and stored immediately, and the table of all designs."""

from __future__ import annotations

import contextlib
import logging
import threading
from array import array
from collections.abc import Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.design.making import (
    SUFFIX,
    Design,
    Journal,
    Makers,
    name_study,
    open_makers,
)
from stiffscope.design.outcomes import Outcomes, find_front
from stiffscope.design.search import SWEEPS, Ending, search
from stiffscope.design.study_reading import load_study
from stiffscope.errors import InputError, require
from stiffscope.robot.parameters import parameters
from stiffscope.runtime.brief import describe_briefly
from stiffscope.runtime.formats import to_dataframe

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    import pandas as pd

    from stiffscope.design.search import Point
    from stiffscope.design.study_file import StudyFile, Values
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.types import Array, Indices, Progress

log = logging.getLogger(__name__)
WHOLE = (1, 1)
_FEW = 4  # designs after which a goal or limit that none has changed is told


@dataclass(frozen=True, eq=False)
class Designs(Sequence[Design]):
    """Finished designs as columns.

    Attributes
    ----------
    values : values of the variables by design.
    responses : (n, r), NaN for failed designs.
    reasons : reasons of failures by index.
    origins : part of the method that requested each design.
    """

    values: list[Values]
    responses: Array
    reasons: Mapping[int, str]
    origins: list[str]

    def __len__(self) -> int:
        """Return the number of designs."""
        return len(self.values)

    def __getitem__(self, index: Any) -> Any:
        """Return a design."""
        responses = tuple(self.responses[index].tolist())
        return Design(self.values[index], responses, self.reasons.get(index, ""))


@dataclass(frozen=True, eq=False)
class Study:
    """A finished study.

    Attributes
    ----------
    file : study file.
    designs : distinct designs in the order of the method.
    outcomes : objectives and violations of each design.
    best : indices of the optimum, or of the Pareto front sorted by the first objective.
    ending : convergence of the search.
    present : the design of the robot file, with the values of variables that are numbers; None if it was not computed.
    """

    __repr__ = describe_briefly

    file: StudyFile
    designs: Designs
    outcomes: Outcomes
    best: tuple[int, ...]
    ending: Ending
    present: Design | None = None

    @property
    def table(self) -> pd.DataFrame:
        """Table with one row per design, SI; units are in the column names."""
        designs = self.designs
        count = len(self.designs)
        columns: dict[str, Any] = {
            "design": list(range(1, count + 1)),
            "from": designs.origins,
        }
        columns["state"] = self.outcomes.states
        for k, v in enumerate(self.file.variables):
            columns[v.column] = [values[k] for values in designs.values]
        for k, response in enumerate(self.file.responses):
            columns[response.column] = designs.responses[:, k]
        columns["best"] = np.isin(np.arange(count), self.best)
        columns["reason"] = [designs.reasons.get(k, "") for k in range(count)]
        return to_dataframe(columns)

    def robot(self, index: int) -> RobotFile:
        """Return the robot of a design."""
        return self.file.design(self.designs.values[index])


def study(
    path: str | Path,
    *,
    folder: str | Path | None = None,
    workers: int = 0,
    scheduler: str | None = None,
    part: tuple[int, int] = WHOLE,
) -> Study:
    """Run a study: compute all designs that its file requests.

    Parameters
    ----------
    path
        Study file; see the guide to studies.
    folder
        Folder for finished designs, from which the study resumes; by default none are stored.
    workers
        Number of local processes; 0 computes all designs in this process. Processes import the main
        module again, so a script needs ``if __name__ == "__main__"``.
    scheduler
        Address of a Dask scheduler whose workers compute the designs, e.g. "tcp://10.0.0.5:8786".
    part
        (i, n): compute only share i of n of a sweep; `merge_study` joins the shares.

    Returns
    -------
    Study
        ``table`` (a pandas DataFrame), ``best``, ``robot(index)``.

    Raises
    ------
    InputError
        The file is invalid, or the scheduler does not respond.
    """
    place = None if folder is None else Path(folder)
    return run_study(
        load_study(path), place, workers=workers, scheduler=scheduler, part=part
    )


def run_study(
    file: StudyFile,
    folder: Path | None,
    report: Progress | None = None,
    *,
    workers: int,
    scheduler: str | None = None,
    part: tuple[int, int] = WHOLE,
) -> Study:
    """Run a study whose file was already read; see `study`.

    Parameters
    ----------
    file, folder
        Study file, and folder to write to; None to write nothing.
    report
        Called with the number of finished designs as text, and their share.
    workers, scheduler
        Number of local processes, and address of a Dask scheduler that replaces them.
    part
        (i, n): share i of n of a sweep.
    """
    check_part(file, part)
    with (
        open_makers(file, workers, scheduler) as makers,
        contextlib.nullcontext()
        if folder is None
        else Journal(file, folder) as journal,
    ):
        desk = _Desk(
            file=file,
            makers=makers,
            stored=[] if journal is None else [journal],
            journal=journal,
            report=report,
            part=part,
        )
        if part == WHOLE:
            desk.compute_present()
        return desk.finish(search(file, desk, part))


def merge_study(file: StudyFile, folders: Sequence[Path]) -> Study:
    """Join the shares of a sweep from their folders without recomputing designs.

    Raises
    ------
    InputError
        A folder has no share of the study in its current state, or a share is missing.
    """
    require(
        file.method in SWEEPS,
        file.path,
        f"a sweep ({', '.join(SWEEPS)}), which has shares",
        file.method,
    )
    journals = [Journal(file, folder) for folder in folders]
    for journal in journals:
        require(
            journal.path.is_file(),
            journal.path.parent,
            f"designs of {file.path} as it and its robot are now, made by this version of stiffscope; got none",
        )

    def refuse(rows: Iterable[Any]) -> Iterator[Any]:
        missing = sum(1 for _ in rows)
        require(
            not missing,
            file.path,
            f"shares with all its {file.designs} designs",
            f"none with {missing} of them; is a share missing, or not finished?",
        )
        yield from ()

    desk = _Desk(
        file=file,
        makers=Makers(refuse, lambda: None),
        stored=journals,
        journal=None,
        report=None,
        part=WHOLE,
    )
    return desk.finish(search(file, desk))


def check_part(file: StudyFile, part: tuple[int, int]) -> None:
    """Raise InputError for an invalid share, or for shares of a method that is not a sweep."""
    number, count = part
    message = ""
    if not 1 <= number <= count:
        message = f"I/N with I from 1 to N such as 3/20, got {number}/{count}"
    elif count > file.designs:
        message = f"at most as many shares as designs, {file.designs}, got {count}"
    elif count > 1 and file.method not in SWEEPS:
        got = f"{file.path} with {file.method}, which looks at all designs before the next"
        cure = "--scheduler has its designs made on several machines"
        message = f"a sweep ({', '.join(SWEEPS)}), got {got}; {cure}"
    require(not message, "--part", message)


def find_study(folders: Sequence[Path]) -> Path:
    """Return the study file that is named in the journals of folders of designs."""
    for folder in folders:
        require(
            folder.is_dir(),
            folder.parent,
            "the output folder of a share",
            f"none with {folder.name}",
        )
        names = map(name_study, sorted(folder.glob(f"*{SUFFIX}")))
        for name in filter(None, names):
            # relative to where the output folder stands, which may hold the journals
            for place in folder.absolute().parents[:2]:
                if (place / name).is_file():
                    return place / name
    expected = "expected the study's file where it was when its shares were made"
    raise InputError(f"{expected}; give it: study merge STUDY.toml DIR...")


class _Desk:
    """Stored and new designs by their values; thread-safe. New ones are stored at once."""

    def __init__(
        self,
        file: StudyFile,
        makers: Makers,
        stored: Sequence[Journal],
        journal: Journal | None,
        report: Progress | None,
        part: tuple[int, int],
    ) -> None:
        self.file = file
        self.makers = makers
        self.journal = journal
        self.report = report
        self.total = len(range(part[0] - 1, file.designs, part[1]))
        self.rows: dict[Values, int] = {}
        self.found = array("d")  # responses, row after row
        self.finished = bytearray()
        self.reasons: dict[int, str] = {}
        self.asked: dict[str, array[int]] = {}
        self.lock = threading.Lock()
        self.ended = False
        self.done = 0
        self.present: Design | None = None
        self.unchanged: dict[int, float] = {}
        self.compared = 0  # designs with those of `unchanged`
        for design in (row for source in stored for row in source.read()):
            self._keep(self._find_row(design.values), design)

    def __call__(self, points: Iterable[Point], origin: str) -> Outcomes:
        """Return outcomes of points of the unit cube in order; points are drawn when needed."""
        rows = array("q")
        self.asked.setdefault(origin, array("q"))

        def missing() -> Iterator[tuple[int, Values]]:
            for point in points:
                if self.ended:
                    raise CancelledError
                shares = zip(self.file.variables, point, strict=True)
                values = tuple(v.find_value(share) for v, share in shares)
                with self.lock:
                    row = self._find_row(values)
                    self.asked[origin].append(row)
                rows.append(row)
                if not self.finished[row]:
                    yield row, values
                else:
                    self._count()

        for row, design in self.makers.make(missing()):
            self._warn_of_unchanged(design)
            if self.journal is not None and not design.again:
                self.journal.add(design)
            with self.lock:
                self._keep(row, design)
            self._count()
        return self._judge(np.array(rows, dtype=np.int64))

    def compute_present(self) -> None:
        """Compute the design of the robot file."""
        file = self.file
        known = {
            parameter.name: parameter
            for parameter in parameters(file.robot, file.components)
        }
        values = tuple(
            float(known[v.name].value) if v.name in known else "as in the file"
            for v in file.variables
        )
        if self.report is not None:
            self.report("the present design", 0.0)
        for _, design in self.makers.make([(-1, None)]):
            self.present = replace(design, values=values)
        judged = {goal.response for goal in (*file.goals, *file.limits)}
        self.unchanged = {
            k: self.present.responses[k]
            for k, response in enumerate(file.responses)
            if self.present and not self.present.reason and response.name in judged
        }

    def _warn_of_unchanged(self, design: Design) -> None:
        """Warn of a goal or limit that is the same in the first designs, which nothing changes.

        Failed designs and those stored by an earlier run are not among them.
        """
        if design.reason or not self.unchanged:
            return
        self.compared += 1
        self.unchanged = {
            k: value
            for k, value in self.unchanged.items()
            if design.responses[k] == value
        }
        if self.compared != _FEW:
            return
        for k, value in self.unchanged.items():
            response = self.file.responses[k]
            message = (
                "%s: %s is %g %s in the present design and in the first %d computed: "
                "does any of its parameters change it?"
            )
            name = self.file.path.name
            log.warning(message, name, response.name, value, response.unit, _FEW)

    def end(self) -> None:
        """Stop: start no more designs and cancel running ones."""
        self.ended = True
        self.makers.end()

    def _find_row(self, values: Values) -> int:
        row = self.rows.setdefault(values, len(self.rows))
        if row == len(self.finished):
            self.finished.append(0)
            self.found.extend(self.file.no_responses)
        return row

    def _keep(self, row: int, design: Design) -> None:
        count = len(self.file.responses)
        self.found[row * count : (row + 1) * count] = array("d", design.responses)
        self.finished[row] = 1
        if design.reason:
            self.reasons[row] = design.reason

    def _count(self) -> None:
        self.done += 1
        if self.report is not None:
            done = min(self.done, self.total)
            self.report(f"designs, {done} of {self.total}", self.done / self.total)

    def _judge(self, rows: Indices) -> Outcomes:
        responses = self._responses(rows)
        by_name = {r.name: responses[:, k] for k, r in enumerate(self.file.responses)}
        failed = np.array([int(row) in self.reasons for row in rows], dtype=bool)
        goals = [goal.sign * by_name[goal.response] for goal in self.file.goals]
        limits = [
            limit.violation(by_name[limit.response]) for limit in self.file.limits
        ]
        none = np.zeros((len(rows), 0))
        return Outcomes(
            np.column_stack([none, *goals]), np.column_stack([none, *limits]), failed
        )

    def _responses(self, rows: Indices) -> Array:
        count = len(self.file.responses)
        if not len(rows):
            return np.zeros((0, count))
        with self.lock:  # an array cannot grow during a view
            return np.frombuffer(self.found).reshape(-1, count)[rows]

    def finish(self, ending: Ending) -> Study:
        """Return the finished study with the designs in the method's order."""
        asked: dict[int, str] = {}  # the first origin of each row
        for origin in sorted(self.asked, key=_rank_origin):
            for row in self.asked[origin]:
                asked.setdefault(row, origin)
        values = list(self.rows)
        rows = np.array(list(asked), dtype=np.int64)
        reasons = {
            k: self.reasons[row] for k, row in enumerate(asked) if row in self.reasons
        }
        chosen = [values[row] for row in asked]
        designs = Designs(chosen, self._responses(rows), reasons, list(asked.values()))
        outcomes = self._judge(rows)
        return Study(
            file=self.file,
            designs=designs,
            outcomes=outcomes,
            best=tuple(find_front(outcomes).tolist()),
            ending=ending,
            present=self.present,
        )


def _rank_origin(origin: str) -> tuple[bool, int]:
    """Return a sort key that puts parallel local searches last, by number."""
    word, _, number = origin.rpartition(" ")
    return (True, int(number)) if word and number.isdigit() else (False, 0)

"""Designs of a study: computed here or on other machines, and kept in a journal.

The journal has one line per finished design, appended immediately. A kill leaves at most an
incomplete last line, whose design is computed again. Its name is a digest of everything designs
depend on, so that other methods, ranges or more designs can reuse them.
"""

from __future__ import annotations

import json
import math
import os
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from threadpoolctl import threadpool_limits

from stiffscope.design.responses import (
    CRITICAL,
    of_modes,
    quantities,
)
from stiffscope.errors import InputError, require
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.experiments.masses import mass_of_solids
from stiffscope.experiments.part_order import LIBRARIES
from stiffscope.lobes.chatter import critical_along, files_of
from stiffscope.path.along import along
from stiffscope.robot.file.part_sections import StepPart
from stiffscope.runtime.cache import code_version, digest
from stiffscope.runtime.executor import Here, Shared, WorkerError, work_through
from stiffscope.runtime.reading import file_digest, open_file
from stiffscope.runtime.scheduler import workers
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.kinematics.configurations import configure

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from stiffscope.design.study_file import StudyFile, Values
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.path.job import Job
    from stiffscope.runtime.types import Array

    Row = tuple[int, Values | None]

CODE = (
    "stiffscope.cad",
    "stiffscope.fea",
    "stiffscope.lobes",
    "stiffscope.path",
    "stiffscope.robot",
    "stiffscope.vjm",
)
SUFFIX = ".jsonl"
MOST_BYTES = 1 << 34  # of a journal: enough for a million designs with reasons
_ENDED = "its worker ended before it did; the same study makes it again"
_alone = threading.Lock()  # only one CAD operation at a time in a process


@dataclass(frozen=True)
class Design:
    """A finished design: variables and responses, SI, in the study's order; reason of a failure.

    ``again``: whether the same study should retry it, because the design did not cause the failure.
    """

    values: Values
    responses: tuple[float, ...]
    reason: str = ""
    seconds: float = 0.0
    again: bool = False


class Journal:
    """Finished designs of a study in a folder: existing ones and those added."""

    def __init__(self, file: StudyFile, folder: Path) -> None:
        self.path = folder / f"{identify(file)[:32]}{SUFFIX}"
        self._file = file
        self._stream: BinaryIO | None = None

    def __enter__(self) -> Journal:
        """Start; the file is opened with the first write."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def read(self) -> Iterator[Design]:
        """Read the designs; skip invalid lines."""
        if not self.path.is_file():
            return
        variables = len(self._file.variables)
        responses = len(self._file.responses)
        with open_file(self.path, "designs of a study", MOST_BYTES) as stream:
            for line in stream:
                try:
                    values, design, reason, seconds = json.loads(line)
                    if (
                        len(values) == variables
                        and len(design) == responses
                        and {*values}
                    ):  # hashable
                        numbers = tuple(
                            math.nan if response is None else float(response)
                            for response in design
                        )
                        yield Design(
                            tuple(values), numbers, str(reason), float(seconds)
                        )
                except (ValueError, TypeError):
                    continue

    def count(self) -> int:
        """Count the written designs without parsing them."""
        if not self.path.is_file():
            return 0
        with self.path.open("rb") as stream:
            blocks = iter(lambda: stream.read(1 << 20), b"")
            return max(0, sum(block.count(b"\n") for block in blocks) - 1)

    def add(self, design: Design) -> None:
        """Append a design with a single write."""
        numbers = [
            None if math.isnan(response) else response for response in design.responses
        ]
        self._write([design.values, numbers, design.reason, round(design.seconds, 6)])

    def _name(self) -> str:
        """Return the study's file from where the output folder stands: both may move together."""
        file = self._file.path.resolve()
        try:
            place = os.path.relpath(file, self.path.parent.parent.resolve())
        except ValueError:  # on another drive
            return file.as_posix()
        return Path(place).as_posix()

    def _write(self, content: Any) -> None:
        if self._stream is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = self.path.open("ab", buffering=0)
            if not self._stream.tell():
                columns = [
                    variable.column
                    for variable in (*self._file.variables, *self._file.responses)
                ]
                self._write({"study": self._name(), "columns": columns})
            else:
                with self.path.open("rb") as held:
                    held.seek(-1, 2)
                    if held.read() != b"\n":  # killed while writing the last line
                        self._stream.write(b"\n")
        self._stream.write(json.dumps(content, ensure_ascii=False).encode() + b"\n")


def name_study(journal: Path) -> str:
    """Return the file of a journal's study; "" if unknown."""
    with open_file(journal, "designs of a study", MOST_BYTES) as stream:
        try:
            return str(json.loads(stream.readline())["study"])
        except (ValueError, TypeError, KeyError):
            return ""


def identify(file: StudyFile) -> str:
    """Return a digest of all that designs depend on except values: robot, responses and code."""
    source = file.robot.source
    responses = [
        {
            "of": r.expression.text,
            "unit": r.unit,
            "name": r.name,
            "take": r.take,
            "poses": [file.poses[k] for k in r.poses]
            if r.job is None
            else len(r.poses),
            "job": r.job
            and [
                r.job.section.model_dump_json(),
                *map(file_digest, files_of(r.job)),
            ],
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
            "robot": source.text,
            "set": source.overrides,
            "solids": solids,
            "components": file.components,
            "tolerance": file.tolerance,
            "variables": [v.name for v in file.variables],
            "responses": responses,
            "code": code_version(CODE, LIBRARIES),
        }
    )


@dataclass(frozen=True)
class Makers:
    """Functions to compute designs from an iterable of rows, in any order, and to stop at once."""

    make: Callable[[Iterable[Row]], Iterable[tuple[int, Design]]]
    end: Callable[[], None]


@contextmanager
def open_makers(file: StudyFile, count: int, scheduler: str | None) -> Iterator[Makers]:
    """Yield makers: ``count`` local processes, workers of a scheduler or, for 0, this process."""
    known = Shared(file)
    here = not count and scheduler is None
    with Here() if here else workers(scheduler, min(count, file.designs)) as executor:

        def make(rows: Iterable[Row]) -> Iterator[tuple[int, Design]]:
            jobs = ((row, (known, row[1])) for row in rows)
            for (row, values), future in work_through(executor, _make_shared, jobs):
                if isinstance(future.exception(), WorkerError):
                    yield (
                        row,
                        Design(values or (), file.no_responses, _ENDED, again=True),
                    )
                else:
                    yield row, future.result()

        yield Makers(make, executor.end)


def _make_shared(file: Shared, values: Values | None) -> Design:
    return make_design(file.value, values)


def make_design(file: StudyFile, values: Values | None) -> Design:
    """Compute a design: read the robot, test its parts, evaluate its responses.

    ``values``: of the variables; None: those of the robot file.

    Runs on any machine. Any error becomes the design's reason, so that it does not end the study.
    """
    begun = time.perf_counter()
    again = False
    reason = ""
    responses = file.no_responses
    with _alone, threadpool_limits(1):  # the same order of summation on any machine
        try:
            responses = _respond(file, values)
        except InputError as error:
            reason = str(error)
        except Exception as error:  # noqa: BLE001
            again = True
            reason = f"{type(error).__name__}: {error}"
    return Design(
        values or (),
        responses,
        " ".join(reason.split()),
        time.perf_counter() - begun,
        again,
    )


def _follow_path(job: Job, assembled: Assembled, asked: set[str]) -> dict[str, Array]:
    """Return the quantities of `ALONG_PATH` that are asked for, at each point of a path."""
    along_path = dict[str, np.ndarray]()
    if asked - {CRITICAL}:
        state = along(job, assembled)
        along_path |= {"error": state.size, **state.parts}
    if CRITICAL in asked:
        along_path[CRITICAL] = critical_along(job, assembled)
    return along_path


def _respond(file: StudyFile, values: Values | None) -> tuple[float, ...]:
    robot = file.robot if values is None else file.design(values)
    of_robot = [response for response in file.responses if response.job is None]
    names = dict.fromkeys(name for r in of_robot for name in r.expression.names)
    with workshop() as shop:
        every = {name for r in file.responses for name in r.expression.names}
        whole = CRITICAL in every or any(of_modes(name) for name in names)
        assembled = assemble_robots(
            {"design": robot}, file.components, shop, whole=whole
        )["design"]
        mass = (
            mass_of_solids(robot, assembled.sources, assembled.results)
            if "mass" in names
            else 0.0
        )
    known: dict[Job | None, dict[str, np.ndarray]] = {}
    for job in {r.job for r in file.responses if r.job is not None}:
        asked = {
            name for r in file.responses if r.job is job for name in r.expression.names
        }
        known[job] = _follow_path(replace(job, robot=robot), assembled, asked)
    if names:
        configurations = configure(
            assembled.mechanism, file.poses_of(robot)
        ).require_valid()
        known[None] = quantities(
            names, assembled.mechanism, configurations, assembled.matrices, mass
        )
    answers = tuple(response.value(known[response.job]) for response in file.responses)
    for response, value in zip(file.responses, answers, strict=True):
        require(
            np.isfinite(value),
            response.name,
            "a finite value",
            "none: the tool moves freely, or has no mode",
        )
    return answers

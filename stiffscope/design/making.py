"""Computing a study's designs (robot, parts' experiments, responses), here or on other machines."""

from __future__ import annotations

import math
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from stiffscope.design.journal import Design
from stiffscope.design.path.along import along
from stiffscope.design.responses import mass_of_solids, of_modes, quantities
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.runtime.executor import Here, Shared, WorkerError, work_through
from stiffscope.runtime.scheduler import workers
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.kinematics import configure

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from stiffscope.design.path.job import Job
    from stiffscope.design.study_file import StudyFile, Values

    Row = tuple[int, Values]

_ENDED = "its worker ended before it did; the same study makes it again"
_alone = threading.Lock()  # only one CAD operation at a time in a process


@dataclass(frozen=True)
class Makers:
    """Functions to compute designs from an iterable of rows, in any order, and to stop at once."""

    make: Callable[[Iterable[Row]], Iterable[tuple[int, Design]]]
    end: Callable[[], None]


@contextmanager
def open_makers(file: StudyFile, count: int, scheduler: str | None) -> Iterator[Makers]:
    """Yield makers: ``count`` local processes, workers of a scheduler or, for 0, this process."""
    known, nothing = Shared(file), (math.nan,) * len(file.responses)
    here = not count and scheduler is None
    with Here() if here else workers(scheduler, min(count, file.designs)) as executor:

        def make(rows: Iterable[Row]) -> Iterator[tuple[int, Design]]:
            jobs = ((row, (known, row[1])) for row in rows)
            for (row, values), future in work_through(executor, _make_shared, jobs):
                if isinstance(future.exception(), WorkerError):
                    yield row, Design(values, nothing, _ENDED, again=True)
                else:
                    yield row, future.result()

        yield Makers(make, executor.end)


def _make_shared(file: Shared, values: Values) -> Design:
    return make_design(file.value, values)


def make_design(file: StudyFile, values: Values) -> Design:
    """Compute a design: read the robot, test its parts, evaluate its responses.

    Runs on any machine. Any error becomes the design's reason, so that it does not end the study.
    """
    begun, again, reason = time.perf_counter(), False, ""
    found = (math.nan,) * len(file.responses)
    with _alone, threadpool_limits(1):  # the same order of summation on any machine
        try:
            found = _respond(file, values)
        except InputError as error:
            reason = str(error)
        except Exception as error:  # noqa: BLE001
            again, reason = True, f"{type(error).__name__}: {error}"
    return Design(values, found, " ".join(reason.split()), time.perf_counter() - begun, again)


def _respond(file: StudyFile, values: Values) -> tuple[float, ...]:
    robot = file.design(values)
    names = dict.fromkeys(name for r in file.responses if r.job is None for name in r.expression.names)
    with workshop() as shop:
        whole = any(of_modes(name) for name in names)
        assembled = assemble_robots({"design": robot}, file.components, shop, whole=whole)["design"]
        mass = mass_of_solids(robot, file.components, assembled.results) if "mass" in names else 0.0
    known: dict[Job | None, dict[str, np.ndarray]] = {}
    for job in {r.job for r in file.responses if r.job is not None}:
        state = along(replace(job, robot=robot), assembled)
        known[job] = {"error": state.size, **state.parts}  # `ALONG_PATH`
    if names:
        found = configure(assembled.mechanism, file.poses_of(robot)).require_valid()
        known[None] = quantities(names, assembled.mechanism, found, assembled.matrices, mass)
    answers = tuple(response.value(known[response.job]) for response in file.responses)
    for response, value in zip(file.responses, answers, strict=True):
        if not np.isfinite(value):
            message = "expected a finite value, got none: the tool moves freely, or has no mode"
            raise InputError(f"{response.name}: {message}")
    return answers

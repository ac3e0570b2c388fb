"""What several commands do around their work: progress while jobs run, a part's tables, warnings."""

from __future__ import annotations

import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from stiffscope.experiments.assembly import assemble_robots
from stiffscope.report import tables
from stiffscope.report.compare import compare
from stiffscope.report.progress import progress
from stiffscope.runtime.workshop import workshop

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.experiments.results import PartResult
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.workshop import Workshop

log = logging.getLogger(__name__)


@contextmanager
def shown_workshop(*, quiet: bool) -> Iterator[Workshop]:
    """A workshop whose jobs run side by side and whose progress is on standard error."""
    with progress(quiet=quiet) as open_line, workshop(open_line, together=True) as shop:
        yield shop


def shown_assembly(robot: RobotFile, components: Any, *, quiet: bool) -> Assembled:
    """The robot with its parts, assembled in such a workshop."""
    with shown_workshop(quiet=quiet) as shop:
        made = assemble_robots({"now": robot}, components, shop)["now"]
    warn_of(made.results.values())
    return made


def warn_of(results: Iterable[PartResult]) -> None:
    """Say on standard error of each part whose tolerance was not met how far it came."""
    for result in results:
        if result.note:
            log.warning("%s: %s", result.name, result.note)


def show_compliance(robot: RobotFile, result: PartResult) -> None:
    """A part's compliance beside beam theory and the published one; a STEP file's solid has nothing beside it."""
    if len(result.experiment.reference_points) > 1:
        tables.show_each_interface(result)
    elif result.own_shape:
        tables.show_comparison(compare(robot, result.name, result))
    else:
        tables.show_matrix(f"Compliance of the {result.name}, SI", result.compliance, result.error)
        tables.show_line("No beam theory beside it: it is a STEP file's solid, not the robot file's own shape\n")

"""Verdicts on a finished study: infeasibility, convergence, parameters at their bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.design.outcomes import FEASIBLE, find_front

if TYPE_CHECKING:
    from stiffscope.design.studies import Study
    from stiffscope.design.study_file import Limit, Variable

SETTLED = (
    0.01  # most of the front's spread that the last quarter of the designs may add
)
AT_END = 1e-3  # distance from the end of a range that counts as the end, over the range


@dataclass(frozen=True)
class Nearest:
    """The design nearest to the limits if no design meets all of them.

    Attributes
    ----------
    design : index of the design.
    limit, found : limit violated most, and the design's response.
    met : number of designs that meet each limit.
    """

    design: int
    limit: Limit
    found: float
    met: tuple[int, ...]


@dataclass(frozen=True)
class AtBound:
    """A parameter of ``count`` best designs at the "lower" or "upper" ``end`` of its range."""

    variable: Variable
    end: str
    count: int


def find_nearest(study: Study) -> Nearest | None:
    """Return the design nearest to the limits; None if one is feasible or all failed."""
    outcomes = study.outcomes
    if outcomes.feasible.any() or outcomes.failed.all():
        return None
    index = int(np.argmin(outcomes.excess))
    limit = study.file.limits[int(np.argmax(outcomes.violations[index]))]
    names = [response.name for response in study.file.responses]
    nearest = float(study.designs.responses[index, names.index(limit.response)])
    met = (outcomes.violations <= FEASIBLE).sum(
        axis=0
    )  # NaN of failed designs gives False
    return Nearest(index, limit, nearest, tuple(met.tolist()))


def find_bounds(study: Study) -> list[AtBound]:
    """Return the parameters of best designs that lie at an end of their range."""
    if not study.file.goals:
        return []
    limits: list[AtBound] = []
    for k, v in enumerate(study.file.variables):
        if v.low is None or v.high is None:
            continue
        values = np.array(
            [study.designs.values[index][k] for index in study.best], dtype=float
        )
        near = AT_END * (v.high - v.low)
        ends = {"lower": values <= v.low + near, "upper": values >= v.high - near}
        limits += [
            AtBound(v, end, int(at.sum())) for end, at in ends.items() if at.any()
        ]
    return limits


def judge_convergence(study: Study) -> tuple[bool | None, tuple[str, ...]]:
    """Return whether the search converged (None if unknown), and lines on how it ended.

    A Pareto front is judged by the additive epsilon indicator (Zitzler et al. 2003) between the
    front of the first three quarters of the designs and the final front, relative to its spread.
    """
    if study.file.method != "pareto":
        return study.ending.converged, study.ending.how
    if len(study.best) < 2:
        return None, ()
    early = find_front(study.outcomes[: max(1, round(0.75 * len(study.designs)))])
    if not early.size:
        return False, (
            "the first feasible designs came with the last quarter of the designs",
        )
    final, former = (
        study.outcomes.objectives[list(some)] for some in (study.best, early)
    )
    spread = np.ptp(final, axis=0)
    scale = np.where(spread > 0, spread, 1.0)
    steps = [float(((former - point) / scale).max(axis=1).min()) for point in final]
    moved = max(0.0, *steps)
    share = f"{100 * moved:.2g} % of its spread"
    return moved <= SETTLED, (
        f"the last quarter of the designs moved the front by {share}",
    )

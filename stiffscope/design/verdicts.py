"""Verdicts on a finished study: why nothing is feasible, whether the search converged, what ended on a bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.design.outcomes import FEASIBLE, find_front

if TYPE_CHECKING:
    from stiffscope.design.studies import Study
    from stiffscope.design.study_file import Limit, Variable

SETTLED = 0.01  # of the front's spread that the last quarter of the designs may add
AT_END = 1e-3  # share of a range that counts as its end


@dataclass(frozen=True)
class Nearest:
    """The design that comes nearest to the limits where none meets them all.

    Attributes
    ----------
    design : its index.
    limit, found : what it exceeds most, and its response there.
    met : for each limit, how many designs meet it.
    """

    design: int
    limit: Limit
    found: float
    met: tuple[int, ...]


@dataclass(frozen=True)
class AtBound:
    """A parameter of best designs at an end of its range: ``end`` is "lower" or "upper", ``count`` designs have it."""

    variable: Variable
    end: str
    count: int


def find_nearest(study: Study) -> Nearest | None:
    """Find the design nearest to the limits; None where one is feasible, or all failed."""
    outcomes = study.outcomes
    if outcomes.feasible.any() or outcomes.failed.all():
        return None
    index = int(np.argmin(outcomes.excess))
    limit = study.file.limits[int(np.argmax(outcomes.violations[index]))]
    names = [response.name for response in study.file.responses]
    found = float(study.designs.responses[index, names.index(limit.response)])
    met = (outcomes.violations <= FEASIBLE).sum(axis=0)  # false where one failed: NaN
    return Nearest(index, limit, found, tuple(met.tolist()))


def find_bounds(study: Study) -> list[AtBound]:
    """Find the parameters that best designs have at an end of their range."""
    if not study.file.goals:
        return []
    found = []
    for k, v in enumerate(study.file.variables):
        if v.low is None or v.high is None:
            continue
        values = np.array([study.designs.values[index][k] for index in study.best], dtype=float)
        near = AT_END * (v.high - v.low)
        ends = {"lower": int((values <= v.low + near).sum()), "upper": int((values >= v.high - near).sum())}
        found += [AtBound(v, end, count) for end, count in ends.items() if count]
    return found


def judge_convergence(study: Study) -> tuple[bool | None, tuple[str, ...]]:
    """Judge whether the search converged, None where it is no search or nothing is feasible; and say how it ended.

    A front by how far that of the first three quarters of the designs must be moved to be as good as the last
    everywhere, as a share of its spread: the additive epsilon indicator (Zitzler et al. 2003).
    """
    if study.file.method != "pareto":
        return study.ending.converged, study.ending.how
    if len(study.best) < 2:
        return None, ()
    early = find_front(study.outcomes[: max(1, round(0.75 * len(study.designs)))])
    if not early.size:
        return False, ("the first feasible designs came with the last quarter of the designs",)
    final, former = (study.outcomes.objectives[list(some)] for some in (study.best, early))
    spread = np.ptp(final, axis=0)
    scale = np.where(spread > 0, spread, 1.0)
    steps = [float(((former - point) / scale).max(axis=1).min()) for point in final]
    moved = max(0.0, *steps)
    return moved <= SETTLED, (f"the last quarter of the designs moved the front by {100 * moved:.2g} % of its spread",)

"""Reach of the tool from home along each coordinate of its pose, one at a time."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import repeat
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.kinematics.continuation import drive_sign, find_solver
from stiffscope.vjm.model.checks import list_names

if TYPE_CHECKING:
    from stiffscope.vjm.kinematics.closure import Solution
    from stiffscope.vjm.kinematics.continuation import Solver
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array

_LONGEST = 1.0 / 48.0
_SHORTEST = 1.0 / 2**20  # steps of a path
_WAYS = (
    2.0,
    0.95 * np.pi,
)  # search limit, as a multiple of the mechanism's length, and in rad


@dataclass(frozen=True)
class Reach:
    """Range ``low`` to ``high`` of a ``coordinate``, m or rad, with the others as at the start.

    ``at_low``, ``at_high``: what limits it; empty if nothing within twice the mechanism's length.
    """

    coordinate: str
    low: float
    high: float
    at_low: str
    at_high: str


def reach(mechanism: Mechanism) -> tuple[Reach, ...]:
    """Return the reach along each coordinate of ``tool.pose``, in drive ranges on home's branch.

    Raises InputError if the mechanism cannot follow its pose coordinates.
    """
    names = mechanism.tool.pose
    solver = find_solver(mechanism, "tool")
    home = mechanism.tool.home + solver.start_values
    limits = [
        _WAYS[1] if name.startswith("r") else _WAYS[0] * solver.linkage.length
        for name in names
    ]
    ways = np.concatenate([-np.diag(limits), np.diag(limits)])
    shares, reasons = _march(solver, ways)
    low, high = np.split(shares * ways.sum(axis=1), 2) + home
    ends = zip(
        names, low.tolist(), high.tolist(), reasons, reasons[len(names) :], strict=False
    )
    return tuple(Reach(*end) for end in ends)


def reach_toward(solver: Solver, goal: Array) -> Array:
    """Return the farthest pose (k,) straight from the start to a goal, both from home."""
    way = goal - solver.start_values
    return solver.start_values + _march(solver, way[None])[0][0] * way


def _march(solver: Solver, ways: Array) -> tuple[Array, list[str]]:
    """Return reachable fractions (n,) of paths (n, k) from the start, and what ends them."""
    linkage = solver.linkage
    n = len(ways)
    q = np.repeat(solver.start[:, None], n, axis=1)
    share = np.zeros(n)
    step = np.full(n, _LONGEST)
    beyond = np.full(n, np.inf)
    steady = np.zeros(n, dtype=int)
    reasons = list(repeat("", n))
    while (going := np.flatnonzero((share < 1.0) & (step >= _SHORTEST))).size:
        ahead = np.minimum(share[going] + step[going], 1.0)
        trial = q[:, going]
        trial[linkage.known] = (solver.start_values + ahead[:, None] * ways[going]).T
        solution = solver.closure.solve(trial)
        faults = _faults(solver, solution)
        for i, k in enumerate(going):
            if not faults[i]:
                steady[k] = steady[k] + 1
                q[:, k] = solution.q[:, i]
                share[k] = ahead[i]
                longer = 2.0 * step[k] if steady[k] > 2 else step[k]
                step[k] = min(_LONGEST, longer, 0.5 * (beyond[k] - share[k]))
                continue
            reasons[k] = faults[i]
            steady[k] = 0
            step[k] *= 0.5
            if solution.closed[i]:
                beyond[k] = ahead[i]
    return share, [
        why if part < 1.0 else "" for why, part in zip(reasons, share, strict=True)
    ]


def _faults(solver: Solver, solution: Solution) -> list[str]:
    """Return why configurations are not valid; empty if they are."""
    linkage = solver.linkage
    sign = drive_sign(solver, solution.placed, solver.closure.rates(solution.placed))
    out = [
        "passes a singular pose" if direction * solver.home_sign < 0.0 else ""
        for direction in sign
    ]
    beyond: dict[int, list[str]] = {}
    for joint in solver.mechanism.drives:
        if joint.drive is not None:
            value = linkage.coordinates(joint, solution.q, solution.placed)[
                :, joint.driven or 0
            ]
            for i in np.flatnonzero(
                (value < joint.drive.low) | (value > joint.drive.high)
            ):
                beyond.setdefault(int(i), []).append(joint.name)
    for i, names in beyond.items():
        out[i] = (
            f"{list_names(names)} at the end of {'its' if len(names) == 1 else 'their'} range"
        )
    for i in np.flatnonzero(~solution.closed):
        open_ = f": the loop through {linkage.name_worst(solution.error[:, i])} does not close"
        out[i] = "out of reach or singular" + open_ * (len(linkage.cuts) > 1)
    return out

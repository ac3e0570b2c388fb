"""Places, wrenches and readings that no robot has, known without a prediction."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.quantities import PUSH, STIFFNESS, WRENCH
from stiffscope.gap.campaign.sanity import SANITY, ReadingRemark

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.runtime.types import Array, Flags
    from stiffscope.vjm.model.mechanism import Mechanism

_AWAY = 30.0  # robot's sizes from its middle: farthest sensor, target or load
_SURE = 8.0  # least standard deviations
_SHARE = 0.1  # least relative excess of 1/C_ii over K_ii
_HEAVY = 1000.0  # largest load over the upper quartile of all


def measure_robot(mechanism: Mechanism) -> tuple[float, Array]:
    """Return the diagonal of the box about joints, centres and tool at home, m, and their middle (3,)."""
    centres = (body.centre for body in mechanism.bodies if body.centre is not None)
    points = np.array(
        [*(joint.at for joint in mechanism.joints), *centres, mechanism.tool.at]
    )
    return float(np.linalg.norm(np.ptp(points, axis=0))), points.mean(axis=0)


def inspect_extremes(
    c: Campaign, mechanism: Mechanism, times: float = 1.0
) -> Iterator[ReadingRemark]:
    """Yield remarks on places far from the robot and on a load far above the others.

    ``times``: factor on the limits.
    """
    size, middle = measure_robot(mechanism)
    places = {("sensors", s.target or s.name): s.at for s in c.sensors if not s.rotates}
    for key, at in (
        places | {("loads", load.name): load.at for load in c.loads}
    ).items():
        away = float(np.linalg.norm(at - middle))
        if away > times * _AWAY * size > 0.0:
            got = f"one {away:.4g} m away, {away / size:.0f} times its size: in mm?"
            text = str(
                c.refuse((*key, "at"), f"expected a place near the robot, got {got}")
            )
            yield ReadingRemark("place", key[1], (text.partition(": ")[0],), text)
    parts = np.abs(np.nan_to_num(c.wrench)) / np.repeat([1.0, size or 1.0], 3)
    load = parts.max(axis=1, initial=0.0)
    row = int(np.argmax(load)) if len(load) else 0
    if (
        load.any()
        and (ratio := load[row] / np.quantile(load[load > 0.0], 0.75)) > times * _HEAVY
    ):
        k = int(np.argmax(parts[row]))
        got = f"{c.wrench[row, k]:g} {'N·m' if k > 2 else 'N'}, {ratio:.2g} times as large: wrong unit?"
        text = f"{c.where(row)}: {WRENCH[k]}: expected a load of the size of the others, got {got}"
        yield ReadingRemark("wrench", WRENCH[k], (c.where(row),), text)


def find_unloaded(c: Campaign) -> Flags:
    """Return flags (n,) of deflections beyond their noise and a known zero, under no force or moment."""
    zeroed = np.array([s.zero == "session" for s in c.sensors] + [False])[c.sensor]
    still = c.is_difference & ~np.nan_to_num(c.wrench).any(axis=1) & ~zeroed
    return still & (np.abs(c.value) > _SURE * np.nan_to_num(c.sigma))


def inspect_mechanics(c: Campaign) -> Iterator[ReadingRemark]:
    """Yield remarks on deflections under no load, and on stiffnesses K_ii below 1/C_ii at their pose."""
    rows = np.flatnonzero(find_unloaded(c))
    for name in dict.fromkeys(map(c.what, rows.tolist())):
        where = tuple(c.where(row) for row in rows.tolist() if c.what(row) == name)
        text = f"{name} is deflected by no force or moment at {', '.join(where[: SANITY.shown])}: is a load missing?"
        yield ReadingRemark(
            "no-load", name, where, f"{text} A diagnosis leaves these out"
        )
    known: dict[tuple[int, int], int] = {}
    for row in np.flatnonzero((c.kind == STIFFNESS) | (c.kind == PUSH)).tolist():
        key = int(c.pose[row]), int(c.direction[row])
        held, free = sorted(
            (known.setdefault(key, row), row), key=lambda each: c.kind[each]
        )
        sigma = np.hypot(*np.nan_to_num(c.sigma[[held, free]]))
        if c.kind[held] < c.kind[free] and c.value[free] - c.value[held] > max(
            _SURE * sigma, _SHARE * c.value[free]
        ):
            one, two = (
                f"{c.value[group]:.4g} at {c.where(group)}" for group in (held, free)
            )
            text = (
                f"{c.what(held)} is {one}, below {c.what(free)} of {two} and one pose"
            )
            where = c.where(held), c.where(free)
            yield ReadingRemark(
                "contradiction", c.what(held), where, f"{text}: are the two exchanged?"
            )
            return

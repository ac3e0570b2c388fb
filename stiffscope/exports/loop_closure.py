"""Closing of a loop by springs at a cut joint, whose compliance is taken from what is next to it.

A rigid joint cannot be closed by a force. A stiff spring can stand for it, and an elastic body or
bearing at the joint is made stiffer by as much, so that both in series yield as before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.model.joints import JOINT_TYPES

if TYPE_CHECKING:
    from stiffscope.vjm.model.screws import Array

_LEVER = (
    0.1  # m, between the points of a spring along an axis with nothing elastic near it
)
_DRAG = 1e-3  # of the stiffness of a closure: what drags a further body along
_MOVED = {
    "universal": 1,
    "cylindrical": 2,
    "planar": 2,
    "prismatic": 1,
}
"""Free motions of a cut joint that a further body performs, so that its spring sees none but a turn
about an axis or about a point."""


@dataclass(frozen=True, eq=False)
class Closure:
    """Springs that close a loop at a cut joint.

    Attributes
    ----------
    body, end
        Elastic body and index of its end that becomes stiffer; end -1 of the joint's own bearing;
        an empty name if nothing does.
    compliance
        (6, 6) what it loses, in part axes at the end, or in the joint's axes.
    stiffness
        (6,) of the closure along and about the joint's axes, N/m and N·m/rad; zero where it is free.
    moved
        How many of the joint's free motions a further body performs.
    side
        Node whose part axes are those of the closure of a ball joint; empty: the joint's axes.
    """

    body: str
    end: int
    compliance: Array
    stiffness: Array
    moved: int
    side: str = ""


def count_moved(kind: str) -> int:
    """Return how many free motions of a cut joint a further body performs."""
    return _MOVED.get(kind, 0)


def close_loop(
    kind: str, local: Array | None, rigid: float | Array, share: float
) -> Array:
    """Return the stiffness (6,) of a closure along and about a joint's axes.

    Parameters
    ----------
    kind
        Kind of the joint.
    local
        (6, 6) stiffness of what is next to the joint, in the joint's axes, zero where it is rigid;
        None if nothing is elastic.
    rigid
        Least stiffness of translations, N/m: of all or of each (3,).
    share
        Of the local compliance that the closure takes.
    """
    moved = count_moved(kind)
    free = JOINT_TYPES[kind].free[moved:]
    held = [k for k in range(6) if k not in free]
    if kind == "universal":  # closed about its second axis, x of the closure
        held = [0, 1, 2, 4, 5]
    stiffness = np.zeros(6)
    least = np.broadcast_to(np.asarray(rigid, dtype=float), 3)
    least = np.concatenate([least, least.max() * np.full(3, _LEVER**2)])
    stiffness[held] = least[held]
    if local is not None:
        used = [k for k in held if local[k, k] > 0.0]
        own = np.sqrt(np.diagonal(local)[used])
        part = local[np.ix_(used, used)] / np.outer(own, own)
        largest = float(np.linalg.eigvalsh(part)[-1])
        needed = largest * own**2 / share
        for k, value in zip(used, needed, strict=True):
            stiffness[k] = max(value, least[k]) if k < 3 else value
    dragged = kind in {"prismatic", "cylindrical"}
    for k in JOINT_TYPES[kind].free[:moved] if dragged else ():
        stiffness[k] = least[k] * _DRAG
    across = [1, 2]
    if 3 not in held and 4 in held:  # two points along the axis hold both alike
        stiffness[across] = stiffness[across].max()
        stiffness[4:] = stiffness[4:].max()
    return stiffness


def taken_compliance(stiffness: Array, local: Array) -> Array:
    """Return the compliance (6, 6) of a closure where the local stiffness (6, 6) is finite."""
    held = (stiffness > 0.0) & (np.diagonal(local) > 0.0)
    out = np.zeros((6, 6))
    index = np.flatnonzero(held)
    out[index, index] = 1.0 / stiffness[index]
    return out


def hold_points(stiffness: Array) -> list[tuple[float, Array, float]]:
    """Return the springs of a closure: place along the joint's x axis (m), direction (6,), stiffness.

    Turns about x that are large allow no springs about y and z: two points on the axis hold both.
    """
    out: list[tuple[float, Array, float]] = []
    directions = np.eye(6)
    line = stiffness[3] == 0.0 and stiffness[4] > 0.0
    if not line:
        return [
            (0.0, directions[k], float(stiffness[k]))
            for k in np.flatnonzero(stiffness > 0.0)
        ]
    if stiffness[0] > 0.0:
        out.append((0.0, directions[0], float(stiffness[0])))
    lever = float(np.sqrt(stiffness[4] / stiffness[1]))
    for along in (-lever, lever):
        out += [(along, directions[k], 0.5 * float(stiffness[k])) for k in (1, 2)]
    return out

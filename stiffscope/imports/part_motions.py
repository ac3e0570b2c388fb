"""Relative motion of two parts in a network of constraints, given as rows on relative twists.

The network is reduced like one of resistors: freedoms add in series, constraints add in parallel,
and a part joined to only one other does not constrain the rest (K. J. Waldron, The constraint
analysis of mechanisms, J. Mechanisms 1, 1966). The irreducible rest is solved as one system.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.model.joints import FREE
from stiffscope.vjm.model.screws import shift
from stiffscope.vjm.model.subspaces import null_space, range_space

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from stiffscope.cad.contacts import Contact
    from stiffscope.runtime.types import Array

    _Network = defaultdict[
        int, dict[int, Array]
    ]  # rows (m, 6) between neighbours, both ways


@dataclass(frozen=True, eq=False)
class Freedom:
    """A joint: kind, place (3,) in m, axes (3,) and reason.

    ``kind`` is empty if no joint type has these freedoms; ``faces`` of either part are in contact.
    """

    first: int
    second: int
    kind: str
    at: Array
    axis: Array | None
    axis2: Array | None
    reason: str
    faces: tuple[tuple[int, ...], tuple[int, ...]]
    freedom: Array = field(repr=False)
    """Twists (6, k) at the base origin, translations over the assembly's size."""
    contacts: tuple[Contact, ...] = field(default=(), repr=False)
    """What touches either part here, hardware between them included."""

    @property
    def ends(self) -> tuple[int, int]:
        """Both parts."""
        return self.first, self.second


@dataclass(frozen=True, eq=False)
class Bond:
    """Constraints of two solids: rows (m, 6) on their relative twist at the base origin; contact.

    ``label``, ``at``: label and place, (3,) m, of the assembly's own joint here.
    """

    first: int
    second: int
    rows: Array
    contact: Contact | None
    label: str = ""
    at: Array | None = None

    @property
    def ends(self) -> tuple[int, int]:
        """Both solids."""
        return self.first, self.second


def joint_freedom(
    kind: str, at: Array, axis: Array | None, axis2: Array | None
) -> Array:
    """Return the twists (6, k) at the base origin that a joint leaves free.

    Parameters
    ----------
    kind
        Kind of the joint.
    at
        Its position (3,), m.
    axis, axis2
        Directions (3,); None where it has none.
    """
    x = np.eye(3)[0] if axis is None else axis
    across = null_space(x[None, :])
    axes = np.column_stack((x, across) if axis2 is None else (x, axis2, across[:, 0]))
    twists = shift(-at) @ np.kron(np.eye(2), axes)
    return twists[:, list(FREE[kind])]


def relative_freedom(
    holds: Iterable[tuple[int, int, Array]], first: int, second: int
) -> Array:
    """Return the orthonormal relative twists (6, k) of two parts that constraints leave free.

    ``holds``: pairs of parts, and rows (m, 6) on their relative twist at the base origin.
    """
    network: _Network = defaultdict(dict)
    for one, other, rows in holds:
        _hold(network, one, other, rows)
    ends = first, second
    waiting = set(network)
    while waiting:
        part = waiting.pop()
        if part not in network or part in ends:
            continue
        around = network[part]
        rigid = next((other for other, rows in around.items() if len(rows) == 6), None)
        if len(around) > 2 and rigid is None:
            continue
        waiting |= set(around)
        del network[part]
        for other in around:
            del network[other][part]
        if rigid is not None:
            for other, rows in around.items():
                _hold(network, rigid, other, rows)
        elif len(around) == 2:
            (one, rows), (other, others) = around.items()
            freedom = range_space(np.hstack((null_space(rows), null_space(others))))
            _hold(network, one, other, null_space(freedom.T).T)
    return _solve_whole(network, first, second)


def holds_more(rows: Array, joints: Sequence[Freedom], first: int, second: int) -> bool:
    """Whether rows (m, 6) hold anything that joints do not hold between two parts."""
    moving = relative_freedom(map(held_by, joints), first, second)
    return bool(np.abs(rows @ moving).max(initial=0.0) > 1e-7)


def held_by(joint: Freedom) -> tuple[int, int, Array]:
    """A joint as its parts and the rows (m, 6) that it takes to zero."""
    return *joint.ends, null_space(joint.freedom.T).T


def tool_motions(
    joints: Sequence[Freedom], tool: int, ground: int, at: Array, scale: float
) -> Array:
    """Return a part's twists (6, k) at a point (3,) to the ground, translations over ``scale``, m."""
    return shift(at / scale) @ relative_freedom(map(held_by, joints), ground, tool)


def _hold(network: _Network, one: int, other: int, rows: Array) -> None:
    """Add a constraint to those between two parts."""
    if one == other or not rows.size:
        return
    here = network[one].get(other)
    if here is not None:
        rows = range_space(np.vstack((here, rows)).T).T
    network[one][other] = network[other][one] = rows


def _solve_whole(network: _Network, first: int, second: int) -> Array:
    """Return the second part's twists (6, k) relative to the first: null space of constraints."""
    order = [second, *(set(network) - {first, second})]
    at = {part: 6 * n for n, part in enumerate(order)}
    blocks = []
    for one, around in network.items():
        for other, rows in around.items():
            if one < other:
                block = np.zeros((len(rows), 6 * len(order)))
                for part, sign in ((one, -1.0), (other, 1.0)):
                    if part != first:
                        block[:, at[part] : at[part] + 6] = sign * rows
                blocks.append(block)
    return range_space(null_space(np.vstack(blocks))[:6]) if blocks else np.eye(6)

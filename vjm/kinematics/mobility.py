"""Mobility of a mechanism at one configuration: motions, idle motions, redundant constraints.

Bodies are rigid. Joint rates q̇ satisfy one twist equation per independent loop, ``A q̇ = 0``; the
null space of A contains the mechanism's motions, its left null space the redundant constraints:
joint wrenches in equilibrium without a load. Both follow from the singular values of A, lengths
relative to the mechanism's.

References
----------
J. Angeles, Fundamentals of Robotic Mechanical Systems, 4th ed., Springer 2014, ch. 8.
T. H. Davies, "Kirchhoff's circulation law applied to multi-loop kinematic chains", Mech. Mach.
Theory 16 (1981) 171.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import repeat
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import say_count
from stiffscope.vjm.kinematics.joint_rates import JointRates
from stiffscope.vjm.model.checks import list_names
from stiffscope.vjm.model.mechanism import COORDINATES
from stiffscope.vjm.model.screws import shift
from stiffscope.vjm.model.subspaces import (
    RANK,
    ZERO,
    find_blocks,
    name_directions,
    null_space,
    range_space,
    rank,
    split_spaces,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.model.subspaces import Direction

NEAR = 1e-4  # relative singular value below which a direction is nearly free
_TOGETHER = 3
_MANY = 1000  # loops that are searched jointly, and their combinations


ALL = 6  # directions of a rigid body


@dataclass(frozen=True, eq=False)
class Redundancy:
    """Constraints that a loop, or ``loops`` of them together, hold redundantly.

    ``bodies``: those of the loop in its order; for several loops all of theirs, sets shortened to
    e.g. leg1. ``directions``: ``count`` of them for a single loop, else empty.
    """

    loops: int
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    count: int
    directions: tuple[Direction, ...]

    def __str__(self) -> str:
        many = say_count(self.count, "redundant constraint")
        if self.loops == 1:
            listed = ", ".join(map(str, self.directions))
            which = "all directions" if self.count == ALL else listed
            return f"the loop through {list_names(self.bodies)} has {many}: {which}"
        return f"the {self.loops} loops through {list_names(self.bodies)} share {many}"


@dataclass(frozen=True, eq=False)
class Idle:
    """``count`` idle motions of ``bodies`` in ``joints``, with tool, drives and springs at rest."""

    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    count: int
    direction: Direction | None
    """Motion of the bodies if it is a single one that all share."""

    def __str__(self) -> str:
        who = list_names(self.bodies)
        where = list_names(self.joints)
        s = "s" if len(self.bodies) == 1 else ""
        if self.direction is None:
            ways = "" if self.count == 1 else f" in {self.count} independent ways"
            return f"{who} move{s} idly{ways} in {where}"
        verb = {"rotation": "spin", "translation": "slide", "screw": "screw"}[
            self.direction.kind
        ]
        place = "between" if len(self.joints) == 2 else "in"
        return f"{who} {verb}{s} {place} {where}"


@dataclass(frozen=True, eq=False)
class Mobility:
    """Mobility of a mechanism with rigid bodies at one configuration.

    Attributes
    ----------
    freedoms
        Sum of the joints' dof.
    loops
        Independent loops, each as the bodies in it.
    dof
        Degrees of freedom of the mechanism: ``freedoms - 6 loops + redundant``.
    tool
        Motions of the tool at M, base axes.
    coordinates
        State of each of x y z rx ry rz at M: "commanded" by ``tool.pose``, "follows" from those,
        "free", "held", or "locked": commanded but held by the loops.
    loose
        Tool motions that neither locked drives nor springs resist: drives are missing.
    dependent_drives
        Drives determined by other drives or the loops; ``redundant_drives`` of them are
        superfluous.
    redundancies, idle
        Redundant constraints and idle motions.
    constraint_margin
        Smallest nonzero singular value of A over the largest: 0 if singular.
    rounding
        Largest singular value of A taken as zero, over the largest.
    conditioning
        Inverse condition number of the map from drives to commanded coordinates, lengths relative
        to the mechanism's: 0 if singular; None if their numbers differ or are zero.
    """

    freedoms: int
    loops: tuple[tuple[str, ...], ...]
    dof: int
    tool: tuple[Direction, ...]
    coordinates: Mapping[str, str]
    loose: tuple[Direction, ...]
    redundant_drives: int
    dependent_drives: tuple[str, ...]
    redundancies: tuple[Redundancy, ...]
    idle: tuple[Idle, ...]
    constraint_margin: float
    rounding: float
    conditioning: float | None

    @property
    def count(self) -> int:
        """Mobility by the Chebychev-Grübler-Kutzbach formula, ``freedoms - 6 loops``."""
        return self.freedoms - 6 * len(self.loops)

    @property
    def redundant(self) -> int:
        """Number of redundant constraints."""
        return sum(r.count for r in self.redundancies)

    @property
    def idle_count(self) -> int:
        """Number of idle motions."""
        return sum(i.count for i in self.idle)


def mobility(
    mechanism: Mechanism, configurations: Configurations | None = None, index: int = 0
) -> Mobility:
    """Return the mobility at home, or at one of given configurations, which must be valid.

    Parameters
    ----------
    mechanism
        Bodies, joints, tool and gravity of the robot.
    configurations
        Configurations (n,) of the mechanism.
    index
        Index of the configuration.
    """
    rates = JointRates(mechanism, configurations, index)
    unit = np.eye(int(rates.starts[-1]))
    size = len(unit)
    equations = [rates.add_twists(loop) for loop in rates.loops]
    whole = np.vstack(equations) if equations else np.zeros((0, size))
    left, values, motions = split_spaces(whole)
    starts = enumerate(rates.starts[:-1].tolist())
    driven = [
        at + (rates.joints[k].driven or 0) for k, at in starts if rates.joints[k].drive
    ]
    springs = [
        unit[rates.columns(k)]
        for k, j in enumerate(rates.joints)
        if j.spring is not None
    ]
    drives = unit[np.array(driven, dtype=int)]
    to_tool = shift((rates.tool - rates.middle) / rates.length)
    tool = to_tool @ rates.of_body(mechanism.carrier(mechanism.tool.body))
    held = motions @ null_space(np.vstack([drives, *springs]) @ motions)
    idle = held @ null_space(tool @ held)
    return Mobility(
        size,
        tuple(rates.bodies(loop) for loop in rates.loops),
        motions.shape[1],
        _twists(rates, tool @ motions),
        _coordinates(rates, tool @ motions),
        _twists(rates, tool @ held),
        *_find_dependent(rates, drives @ motions),
        _redundancies(rates, equations, left),
        _idle(rates, idle),
        *values,
        _measure_conditioning(
            (tool @ motions)[mechanism.tool.commanded_axes], drives @ motions
        ),
    )


def _shorten_names(names: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """Abbreviate names: a complete set ("leg1.…") by its prefix."""
    out: list[str] = []
    for name in names:
        leader = name.partition(".")[0]
        whole = [other for other in known if other.partition(".")[0] == leader]
        out.append(leader if len(whole) > 1 and set(whole) <= set(names) else name)
    return tuple(dict.fromkeys(out))


def _find_dependent(rates: JointRates, drives: Array) -> tuple[int, tuple[str, ...]]:
    """Return the number of drives that depend on others, and the names of those involved."""
    left = null_space(drives.T)
    names = [j.name for j in rates.mechanism.drives]
    taking = np.linalg.norm(left, axis=1) > ZERO
    return left.shape[1], tuple(
        name for name, part in zip(names, taking, strict=True) if part
    )


def _twists(rates: JointRates, twists: Array) -> tuple[Direction, ...]:
    """Return the named directions of a space of twists (6, k) at M."""
    basis = np.roll(range_space(twists), 3, axis=0)  # the rotation first
    return tuple(name_directions(basis, "rotation", "translation", rates.length))


def _coordinates(rates: JointRates, tool: Array) -> dict[str, str]:
    """Return ``Mobility.coordinates`` from tool motions (6, k)."""
    pose = rates.mechanism.tool.pose
    out: dict[str, str] = {}
    taken: Array = np.zeros((0, tool.shape[1]))
    for name in sorted(
        COORDINATES, key=lambda each: (each not in pose, COORDINATES.index(each))
    ):
        row = tool[COORDINATES.index(name)]
        more = np.vstack([taken, row])
        fresh = rank(more) > rank(taken) and np.linalg.norm(row) > RANK
        if fresh:
            taken = more
        if name in pose:
            out[name] = "commanded" if fresh else "locked"
        elif np.linalg.norm(row) <= RANK:
            out[name] = "held"
        else:
            out[name] = "free" if fresh else "follows"
    return {name: out[name] for name in COORDINATES}


def _measure_conditioning(pose: Array, drives: Array) -> float | None:
    """Return the inverse condition number from drives to commanded coordinates, (d, k) and (p, k)."""
    if len(drives) != len(pose) or not len(pose):
        return None
    forward = pose @ np.linalg.pinv(drives, rcond=RANK)
    backward = drives @ np.linalg.pinv(pose, rcond=RANK)
    if rank(forward) < len(pose) or rank(backward) < len(pose):
        return 0.0
    values = np.linalg.svd(forward, compute_uv=False)
    return float(values[-1] / values[0])


def _redundancies(
    rates: JointRates, equations: list[Array], left: Array
) -> tuple[Redundancy, ...]:
    """Split the left null space (6 loops, r): single loops first, then few, then many together."""
    out: list[Redundancy] = []
    known = np.zeros((len(left), 0))
    for group in _neighbours(rates):
        if known.shape[1] == left.shape[1]:
            break
        wrenches = null_space(np.vstack([equations[k] for k in group]).T)
        block = np.zeros((len(left), wrenches.shape[1]))
        for i, k in enumerate(group):
            block[6 * k : 6 * k + 6] = wrenches[6 * i : 6 * i + 6]
        fresh = range_space(block - known @ (known.T @ block))
        if fresh.shape[1]:
            out.append(_redundancy(rates, group, fresh))
            known = np.hstack([known, fresh])
    rest = left @ null_space(known.T @ left)
    blocks = find_blocks(rest, list(repeat(6, len(equations))))
    return (*out, *(_redundancy(rates, group, rest[:, :n]) for group, n in blocks))


def _redundancy(rates: JointRates, group: Sequence[int], wrenches: Array) -> Redundancy:
    loops = [rates.loops[k] for k in group]
    names = rates.names(dict.fromkeys(j for loop in loops for j, _ in loop))
    equation_wrenches = (
        wrenches[6 * group[0] : 6 * group[0] + 6]
        if len(group) == 1
        else np.zeros((6, 0))
    )
    directions = tuple(
        name_directions(equation_wrenches, "translation", "rotation", rates.length)
    )
    bodies = tuple(dict.fromkeys(name for loop in loops for name in rates.bodies(loop)))
    if len(loops) > 1:
        bodies = _shorten_names(bodies, [b.name for b in rates.mechanism.bodies])
    return Redundancy(len(loops), bodies, names, wrenches.shape[1], directions)


def _neighbours(rates: JointRates) -> Iterable[tuple[int, ...]]:
    """Yield each loop, then pairs and triples of loops that share joints, while they are few."""
    joints = [{k for k, _ in loop} for loop in rates.loops]
    groups: list[tuple[int, ...]] = [(k,) for k in range(len(joints))]
    for _ in range(_TOGETHER):
        yield from groups
        larger = {
            tuple(sorted((*group, k)))
            for group in groups
            for k in range(len(joints))
            if k not in group and any(joints[k] & joints[other] for other in group)
        }
        groups = sorted(larger)
        if len(groups) > _MANY:
            return


def _idle(rates: JointRates, idle: Array) -> tuple[Idle, ...]:
    """Split idle motions (m, k) into independent ones, which share no joint."""
    out: list[Idle] = []
    for group, count in find_blocks(idle, np.diff(rates.starts).astype(int).tolist()):
        separate = np.zeros_like(idle)
        for j in group:
            separate[rates.columns(j)] = idle[rates.columns(j)]
        motion = range_space(separate)
        twists = {
            b.name: rates.of_body(b.name) @ motion for b in rates.mechanism.bodies
        }
        moving = {
            name: t for name, t in twists.items() if np.abs(t).max(initial=0.0) > ZERO
        }
        together = range_space(np.hstack(list(moving.values())))
        single = count == 1 and together.shape[1] == 1
        direction = _twists(rates, together)[0] if single else None
        out.append(Idle(tuple(moving), rates.names(group), count, direction))
    return tuple(out)

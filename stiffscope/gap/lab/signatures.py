"""Signatures of small faults in readings, from element wrenches, to find equivalent faults."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, cast

import numpy as np

from stiffscope.gap.lab.closure import joint_state
from stiffscope.gap.lab.machine import BASE, DRIVEN, FREE, TOOL
from stiffscope.gap.lab.measuring import sigma_of
from stiffscope.gap.lab.nonlinear import rounding_force
from stiffscope.gap.lab.response import Spot, respond, tool_spot
from stiffscope.gap.lab.rotations import turn

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stiffscope.gap.lab.closure import Located
    from stiffscope.gap.lab.machine import Joint, Machine
    from stiffscope.gap.lab.measuring import Noise, Plan, Readings
    from stiffscope.gap.lab.rotations import Array

_JOINT = ([0.0, 1, 1, 0, 0, 0], [1.0, 0, 0, 0, 0, 0], [0.0, 0, 0, 1, 1, 1])  # radial, axial, tilting
_GUIDE = ([0.0, 1, 0, 0, 0, 0], [0.0, 0, 1, 0, 0, 0], [0.0, 0, 0, 1, 1, 1])
_ENTRIES = [(i, j) for i in range(6) for j in range(i, 6)]
_DEPENDENT = 1e-9  # relative singular value of linearly dependent columns


class Signatures:
    """Derivatives of a plan's readings by fault parameters, divided by the noise."""

    def __init__(self, machine: Machine, plan: Plan, located: Located, rows: Readings, noise: Noise) -> None:
        self._machine, self._plan, self._rows, self._located = machine, plan, rows, located
        self._found: dict[tuple[str, str], Array | None] = {}
        self.sigma = sigma_of(rows, noise)
        channels = plan.channels(machine)
        spots = [tool_spot(machine), *plan.hooks.values(), *(Spot(s.node, s.at) for s in channels)]
        self._response = respond(machine, located, spots)
        first = 6 * (1 + len(plan.hooks))
        cases = self._response.dead + 1
        self._looks = np.zeros((len(channels), cases))  # unit loads in each channel's direction
        for k, sensor in enumerate(channels):
            at = first + 6 * k + (0 if sensor.measures == "displacement" else 3)
            self._looks[k, at : at + 3] = sensor.direction
        where = {name: 6 * (k + 1) for k, name in enumerate(plan.hooks)} | {"": 0}
        self._pulls = np.zeros((len(plan.loads) + 1, cases))  # the last: permanent loads
        self._pulls[-1, -1] = 1.0
        for k, (name, wrench) in enumerate(plan.loads):
            self._pulls[k, where[name] : where[name] + 6] = wrench

    def find_columns(self, effect: str, place: str, softer: Mapping[str, Array]) -> Array | None:
        """Return the cached columns of an effect; see `_columns`."""
        if (effect, place) not in self._found:
            self._found[effect, place] = self._columns(effect, place, softer)
        return self._found[effect, place]

    def _columns(self, effect: str, place: str, softer: Mapping[str, Array]) -> Array | None:
        """Return the columns (r, k) of an effect at a place; None if it does not act on elements.

        softer: compliance added to each body by a parameter step, for effects that change parts.
        """
        members = self._machine.members(place)
        joints, bodies = self._machine.joints, self._machine.bodies
        shapes = {"joint-compliance": _JOINT, "guide-compliance": _GUIDE}
        added = {"base-compliance": BASE, "platform-compliance": TOOL}
        of_drives = {"actuator-stiffness": self._soften, "encoder-offset": self._move, "backlash": self._lose_motion}
        if effect in of_drives:
            return of_drives[effect]({name: np.eye(6)[DRIVEN[joints[name].kind]] for name in members})
        if effect == "part-compliance":
            return self._entries(members)
        if effect == "joint-axis":
            return self._mislay({name: joints[name] for name in members})
        if effect in added or effect in shapes:
            held = {} if effect in added else {
                n: [self._hold_diagonal(n, np.array(shape)) for shape in shapes[effect]] for n in members
            }  # fmt: skip
            return self._add_compliance(held or {added[effect]: list(np.eye(6))})
        if effect in {"link-length", "thermal"}:
            grown = {n: bodies[n].expansion if effect == "thermal" else 1.0 / bodies[n].length for n in members}
            return self._move({n: np.pad(size * bodies[n].away, ((0, 0), (0, 3))).ravel() for n, size in grown.items()})
        return self._spread(softer) if softer else None

    def _entries(self, members: Sequence[str]) -> Array:
        """Return the columns (r, 21) of compliance entries common to these bodies."""
        columns: list[Array] = []
        for i, j in _ENTRIES:
            entry = np.zeros((6, 6))
            entry[i, j] = entry[j, i] = 1.0
            columns.append(self._spread(dict.fromkeys(members, entry)))
        return np.hstack(columns)

    def _hold_diagonal(self, name: str, diagonal: Array) -> Array:
        joint = self._machine.joints[name]
        if not joint.directed:  # equal in all directions
            diagonal = np.array([diagonal[1], *diagonal[1:]])
        free = () if joint.kind == "universal" else FREE[joint.kind]
        return np.array([0.0 if i in free else value for i, value in enumerate(diagonal)])

    def _add_compliance(self, diagonals: Mapping[str, list[Array]]) -> Array:
        """Return the columns of diagonal compliances (6,), one for each in the list."""
        count = len(next(iter(diagonals.values())))
        return np.hstack([self._spread({n: np.diag(d[k]) for n, d in diagonals.items()}) for k in range(count)])

    def _soften(self, along: Mapping[str, Array]) -> Array:
        """Return the column (r, 1) of elements compliant in one direction (6,) each."""
        return self._add_compliance({name: [direction] for name, direction in along.items()})

    def _spread(self, compliances: Mapping[str, Array]) -> Array:
        out = np.zeros((len(self._plan.poses), len(self._looks), len(self._pulls)))
        for name, compliance in compliances.items():
            carried = self._response.wrench(name)[:, :, : self._looks.shape[1]]
            pulls = carried @ self._pulls.T
            if name == TOOL:
                pulls[:, :, -1] = 0.0  # it does not carry the machine's weight
            out += np.swapaxes(carried @ self._looks.T, 1, 2) @ compliance @ pulls
        return self._column(out)

    def _move(self, offsets: Mapping[str, Array]) -> Array:
        out = np.zeros((len(self._plan.poses), len(self._looks), len(self._pulls)))
        for name, twist in offsets.items():
            carried = self._response.wrench(name)[:, :, : self._looks.shape[1]]
            out[:, :, -1] += np.einsum("nic,kc,ni->nk", carried, self._looks, np.broadcast_to(twist, carried.shape[:2]))
        return self._column(out)

    def _mislay(self, joints: Mapping[str, Joint]) -> Array:
        """Return columns (r, k) of axis errors: a twist less itself moved by the joint's motion."""
        columns: list[Array] = []
        for k in (1, 2, 4, 5):
            moved: dict[str, Array] = {}
            for name, joint in joints.items():
                ends = self._machine.carrier(joint.first), self._machine.carrier(joint.second)
                way = joint_state(joint.drawn_joint, self._located.frames, *ends).displacement
                astray = np.eye(6)[k].reshape(2, 3)
                if joint.kind == "prismatic":  # a rotated slide changes direction
                    moved[name] = np.hstack([way[:, None] * np.cross(astray[1], np.eye(3)[0]), np.zeros((len(way), 3))])
                else:
                    moved[name] = np.hstack([a - turn(way[:, None] * np.eye(3)[0]) @ a for a in astray])
            columns.append(self._move(moved))
        return np.hstack(columns)

    def _lose_motion(self, along: Mapping[str, Array]) -> Array:
        """Return the column (r, 1) of play: elements shift along (6,) towards their force."""
        out = np.zeros((len(self._plan.poses), len(self._looks), len(self._pulls)))
        for name, direction in along.items():
            carried = direction @ self._response.wrench(name)[:, :, : self._looks.shape[1]]
            force = carried @ self._pulls.T
            for kind in (slice(0, -1), slice(-1, None)):  # rounding by loads or weights
                none = rounding_force(force[:, kind])
                sign = np.where(np.abs(force[:, kind]) > none, np.sign(force[:, kind]), 0.0)
                out[:, :, kind] += (carried @ self._looks.T)[:, :, None] * sign[:, None]
        return self._column(out)

    def _column(self, shown: Array) -> Array:
        """Return readings (r, 1) over their noise from channel values (n, c, loads)."""
        rows = self._rows
        return (shown[rows.pose, rows.channel, rows.load] / self.sigma)[:, None]  # load -1: the last


def orthonormal_basis(columns: Array) -> Array:
    """Return an orthonormal basis (r, m) of the span of columns (r, k)."""
    size = np.linalg.norm(columns, axis=0)
    basis, values, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return basis[:, values > _DEPENDENT * values.max(initial=0.0)]


def project_out(columns: Array, basis: Array) -> Array:
    """Return columns (r, k) minus their projection onto an orthonormal basis (r, m)."""
    return columns - basis @ (basis.T @ columns)


def fit_residual(signature: Array, columns: Array, most: int) -> float:
    """Return the residual norm of a signature (r,) fitted by at most `most` of columns (r, k)."""
    size = np.linalg.norm(columns, axis=0)
    unit = columns[:, size > 0.0] / size[size > 0.0]
    gram, pull, whole = unit.T @ unit, unit.T @ signature, float(signature @ signature)
    best = whole
    count = len(pull)
    for some in cast("Iterable[tuple[int, ...]]", combinations(range(count), min(most, count))):
        part = cast("Array", pull[list(some)])
        inverse = cast("Array", np.linalg.pinv(gram[np.ix_(some, some)], rcond=_DEPENDENT, hermitian=True))
        best = min(best, whole - float(part @ inverse @ part))
    return float(np.sqrt(max(best, 0.0)))

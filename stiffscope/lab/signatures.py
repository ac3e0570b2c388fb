"""Signatures of small faults in readings, from element wrenches, to find equivalent faults."""

from __future__ import annotations

from itertools import combinations, combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.lab.closure import joint_state
from stiffscope.lab.machine import BASE, DRIVEN, FREE, TOOL
from stiffscope.lab.measuring import drawn_targets, sigma_of
from stiffscope.lab.nonlinear import rounding_force
from stiffscope.lab.response import Spot, respond, tool_spot
from stiffscope.lab.rotations import turn

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stiffscope.lab.closure import Located
    from stiffscope.lab.machine import Joint, Machine
    from stiffscope.lab.measuring import Noise, Plan, Readings
    from stiffscope.lab.rotations import Array

_SHAPES = {
    "joint-compliance": np.array(
        [[0.0, 1, 1, 0, 0, 0], [1, 0, 0, 0, 0, 0], [0, 0, 0, 1, 1, 1]]
    ),
    "guide-compliance": np.array(
        [[0.0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]]
    ),
}
"""Diagonals of a unit of each parameter: radial, axial, tilting; lateral, vertical, angular."""
_SUPPORTS = {"base-compliance": BASE, "platform-compliance": TOOL}
_DEPENDENT = 1e-9  # relative singular value of linearly dependent columns


class Signatures:
    """Derivatives of a plan's readings by fault parameters, divided by the noise."""

    def __init__(
        self,
        machine: Machine,
        plan: Plan,
        located: Located,
        rows: Readings,
        noise: Noise,
    ) -> None:
        self._machine = machine
        self._plan = plan
        self._rows = rows
        self._located = located
        self._found: dict[tuple[str, str], Array | None] = {}
        self.sigma = sigma_of(rows, noise)
        channels = plan.channels(machine)
        spots = [
            tool_spot(machine),
            *plan.hooks.values(),
            *(Spot(s.node, s.at) for s in channels),
        ]
        self._response = respond(machine, located, spots)
        first = 6 * (1 + len(plan.hooks))
        cases = self._response.dead + 1
        self._looks = np.zeros(
            (len(channels), cases)
        )  # unit loads in each channel's direction
        for k, sensor in enumerate(channels):
            at = first + 6 * k + (0 if sensor.measures == "displacement" else 3)
            self._looks[k, at : at + 3] = sensor.direction
        where = {name: 6 * (k + 1) for k, name in enumerate(plan.hooks)} | {"": 0}
        self._pulls = np.zeros(
            (len(plan.loads) + 1, cases)
        )  # the last: permanent loads
        self._pulls[-1, -1] = 1.0
        for k, (name, wrench) in enumerate(plan.loads):
            self._pulls[k, where[name] : where[name] + 6] = wrench
        self._still = slice(
            -1, None
        )  # what shows the unloaded machine: of positions every reading
        if plan.frame is not None:
            self._pulls[:-1] += self._pulls[-1]
            self._still = slice(None)

    def find_columns(
        self, effect: str, place: str, softer: Mapping[str, Array]
    ) -> Array | None:
        """Return the cached columns of an effect; see `_columns`."""
        if (effect, place) not in self._found:
            self._found[effect, place] = self._columns(effect, place, softer)
        return self._found[effect, place]

    def _columns(
        self, effect: str, place: str, softer: Mapping[str, Array]
    ) -> Array | None:
        """Return the columns (r, k) of an effect at a place; None if it does not act on elements.

        softer: compliance added to each body by a parameter step, for effects that change parts.
        """
        members = self._machine.members(place)
        joints = {
            n: self._machine.joints[n] for n in members if n in self._machine.joints
        }
        bodies = {
            n: self._machine.bodies[n] for n in members if n in self._machine.bodies
        }
        spread: list[Mapping[str, Array]] = [softer] if softer else []
        if effect in {"encoder-offset", "backlash"}:
            along = {
                name: np.eye(6)[DRIVEN[joint.kind]] for name, joint in joints.items()
            }
            return (
                self._move(along)
                if effect == "encoder-offset"
                else self._lose_motion(along)
            )
        if effect in {"link-length", "thermal"}:
            warm = effect == "thermal"
            sizes = {
                n: b.expansion if warm else 1.0 / b.length for n, b in bodies.items()
            }
            away = {
                n: np.pad(b.away * sizes[n], ((0, 0), (0, 3)))
                for n, b in bodies.items()
            }
            return self._move({name: twist.ravel() for name, twist in away.items()})
        if effect == "joint-axis":
            return self._mislay(joints)
        if effect == "actuator-stiffness":
            spread = [
                {
                    n: np.diag(np.eye(6)[DRIVEN[joint.kind]])
                    for n, joint in joints.items()
                }
            ]
        elif effect == "part-compliance":
            units = (
                np.outer(a, b) for a, b in combinations_with_replacement(np.eye(6), 2)
            )
            spread = [
                dict.fromkeys(members, np.maximum(unit, unit.T)) for unit in units
            ]
        elif effect in _SUPPORTS:
            spread = [{_SUPPORTS[effect]: np.diag(axis)} for axis in np.eye(6)]
        elif effect in _SHAPES:
            units = _SHAPES[effect]
            spread = [
                {n: _hold(joint, unit) for n, joint in joints.items()} for unit in units
            ]
        return np.hstack([self._spread(each) for each in spread]) if spread else None

    def _carry(self, name: str) -> tuple[Array, Array]:
        """Return wrenches in an element, its axes: n poses by units of channels and by loads."""
        carried = self._response.wrench(name)[:, :, : self._looks.shape[1]]
        return np.swapaxes(carried @ self._looks.T, 1, 2), carried @ self._pulls.T

    def _spread(self, compliances: Mapping[str, Array]) -> Array:
        """Return the column (r, 1) of compliance (6, 6) added to elements."""
        out = self._nothing
        for name, compliance in compliances.items():
            looks, pulls = self._carry(name)
            if name == TOOL:
                pulls[:, :, self._still] -= pulls[
                    :, :, -1:
                ].copy()  # it does not carry the weight
            out += looks @ compliance @ pulls
        return self._column(out)

    def _move(self, offsets: Mapping[str, Array]) -> Array:
        """Return the column (r, 1) of twists (6,) or (n, 6) of unloaded elements."""
        out = self._nothing
        for name, twist in offsets.items():
            looks, _ = self._carry(name)
            each = np.broadcast_to(twist, looks[:, 0].shape)
            out[:, :, self._still] += np.einsum("nki,ni->nk", looks, each)[:, :, None]
        return self._column(out)

    def _mislay(self, joints: Mapping[str, Joint]) -> Array:
        """Return columns (r, k) of axis errors: a twist less itself moved by the joint's motion."""
        columns: list[Array] = []
        for k in (1, 2, 4, 5):
            moved: dict[str, Array] = {}
            for name, joint in joints.items():
                ends = (
                    self._machine.carrier(joint.first),
                    self._machine.carrier(joint.second),
                )
                way = joint_state(
                    joint.drawn_joint, self._located.frames, *ends
                ).displacement
                misalignment = np.eye(6)[k].reshape(2, 3)
                along = way[:, None] * np.eye(3)[0]
                if joint.kind == "prismatic":  # a rotated slide changes direction
                    turned = way[:, None] * np.cross(misalignment[1], np.eye(3)[0])
                    moved[name] = np.hstack([turned, np.zeros((len(way), 3))])
                else:
                    moved[name] = np.hstack([a - turn(along) @ a for a in misalignment])
            columns.append(self._move(moved))
        return np.hstack(columns)

    def _lose_motion(self, along: Mapping[str, Array]) -> Array:
        """Return the column (r, 1) of play: elements shift along (6,) towards their force."""
        out = self._nothing
        for name, direction in along.items():
            looks, pulls = self._carry(name)
            force = direction @ pulls
            for kind in (slice(0, -1), slice(-1, None)):  # rounding by loads or weights
                none = rounding_force(force[:, kind])
                sign = np.where(
                    np.abs(force[:, kind]) > none, np.sign(force[:, kind]), 0.0
                )
                out[:, :, kind] += (looks @ direction)[:, :, None] * sign[:, None]
        return self._column(out)

    @property
    def frame(self) -> Array:
        """Columns (r, 6 or 0) of rigid motions of an instrument that stands anywhere."""
        rows = self._rows
        if self._plan.frame is None:
            return np.zeros((len(self.sigma), 0))
        targets = drawn_targets(self._machine, self._plan, self._located)
        at = targets[rows.pose, rows.channel // 3]
        along = np.array([sensor.direction for sensor in self._plan.sensors])[
            rows.channel
        ]
        return np.hstack([along, np.cross(at, along)]) / self.sigma[:, None]

    @property
    def _nothing(self) -> Array:
        return np.zeros((len(self._plan.poses), len(self._looks), len(self._pulls)))

    def _column(self, shown: Array) -> Array:
        """Return readings (r, 1) over their noise from channel values (n, c, loads)."""
        rows = self._rows  # load -1: the last
        return (shown[rows.pose, rows.channel, rows.load] / self.sigma)[:, None]


def _hold(joint: Joint, diagonal: Array) -> Array:
    """Return the compliance (6, 6) of a diagonal in a joint's constrained directions."""
    first = diagonal[
        0 if joint.directed else 1
    ]  # without an axis equal in all directions
    out = np.diag([first, *diagonal[1:]])
    if joint.kind != "universal":
        out[FREE[joint.kind], FREE[joint.kind]] = 0.0
    return out


def orthonormal_basis(columns: Array) -> Array:
    """Return an orthonormal basis (r, m) of the span of columns (r, k)."""
    size = np.linalg.norm(columns, axis=0)
    basis, values, _ = np.linalg.svd(
        columns[:, size > 0] / size[size > 0], full_matrices=False
    )
    return basis[:, values > _DEPENDENT * values.max(initial=0.0)]


def project_out(columns: Array, basis: Array) -> Array:
    """Return columns (r, k) minus their projection onto an orthonormal basis (r, m)."""
    return columns - basis @ (basis.T @ columns)


def fit_residual(signature: Array, columns: Array, most: int) -> float:
    """Return the residual norm of a signature (r,) fitted by at most `most` of columns (r, k)."""
    size = np.linalg.norm(columns, axis=0)
    unit = columns[:, size > 0.0] / size[size > 0.0]
    gram = unit.T @ unit
    pull = unit.T @ signature
    whole = float(signature @ signature)
    best = whole
    for some in combinations(range(len(pull)), min(most, len(pull))):
        part: Array = pull[list(some)]
        square: Array = gram[np.ix_(some, some)]
        inverse = np.linalg.pinv(square, rcond=_DEPENDENT, hermitian=True)
        best = min(best, whole - float(part @ inverse @ part))
    return float(np.sqrt(max(best, 0.0)))

"""Where the bodies of a rigid machine stand: Newton's method over the poses of all bodies, from home."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.lab.machine import DRIVEN, FREE, GROUND
from stiffscope.gap.lab.rotations import about_x, lever, rates_of_vector, transform_to, turn, vector_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.lab.machine import Joint, Machine
    from stiffscope.gap.lab.rotations import Array

COORDINATES = ("x", "y", "z", "rx", "ry", "rz")
_STEPS = 8  # on the way from home
_WALK = 2  # iterations at each of them
_END = 30  # iterations at the pose itself
CLOSED = 1e-11
"""Residual of a closed loop, m and rad."""
_DAMPING = 1e-10  # of the largest entry of JᵀJ: idle motions stay where they are


@dataclass(frozen=True)
class Frames:
    """Displacement from home x = R x_home + p of some nodes or bodies, by name; stacks over poses (n, …)."""

    rotation: dict[str, Array]
    position: dict[str, Array]

    def point(self, name: str, home: Array) -> Array:
        """Where a point (3,) of a node is (n, 3)."""
        return self.rotation[name] @ home + self.position[name]

    def some(self, mask: Any) -> Frames:
        """Those at some of the poses."""
        return Frames(
            {name: r[mask] for name, r in self.rotation.items()}, {name: p[mask] for name, p in self.position.items()}
        )

    def move(self, twists: dict[str, Array]) -> Frames:
        """After twists (n, 6) about the origin of some of them."""
        rotation, position = dict(self.rotation), dict(self.position)
        for name, t in twists.items():
            r = turn(t[:, 3:])
            rotation[name] = r @ rotation[name]
            position[name] = (r @ position[name][..., None])[..., 0] + t[:, :3]
        return Frames(rotation, position)


def frames_at_home(names: Sequence[str], count: int) -> Frames:
    """Frames of nodes at home, `count` times."""
    rotation = {name: np.broadcast_to(np.eye(3), (count, 3, 3)).copy() for name in (*names, GROUND)}
    return Frames(rotation, {name: np.zeros((count, 3)) for name in (*names, GROUND)})


@dataclass(frozen=True)
class JointState:
    """A joint at n poses."""

    misfit: Array
    """(n, 6) of the second node against the first in the joint's axes; driven: away from `commanded`, free: zero."""
    carry: Array
    """(n, 6, 6) from a twist about the origin to the joint's axes and point."""
    held: Array
    """(n, r, 6) directions that it holds."""
    displacement: Array
    """(n,) along its first free direction from home: of a drive."""


def joint_state(joint: Joint, frames: Frames, first: str, second: str, commanded: Array | float = 0.0) -> JointState:
    """Return the state of a joint between two nodes.

    Parameters
    ----------
    joint
        Joint of the laboratory's robot.
    frames
        Rotations and places of all nodes at n poses.
    first, second
        Names of the nodes that it joins.
    commanded
        Displacement of its drive from home (n,), m or rad.

    """
    axes = frames.rotation[first] @ joint.axes
    back = np.swapaxes(axes, -1, -2)
    point = frames.point(second, joint.at_second)
    apart = (back @ (point - frames.point(first, joint.at_first))[..., None])[..., 0]
    relative = back @ frames.rotation[second] @ joint.axes
    n = len(point)
    rows = [i for i in joint.held_directions if not (joint.kind == "universal" and i >= 3)]
    held = np.broadcast_to(np.eye(6)[rows], (n, len(rows), 6))
    around = np.zeros((n, 3))
    displacement = apart[:, 0]
    if joint.kind in {"fixed", "prismatic"}:
        around = vector_of(relative)
    elif joint.kind in {"revolute", "cylindrical", "planar"}:
        angle = np.arctan2(relative[:, 2, 1] - relative[:, 1, 2], relative[:, 1, 1] + relative[:, 2, 2])
        around = vector_of(relative @ about_x(-angle))
        if joint.kind == "revolute":
            displacement = commanded + (angle - commanded + np.pi) % (2.0 * np.pi) - np.pi
            around[:, 0] = 0.0
    elif joint.kind == "universal":
        other = (back @ frames.rotation[second] @ joint.axis2[:, None])[..., 0]  # axis2, in the joint's axes
        normal = np.cross(np.eye(3)[0], other)
        size = np.linalg.norm(normal, axis=1)
        home = joint.axes.T @ joint.axis2
        error = np.arctan2(size, other[:, 0]) - np.arctan2(np.linalg.norm(home[1:]), home[0])
        normal = normal / size[:, None]
        around = error[:, None] * normal
        row = np.concatenate([np.zeros((n, 3)), normal], axis=1)
        held = np.concatenate([held, row[:, None]], axis=1)
    misfit = np.concatenate([apart, around], axis=1)
    if joint.drive is not None:
        misfit[:, DRIVEN[joint.kind]] = displacement - commanded
    return JointState(misfit, transform_to(axes, point), held, displacement)


def spring_state(joint: Joint, frames: Frames, first: str, second: str) -> tuple[Array, Array]:
    """Return the free motions of a joint, and how far it is from the rest of its spring.

    Parameters
    ----------
    joint, frames, first, second
        As for `joint_state`.

    Returns
    -------
    Free motions (n, k, 6) as rows, and the displacement (n, 6) from rest; in the joint's axes at its point.

    """
    state = joint_state(joint, frames, first, second)
    axes = frames.rotation[first] @ joint.axes
    back = np.swapaxes(axes, -1, -2)
    relative = back @ frames.rotation[second] @ joint.axes
    n = len(relative)
    away = np.zeros((n, 6))
    rows = np.broadcast_to(np.eye(6)[list(FREE[joint.kind])], (n, len(FREE[joint.kind]), 6))
    if joint.kind == "spherical":
        away[:, 3:] = vector_of(relative)
    elif joint.kind == "universal":  # about x, then about the second axis, seen from the first body
        home, other = joint.axes.T @ joint.axis2, (back @ frames.rotation[second] @ joint.axis2[:, None])[..., 0]
        about = np.arctan2(other[:, 2], other[:, 1]) - np.arctan2(home[2], home[1])
        image = np.swapaxes(relative, -1, -2) @ np.eye(3)[0]  # the first axis, seen from the second body
        side = np.cross(home, np.eye(3)[0])
        turned = -np.arctan2(image @ side, image @ np.cross(side, home))
        rows = np.array(np.broadcast_to(np.eye(6)[[3, 4]], (n, 2, 6)))
        rows[:, 1, 3:] = other
        away[:, 3:] = about[:, None] * np.eye(3)[0] + turned[:, None] * other
    else:
        away[:, DRIVEN[joint.kind]] = state.displacement - joint.rest
    return rows, away


@dataclass(frozen=True)
class Located:
    """The bodies of the machine as its controller believes it to be, at commanded poses."""

    frames: Frames
    drives: dict[str, Array]
    """Displacement (n,) of every drive from home."""
    closed: NDArray[np.bool_]
    """(n,) whether the loops close there and every drive is within its range."""

    def some(self, mask: Any) -> Located:
        """Those at some of the poses."""
        drives = {name: q[mask] for name, q in self.drives.items()}
        return Located(self.frames.some(mask), drives, self.closed[mask])


def home_of(machine: Machine) -> Array:
    """Return the commanded coordinates (k,) of M at home."""
    return np.concatenate([machine.at, np.zeros(3)])[[COORDINATES.index(name) for name in machine.pose]]


def locate(machine: Machine, poses: Array) -> Located:
    """Return where the bodies stand as drawn and rigid when M is at poses (n, k), reached straight from home."""
    n = len(poses)
    home = home_of(machine)
    frames = frames_at_home(tuple(machine.bodies), n)
    residual = np.full(n, np.inf)
    for share in np.arange(1, _STEPS + 1) / _STEPS:
        target = home + share * (poses - home)
        for _ in range(_WALK if share < 1.0 else _END):
            rows, errors = _equations(machine, frames, target)
            before, residual = residual, np.abs(errors).max(axis=1)
            if ((residual < 1e-2 * CLOSED) | (share == 1.0) & (residual < CLOSED) & (residual >= 0.5 * before)).all():
                break
            frames = frames.move(_step(machine, rows, errors))
    drives: dict[str, Array] = {}
    closed = residual < CLOSED
    for name, joint in machine.joints.items():
        if joint.drive is not None:
            ends = machine.carrier(joint.first), machine.carrier(joint.second)
            drives[name] = joint_state(joint.drawn_joint, frames, *ends).displacement
            closed &= (drives[name] >= joint.drive.low) & (drives[name] <= joint.drive.high)
    return Located(frames, drives, closed)


def _equations(machine: Machine, frames: Frames, target: Array) -> tuple[Array, Array]:
    """Return derivatives (n, r, 6 bodies) of all constraints by twists about the origin, and their errors (n, r)."""
    index = {name: 6 * k for k, name in enumerate(machine.bodies)}
    n, columns = len(target), 6 * len(index)
    rows: list[Array] = []
    errors: list[Array] = []
    for joint in machine.joints.values():
        first, second = machine.carrier(joint.first), machine.carrier(joint.second)
        state = joint_state(joint.drawn_joint, frames, first, second)
        driven = joint.drive is not None
        keep = [i for i in range(state.held.shape[1]) if not (driven and state.held[0, i, DRIVEN[joint.kind]])]
        held = state.held[:, keep]
        line = np.zeros((n, held.shape[1], columns))
        for name, sign in ((second, 1.0), (first, -1.0)):
            if name != GROUND:
                line[:, :, index[name] : index[name] + 6] += sign * held @ state.carry
        rows.append(line)
        errors.append((held @ state.misfit[..., None])[..., 0])
    body = machine.carrier(machine.tool)
    point = frames.point(body, machine.at)
    vector = vector_of(frames.rotation[body])
    move = lever(point)
    move[:, 3:, 3:] = rates_of_vector(vector)
    wanted = [COORDINATES.index(name) for name in machine.pose]
    line = np.zeros((n, len(wanted), columns))
    line[:, :, index[body] : index[body] + 6] = move[:, wanted]
    rows.append(line)
    errors.append(np.concatenate([point, vector], axis=1)[:, wanted] - target)
    return np.concatenate(rows, axis=1), np.concatenate(errors, axis=1)


def _step(machine: Machine, rows: Array, errors: Array) -> dict[str, Array]:
    """Return the smallest twists (n, 6) of all bodies that undo errors (n, r), to first order."""
    square = np.swapaxes(rows, -1, -2) @ rows
    size = square.shape[-1]
    square[:, range(size), range(size)] += _DAMPING * np.abs(square).max(axis=(1, 2))[:, None]
    right = np.swapaxes(rows, -1, -2) @ errors[..., None]
    back = -np.linalg.solve(square, right)[..., 0]
    back *= np.minimum(1.0, 0.5 / np.maximum(np.abs(back).max(axis=1), 1e-300))[:, None]  # half a radian at most
    return {name: back[:, 6 * k : 6 * k + 6] for k, name in enumerate(machine.bodies)}

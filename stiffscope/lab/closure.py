"""Poses of the bodies of a rigid machine, by Newton's method from home over all bodies."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.lab.machine import DRIVEN, FREE, GROUND
from stiffscope.lab.rotations import (
    lever,
    rates_of_vector,
    transform_to,
    turn,
    vector_of,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.lab.machine import Joint, Machine
    from stiffscope.lab.rotations import Array

COORDINATES = ("x", "y", "z", "rx", "ry", "rz")
_STEPS = 8  # load steps from home to the pose
_WALK = 2  # iterations at each step
_END = 30  # iterations at the pose itself
CLOSED = 1e-11
"""Largest residual of a closed loop, m and rad."""
_DAMPING = 1e-10  # relative to the largest entry of JᵀJ: keeps idle motions in place


@dataclass(frozen=True)
class Frames:
    """Displacement x = R x_home + p of nodes or bodies from home, by name; stacked over n poses."""

    rotation: dict[str, Array]
    position: dict[str, Array]

    def point(self, name: str, home: Array) -> Array:
        """Return the positions (n, 3) of a node's point (3,)."""
        return self.rotation[name] @ home + self.position[name]

    def some(self, mask: Any) -> Frames:
        """Return the selected poses."""
        both = (
            {n: x[mask] for n, x in known.items()}
            for known in (self.rotation, self.position)
        )
        return Frames(*both)

    def move(self, twists: dict[str, Array]) -> Frames:
        """Return the frames after twists (n, 6) of some of them about the origin."""
        rotation = dict(self.rotation)
        position = dict(self.position)
        for name, t in twists.items():
            r = turn(t[:, 3:])
            rotation[name] = r @ rotation[name]
            position[name] = (r @ position[name][..., None])[..., 0] + t[:, :3]
        return Frames(rotation, position)


@dataclass(frozen=True)
class JointState:
    """A joint at n poses."""

    misfit: Array
    """Offset (n, 6) between the nodes, joint axes; driven: from `commanded`, free: zero."""
    carry: Array
    """Transform (n, 6, 6) of a twist about the origin to the joint's axes and point."""
    held: Array
    """Constrained directions (n, r, 6)."""
    displacement: Array
    """Displacement (n,) from home along the first free direction, that of a drive."""


def joint_state(
    joint: Joint,
    frames: Frames,
    first: str,
    second: str,
    commanded: Array | float = 0.0,
) -> JointState:
    """Return the state of a joint between two nodes.

    Parameters
    ----------
    joint
        Joint of the laboratory's robot.
    frames
        Rotations and positions of all nodes at n poses.
    first, second
        Names of the nodes that it connects.
    commanded
        Displacement of its drive from home (n,), m or rad.
    """
    axes = frames.rotation[first] @ joint.axes
    back = np.swapaxes(axes, -1, -2)
    point = frames.point(second, joint.at_second)
    apart = (back @ (point - frames.point(first, joint.at_first))[..., None])[..., 0]
    relative = back @ frames.rotation[second] @ joint.axes
    n = len(point)
    rows = [
        i for i in joint.held_directions if not (joint.kind == "universal" and i >= 3)
    ]
    held = np.broadcast_to(np.eye(6)[rows], (n, len(rows), 6))
    around = np.zeros((n, 3))
    displacement = apart[:, 0]
    if joint.kind in {"fixed", "prismatic"}:
        around = vector_of(relative)
    elif joint.kind in {"revolute", "cylindrical", "planar"}:
        sine = relative[:, 2, 1] - relative[:, 1, 2]
        cosine = relative[:, 1, 1] + relative[:, 2, 2]
        angle = np.arctan2(sine, cosine)
        around = vector_of(relative @ turn(-angle[:, None] * np.eye(3)[0]))
        if joint.kind == "revolute":
            displacement = (
                commanded + (angle - commanded + np.pi) % (2.0 * np.pi) - np.pi
            )
            around[:, 0] = 0.0
    elif joint.kind == "universal":
        other = (back @ frames.rotation[second] @ joint.axis2[:, None])[
            ..., 0
        ]  # in joint axes
        normal = np.cross(np.eye(3)[0], other)
        size = np.linalg.norm(normal, axis=1)
        home = joint.axes.T @ joint.axis2
        error = np.arctan2(size, other[:, 0]) - np.arctan2(
            np.linalg.norm(home[1:]), home[0]
        )
        normal = normal / size[:, None]
        around = error[:, None] * normal
        row = np.concatenate([np.zeros((n, 3)), normal], axis=1)
        held = np.concatenate([held, row[:, None]], axis=1)
    if joint.slides_in_first:
        # the second body's point that has slid into the bearing: tilted back about its own
        point = frames.point(first, joint.at_first)
        apart = (turn(-around) @ apart[..., None])[..., 0]
        displacement = apart[:, 0]
    misfit = np.concatenate([apart, around], axis=1)
    if joint.drive is not None:
        misfit[:, DRIVEN[joint.kind]] = displacement - commanded
    return JointState(misfit, transform_to(axes, point), held, displacement)


def spring_state(
    joint: Joint, frames: Frames, first: str, second: str
) -> tuple[Array, Array]:
    """Return the free motions of a joint, and its displacement from the spring's rest position.

    Parameters
    ----------
    joint, frames, first, second
        As for `joint_state`.

    Returns
    -------
    Free motions (n, k, 6) as rows, and the displacement (n, 6) from rest; in the joint's axes at
    its point.
    """
    back = np.swapaxes(frames.rotation[first] @ joint.axes, -1, -2)
    relative = back @ frames.rotation[second] @ joint.axes
    n = len(relative)
    free = list(FREE[joint.kind])
    away = np.zeros((n, 6))
    rows = np.broadcast_to(np.eye(6)[free], (n, len(free), 6))
    if joint.kind == "spherical":
        away[:, 3:] = vector_of(relative)
    elif joint.kind == "universal":  # about x, then axis2, in axes of the first body
        home = joint.axes.T @ joint.axis2
        other = (back @ frames.rotation[second] @ joint.axis2[:, None])[..., 0]
        about = np.arctan2(other[:, 2], other[:, 1]) - np.arctan2(home[2], home[1])
        image = (
            np.swapaxes(relative, -1, -2) @ np.eye(3)[0]
        )  # axis 1 in the second body
        side = np.cross(home, np.eye(3)[0])
        turned = -np.arctan2(image @ side, image @ np.cross(side, home))
        rows = np.array(np.broadcast_to(np.eye(6)[[3, 4]], (n, 2, 6)))
        rows[:, 1, 3:] = other
        away[:, 3:] = about[:, None] * np.eye(3)[0] + turned[:, None] * other
    else:
        moved = joint_state(joint, frames, first, second).displacement
        away[:, DRIVEN[joint.kind]] = moved - joint.rest
    return rows, away


@dataclass(frozen=True)
class Located:
    """Bodies of the machine at commanded poses, as assumed by its controller."""

    frames: Frames
    drives: dict[str, Array]
    """Displacement (n,) of each drive from home."""
    closed: NDArray[np.bool_]
    """(n,) whether the loops close and every drive is within its range."""

    def some(self, mask: Any) -> Located:
        """Return the selected poses."""
        drives = {name: q[mask] for name, q in self.drives.items()}
        return Located(self.frames.some(mask), drives, self.closed[mask])


def home_of(machine: Machine) -> Array:
    """Return the commanded coordinates (k,) of M at home."""
    return _find_home(machine, machine.pose)


def _find_home(machine: Machine, names: tuple[str, ...]) -> Array:
    """Return some coordinates (k,) of M at home."""
    home = np.concatenate([machine.at, np.zeros(3)])
    return home[[COORDINATES.index(name) for name in names]]


def locate(machine: Machine, poses: Array) -> Located:
    """Return the poses of the rigid bodies, as drawn, with M at poses (n, k) reached from home."""
    n = len(poses)
    names = (*machine.bodies, GROUND)
    home = home_of(machine)
    frames = Frames(
        {name: np.broadcast_to(np.eye(3), (n, 3, 3)) for name in names},
        {name: np.zeros((n, 3)) for name in names},
    )
    residual = np.full(n, np.inf)
    for share in np.arange(1, _STEPS + 1) / _STEPS:
        target = home + share * (poses - home)
        for _ in range(_WALK if share < 1.0 else _END):
            rows, errors = _equations(machine, frames, target)
            before = residual
            residual = np.abs(errors).max(axis=1)
            stalled = (residual < CLOSED) & (residual >= 0.5 * before)
            if ((residual < 1e-2 * CLOSED) | (share == 1.0) & stalled).all():
                break
            frames = frames.move(_step(machine, rows, errors))
    drives: dict[str, Array] = {}
    closed = residual < CLOSED
    for name, joint in machine.joints.items():
        if joint.drive is not None:
            ends = machine.carrier(joint.first), machine.carrier(joint.second)
            drives[name] = joint_state(joint.drawn_joint, frames, *ends).displacement
            closed &= (drives[name] >= joint.drive.low) & (
                drives[name] <= joint.drive.high
            )
    return Located(frames, drives, closed)


def _equations(machine: Machine, frames: Frames, target: Array) -> tuple[Array, Array]:
    """Return derivatives (n, r, 6 bodies) of constraints by twists, and their errors (n, r)."""
    index = {name: 6 * k for k, name in enumerate(machine.bodies)}
    n = len(target)
    columns = 6 * len(index)
    rows: list[Array] = []
    errors: list[Array] = []
    for joint in machine.joints.values():
        first = machine.carrier(joint.first)
        second = machine.carrier(joint.second)
        state = joint_state(joint.drawn_joint, frames, first, second)
        held = state.held
        misfit = state.misfit
        if joint.name in machine.still and joint.drive is None:
            free, away = spring_state(replace(joint, rest=0.0), frames, first, second)
            held = np.concatenate([held, free], axis=1)
            misfit = misfit + away
        elif (
            joint.drive is not None and joint.name not in machine.still
        ):  # its direction is free here
            held = held[:, held[0, :, DRIVEN[joint.kind]] == 0.0]
        line = np.zeros((n, held.shape[1], columns))
        for name, sign in ((second, 1.0), (first, -1.0)):
            if name != GROUND:
                line[:, :, index[name] : index[name] + 6] += sign * held @ state.carry
        rows.append(line)
        errors.append((held @ misfit[..., None])[..., 0])
    body = machine.carrier(machine.tool)
    point = frames.point(body, machine.at)
    vector = vector_of(frames.rotation[body])
    move = lever(point)
    move[:, 3:, 3:] = rates_of_vector(vector)
    wanted = [COORDINATES.index(name) for name in (*machine.pose, *machine.kept)]
    target = np.hstack([target, np.tile(_find_home(machine, machine.kept), (n, 1))])
    line = np.zeros((n, len(wanted), columns))
    line[:, :, index[body] : index[body] + 6] = move[:, wanted]
    rows.append(line)
    errors.append(np.concatenate([point, vector], axis=1)[:, wanted] - target)
    return np.concatenate(rows, axis=1), np.concatenate(errors, axis=1)


def _step(machine: Machine, rows: Array, errors: Array) -> dict[str, Array]:
    """Return the smallest twists (n, 6) of all bodies that cancel errors (n, r) to first order."""
    square = np.swapaxes(rows, -1, -2) @ rows
    size = square.shape[-1]
    square[:, range(size), range(size)] += (
        _DAMPING * np.abs(square).max(axis=(1, 2))[:, None]
    )
    right = np.swapaxes(rows, -1, -2) @ errors[..., None]
    back = -np.linalg.solve(square, right)[..., 0]
    largest = np.maximum(np.abs(back).max(axis=1), 1e-300)
    back *= np.minimum(1.0, 0.5 / largest)[:, None]  # at most 0.5 rad
    return {name: back[:, 6 * k : 6 * k + 6] for k, name in enumerate(machine.bodies)}

"""Plain least squares of an arm's tracked positions, one kind of error after another.

    python -m examples.measured.motoman leica_left_hand_6x6x6_dataset.mat --arm left --ladder

It shares nothing with the diagnosis but the arm's nominal data: rotations, chains and sag are written
out here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from examples.measured.arm import split_postures, transform

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from examples.measured.arm import Arm

    Array = NDArray[np.float64]

GRAVITY = 9.81  # m/s²
INSTRUMENT = 9  # parameters: tracker's place and rotation, reflector's place
KINDS = {"instrument": 0, "+ zeros": 1, "+ axes": 5, "+ joint compliance": 6}
"""Parameters a joint: its zero; two offsets, two tilts; its compliance."""
UNIT = 1e-3  # m, rad; compliances are times 1e-3 rad/(kN·m)


def _sag(arm: Arm, angles: Array) -> Array:
    """Return the weights' torques (p, n) about each joint, N·m."""
    out = np.zeros(angles.shape)
    down = GRAVITY * np.array(arm.gravity)
    for row, posture in enumerate(angles):
        frames = arm.frames(posture)
        points = frames[:, :3, 3]
        for joint in range(len(arm.rows)):
            axis = frames[joint, :3, 2]
            for body in range(joint, len(arm.rows)):
                centre = 0.5 * (points[body] + points[body + 1]) - points[joint]
                out[row, joint] += arm.masses[body] * axis @ np.cross(centre, down)
    return out


def _turn_z(angles: Array) -> Array:
    """Return rotations (p, 4, 4) about z."""
    out = np.tile(np.eye(4), (len(angles), 1, 1))
    turns = angles[:, None] * np.array([0.0, 0.0, 1.0])
    out[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
    return out


def _positions(arm: Arm, angles: Array, torques: Array, errors: Array) -> Array:
    """Return the reflector (p, 3) in the tracker's axes, for errors (9 + 6 n,) in `UNIT`."""
    own = UNIT * errors[INSTRUMENT:].reshape(len(arm.rows), 6)
    at = np.tile(transform(arm.base), (len(angles), 1, 1))
    for joint, (row, error) in enumerate(zip(arm.rows, own, strict=True)):
        zero, x, y, rx, ry, soft = error
        misalignment = np.eye(4)
        misalignment[:3, :3] = Rotation.from_rotvec([rx, ry, 0.0]).as_matrix()
        misalignment[:2, 3] = x, y
        turned = angles[:, joint] + zero + 1e-3 * soft * torques[:, joint]
        at = at @ misalignment @ _turn_z(turned) @ transform(row)
    place = np.append(transform(arm.target)[:3, 3] + UNIT * errors[:3], 1.0)
    seen = (at @ place)[:, :3] - UNIT * errors[6:9]
    return Rotation.from_rotvec(UNIT * errors[3:6]).apply(seen)


def _align(seen: Array, nominal: Array) -> Array:
    """Return the positions seen (p, 3) in axes near the robot's, by their best rotation."""
    turn, _ = Rotation.align_vectors(
        nominal - nominal.mean(axis=0), seen - seen.mean(axis=0)
    )
    return turn.apply(seen - seen.mean(axis=0)) + nominal.mean(axis=0)


def fit_ladder(
    arm: Arm, angles: Array, seen: Array
) -> Iterator[tuple[str, float, float]]:
    """Yield what is free, and the rms of a coordinate, m: of postures fitted, and held out.

    Parameters
    ----------
    arm
        Nominal arm.
    angles
        Joint angles (p, n), rad.
    seen
        Positions (p, 3) of the reflector in the tracker's axes, m.
    """
    fitted, held = (np.array(rows) for rows in split_postures(len(angles)))
    torques = _sag(arm, angles)
    count = len(arm.rows)
    nominal = _positions(arm, angles, torques, np.zeros(INSTRUMENT + 6 * count))
    near = _align(seen, nominal)
    best = np.zeros(INSTRUMENT + 6 * count)
    for name, most in KINDS.items():
        free = [*range(INSTRUMENT)]
        free += [INSTRUMENT + 6 * j + k for j in range(count) for k in range(most)]

        def leave(rows: NDArray[np.int64], errors: Array) -> Array:
            shown = _positions(arm, angles[rows], torques[rows], errors)
            return (shown - near[rows]).ravel()

        def miss(values: Array, free: list[int] = free) -> Array:
            trial = best.copy()
            trial[free] = values
            return leave(fitted, trial) / UNIT

        best[free] = least_squares(miss, best[free], method="lm").x
        sizes = (leave(rows, best) for rows in (fitted, held))
        inside, outside = (float(np.sqrt(np.mean(size**2))) for size in sizes)
        yield name, inside, outside

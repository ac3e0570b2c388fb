"""Robots of other kinds: a hexapod beside its closed form, a Delta beside a direct-stiffness model."""

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.statics.analysis import stiffness
from stiffscope.vjm.statics.singularity import count_freedoms
from stiffscope.vjm.statics.yielding import respond
from tests.robots import cubic_hexapod


@pytest.mark.parametrize("height", [0.0, 0.11])
def test_cubic_gough_stewart_platform(height):
    """tdehaeze, stewart-simscape, cubic configuration: K at the cube's centre, and at a point d above it."""
    k = 2.5e6
    size = 0.3
    closed = np.diag(
        [2 * k] * 3 + [1.5 * k * size**2 + 2 * k * height**2] * 2 + [6 * k * size**2]
    )
    closed[0, 4] = closed[4, 0] = -2 * k * height
    closed[1, 3] = closed[3, 1] = 2 * k * height
    hexapod = cubic_hexapod(size, k, height)
    assert np.allclose(
        stiffness(hexapod, hexapod.tool.home)[0],
        closed,
        rtol=1e-10,
        atol=1e-9 * k * size**2,
    )


def test_delta_agrees_with_direct_stiffness():
    """The shipped Delta: three elbows (6 freedoms each), three drives and the platform; rods as bars between balls."""
    robot = load_robot("delta")
    delta = mechanism_of(robot, part_matrices(robot))
    poses = np.array(list(robot.poses.values()))
    ours = stiffness(delta, poses)
    for pose, matrix in zip(poses, ours, strict=True):
        assert np.allclose(
            matrix,
            direct(robot, delta, pose),
            rtol=1e-8,
            atol=1e-9 * np.abs(matrix).max(),
        )
    assert count_freedoms(ours)[0].tolist() == [0, 0]


def elbow_of(shoulder, wrist, out, arm, rod):
    """Outer intersection of the arm's circle, in the plane of ``out`` and z, with the rod's sphere about the wrist."""
    to = wrist - shoulder
    r = to @ out
    z = to[2]
    angle = np.arctan2(z, r) + np.arccos(
        (arm**2 + to @ to - rod**2) / (2 * arm * np.hypot(r, z))
    )
    return shoulder + arm * (
        np.cos(angle) * out + np.sin(angle) * np.array([0, 0, 1.0])
    )


def direct(robot, delta, pose):
    """Energy of drives, arms and bars over 21 + 6 explicit freedoms, condensed; places by trigonometry."""
    size = robot.parameters
    k = np.zeros((27, 27))
    arm, rod = (delta.body(name).elastic for name in ("leg1.arm", "leg1.rod1"))
    lengths = [np.linalg.norm(e.tip - e.base) for e in (arm, rod)]
    platform = np.arange(21, 27)

    def at(rows, lever):
        out = np.zeros((3, 27))
        out[:, rows[:3]] = np.eye(3)
        out[:, rows[3:]] = np.cross(np.eye(3), lever).T
        return out

    for leg in range(3):
        turn = 2 * np.pi * leg / 3
        out, side = (
            np.array([np.cos(turn), np.sin(turn), 0]),
            np.array([-np.sin(turn), np.cos(turn), 0]),
        )
        shoulder = size["w_B"] * out
        wrist = pose + size["u_P"] * out
        elbow = elbow_of(shoulder, wrist, out, *lengths)
        k[leg, leg] += delta.joint("leg1.motor").drive.stiffness
        tip = np.arange(3 + 6 * leg, 9 + 6 * leg)
        stretch = np.eye(27)[tip]
        stretch[:3, leg] -= np.cross(side, elbow - shoulder)
        stretch[3:, leg] -= side
        along = (elbow - shoulder) / lengths[0]
        stretch = (
            np.kron(np.eye(2), np.array([along, side, np.cross(along, side)])) @ stretch
        )
        k += stretch.T @ np.linalg.inv(arm.compliance) @ stretch
        for shift in (-0.5, 0.5):
            beside = shift * size["h"] * side
            bar = (
                (wrist - elbow)
                / lengths[1]
                @ (at(platform, wrist + beside - pose) - at(tip, beside))
            )
            k += np.outer(bar, bar) / rod.compliance[0, 0]
    return k[21:, 21:] - k[21:, :21] @ np.linalg.solve(k[:21, :21], k[:21, 21:])


def test_a_pose_out_of_reach_has_no_numbers_and_is_refused_by_name():
    robot = load_robot("delta")
    delta = mechanism_of(robot, part_matrices(robot))
    far = [0.0, 0.0, -3.0]
    assert np.isnan(stiffness(delta, far)).all()
    assert not configure(delta, far).valid.any()
    with pytest.raises(InputError, match="out of reach"):
        respond(delta, far, np.zeros(6))

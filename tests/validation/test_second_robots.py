"""Robots composed from the same algebra as the Biglide's, beside closed forms and a direct-stiffness check."""

import numpy as np
import pytest

from examples.delta import example
from examples.gough_stewart import cubic_platform
from stiffscope.errors import InputError
from stiffscope.vjm.analysis import mobility, stiffness
from stiffscope.vjm.reduction import as_stiffness
from stiffscope.vjm.response import respond


def test_cubic_gough_stewart_platform():
    """tdehaeze, stewart-simscape, cubic configuration: K at the cube's centre, and at a point d above it."""
    k, size, d = 2.5e6, 0.3, 0.11
    closed = np.diag([2 * k] * 3 + [1.5 * k * size**2] * 2 + [6 * k * size**2])
    assert np.allclose(as_stiffness(cubic_platform(size, k)), closed, rtol=1e-10, atol=1e-6 * k * size**2)
    closed[3, 3] = closed[4, 4] = 1.5 * k * size**2 + 2 * k * d**2
    closed[0, 4] = closed[4, 0] = -2 * k * d
    closed[1, 3] = closed[3, 1] = 2 * k * d
    assert np.allclose(as_stiffness(cubic_platform(size, k, d)), closed, rtol=1e-10, atol=1e-6 * k * size**2)


def test_delta_agrees_with_direct_stiffness():
    """Three drives, three elbows (6 freedoms each) and the platform; rods as bars between ball joints."""
    robot, poses = example(), np.array([[0.0, 0.0, 0.55], [0.1, 0.05, 0.5]])
    ours = stiffness(robot, poses)
    for pose, matrix in zip(poses, ours, strict=True):
        assert np.allclose(matrix, _direct(robot, pose), rtol=1e-8, atol=1e-9 * np.abs(matrix).max())
    assert mobility(ours)[0].tolist() == [0, 0]


def _direct(robot, pose):
    """Energy of arms and bars over 21 + 6 explicit freedoms, condensed; places from the joints' own frames."""
    state = respond(robot.tree(pose), np.eye(6)).elements
    k = np.zeros((27, 27))

    def at(rows, point):
        out = np.zeros((3, 27))
        out[:, rows[:3]] = np.eye(3)
        out[:, rows[3:]] = _lever(point)
        return out

    platform = np.arange(21, 27)
    for leg in range(3):
        angle = 2 * np.pi * leg / 3
        side = np.array([-np.sin(angle), np.cos(angle), 0.0])
        k[leg, leg] += robot.drive
        elbow = np.arange(3 + 6 * leg, 9 + 6 * leg)
        arm = state[f"leg{leg}.arm"].frame
        origin = arm.origin().reshape(3)
        shoulder = state[f"leg{leg}.drive"].frame.origin().reshape(3)
        stretch = np.zeros((6, 27))
        stretch[:3, elbow[:3]], stretch[3:, elbow[3:]] = np.eye(3), np.eye(3)  # the elbow body's motion at its origin
        stretch[:3, leg] -= np.cross(side, origin - shoulder)
        stretch[3:, leg] -= side
        turned = np.kron(np.eye(2), arm.matrix().reshape(3, 3).T) @ stretch
        k += turned.T @ np.linalg.inv(robot.arm_compliance) @ turned
        for rod in range(2):
            top = state[f"leg{leg}.rod{rod}.upper"].frame.origin().reshape(3)
            low = state[f"leg{leg}.rod{rod}.lower"].frame.origin().reshape(3)
            along = (low - top) / np.linalg.norm(low - top)
            row = along @ (at(platform, low) - at(elbow, top - origin))
            k += np.outer(row, row) / robot.rod_compliance[0, 0]
    return k[21:, 21:] - k[21:, :21] @ np.linalg.solve(k[:21, :21], k[:21, 21:])


def _lever(point):
    """ω × p as a matrix on ω."""
    return np.array([[0, point[2], -point[1]], [-point[2], 0, point[0]], [point[1], -point[0], 0]])


def test_a_delta_out_of_reach_is_refused():
    with pytest.raises(InputError, match="out of reach"):
        stiffness(example(), [0.0, 0.0, 1.0])

"""Homes at which the tool cannot be moved along every commanded coordinate are ordinary."""

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.vjm.kinematics.configurations import (
    configure,
    configure_drives,
    start_note,
)
from stiffscope.vjm.kinematics.linkage import rotation_vector
from stiffscope.vjm.kinematics.reach import reach
from stiffscope.vjm.model.screws import rotation
from tests.vjm.test_rigid_directions import SIX, WRISTED, arm

STRETCHED = arm(
    [[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1]],
    [[0, 0, 0], [0, 0, 0.4], [0, 0, 0.8], [0, 0, 1.0], [0, 0, 1.2], [0, 0, 1.3]],
    [0, 0, 1.4],
    SIX,
)


def forward(m, q):
    """Tool's place and rotation vector by a product of exponentials."""
    turn = np.eye(3)
    shift = np.zeros(3)
    for j, angle in zip(m.joints, q, strict=True):
        r = rotation(j.axis, angle)
        shift = turn @ (j.at - r @ j.at) + shift
        turn = turn @ r
    return np.r_[turn @ m.tool.at + shift, rotation_vector(turn)]


@pytest.mark.parametrize("m", [WRISTED, STRETCHED])
def test_poses_of_an_arm_that_is_straight_at_home(m, rng):
    q = rng.uniform(0.1, 0.5, (12, 6))
    poses = np.array([forward(m, each) for each in q])
    found = configure(m, poses)
    assert found.valid.mean() > 0.9
    for pose, drives, valid in zip(poses, found.drives, found.valid, strict=True):
        assert not valid or np.allclose(forward(m, drives), pose, atol=1e-9)
    assert "home is singular" in start_note(m)


@pytest.mark.parametrize("m", [WRISTED, STRETCHED])
def test_a_singular_home_is_a_pose_itself(m):
    found = configure(m, np.vstack([m.tool.home, m.tool.home]))
    assert found.valid.all()
    assert np.abs(found.drives).max() == 0.0
    assert np.allclose(found.tool, m.tool.home)
    assert np.allclose(
        configure_drives(m, np.full((1, 6), 0.3)).tool[0],
        forward(m, np.full(6, 0.3)),
        atol=1e-12,
    )


def test_reach_starts_where_tool_poses_do():
    for each in reach(WRISTED):
        assert each.low < each.high


def test_a_coordinate_that_the_mechanism_cannot_move_in_is_still_refused():
    m = arm([[0, 0, 1]] * 2, [[0, 0, 0], [0.3, 0, 0]], [0.3, 0.25, 0], ("x", "z"))
    with pytest.raises(
        InputError,
        match="expected coordinates that the mechanism can move in at home, got z, held",
    ):
        configure(m, m.tool.home)


def test_a_regular_home_needs_no_note():
    assert (
        start_note(
            arm([[0, 0, 1]] * 2, [[0, 0, 0], [0.3, 0, 0]], [0.3, 0.25, 0], ("x", "y"))
        )
        is None
    )

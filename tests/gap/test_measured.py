"""Published datasets converted: the robot file has the authors' geometry, the campaign their readings."""

import numpy as np
import pytest
from scipy.io import savemat

from examples.measured.motoman import ARMS, JOINTS, convert
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.forward.placing import align_points
from stiffscope.robot.inspection import rigid_mechanism
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.kinematics import configure_drives
from stiffscope.vjm.screws import rotation_of


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_dataset_is_converted(side, tmp_path):
    """Twelve postures, each named twice; one is not seen, one is not a number."""
    rng, arm = np.random.default_rng(4), ARMS[side]
    angles = np.array([-0.2, 0.8, -0.6, 1.7, 0.3, 1.5]) + rng.uniform(-0.3, 0.3, (12, 6))
    turn, origin = rotation_of(np.array([0.2, -2.0, 1.5])), np.array([-3.0, 2.0, 1.0])
    seen = (np.array([arm.target_at(each) for each in angles]) - origin) @ turn
    table = np.zeros((12, 26))
    table[:, 0], table[:, JOINTS[side]], table[:, 19:22] = np.arange(12), angles, seen
    table[3, 19:22], table[7, 19:22] = 0.0, np.nan
    savemat(tmp_path / "d.mat", {"dataset": np.repeat(table, 2, axis=0)})
    found = convert(tmp_path / "d.mat", side, tmp_path / "out")
    assert found["postures"] == 10
    assert found["rms"] < 1e-12
    robot = load_robot(tmp_path / "out" / "fit" / "robot.toml")
    campaign = load_campaign(tmp_path / "out" / "fit", robot)
    assert (len(campaign), len(campaign.poses)) == (24, 8)
    assert len(load_campaign(tmp_path / "out" / "held-out", robot)) == 6
    kept = [k for k in range(12) if k not in (3, 7)]
    assert campaign.value.reshape(-1, 3) == pytest.approx(seen[[kept[k] for k in (0, 1, 2, 3, 5, 6, 7, 8)]])
    tool = configure_drives(rigid_mechanism(robot), campaign.poses).tool[:, :3]
    flange = [arm.frames(angles[kept[k]])[-1, :3, 3] for k in (0, 1, 2, 3, 5, 6, 7, 8)]
    assert tool == pytest.approx(np.array(flange), abs=1e-8)  # the file has nine decimals


def test_an_instrument_is_placed_at_any_rotation():
    rng = np.random.default_rng(1)
    nominal, turn = rng.standard_normal((9, 3)), rotation_of(np.array([1.0, 2.5, -1.5]))
    found, origin = align_points((nominal - [1.0, 2.0, 3.0]) @ turn, nominal)
    assert found == pytest.approx(turn)
    assert origin == pytest.approx([1.0, 2.0, 3.0])

"""Positions in axes or units that no frame explains are refused before a search, by the section of their frame."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.gap.campaign.campaign import InstrumentFrame
from stiffscope.gap.diagnose import diagnose_campaign
from stiffscope.gap.forward.misread_frames import find_misread
from stiffscope.gap.forward.robot_at_poses import RobotAtPoses
from tests.gap.test_instruments import ORIGIN, campaign, targets
from tests.gap.test_robot_model import nominal

STATED = InstrumentFrame(
    "tracker", (*ORIGIN, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 3.0, 3.0, 3.0)
)
ROBOT = nominal("serial-arm")


def swap(c):
    """The readings with y and z exchanged."""
    order = np.arange(len(c)).reshape(-1, 3)[:, [0, 2, 1]].ravel()
    return c.value[order]


@pytest.mark.parametrize(
    ("measures", "change", "cause"),
    [
        (
            "position",
            lambda c: np.where(c.direction == 0, -c.value, c.value),
            "if mirrored: mirrored axes?",
        ),
        ("position", swap, "if mirrored: mirrored axes?"),
        ("position", lambda c: 1e3 * c.value, "if divided by 1000: mm?"),
        ("position", lambda c: 1e-3 * c.value, "if multiplied by 1000: mm?"),
        ("position", lambda c: np.roll(c.value, 30), "wrong poses, rows or frame?"),
        ("distance", lambda c: 1e3 * c.value, "if divided by 1000: mm?"),
    ],
)
def test_mirrored_axes_and_other_units_are_refused(measures, change, cause):
    c = campaign(ROBOT, targets(ROBOT, measures=measures), 5e-3 * np.eye(6)[2])
    with pytest.raises(
        InputError,
        match=r"^campaign: frames.tracker: expected positions of the robot, got ",
    ) as error:
        diagnose_campaign(replace(c, value=change(c)), ROBOT)
    assert str(error.value).endswith(cause)


@pytest.mark.parametrize("frame", [None, STATED])
@pytest.mark.parametrize("size", [0.0, 0.1])
def test_errors_of_a_robot_are_no_misread_frame(frame, size):
    """Even a drive 6 degrees off its zero, and some gross outliers, are read by right-handed axes in metres."""
    c = campaign(ROBOT, targets(ROBOT, frame=frame), size * np.eye(6)[2])
    wild = np.where(np.arange(len(c)) % 50 == 7, 1.0, 0.0) + c.value
    for value in (c.value, wild, np.where(np.arange(len(c)) < 12, np.nan, c.value)):
        assert not list(find_misread(RobotAtPoses(ROBOT, replace(c, value=value))))


def test_a_frame_without_readings_is_not_misread():
    c = campaign(ROBOT, targets(ROBOT), np.zeros(6))
    gone = replace(c, sensor=np.full(len(c), -1), quantity=np.zeros(len(c), dtype=int))
    assert not list(find_misread(RobotAtPoses(ROBOT, gone)))

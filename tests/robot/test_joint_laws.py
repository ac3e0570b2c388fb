"""Springs of passive joints and drives that are not linear, as robot files say them."""

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot

ROBOT = """
[bodies.arm]
mass = "2 kg"
centre = ["0.5 m", 0, 0]
[joints.hinge]
between = ["ground", "arm"]
type = "{kind}"
at = [0, 0, 0]
axis = [0, 1, 0]
{more}
[tool]
body = "arm"
at = ["0.5 m", 0, 0]
pose = ["z"]
"""


def read(tmp_path, more, kind="revolute"):
    path = tmp_path / "arm.toml"
    path.write_text(ROBOT.format(kind=kind, more=more))
    robot = load_robot(str(path))
    return mechanism_of(robot, part_matrices(robot)).joint("hinge")


def test_a_spring_and_its_rest(tmp_path):
    joint = read(tmp_path, 'spring = "40 N*m/rad"\nrest = "5 deg"')
    assert (joint.spring, joint.rest) == (40.0, pytest.approx(np.radians(5)))
    joint = read(tmp_path, 'spring = "35 N/mm"\nrest = "2 mm"', "prismatic")
    assert (joint.spring, joint.rest) == (pytest.approx(35e3), pytest.approx(2e-3))


@pytest.mark.parametrize(
    ("drive", "starts", "slopes"),
    [
        (
            'curve = [["0.1 mrad", "1 N*m"], ["0.5 mrad", "9 N*m"]], backlash = "20 urad"',
            [1e-5, 1.1e-4],
            [1e4, 2e4],
        ),
        ('stiffness = "10 kN*m/rad", backlash = "20 urad"', [1e-5], [1e4]),
        (
            'gear = { k1 = 8100, k2 = 11000, k3 = 13000, t1 = "14 N*m", t2 = "48 N*m" }',
            [0.0, 14 / 8100, 14 / 8100 + 34 / 11000],
            [8100, 11000, 13000],
        ),
    ],
    ids=["curve", "backlash", "gear"],
)
def test_drives_that_are_not_linear(drive, starts, slopes, tmp_path):
    law = read(tmp_path, f"drive = {{ {drive} }}").drive.law
    assert law.starts == pytest.approx(starts)
    assert law.slopes == pytest.approx(slopes)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (
            'drive = { stiffness = 3, curve = [["1 mrad", "1 N*m"]] }',
            "expected one of stiffness, curve, gear",
        ),
        (
            'drive = { backlash = "1 mrad" }',
            "expected one of stiffness, curve, gear, got none of them",
        ),
        (
            'drive = { curve = [["1 mrad", "2 N*m"], ["2 mrad", "1 N*m"]] }',
            "rises from point to point",
        ),
        ('drive = { curve = [["1 mm", "2 N*m"]] }', "an angle"),
        (
            "drive = { gear = { k1 = 1, k2 = 2, k3 = 3, t1 = 4, t2 = 3 } }",
            "expected a torque t1 below t2",
        ),
        (
            'spring = "3 N*m/rad"\ndrive = { stiffness = 3 }',
            "spring: expected a passive joint",
        ),
        ('spring = "-3 N*m/rad"', "spring: expected a torsional stiffness"),
        ('rest = "3 deg"', "rest: expected a spring beside it, got none"),
    ],
)
def test_what_is_refused(more, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read(tmp_path, more)

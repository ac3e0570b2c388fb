"""Gauges between the ends of an elastic body: closed forms of beams, and a body cut in two."""

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.gap.campaigns import open_case
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices

E = 211e9
SHEAR = E / 2.6
RADIUS = 0.02
LENGTH = 0.8
ARM = """name = "crane"
[parts.rod]
shape = "rod"
material = "steel"
radius = "20 mm"
length = "{length} mm"
compliance = "beam"
{bodies}
[joints.slew]
between = ["ground", "{first}.base"]
type = "revolute"
at = [0, 0, 0]
axis = [0, 0, 1]
drive = {{ stiffness = "3 kN*m/rad" }}
[tool]
body = "hand"
at = [0.8, 0, 0]
pose = ["rz"]
[bodies.hand]
[joints.end]
between = ["{last}.tip", "hand"]
type = "fixed"
at = [0.8, 0, 0]
"""
WHOLE = """[bodies.beam]
part = "rod"
base = [0, 0, 0]
tip = [0.8, 0, 0]
"""
HALVES = """[bodies.near]
part = "rod"
base = [0, 0, 0]
tip = [0.4, 0, 0]
[bodies.far]
part = "rod"
base = [0.4, 0, 0]
tip = [0.8, 0, 0]
[joints.middle]
between = ["near.tip", "far.base"]
type = "fixed"
at = [0.4, 0, 0]
"""


def predict(folder, body, halves=False, gauges="side lift", turned=0.3):
    """Readings of gauges 30 mm above a point of the beam under a force on the tool."""
    folder.mkdir()
    bodies, first, last = (HALVES, "near", "far") if halves else (WHOLE, "beam", "beam")
    robot = ARM.format(
        length=400 if halves else 800, bodies=bodies, first=first, last=last
    )
    (folder / "robot.toml").write_text(robot)
    header = 'robot = "robot.toml"\nreadings = "readings.csv"\n'
    for name, direction in {"side": [0, 1, 0], "lift": [0, 0, 1]}.items():
        header += (
            f'[sensors.{name}]\nmeasures = "displacement"\nbody = "{body}"\n'
            f"at = [0.4, 0, 0.03]\ndirection = {direction}\n"
        )
    header += f'[sensors.slope]\nmeasures = "rotation"\nbody = "{body}"\ndirection = [0, 1, 0]\n'
    (folder / "campaign.toml").write_text(header)
    rows = [
        f"{turned},30,-50,-200,sensor,{name},1e-5"
        for name in (*gauges.split(), "slope")
    ]
    rows = [row.replace("sensor,", "") for row in rows]
    (folder / "readings.csv").write_text(
        "\n".join(["rz,fx,fy,fz,sensor,value", *rows]) + "\n"
    )
    case = open_case(folder)
    made = mechanism_of(case.robot, part_matrices(case.robot, "beam"))
    return RobotModel(case.campaign, NominalRobot(made, case.robot)).predict().values


def test_the_middle_of_a_cantilever_moves_as_timoshenko_says(tmp_path):
    """v(s) = F s² (3 L - s) / (6 E I) + F s / (k G A); the base does not yield to a lift."""
    _, lift, slope = predict(tmp_path / "a", "beam:0.5", turned=0.0)
    area = np.pi * RADIUS**2
    inertia = np.pi * RADIUS**4 / 4
    k = 6 * 1.3 / (7 + 6 * 0.3)  # of a full circle (Cowper 1966), nu = 0.3
    s = LENGTH / 2
    bent = s**2 * (3 * LENGTH - s) / (6 * E * inertia) + s / (k * SHEAR * area)
    assert lift == pytest.approx(-200 * bent, rel=2e-3)
    turned = s * (2 * LENGTH - s) / (2 * E * inertia)
    assert slope == pytest.approx(200 * turned, rel=2e-3)


@pytest.mark.parametrize("turned", [0.0, 0.7])
def test_a_point_within_a_body_is_the_end_of_its_half(tmp_path, turned):
    whole = predict(tmp_path / "a", "beam:0.5", turned=turned)
    halves = predict(tmp_path / "b", "near.tip", halves=True, turned=turned)
    assert whole == pytest.approx(halves, rel=1e-6)


@pytest.mark.parametrize("body", ["beam:0", "beam:1.5", "hand:0.5", "beam:x"])
def test_a_place_that_is_not_within_a_body_is_refused(tmp_path, body):
    with pytest.raises(
        InputError, match=r"campaign.toml:5: sensors\.side\.body: expected"
    ):
        predict(tmp_path / "a", body)

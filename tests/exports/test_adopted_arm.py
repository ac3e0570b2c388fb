"""An arm with what a diagnosis found predicts in MuJoCo and EXUDYN what it predicts here."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from examples.measured.arm import write_robot
from examples.measured.motoman import ARMS
from stiffscope.cli.poses import find_poses
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.exports.exudyn_model import tabulate
from stiffscope.exports.mjcf import export_robot
from stiffscope.exports.target import Order
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.statics.analysis import sag

pytestmark = pytest.mark.slow

HOME = np.array([0.1, -0.2, 0.3, -0.2, 0.1, 0.4])
FOUND = """
[[effects]]
effect = "geometry"
place = "robot"
parameters = { "J6.z" = 1.8e-3, "J1.z" = -1.5e-3, "J5.y" = 1.3e-3, "J2.ry" = 8e-5, "J3.zero" = -2e-5 }

[[effects]]
effect = "actuator-stiffness"
place = "J4"
parameters = { factor = 0.021 }
"""
"""As found on the measured arm, rounded: see docs/measured.md."""
POSTURES = [
    "J1=-6 deg,J2=-2 deg,J3=15 deg,J5=4 deg,J6=-17 deg",
    "J1=8 deg,J2=-21 deg,J3=-20 deg,J4=-8 deg,J6=-1 deg",
    "J1=-15 deg,J2=-9 deg,J3=-13 deg,J4=16 deg,J5=1 deg,J6=4 deg",
    "J1=11 deg,J2=3 deg,J3=12 deg,J4=-10 deg,J6=-12 deg",
]
POINT = np.array(
    [-0.25, -0.05, 0.01]
)  # m from M, on the last link at home: what is read


@pytest.fixture(scope="module")
def orders(tmp_path_factory):
    """The arm as drawn, and with what was found, at the postures."""
    folder = tmp_path_factory.mktemp("arm")
    path = folder / "arm.toml"
    write_robot(ARMS["left"], HOME, path)
    text = path.read_text()
    out = []
    for name, effects in (("drawn", ""), ("found", FOUND)):
        file = folder / f"{name}.toml"
        file.write_text(text + effects)
        robot = load_robot(file)
        with workshop() as shop:
            made = assemble_robots({name: robot}, None, shop)[name]
        out.append(Order(made, find_poses(robot, (), POSTURES), 500.0))
    return out


def predict(order):
    """Return where our model has the point (p, 3), base axes."""
    configurations = order.asked.configurations
    moved = sag(order.assembled.mechanism, configurations)
    turned = Rotation.from_rotvec(configurations.tool[:, 3:])
    turned = Rotation.from_rotvec(moved[:, 3:]) * turned
    return configurations.tool[:, :3] + moved[:, :3] + turned.apply(POINT)


def compare(predicted, orders):
    """Assert a prediction like ours, to a fiftieth of what was found."""
    drawn, found = map(predict, orders)
    change = np.sqrt(np.mean((found - drawn) ** 2))
    assert np.sqrt(np.mean((predicted - found) ** 2)) < 0.02 * change
    assert change > 1e-4


def test_a_found_arm_reads_in_mujoco_as_here(orders, tmp_path):
    mujoco = pytest.importorskip("mujoco")
    from tests.exports import settling

    export = export_robot(orders[1])
    export.write(tmp_path)
    (file,) = export.answer["files"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / file))
    data = mujoco.MjData(model)
    seen = []
    for key in range(len(POSTURES)):
        mujoco.mj_resetDataKeyframe(model, data, key)
        place, turn = settling.settle(model, data)
        seen.append(place + turn @ POINT)
    compare(np.array(seen), orders)


def test_a_found_arm_reads_in_exudyn_as_here(orders):
    pytest.importorskip("exudyn")
    from stiffscope.exports.exudyn_robot import Robot

    found = orders[1]
    names = found.asked.names
    model = tabulate(found.assembled.mechanism, found.asked.configurations, names)
    seen = []
    for name in names:
        robot = Robot(model, name)
        twist = robot.settle()
        turn = Rotation.from_rotvec(twist[3:]).as_matrix()
        turn = turn @ robot.turn(model["tool"]["body"])
        seen.append(robot.tool + twist[:3] + turn @ POINT)
    compare(np.array(seen), orders)

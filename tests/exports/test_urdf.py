"""A URDF read by MuJoCo stands where the robot does, with its masses and what was found on it."""

import mujoco
import numpy as np
import pytest
import yaml

from stiffscope.exports.urdf import export_robot
from stiffscope.imports.import_model import import_model
from stiffscope.robot.mechanism_of import rigid_mechanism
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.kinematics.configurations import configure_drives
from stiffscope.vjm.model.mechanism import Change
from tests.exports.test_mjcf import order

pytestmark = pytest.mark.slow


def read(tmp_path, wanted):
    export = export_robot(wanted)
    export.write(tmp_path)
    urdf, beside = (tmp_path / file for file in export.answer["files"])
    spec = mujoco.MjSpec.from_file(str(urdf))
    spec.compiler.fusestatic = 0
    spec.compiler.boundmass = 1e-9
    spec.compiler.boundinertia = 1e-12
    model = spec.compile()
    return model, mujoco.MjData(model), yaml.safe_load(beside.read_text()), urdf


def place(model, data, values):
    for name, value in values.items():
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_kinematics(model, data)
    tool = data.body("tool0")
    return tool.xpos.copy(), tool.xmat.reshape(3, 3).copy()


def test_the_tool_stands_where_the_robots_does(tmp_path):
    robot = load_robot("serial-arm")
    model, data, beside, _ = read(tmp_path, order(robot))
    moves = np.random.default_rng(5).uniform(-0.9, 0.9, (20, 6))
    found = configure_drives(rigid_mechanism(robot), moves)
    rotation, position = found.frame("flange")
    for k, values in enumerate(moves):
        names = [f"J{n + 1}" for n in range(6)]
        at, turn = place(model, data, dict(zip(names, values, strict=True)))
        np.testing.assert_allclose(
            at, rotation[k] @ robot.tool.at + position[k], atol=1e-12
        )
        np.testing.assert_allclose(turn, rotation[k], atol=1e-12)
    place(model, data, beside["poses"]["near"])
    at = data.body("tool0").xpos
    np.testing.assert_allclose(at, robot.poses["near"][:3], atol=1e-12)


@pytest.mark.parametrize("name", ["serial-arm", "delta", "five-bar"])
def test_masses_and_inertias_come_back_through_import(name, tmp_path):
    wanted = order(load_robot(name))
    *_, urdf = read(tmp_path, wanted)
    import_model(urdf, tmp_path / "back.toml")
    back = rigid_mechanism(load_robot(tmp_path / "back.toml"))
    for body in wanted.assembled.mechanism.bodies:
        again = back.body(body.name)
        assert again.mass == pytest.approx(body.mass, rel=1e-12)
        if body.elastic is None and body.mass:
            np.testing.assert_allclose(again.centre, body.centre, atol=1e-12)
            inertia = np.zeros((3, 3)) if body.inertia is None else body.inertia
            given = np.zeros((3, 3)) if again.inertia is None else again.inertia
            np.testing.assert_allclose(given, inertia, atol=1e-12)


def test_loops_are_cut_and_named(tmp_path):
    *_, beside, urdf = read(tmp_path, order(load_robot("delta")))
    assert len(beside["cut_joints"]) == 5
    for name, joint in beside["cut_joints"].items():
        assert joint["type"] == "spherical"
        assert f'joint name="{name}' not in urdf.read_text()
    assert beside["joints"]["leg1.motor"]["drive"] == {"stiffness": 30000.0}
    assert np.shape(beside["bodies"]["leg1.rod1"]["compliance"]) == (6, 6)


def test_zeros_axes_and_tool_that_were_found_are_in_the_urdf(tmp_path):
    robot = load_robot("serial-arm")
    zero = np.array([0.0, 0, 0, 2e-3, 0, 0])
    axis = np.array([0.0, 3e-4, 0, 0, 0, 1e-3])
    grip = np.array([1e-3, 0, 2e-3, 0, 0, 5e-3])

    def change(mechanism):
        changes = {
            "J2": Change(offset=zero, misalignment=axis),
            "<tool>": Change(offset=grip),
        }
        return mechanism.change_elements(changes)

    model, data, *_ = read(tmp_path, order(robot, mechanism=change))
    joint = rigid_mechanism(robot).joint("J2")
    moved = joint.axes @ axis.reshape(2, 3).T
    start = joint.at + moved[:, 0]
    along = joint.axis + np.cross(moved[:, 1], joint.axis)
    along /= np.linalg.norm(along)
    angle = 0.3
    turn = rotate(along, angle + zero[3])
    tool = robot.tool.at + grip[:3]
    at, _ = place(model, data, {"J2": angle})
    expected = start + turn @ (tool - start)
    np.testing.assert_allclose(at, expected, atol=2e-6)
    plain = tmp_path / "plain"
    plain.mkdir()
    model, data, *_ = read(plain, order(robot))
    nominal, _ = place(model, data, {"J2": angle})
    assert np.linalg.norm(nominal - expected) > 1e-3


def rotate(axis, angle):
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def test_pinocchio_reads_the_same_places_and_masses(tmp_path):
    pinocchio = pytest.importorskip("pinocchio")
    robot = load_robot("serial-arm")
    wanted = order(robot)
    *_, urdf = read(tmp_path, wanted)
    model = pinocchio.buildModelFromUrdf(str(urdf))
    data = model.createData()
    moves = np.random.default_rng(6).uniform(-0.9, 0.9, (10, 6))
    found = configure_drives(rigid_mechanism(robot), moves)
    rotation, position = found.frame("flange")
    for k, values in enumerate(moves):
        state = pinocchio.neutral(model)
        for number, value in enumerate(values, start=1):
            joint = model.joints[model.getJointId(f"J{number}")]
            turning = joint.nq == 2  # a joint without limits: cosine and sine
            pair = [np.cos(value), np.sin(value)] if turning else [value]
            state[joint.idx_q : joint.idx_q + joint.nq] = pair
        pinocchio.framesForwardKinematics(model, data, state)
        tool = data.oMf[model.getFrameId("tool0")]
        at = rotation[k] @ robot.tool.at + position[k]
        np.testing.assert_allclose(tool.translation, at, atol=1e-12)
        np.testing.assert_allclose(tool.rotation, rotation[k], atol=1e-12)
    masses = sum(body.mass for body in wanted.assembled.mechanism.bodies)
    assert pinocchio.computeTotalMass(model) == pytest.approx(masses, rel=1e-12)

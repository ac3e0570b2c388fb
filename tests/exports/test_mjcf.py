"""Robots in MuJoCo yield, sag and vibrate as here, and stand at the time step that is set."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from stiffscope.cli.poses import find_poses
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.exports.mjcf import export_robot
from stiffscope.exports.mjcf_tree import servos
from stiffscope.exports.target import Order
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.model.joints import Law
from stiffscope.vjm.model.mechanism import Change
from stiffscope.vjm.statics.analysis import compliance, sag
from stiffscope.vjm.vibration.modes import frequencies
from tests.exports import settling
from tests.vjm.files import FILES

pytestmark = pytest.mark.slow

ARM = """
name = "arm"
[bodies.arm]
mass = "2 kg"
centre = ["0.5 m", 0, 0]
inertia = [0.01, 0.02, 0.02, 0, 0, 0]
[joints.hinge]
between = ["ground", "arm"]
type = "revolute"
at = [0, 0, 0]
axis = [0, 1, 0]
{drive}
[tool]
body = "arm"
at = ["0.5 m", 0, 0]
pose = ["z"]
[gravity]
acceleration = 9.81
direction = [0, 0, -1]
[poses]
home = [0]
"""


def order(robot, at=(), mechanism=None):
    with workshop() as shop:
        made = assemble_robots({"robot": robot}, "beam", shop)["robot"]
    if mechanism is not None:
        made = replace(made, mechanism=mechanism(made.mechanism))
    return Order(made, find_poses(robot, at, ()))


def load(tmp_path, wanted):
    export = export_robot(wanted)
    export.write(tmp_path)
    file = tmp_path / export.answer["files"][0]
    model = mujoco.MjModel.from_xml_path(str(file))
    return model, mujoco.MjData(model), export


def check(tmp_path, wanted, tolerance=0.01, force=1.0):
    """Compare statics and frequencies at all poses with MuJoCo's own."""
    model, data, export = load(tmp_path, wanted)
    mechanism = wanted.assembled.mechanism
    found = wanted.asked.configurations
    soft = compliance(mechanism, found)
    sagged = sag(mechanism, found)
    hertz = frequencies(mechanism, found, 6)
    for k in range(len(found)):
        mujoco.mj_resetDataKeyframe(model, data, k)
        mujoco.mj_forward(model, data)
        free = settling.place(data)
        np.testing.assert_allclose(free[0], found.tool[k, :3], atol=1e-12)
        known = hertz[k][np.isfinite(hertz[k]) & (hertz[k] > 0.0)]
        ours = settling.frequencies(model, data)
        np.testing.assert_allclose(ours[: len(known)], known, rtol=tolerance)
        mujoco.mj_resetDataKeyframe(model, data, k)
        assert settling.growth(model, data) <= 1.0 + 1e-6
        home = settling.balance(model, data)
        close(settling.twist(free, home), sagged[k], tolerance)
        check_loads(model, data, home, soft[k], tolerance, force)
    return model, data, export


def check_loads(model, data, home, soft, tolerance, force=1.0):
    """Compare twists from a balanced place under six wrenches with a compliance (6, 6)."""
    rest = data.qpos.copy()
    for wrench in force * np.eye(6):
        data.qpos[:] = rest
        loaded = settling.balance(model, data, wrench)
        close(settling.twist(home, loaded), soft @ wrench, tolerance)


def close(given, right, tolerance):
    """Compare twists, rotations on a lever of 0.1 m."""
    lever = np.repeat([1.0, 0.1], 3)
    size = np.linalg.norm(lever * right)
    assert np.linalg.norm(lever * (given - right)) < tolerance * size + 1e-10


@pytest.mark.parametrize("name", ["serial-arm", "five-bar"])
def test_bundled_robots_yield_sag_and_vibrate_as_here(name, tmp_path):
    check(tmp_path, order(load_robot(name)))


@pytest.mark.parametrize("name", ["stewart", "linear-delta", "braced-gantry"])
def test_robots_of_rigid_and_massless_struts_do_too(name, tmp_path):
    check(tmp_path, order(load_robot(FILES / f"{name}.toml")))


@pytest.mark.parametrize("ends", ['"ground", "arm"', '"arm", "ground"'])
@pytest.mark.parametrize("carrier", ["first", "second"])
def test_a_guide_yields_where_its_carriage_stands(tmp_path, ends, carrier):
    text = ARM.format(drive='drive = { stiffness = "50 N/um" }')
    text = text.replace("revolute", "prismatic").replace("[0, 1, 0]", "[0, 0, 1]")
    guide = 'compliance = { radial = "0.02 um/N", tilting = "10 urad/(N*m)" }'
    text = text.replace("[tool]", f'{guide}\ncarried_by = "{carrier}"\n[tool]')
    text = text.replace('"ground", "arm"', ends)
    path = tmp_path / "slide.toml"
    path.write_text(text.replace("home = [0]", 'home = [0]\nup = ["300 mm"]'))
    check(tmp_path, order(load_robot(path)))


def test_a_model_settles_at_its_own_time_step(tmp_path):
    wanted = order(load_robot("serial-arm"), ["home"])
    model, data, export = load(tmp_path, wanted)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    free = settling.place(data)
    home = settling.settle(model, data)
    close(settling.twist(free, home), np.array(export.answer["sag"][0]), 0.01)


def test_loops_stay_closed_to_a_micrometre_under_100_newtons(tmp_path):
    model, data, _ = load(tmp_path, order(load_robot("five-bar"), ["home"]))
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for wrench in 100.0 * np.eye(6)[:3]:
        settling.balance(model, data, wrench)
        sites = model.actuator_trntype == mujoco.mjtTrn.mjTRN_SITE
        for one, other in model.actuator_trnid[sites]:
            gap = np.linalg.norm(data.site_xpos[one] - data.site_xpos[other])
            assert gap < 1e-6
    assert model.neq == 0


def test_gravity_acts_on_the_drives_as_here(tmp_path):
    wanted = order(load_robot("serial-arm"))
    model, data, _ = load(tmp_path, wanted)
    found = wanted.asked.configurations
    shoulder = model.joint("J2")
    for k in range(len(found)):
        mujoco.mj_resetDataKeyframe(model, data, k)
        mujoco.mj_forward(model, data)
        moment = 0.0
        for body in wanted.assembled.mechanism.bodies[1:]:
            centre = np.mean([found.frame(node)[1][k] for node in body.nodes], axis=0)
            if body.elastic is None:
                rotation, position = found.frame(body.name)
                centre = rotation[k] @ body.centre + position[k]
            weight = body.mass * np.array([0.0, 0.0, -9.81])
            arm = centre - data.xanchor[shoulder.id]
            moment += np.cross(arm, weight) @ data.xaxis[shoulder.id]
        drive = int(shoulder.dofadr[0])
        assert -data.qfrc_bias[drive] == pytest.approx(moment, rel=1e-9)


@pytest.mark.parametrize("name", ["delta", "stewart"])
def test_bodies_without_a_mass_weigh_nothing(name, tmp_path):
    wanted = order(load_robot(name))
    model, data, _ = load(tmp_path, wanted)
    found = wanted.asked.configurations
    given = np.zeros(len(found))
    right = np.zeros(len(found))
    for k in range(len(found)):
        mujoco.mj_resetDataKeyframe(model, data, k)
        mujoco.mj_forward(model, data)
        given[k] = -model.body_mass @ data.xipos @ model.opt.gravity
        for body in wanted.assembled.mechanism.bodies:
            centre = np.mean([found.frame(node)[1][k] for node in body.nodes], axis=0)
            if body.elastic is None and body.mass:
                rotation, position = found.frame(body.name)
                centre = rotation[k] @ body.centre + position[k]
            right[k] += body.mass * 9.81 * centre[2]
    # virtual work of weight between poses: that of gravity torques along the way
    assert given[1] - given[0] == pytest.approx(right[1] - right[0], rel=1e-11)


@pytest.mark.parametrize(
    "law",
    [
        Law.from_curve([[1e-4, 1.0], [5e-4, 9.0]], 2e-5),
        Law.from_curve([[1e-4, 9.0], [5e-4, 10.0]]),
        Law.from_curve([[1.0, 1e4]], 4e-5),
    ],
    ids=["stiffening, backlash", "softening", "backlash"],
)
def test_servos_in_parallel_follow_a_law(law):
    deflections = np.linspace(-1e-3, 1e-3, 401)
    force = np.zeros_like(deflections)
    for gain, limit in servos(1.0, law):
        alone = gain * deflections
        force += alone if limit is None else np.clip(alone, -limit, limit)
    np.testing.assert_allclose(force, law.force(deflections), atol=1e-9)


def test_backlash_lets_the_arm_hang_at_its_end(tmp_path):
    drive = 'drive = { stiffness = "10 kN*m/rad", backlash = "2 mrad" }'
    path = tmp_path / "arm.toml"
    path.write_text(ARM.format(drive=drive))
    model, data, export = load(tmp_path, order(load_robot(path)))
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[:] = 2e-3
    settling.balance(model, data)
    assert data.qpos[0] == pytest.approx(1e-3 + 2.0 * 9.81 * 0.5 / 1e4, rel=1e-3)
    assert "hinge:law1" in export.remarks[0]


def test_what_was_found_on_a_robot_is_in_its_model(tmp_path):
    def change(mechanism):
        yielding = np.diag([2e-8, 1e-8, 1e-8, 1e-6, 2e-6, 1e-6])
        zero = np.array([0.0, 0, 0, 4e-4, 0, 0])
        drive = np.diag([0.0, 0, 0, 1e-5, 0, 0])
        bent = np.array([0.0, 1e-4, 2e-4, 0, 0, 0])
        return mechanism.change_elements(
            {
                "<base>": Change(compliance=yielding),
                "<tool>": Change(compliance=0.5 * yielding, offset=0.1 * bent),
                "J2": Change(compliance=drive, offset=zero),
                "J5": Change(compliance=np.diag([0.0, 3e-8, 3e-8, 0, 1e-6, 1e-6])),
                "fore": Change(offset=bent),
            }
        )

    wanted = order(load_robot("serial-arm"), ["home"], change)
    model, data, _ = load(tmp_path, wanted)
    mechanism = wanted.assembled.mechanism
    found = wanted.asked.configurations
    mujoco.mj_resetDataKeyframe(model, data, 0)
    home = settling.balance(model, data)
    nominal = found.tool[0, :3], np.eye(3)
    # Tilts of 2 mrad against displacements of 1 mm: the linear sag is right to some 1e-3 of it.
    close(settling.twist(nominal, home), sag(mechanism, found)[0], 0.01)
    model.opt.gravity[:] = 0.0
    home = settling.balance(model, data)
    rest = data.qpos.copy()
    soft = compliance(mechanism, found)[0]
    for wrench in np.eye(6):
        data.qpos[:] = rest
        moved = settling.twist(home, settling.balance(model, data, wrench))
        close(moved, soft @ wrench, 0.01)


def test_a_lower_highest_frequency_allows_larger_steps(tmp_path):
    wanted = order(load_robot("serial-arm"), ["home"])
    steps = [
        export_robot(replace(wanted, highest=hertz)).answer["timestep"]
        for hertz in (2000.0, 8000.0)
    ]
    assert steps[0] > 3.0 * steps[1]


@pytest.mark.parametrize("name", ["serial-arm", "five-bar"])
def test_what_vibrates_above_the_highest_frequency_is_lumped(name, tmp_path):
    highest = 300.0
    wanted = replace(order(load_robot(name)), highest=highest)
    model, data, _ = load(tmp_path, wanted)
    # an undamped spring is stable below 1/(pi f), in Hz
    assert model.opt.timestep == pytest.approx(0.8 / (np.pi * highest), rel=0.05)
    mechanism = wanted.assembled.mechanism
    found = wanted.asked.configurations
    soft = compliance(mechanism, found)
    sagged = sag(mechanism, found)
    hertz = frequencies(mechanism, found, 6)
    for k in range(len(found)):
        mujoco.mj_resetDataKeyframe(model, data, k)
        mujoco.mj_forward(model, data)
        free = settling.place(data)
        # inertia in proportion to stiffness adds 1/f_h^2 to the square of each period
        ours = settling.frequencies(model, data)
        lumped = 1.0 / np.sqrt(hertz[k] ** -2 + highest**-2)
        np.testing.assert_allclose(ours[:6], lumped, rtol=0.01)
        closing = int((model.actuator_trntype == mujoco.mjtTrn.mjTRN_SITE).sum())
        # what closes loops is faster, and overdamped
        assert (ours > highest * 1.001).sum() <= closing
        mujoco.mj_resetDataKeyframe(model, data, k)
        assert settling.growth(model, data) <= 1.0 + 1e-6
        close(settling.twist(free, settling.settle(model, data)), sagged[k], 0.01)
        home = settling.balance(model, data)
        check_loads(model, data, home, soft[k], 0.01)


def test_robots_that_a_simulator_cannot_hold_are_refused(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(ARM.format(drive=""))
    robot = load_robot(path)
    with pytest.raises(InputError, match="--to urdf"):
        export_robot(order(robot))
    spring = 'drive = { stiffness = "10 kN*m/rad" }'
    text = ARM.format(drive=spring)
    path.write_text(text.replace("mass =", "# mass =").replace("inertia", "# inertia"))
    with pytest.raises(InputError, match="expected masses, got none"):
        export_robot(order(load_robot(path)))

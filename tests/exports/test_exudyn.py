"""A robot in EXUDYN against the robot here: sag, deflections, frequencies."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stiffscope as ss
from stiffscope.errors import InputError
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.bodies import Body, member, superelement_body
from stiffscope.vjm.model.joints import Drive, Joint, Law
from stiffscope.vjm.model.mechanism import Change, Mechanism, Tool
from stiffscope.vjm.statics.analysis import compliance, sag
from stiffscope.vjm.vibration.modes import frequencies

pytest.importorskip("exudyn")

from stiffscope.exports.exudyn_model import tabulate, write_script
from stiffscope.exports.exudyn_robot import Robot, find_deflection, find_sag

pytestmark = pytest.mark.slow

ROBOTS = Path(__file__).parents[1] / "vjm" / "robots"
TOLERANCE = 1e-3
X, Y, Z = np.eye(3)
DOWN = np.array([0.0, 0.0, -9.81])


def off(got, want):
    """Return the greatest difference over the greatest displacement, at a lever of 0.3 m."""
    unit = np.repeat([1.0, 0.3], 3)
    return (np.abs(got - want) * unit).max() / (np.abs(want) * unit).max()


def assert_alike(mechanism, found, *, vibrates=True):
    """Compare sag, six loads at M, and the lowest six frequencies."""
    names = [f"pose{k}" for k in range(len(found))]
    model = tabulate(mechanism, found, names)
    sunk = sag(mechanism, found)
    soft = compliance(mechanism, found)
    for k, name in enumerate(names):
        assert off(find_sag(model, name), sunk[k]) < TOLERANCE
        for load, column in zip(np.diag([9, 9, 9, 1, 1, 1.0]), soft[k].T, strict=True):
            got = find_deflection(model, name, load) / load.max()
            assert off(got, column) < TOLERANCE
    if vibrates:
        want = frequencies(mechanism, found, 6)
        for k, name in enumerate(names):
            known = want[k][want[k] > 0.0]
            got = Robot(model, name, linear=True).frequencies(len(known))
            assert np.allclose(got, known, rtol=TOLERANCE, atol=0.0)


def of_file(name, components="beam"):
    robot = ss.load_robot(name)
    mechanism = ss.assemble(robot, components)
    poses = [list(pose) for pose in robot.poses.values()] or [mechanism.tool.home]
    return mechanism, configure(mechanism, poses)


@pytest.mark.parametrize("name", ["five-bar", "serial-arm", "delta"])
def test_robots_sag_yield_and_vibrate_in_exudyn_as_here(name):
    assert_alike(*of_file(name))


def test_a_published_robot_without_inertias_does_too():
    assert_alike(*of_file("biglide", "published"))


def test_a_robot_with_rigid_loops_and_idle_struts_does_too():
    assert_alike(*of_file(ROBOTS / "linear-delta.toml"))


def test_a_guide_yields_in_exudyn_where_its_first_body_carries_it():
    way = Joint(
        "way",
        "ground",
        "table",
        "prismatic",
        [0.02, 0, 0.05],
        [1, 0.2, 0.1],
        drive=Drive(2e7),
        compliance=np.diag([0.0, 2e-8, 1e-8, 1e-6, 2e-6, 3e-6]),
        carried_by="first",
    )
    table = Body("table", 40.0, np.array([0.1, 0.05, 0.1]), np.eye(3))
    m = Mechanism((table,), (way,), Tool("table", [0.25, 0.1, 0.3], ("x",)), DOWN)
    assert_alike(m, configure(m, [[0.25], [0.65]]))


def bracket():
    """A wheel that turns on a three-armed bracket, each arm another stiffness."""
    places = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.0, 0.3, 0.1]])
    rng = np.random.default_rng(4)
    root = rng.standard_normal((12, 12)) * np.tile(
        [1e-4, 1e-4, 1e-4, 3e-4, 3e-4, 3e-4], 2
    )
    soft = root @ root.T + 1e-8 * np.eye(12)
    arms = [np.eye(6), np.eye(6)]
    for arm, place in zip(arms, places[1:], strict=True):
        x, y, z = place
        arm[:3, 3:] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rigid = np.vstack(arms)
    whole = np.hstack([-rigid, np.eye(12)])
    stiffness = whole.T @ np.linalg.inv(soft) @ whole
    body = superelement_body(
        "bracket",
        dict(zip(("foot", "left", "right"), places, strict=True)),
        stiffness,
        mass=6.0,
    )
    wheel = Body("wheel", 3.0, np.array([0.5, 0.1, 0.0]), 0.02 * np.eye(3))
    joints = (
        Joint("clamp", "ground", "bracket.foot", "fixed", np.zeros(3)),
        Joint(
            "motor",
            "bracket.left",
            "wheel",
            "revolute",
            places[1],
            axis=Y,
            drive=Drive(2e4),
            compliance=np.diag([2e-8, 3e-8, 3e-8, 0.0, 1e-6, 1e-6]),
        ),
    )
    tool = Tool("wheel", np.array([0.6, 0.1, 0.05]), ("z",))
    return Mechanism((body, wheel), joints, tool, DOWN)


def test_a_body_with_three_ends_is_one_superelement():
    mechanism = bracket()
    assert_alike(mechanism, configure(mechanism, [mechanism.tool.home]))


def pendulum(law=None, **changes):
    """A slender arm on a drive, with a mass at its end."""
    arm = member("arm", [0, 0, 0], [0.5, 0, 0], 1e-6 * np.eye(6), mass=1.0)
    load = Body("load", 5.0, np.array([0.6, 0.0, 0.0]), 0.01 * np.eye(3))
    drive = Drive(2e4) if law is None else Drive(float(law.slopes[0]), law=law)
    joints = (
        Joint(
            "motor", "ground", "arm.base", "revolute", np.zeros(3), axis=Y, drive=drive
        ),
        Joint("flange", "arm.tip", "load", "fixed", np.array([0.5, 0.0, 0.0])),
    )
    tool = Tool("load", np.array([0.7, 0.0, 0.0]), ("z",))
    return Mechanism((arm, load), joints, tool, DOWN, **changes)


def test_base_and_tool_that_yield_and_lacks_of_fit_are_exported():
    soft = np.diag([1e-7, 2e-7, 3e-7, 1e-6, 2e-6, 3e-6])
    lack = np.array([2e-4, -1e-4, 3e-4, 1e-4, 2e-4, -3e-4])
    mechanism = pendulum(base=Change(soft), grip=Change(2 * soft)).change_elements(
        {"arm": Change(offset=lack), "motor": Change(misalignment=0.1 * lack)}
    )
    # a robot of home pose only: what is displaced is so there
    found = configure(mechanism, [mechanism.tool.home])
    assert_alike(mechanism, found)


def test_a_drive_with_backlash_and_a_curve_settles_on_its_law():
    law = Law.from_curve([[1e-3, 10.0], [2e-3, 40.0]], backlash=4e-4)
    mechanism = pendulum(law)
    found = configure(mechanism, [mechanism.tool.home])
    got = find_sag(tabulate(mechanism, found, ["home"]), "home")
    assert off(got, sag(mechanism, found)[0]) < TOLERANCE


def test_the_script_stands_alone_and_prints_its_answers(tmp_path):
    mechanism, found = of_file("five-bar")
    names = ["home", "side"]
    script = tmp_path / "model.py"
    script.write_text(write_script("five-bar", tabulate(mechanism, found, names)))
    call = [sys.executable, "-I", str(script), "side", "--wrench", "0,0,5,0,0,0"]
    done = subprocess.run(call, capture_output=True, text=True, check=True)
    answer = json.loads(done.stdout)
    assert off(np.array(answer["sag"]), sag(mechanism, found)[1]) < TOLERANCE
    want = compliance(mechanism, found)[1][:, 2] * 5.0
    assert off(np.array(answer["deflection"]), want) < TOLERANCE
    assert len(answer["frequencies"]) == 6


def test_a_robot_whose_tool_moves_freely_is_refused_with_a_remedy():
    free = pendulum()
    joints = (replace(free.joints[0], drive=None), free.joints[1])
    mechanism = replace(free, joints=joints)
    found = configure(pendulum(), [free.tool.home])
    with pytest.raises(InputError, match="give the joints drives"):
        tabulate(mechanism, replace(found), ["home"])

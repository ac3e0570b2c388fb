"""A second laboratory: EXUDYN's machine reads as ours does, but for finite displacements."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.lab.blind import check
from stiffscope.lab.blind.cases import BlindCase, Fault
from stiffscope.lab.blind.check import Task, solve
from stiffscope.lab.blind.drawing import prepare_case
from stiffscope.lab.blind.laboratory import Lab, blind_robots
from stiffscope.lab.closure import locate
from stiffscope.lab.faults import inject
from stiffscope.lab.machine import NoEquilibriumError, machine_of
from stiffscope.lab.measuring import RECORDED, Plan, true_readings
from stiffscope.robot.reader import load_robot, read_robot
from stiffscope.runtime.workshop import workshop
from tests.labs import GUIDES

pytestmark = pytest.mark.slow

pytest.importorskip("exudyn")

POSES = 2
CASES = {
    "sound": None,
    "soft drive": ("actuator-stiffness", "limb2.actuator", {"factor": 0.3}),
    "bearing": (
        "joint-compliance",
        "limb1.link1.joint_a",
        {"radial": 3e-9, "axial": 2e-9, "tilting": 8e-8},
    ),
    "link": ("link-stiffness", "limb1.slider", {"factor": 0.4}),
    "base": ("base-compliance", "base", {"x": 1e-8, "rz": 1e-7}),
    "tool": ("platform-compliance", "tool", {"z": 1e-8, "rx": 1e-7}),
    "tool offset": ("tool-offset", "tool", {"x": 3e-3, "y": -4e-3, "z": 5e-3}),
    "mass": ("mass", "platform", {"factor": 1.4}),
    "payload": ("payload", "platform", {"mass": 4.0, "x": 0.05, "y": 0.0, "z": 0.02}),
    "encoder": ("encoder-offset", "limb1.actuator", {"offset": 5e-5}),
    "length": ("link-length", "limb1.link1", {"error": 3e-5}),
    "backlash": ("backlash", "limb1.actuator", {"half_width": 8e-6}),
    "friction": ("friction", "limb2.actuator", {"force": 40.0}),
    "hardening": ("hardening-drive", "limb2.actuator", {"cubic": 5e15}),
    "play": ("joint-play", "limb1.link1.joint_a", {"radial": 4e-6}),
    "bolt": ("loose-bolt", "limb1.link1.joint_a", {"opening": 1e-8}),
}


@pytest.fixture(scope="module")
def lab():
    with workshop() as shop:
        return Lab(blind_robots([load_robot("biglide")], None, shop)[0], poses=24)


@pytest.mark.parametrize("name", CASES)
def test_exudyn_s_machine_reads_as_ours_but_for_finite_displacements(lab, name):
    machine, plan, located, _ = prepare_case(BlindCase("none", 1), 0, lab)
    plan = replace(plan, poses=plan.poses[:POSES])
    located = located.some(range(POSES))
    if CASES[name] is not None:
        machine = inject(machine, *CASES[name])
    own = true_readings(machine, plan, located)
    other = true_readings(machine, plan, located, mechanics="exudyn")
    for turns in (0, 1):
        some = own.turns == turns
        size = np.abs(own.value[some]).max()
        # a few hundred micrometres of deflection turn the machine by 1e-3
        assert np.abs(own.value - other.value)[some].max() < 1e-2 * size


@pytest.mark.parametrize("carrier", ["first", "second"])
def test_a_guide_yields_in_exudyn_where_a_body_carries_it(carrier):
    text = GUIDES.format(ends='"ground", "table"', carrier=carrier)
    robot = read_robot(Path("guides.toml"), text)
    sound = machine_of(robot, {})
    poses = np.array(list(robot.poses.values()))
    wrench = np.array([30.0, 20, -50, 3, 4, 5])
    plan = Plan(poses, (("", wrench),), deviations=True)
    located = locate(sound, poses)
    own = true_readings(sound, plan, located).value
    other = true_readings(sound, plan, located, mechanics="exudyn").value
    assert np.abs(own - other).max() < 1e-3 * np.abs(own).max()


def test_a_sound_machine_of_exudyn_has_no_gap(lab):
    robot = replace(lab.robot, mechanics="exudyn")
    files = solve(robot, Task(robot.name, 7, 3))  # the eighth of ten is sound
    (outcome,) = json.loads(files["outcome.json"])
    assert outcome["kind"] == "none"
    assert outcome["verdict"] == "no-gap"


def test_a_machine_without_equilibrium_is_drawn_again_and_told(monkeypatch, tmp_path):
    fault = Fault("backlash", "drive", {"half_width": 1e-5})

    def draw(number, seed, lab):
        return BlindCase("single", seed, (fault,))

    def write(folder, number, case, lab):
        if case.seed == 3:
            raise NoEquilibriumError("pose: none")

    monkeypatch.setattr(check, "draw_case", draw)
    monkeypatch.setattr(check, "write_case", write)
    case, redrawn = check._measure(tmp_path, Task("robot", 7, 3), None)
    assert case.seed != 3
    assert redrawn == ("backlash @ drive",)

    def never(folder, number, case, lab):
        raise NoEquilibriumError("pose: none")

    monkeypatch.setattr(check, "write_case", never)
    with pytest.raises(InputError, match="robot/campaign-007: expected a machine with"):
        check._measure(tmp_path, Task("robot", 7, 3), None)


def test_a_drive_that_no_weight_turns_stays_in_the_middle_of_its_gap():
    # the drives of the five-bar stand upright: finite displacements alone load them, by 1e-5 N·m
    with workshop() as shop:
        robots = blind_robots([load_robot("five-bar")], None, shop)
    lab = Lab(robots[0], poses=24)
    machine, plan, located, _ = prepare_case(BlindCase("none", 1), 0, lab)
    plan = replace(plan, poses=plan.poses[:POSES], deviations=True)
    loose = inject(machine, "backlash", "left.motor", {"half_width": 2e-5})
    located = located.some(range(POSES))
    sound, played = (
        true_readings(each, plan, located, mechanics="exudyn")
        for each in (machine, loose)
    )
    still = np.array([not RECORDED[kind].is_loaded for kind in sound.kind])
    assert still.any()
    assert played.value[still] == pytest.approx(sound.value[still], abs=1e-9)
    assert np.abs(played.value - sound.value)[~still].max() > 1e-6

"""The virtual lab: its mechanics against verified numbers and the engine, its faults against their meaning."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.gap.effects.vocabulary import apply_effect
from stiffscope.lab import faults as lab_faults
from stiffscope.lab.closure import locate
from stiffscope.lab.faults import KNOWN, OUTSIDE, beam, inject, section_of
from stiffscope.lab.machine import Slot, machine_of
from stiffscope.lab.measuring import Noise, Plan, Sensor, true_readings
from stiffscope.lab.nonlinear import settle
from stiffscope.lab.plans import draw_plan, workspace
from stiffscope.lab.response import Spot, respond, tool_spot
from stiffscope.lab.rotations import rates_of_vector, turn, vector_of
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot, read_robot
from stiffscope.vjm.statics import analysis as statics
from tests.labs import (
    ARM,
    FEA_SLIDER,
    GUIDES,
    LINKS,
    PLACES,
    biglide,
    default_plan,
    located,
    machine,
    measure,
    sag,
    stiffness,
    with_slider,
)

pytestmark = pytest.mark.slow

ROBOTS = ("biglide", "delta", "five-bar", "orthoglide", "serial-arm", "stewart")
SOUND = biglide()
QUIET = Noise(displacement=0.0, rotation=0.0, stiffness=0.0, stated=None)
MIRROR = np.diag([-1.0, 1, 1, 1, -1, -1])  # the plane x = 0
HOME = np.array([[0.0, 0.0, 0.35]])
DRIVE = 1.27e7
DIAGONAL = {"x": 1e-9, "y": 1e-9, "z": 1e-9, "rx": 1e-7, "ry": 1e-7, "rz": 1e-7}
EXAMPLES = {
    ("gravity", "robot"): {},
    ("payload", "platform"): {"mass": 12.0, "x": 0.02, "y": -0.03, "z": 0.05},
    ("actuator-stiffness", "limb1"): {"factor": 0.8},
    ("actuator-stiffness", "drives"): {"factor": 0.8},
    ("joint-compliance", "joints"): {"radial": 5e-9, "axial": 1e-8, "tilting": 1e-5},
    ("joint-compliance", "limb1.link2.joint_a"): {"radial": 2e-8},
    ("link-stiffness", "links"): {"factor": 0.9},
    ("link-stiffness", "limb2.link3"): {"factor": 0.7},
    ("rigid-ends", "links"): {"length": 0.03},
    ("part-compliance", "sliders"): {"factor": 2.0},
    ("part-compliance", "limb2.slider"): {"factor": 4.0},
    ("part-dimension", "slider.thickness"): {
        "c33": 6e-9,
        "c35": -1e-7,
        "c55": 2.5e-6,
        "c11": 7e-11,
        "c22": 2e-11,
        "c44": 3e-8,
        "c66": 8e-9,
    },
    ("guide-compliance", "carriages"): {
        "lateral": 5e-9,
        "vertical": 5e-9,
        "angular": 1e-6,
    },
    ("joint-axis", "stage"): {"rz": 1e-3},
    ("mass", "platform"): {"factor": 1.3},
    ("base-compliance", "base"): DIAGONAL,
    ("platform-compliance", "tool"): {"x": 1e-8, "z": 1e-8, "ry": 1e-6},
    ("backlash", "stage"): {"half_width": 1e-5},
    ("encoder-offset", "limb1"): {"offset": 1e-4},
    ("link-length", "limb1.link2"): {"error": 5e-5},
    ("thermal", "links"): {"temperature": 8.0},
    ("instrument-misalignment", "instrument"): {"rx": 0.01, "ry": -0.02, "rz": 0.03},
    ("displacement-scale", "instrument"): {"factor": 1.05},
    ("unit", "instrument"): {"factor": 1e3},
    ("sensor-sign", "rx"): {},
    ("sensor-step", "z"): {"jump": 1e-4, "row": 40},
    ("force-scale", "instrument"): {"factor": 0.95},
    ("cable-chain", "tool"): {"x": 2e4, "y": 2e4, "z": 1e4},
    ("hardening-drive", "limbs"): {"cubic": 1e16},
    ("friction", "limb1"): {"force": 60.0},
    ("preload-loss", "limb1"): {"load": 40.0, "factor": 0.6},
    ("tool-offset", "tool"): {"x": 0.02, "z": -0.01, "ry": 0.003},
    ("force-cross-talk", "fz"): {"fx": 0.05, "fy": -0.03},
    ("column-swap", "x/y"): {},
    ("load-value", "500 N"): {"factor": 0.9},
    ("stiffening-joint", "limb1.link2.joint_a"): {"radial": 1e-7, "knee": 1e-6},
    ("joint-play", "limb1.link2.joint_a"): {"radial": 2e-5},
    ("loose-bolt", "limb1.link2.joint_a"): {"opening": 1e-7},
    ("bowed-link", "limb2.link1"): {"curvature": 1e-3},
    ("screw-pitch", "limbs"): {"relative": 2e-4},
    ("larger-body", "platform"): {"relative": 1e-3},
    ("drifting-sensor", "instrument"): {"displacement": 1e-5, "rotation": 5e-5},
    ("gain-drift", "instrument"): {"relative": 0.1},
    ("cross-talk", "z->x"): {"share": 0.05},
    ("coarse-converter", "instrument"): {"displacement": 1e-5, "rotation": 5e-5},
    ("wrench-off-centre", "instrument"): {"x": 0.02},
    ("bad-session", "instrument"): {"relative": 0.1},
}


def without_weight(machine):
    return replace(machine, weighted=False)


def seen(machine, plan=None):
    """All three kinds of reading, noiseless, by kind: (p, m, 6), (p, 6), (p, 6)."""
    plan = plan or default_plan(
        SOUND, np.random.default_rng(3), poses=4, stiffness="k", sessions=2
    )
    c = measure(machine, plan, QUIET, np.random.default_rng(0))
    parts = [c.value[c.kind == kind] for kind in range(3)]
    p = len(plan.poses)
    m = len(plan.loads)
    return parts[0].reshape(p, m, 6), parts[1].reshape(-1, 6), parts[2].reshape(-1, 6)


def loaded(poses, *wrenches, deviations=True):
    return Plan(
        np.array(poses),
        tuple(("", np.array(w, dtype=float)) for w in wrenches),
        deviations=deviations,
    )


def angle_at(pose):
    return np.arcsin((pose[2] - 0.055) / 0.5)


def at_angle(degrees):
    return np.array([[0, 0, 0.055 + 0.5 * np.sin(np.deg2rad(degrees))]])


def poses_of(sound, count=5, seed=1):
    return default_plan(sound, np.random.default_rng(seed), poses=count).poses


@pytest.mark.extended_for("delta", "orthoglide", "stewart", "biglide")
@pytest.mark.parametrize("name", ROBOTS)
def test_stiffness_and_sag_are_those_of_the_mechanism_engine(name):
    """Two independent mechanics: loops closed and stiffness assembled otherwise, from the same file and matrices."""
    robot = load_robot(name)
    parts = part_matrices(robot, "beam")
    mechanism = mechanism_of(robot, parts)
    sound = machine(name, components="beam")
    poses = np.vstack([list(robot.poses.values()), poses_of(sound, 3)])
    k = statics.stiffness(mechanism, poses)
    w = statics.sag(mechanism, poses)
    size = np.sqrt(np.einsum("nii->ni", k))
    assert (
        np.abs(stiffness(sound, poses) - k) < 1e-8 * size[:, :, None] * size[:, None, :]
    ).all()
    assert np.abs(sag(sound, poses) - w).max() < 1e-8 * np.abs(w).max()


@pytest.mark.parametrize("ends", ['"ground", "table"', '"table", "ground"'])
@pytest.mark.parametrize("carrier", ["first", "second"])
def test_a_guide_yields_in_the_lab_where_a_body_carries_it(ends, carrier):
    """As in the engine, which takes another way: compliances of the sound machine, and its sag."""
    robot = read_robot(Path("guides.toml"), GUIDES.format(ends=ends, carrier=carrier))
    sound = machine_of(robot, {})
    mechanism = mechanism_of(robot, {})
    poses = np.array(list(robot.poses.values()))
    weight = statics.sag(mechanism, poses)
    assert sag(sound, poses) == pytest.approx(weight, rel=1e-8, abs=1e-15)
    loads = np.diag([30.0, 30, 30, 3, 3, 3])
    plan = loaded(poses, *loads, deviations=False)
    got = true_readings(sound, plan, locate(sound, poses)).value
    expected = statics.compliance(mechanism, poses) @ loads
    assert got.reshape(2, 6, 6) == pytest.approx(
        expected.swapaxes(1, 2), rel=1e-8, abs=1e-14
    )


def test_a_load_on_a_body_without_mass_is_placed_from_the_middle_of_its_joints():
    """By lab and model alike: the body of a robot file with the load as its own mass sags as much."""
    file = Path(__file__).parents[1] / "vjm" / "robots" / "stewart.toml"
    robot = load_robot(file)
    load = {"mass": 1.3, "x": -0.036, "y": 0.0875, "z": -0.059}
    joints = [
        joint.at
        for joint in mechanism_of(robot, {}).joints
        if "strut6.lower" in (joint.first, joint.second)
    ]
    centre = (np.mean(joints, axis=0) + [load[axis] for axis in "xyz"]).tolist()
    section = '[bodies."strut6.lower"]'
    heavy = read_robot(
        file,
        file.read_text().replace(section, f"{section}\nmass = 1.3\ncentre = {centre}"),
    )
    poses = mechanism_of(robot, {}).tool.home + np.array(
        [[0.0] * 6, [0.02, -0.01, 0.01, 0.05, -0.1, 0.08]]
    )
    expected = statics.sag(mechanism_of(heavy, {}), poses)
    assert sag(
        inject(machine_of(robot, {}), "payload", "strut6.lower", load), poses
    ) == pytest.approx(expected, rel=1e-6)
    placed = read_robot(
        file, file.read_text().replace(section, f"{section}\ncentre = {centre}")
    )
    own = inject(machine_of(placed, {}), "payload", "strut6.lower", {"mass": 1.3})
    assert sag(own, poses) == pytest.approx(expected, rel=1e-6)
    assert np.isfinite(
        sag(inject(machine_of(robot, {}), "payload", "tool", load), poses)
    ).all()
    loaded_robot = apply_effect(
        NominalRobot(mechanism_of(robot, {}), robot), "payload", "strut6.lower", load
    )
    assert statics.sag(loaded_robot.mechanism, poses) == pytest.approx(
        expected, rel=1e-6
    )


@pytest.mark.parametrize(
    ("angle", "rigid_slider", "expected"),
    [
        (
            36,
            False,
            [
                23.82111,
                1.96743,
                12.574307,
                1.464912,
                0.141031,
                2.819319,
                0.922902,
                0.325959,
            ],
        ),
        (
            66,
            False,
            [
                17.883256,
                1.96691,
                90.215325,
                3.442252,
                0.699246,
                0.759309,
                2.918568,
                0.494572,
            ],
        ),
        (
            36,
            True,
            [
                24.63093,
                1.969098,
                13.001783,
                1.495549,
                0.147504,
                2.874351,
                0.868302,
                0.318888,
            ],
        ),
    ],
)
def test_stiffness_is_that_of_the_verified_table(angle, rigid_slider, expected):
    k = (
        stiffness(
            with_slider(SOUND, np.zeros((6, 6))) if rigid_slider else SOUND,
            at_angle(angle),
        )[0]
        / 1e6
    )
    assert np.array([*np.diag(k), k[0, 4], k[1, 3]]) == pytest.approx(
        expected, abs=6e-7
    )
    k[[0, 4, 1, 3], [4, 0, 3, 1]] = 0
    assert np.abs(k - np.diag(np.diag(k))).max() < 1e-8


def test_the_platform_sags_and_the_weight_pulls_the_limbs_together():
    """Sag 10.8 µm; thrust (W/2 + 3w/2) cot q in each drive."""
    probed = inject(SOUND, "friction", "limbs", {"force": 1.0})
    response = respond(probed, HOME, [tool_spot(probed)])
    assert sag(SOUND, HOME)[0] * 1e6 == pytest.approx([0, 0, 10.8, 0, 0, 0], abs=0.05)
    thrust = (7.93 + 3 * 2 * 1.95 / 2) / 2 * 9.81 / np.tan(angle_at(HOME[0]))
    assert response.force[0, :, response.dead] == pytest.approx(
        [-thrust, -thrust], rel=1e-6
    )  # inward


def test_mirrored_machine_answers_mirrored():
    poses = poses_of(SOUND)
    answers = []
    for limb, where in (("limb1", poses), ("limb2", poses * [-1, 1, 1])):
        one = inject(SOUND, "actuator-stiffness", limb, {"factor": 0.7})
        one = inject(one, "link-length", f"{limb}.link2", {"error": 1e-4})
        one = inject(one, "part-compliance", f"{limb}.slider", {"factor": 3.0})
        tool = tool_spot(one)
        response = respond(one, where, [tool])
        answers.append((response.find_twists(tool), response.shift(tool)))
    (one, moved), (other, mirrored) = answers
    assert np.allclose(
        one[:, :, :6], MIRROR @ other[:, :, :6] @ MIRROR, rtol=1e-7, atol=1e-16
    )
    assert np.allclose(one[:, :, 6], other[:, :, 6] @ MIRROR, rtol=1e-7, atol=1e-12)
    assert np.allclose(moved, mirrored @ MIRROR, rtol=1e-7, atol=1e-12)


@pytest.mark.extended_for("orthoglide")
@pytest.mark.parametrize("name", ROBOTS)
def test_compliance_is_symmetric_and_positive(name):
    sound = machine(name)
    tool = tool_spot(sound)
    c = respond(sound, poses_of(sound), [tool]).find_twists(tool)[:, :, :6]
    assert np.allclose(c, np.swapaxes(c, 1, 2), rtol=1e-6, atol=1e-9 * np.abs(c).max())
    assert (np.linalg.eigvalsh(c) > 0).all()


@pytest.mark.parametrize("effect", [e for e in EXAMPLES if e[0].endswith("compliance")])
def test_more_compliance_only_softens(effect):
    """Every reading of K stays under the sound machine's, in the sense of matrices."""
    poses = poses_of(SOUND)
    softer = stiffness(inject(SOUND, *effect, EXAMPLES[effect]), poses)
    excess = np.linalg.eigvalsh(stiffness(SOUND, poses) - softer)
    assert (excess > -1e-6 * excess.max()).all()
    assert excess.max() > 0


@pytest.mark.extended
def test_every_word_and_every_fault_can_be_planted_and_seen():
    # the Biglide states no springs, and readings under loads show no sensor of a hammer test
    here = {*KNOWN, *OUTSIDE} - {"joint-stiffness", "sensor-mass", "response-gain"}
    assert {effect for effect, _ in EXAMPLES} == here >= {*PLACES} - {"joint-stiffness"}
    plan = default_plan(
        SOUND, np.random.default_rng(3), poses=4, stiffness="k", sessions=2
    )
    start = without_weight(SOUND)
    reference = {
        base.weighted: true_readings(base, plan, located(base, plan)).value
        for base in (SOUND, start)
    }
    for (effect, place), parameters in EXAMPLES.items():
        base = SOUND if effect in {"backlash", "joint-play", "mass"} else start
        faulty = inject(base, effect, place, parameters)
        after = measure(faulty, plan, QUIET, np.random.default_rng(0)).value
        assert np.isfinite(after).all(), effect
        assert not np.allclose(after, reference[base.weighted], rtol=1e-4, atol=0), (
            effect
        )


def test_loads_show_where_they_act():
    """Weights move the unloaded platform only; a platform's compliance yields to the applied wrench only."""
    for effect, place in [
        ("payload", "platform"),
        ("encoder-offset", "limb1"),
        ("thermal", "links"),
    ]:
        d, e, _ = seen(inject(SOUND, effect, place, EXAMPLES[effect, place]))
        assert np.allclose(d, seen(SOUND)[0], rtol=2e-3, atol=1e-9)
        assert not np.allclose(e, seen(SOUND)[1], atol=1e-7)
    soft = inject(SOUND, "platform-compliance", "platform", {"z": 1e-8})
    assert np.allclose(seen(soft)[1], seen(SOUND)[1], atol=1e-12)
    plan = loaded(HOME, [0, 0, 100.0, 0, 0, 0])
    assert seen(soft, plan)[0][0, 0] - seen(SOUND, plan)[0][0, 0] == pytest.approx(
        [0, 0, 1e-6, 0, 0, 0], abs=1e-12
    )


def test_instrument_acts_on_what_is_read():
    d, e, k = seen(SOUND)
    d2, e2, k2 = seen(
        inject(SOUND, "displacement-scale", "instrument", {"factor": 1.1})
    )
    assert np.allclose(d2, 1.1 * d)
    assert np.allclose(e2, 1.1 * e)
    assert np.allclose(k2 / k, 1 / 1.1)
    d3, e3, k3 = seen(inject(SOUND, "force-scale", "instrument", {"factor": 1.1}))
    assert np.allclose(d3, 1.1 * d)
    assert np.allclose(e3, e)
    assert np.allclose(k3 / k, 1 / 1.1)
    turned = seen(inject(SOUND, "instrument-misalignment", "instrument", {"rz": 0.01}))[
        0
    ]
    assert np.allclose(turned[..., 0], d[..., 0] - 0.01 * d[..., 1])
    assert np.allclose(turned[..., 4], d[..., 4] + 0.01 * d[..., 3])


def test_geometry_errors_are_exact_rigid_kinematics():
    """Both carriages out by e: z from the circle; one link set longer: M where the circles meet."""
    bare = without_weight(SOUND)
    plan = loaded(HOME)
    e = 2e-3
    both = inject(bare, "encoder-offset", "limbs", {"offset": e})
    q = angle_at(HOME[0])
    depth = np.sqrt(0.25 - (0.5 * np.cos(q) + e) ** 2) - 0.5 * np.sin(q)
    assert seen(both, plan)[1][0] == pytest.approx([0, 0, depth, 0, 0, 0], abs=1e-12)
    one = seen(inject(bare, "encoder-offset", "limb2", {"offset": e}), plan)[1][0]
    assert one[0] == pytest.approx(e / 2, rel=1e-12)
    moved = seen(inject(bare, "encoder-offset", "stage", {"offset": e}), plan)[1][0]
    assert moved == pytest.approx([0, e, 0, 0, 0, 0], abs=1e-12)
    hot = seen(inject(bare, "thermal", "links", {"temperature": 10.0}), plan)[1][0]
    assert hot[2] == pytest.approx(10 * 11.7e-6 * 0.5 / np.sin(q), rel=1e-3)


def test_an_arm_follows_its_errors_exactly():
    """J1 turned by e about z swings M about the origin; a longer upper arm moves it along that arm."""
    arm = without_weight(machine("serial-arm"))
    home = load_robot("serial-arm").poses["near"]
    e = 1e-2
    plan = loaded([home], deviations=True)
    tool = tool_spot(arm)
    swung = inject(arm, "encoder-offset", "J1", {"offset": e})
    response = respond(swung, plan.poses, [tool])
    there = turn(np.array([0, 0, e])) @ np.array(home[:3])
    assert response.true.point(tool.node, tool.at)[0] == pytest.approx(there, abs=1e-12)
    assert response.shift(tool)[0, 3:] == pytest.approx([0, 0, e], abs=1e-12)
    longer = respond(
        inject(arm, "link-length", "upper", {"error": e}), plan.poses, [tool]
    )
    along = (
        locate(arm, plan.poses).frames.rotation["upper"][0]
        @ arm.bodies["upper"].axes[:, 0]
    )
    assert longer.shift(tool)[0] == pytest.approx([*(e * along), 0, 0, 0], abs=1e-12)


def test_a_turn_of_both_bodies_of_a_sensor_is_not_read():
    """The shoulder's error moves foot and target of a sensor beyond it alike, also far from home."""
    arm = machine_of(
        load_robot("serial-arm"), part_matrices(load_robot("serial-arm"), "beam")
    )
    poses = np.array([load_robot("serial-arm").poses["near"]])
    spot = Spot("wrist1", np.array([0.4, 0.1, 0.2]))
    for joint, alike in (("J2", True), ("J3", False)):
        response = respond(
            inject(arm, "encoder-offset", joint, {"offset": 1e-3}), poses, []
        )
        moved = response.shift(spot) - response.shift(spot, "upper.tip")
        assert (np.abs(moved).max() < 1e-12) == alike


def test_an_axis_that_lies_off_leads_the_arm_about_itself():
    """J1 by q about an axis off by (x, y), tilted by e: M turns about that, and stays where it is at home."""
    arm = without_weight(machine("serial-arm"))
    home = load_robot("serial-arm").poses["near"]
    e = 2e-3
    plan = loaded([home], deviations=True)
    tool = tool_spot(arm)
    axes = arm.joints["J1"].axes
    misalignment = inject(arm, "joint-axis", "J1", {"y": 1e-3, "rz": e})
    response = respond(misalignment, plan.poses, [tool])
    (q,) = locate(arm, plan.poses).drives["J1"]
    other = turn(axes @ [0, 0, e]) @ axes[:, 0]
    there = turn(q * other)
    drawn = turn(q * axes[:, 0])
    on_axis = arm.joints["J1"].at + axes @ [0, 1e-3, 0]
    expected = on_axis + there @ (
        drawn.T @ home[:3] - on_axis
    )  # J1 at home has it at drawnᵀ home
    assert np.abs(response.true.point(tool.node, tool.at)[0] - expected).max() < 1e-12


def test_a_turned_drive_may_go_round_more_than_once():
    """A drive's displacement counts from home along the way there."""
    arm = machine("serial-arm")
    home = np.array(load_robot("serial-arm").poses["home"])
    turned = home + np.array([0, 0, 0, 0, 0, 2.5])
    drives = locate(arm, turned[None]).drives
    assert drives["J6"][0] == pytest.approx(-2.5, abs=1e-10)
    assert all(abs(drives[name][0]) < 1e-10 for name in ("J1", "J2", "J3", "J4", "J5"))


def test_single_links_errors_add_up_to_that_of_all():
    bare = without_weight(SOUND)
    plan = loaded(HOME)
    singles = sum(
        seen(inject(bare, "link-length", link, {"error": 1e-7}), plan)[1][0]
        for link in LINKS
    )
    assert singles == pytest.approx(
        seen(inject(bare, "link-length", "links", {"error": 1e-7}), plan)[1][0],
        abs=1e-11,
    )


def test_backlash_shifts_towards_the_force_and_not_without_one():
    b = 8e-6
    plan = loaded(
        HOME, [0, 400.0, 0, 0, 0, 0], [0, -400.0, 0, 0, 0, 0], [0, 0, 300, 0, 0, 0]
    )
    before = seen(SOUND, plan)
    after = seen(inject(SOUND, "backlash", "stage", {"half_width": b}), plan)
    assert (after[0] - before[0])[0, :, 1] == pytest.approx([b, -b, 0], abs=1e-13)
    assert np.allclose(after[1], before[1], atol=1e-12)
    d, e, _ = seen(inject(SOUND, "backlash", "limb1", {"half_width": b}), plan)
    shift = e[0] - before[1][0]
    assert shift[:3] == pytest.approx(
        [b / 2, 0, b / 2 / np.tan(angle_at(HOME[0]))], rel=1e-6
    )
    assert (d - before[0])[0, :2] == pytest.approx(np.zeros((2, 6)), abs=1e-12)


def test_a_tied_drive_hangs_in_its_gap():
    """With a cable that holds the platform, a small force cannot push a wide gap to its end."""
    tied = inject(SOUND, "cable-chain", "tool", {"y": 2e5})
    slack = inject(tied, "backlash", "stage", {"half_width": 1e-2})
    plan = loaded(HOME, [0, 100.0, 0, 0, 0, 0], deviations=False)
    assert seen(slack, plan)[0][0, 0, 1] == pytest.approx(100 / 2e5, rel=1e-4)


def test_nonlinear_drives():
    plan = loaded(
        HOME, *([0, f, 0, 0, 0, 0] for f in (-500.0, 50.0, 500.0)), deviations=False
    )
    linear = seen(SOUND, plan)[0][0, :, 1]
    hard = seen(inject(SOUND, "hardening-drive", "stage", {"cubic": 1e16}), plan)[0][
        0, :, 1
    ]
    e = hard[2] - linear[2] + 500 / DRIVE
    assert DRIVE * e + 1e16 * e**3 == pytest.approx(500, rel=1e-6)
    assert hard[0] == pytest.approx(-hard[2])
    stuck = seen(inject(SOUND, "friction", "stage", {"force": 60.0}), plan)[0][0, :, 1]
    assert linear - stuck == pytest.approx(np.array([-60, 50, 60]) / DRIVE, rel=1e-6)
    alike = seen(inject(SOUND, "preload-loss", "stage", {"load": 60.0}), plan)[0]
    assert alike[0, :, 1] == pytest.approx(linear, rel=1e-9)


@pytest.mark.parametrize("law", ["one-sided", "stiffening", "hardening", "friction"])
def test_lost_motion_is_in_equilibrium_with_the_force_that_it_leaves(law):
    """A spring k against a slot: the force left is f - k s, and the law gives s at that force."""
    size = {"one-sided": 1e-6, "stiffening": 1e-6, "hardening": 1e14, "friction": 3.0}[
        law
    ]
    stiff = {"hardening": 1e6, "friction": 1e6}.get(law, np.inf)
    slot = Slot("joint", 1, law, size, stiff, 1e-5)
    against = 5e5
    force = np.array([[-40.0], [-2.0], [0.0], [2.0], [40.0]])
    s = settle([slot], np.full((5, 1, 1), -against), force, gaps=True)[:, 0]
    left = force[:, 0] - against * s
    extension = s + left / stiff
    law_of = {
        "one-sided": lambda: size * np.maximum(left, 0.0) - s,
        "stiffening": lambda: (left - s / size * (1 + (s / 1e-5) ** 2)) * size,
        "hardening": lambda: (left - stiff * extension - size * extension**3) / stiff,
        "friction": lambda: (
            (np.abs(left - stiff * extension) - np.minimum(np.abs(left), size)) / stiff
        ),
    }[law]()
    assert np.abs(law_of).max() < 1e-12
    assert np.abs(s).max() > 1e-7


def test_gauges_see_the_motion_of_their_points():
    """Three upright gauges tell z, rx and ry of a platform; a hook off M is a force and a moment at M."""
    sound = machine("stewart")
    arm = 0.1
    at = sound.at
    home = load_robot("stewart").poses["tilted"]
    gauges = tuple(
        Sensor(
            f"g{k}", "displacement", "platform", at + np.array(p), np.array([0, 0, 1.0])
        )
        for k, p in enumerate([[arm, 0, 0], [0, arm, 0], [-arm, 0, 0], [0, -arm, 0]])
    )
    spin = Sensor("level", "rotation", "platform", at, np.array([0, 0, 1.0]))
    hook = {"hook": Spot("platform", at + np.array([0.05, 0, 0]))}
    plan = Plan(
        np.array([home]),
        (("hook", np.array([0, 0, 400.0, 0, 0, 0])),),
        hook,
        (*gauges, spin),
    )
    shown = true_readings(sound, plan)
    pose = turn(np.array(home[3:]))
    moment = np.cross(pose @ [0.05, 0, 0], [0, 0, 400.0])
    twist = np.linalg.inv(stiffness(sound, plan.poses))[0] @ [0, 0, 400.0, *moment]
    points = [
        pose @ np.array(p)
        for p in [[arm, 0, 0], [0, arm, 0], [-arm, 0, 0], [0, -arm, 0]]
    ]
    expected = [twist[2] + np.cross(twist[3:], p)[2] for p in points]
    assert shown.value[shown.kind == 0] == pytest.approx(
        [*expected, twist[5]], rel=1e-7
    )
    weight = sag(sound, plan.poses)[0]
    expected = [weight[2] + np.cross(weight[3:], p)[2] for p in points]
    assert shown.value[shown.kind == 1] == pytest.approx(
        [*expected, weight[5]], rel=1e-7
    )


def test_a_gauge_on_a_moving_body_reads_the_difference():
    at = np.array([-0.56, 0, 0.04])
    along = np.array([1.0, 0, 0])
    gauge = Sensor("slide", "displacement", "limb1.slider.base", at, along, "rail")
    plan = replace(
        loaded(HOME, [300.0, 0, 0, 0, 0, 0], deviations=False), sensors=(gauge,)
    )
    probed = inject(SOUND, "friction", "limb1", {"force": 1e-9})
    force = respond(probed, HOME, [tool_spot(probed)]).force[0, 0, 0] * 300.0
    assert true_readings(SOUND, plan).value[0] == pytest.approx(
        -force / DRIVE, rel=1e-6
    )  # its axis points to -x


def test_rigid_ends_and_sections_follow_beam_theory():
    section = np.array([1.0, 0.3, 0.3, 2.0, 5.0, 5.0]) * 1e-6
    assert section_of(beam(0.5, section), 0.5) == pytest.approx(section)
    before = SOUND.bodies["limb1.link1"].compliance
    ends = (
        inject(SOUND, "rigid-ends", "links", {"length": 0.05})
        .bodies["limb1.link1"]
        .compliance
    )
    assert ends[0, 0] / before[0, 0] == pytest.approx(0.8)
    assert ends[1, 1] == pytest.approx((0.45**3 - 0.05**3) / (3 * 0.5 / before[5, 5]))


@pytest.mark.parametrize(
    "vector", [[0.3, -0.2, 0.9], [1e-7, 0, 2e-7], [0, 0, 0], [2.0, 1.0, -1.5]]
)
def test_rotations(vector):
    r = np.array(vector)
    assert vector_of(turn(r)) == pytest.approx(r, abs=1e-12)
    step = 1e-6 * np.array([0.3, 0.5, -0.7])
    ahead = vector_of(turn(step) @ turn(r)) - vector_of(turn(-step) @ turn(r))
    assert rates_of_vector(r) @ (2 * step) == pytest.approx(ahead, rel=1e-6, abs=1e-14)


def test_readings_are_as_noisy_as_they_say():
    plan = default_plan(SOUND, np.random.default_rng(5), stiffness="k")
    true = measure(SOUND, plan, QUIET, np.random.default_rng(0))
    c = measure(SOUND, plan, Noise(spread=0.5), np.random.default_rng(7))
    z = (c.value - true.value) / c.sigma
    assert len(c) == 12 * (10 + 2) * 6
    assert z.std() == pytest.approx(1, abs=0.08)
    assert c.sigma[c.kind == 0].std() > 1e-7
    rough = measure(
        SOUND,
        plan,
        Noise(outliers=0.05, missing=0.2, stated=None),
        np.random.default_rng(7),
    )
    assert len(rough) == pytest.approx(0.8 * len(c), rel=0.06)
    assert np.isnan(rough.sigma).all()


@pytest.mark.parametrize(
    ("effect", "place", "parameters", "expected"),
    [
        ("rust", "base", {}, "effect: expected one of gravity, payload"),
        (
            "backlash",
            "links",
            {"half_width": 1e-6},
            "backlash, place: expected what it can act on in biglide",
        ),
        (
            "backlash",
            "stage",
            {"width": 1e-6},
            "backlash, width: expected one of half_width",
        ),
        (
            "actuator-stiffness",
            "stage",
            {"factor": -1.0},
            "factor: expected a finite number",
        ),
        (
            "rigid-ends",
            "links",
            {"length": 0.3},
            "rigid-ends, length: expected 0 to 0.25 m",
        ),
    ],
)
def test_refuses_what_cannot_be_planted(effect, place, parameters, expected):
    with pytest.raises(InputError, match=expected):
        inject(SOUND, effect, place, parameters)


@pytest.mark.parametrize("pose", [[0.4, 0, 0.35], [0, 0, 0.9]])
def test_refuses_a_pose_out_of_reach(pose):
    with pytest.raises(
        InputError, match="pose: expected poses that the machine reaches"
    ):
        stiffness(SOUND, np.array([pose]))


def test_fea_slider_where_the_nominal_has_a_beam():
    k = stiffness(with_slider(SOUND, FEA_SLIDER), HOME)[0] / stiffness(SOUND, HOME)[0]
    assert 0.97 < k[0, 0] < 1.03
    assert k[3, 3] < 0.95


def test_lab_imports_no_mechanics_of_the_diagnosis():
    own = r"errors|robot\.file\.|lab\.|gap\.campaign\.(quantities|writing)|responses\.(model|uff_writing)"
    # EXUDYN's robot is written for exports: its mechanics are EXUDYN's own
    others = {"command.py", "show.py", "slice.py", "exudyn_machine.py"}
    for file in Path(lab_faults.__file__).parent.glob("*.py"):
        if file.name in others:
            continue
        for module in re.findall(r"from stiffscope\.?(\S*) import", file.read_text()):
            assert re.match(own, module), (file.name, module)


@pytest.mark.parametrize(
    ("kind", "axis", "pose"),
    [("revolute", "[0, 0, 1]", '["x", "y"]'), ("prismatic", "[1, 0, 0]", '["x", "z"]')],
)
def test_a_lab_loads_a_robot_that_is_rigid_in_most_directions_as_it_does_others(
    kind, axis, pose
):
    text = ARM.format(kind=kind, axis=axis, pose=pose, at="[0.3, 0.2, 0]")
    where = workspace(
        machine_of(read_robot(Path("arm.toml"), text), {}), 9, np.random.default_rng(2)
    )
    for style in ("tool", "gauges"):
        plan, _ = draw_plan(where, np.random.default_rng(3), style, poses=4)
        sizes = np.abs([wrench for _, wrench in plan.loads]).max(axis=0)
        assert (sizes[:3] > 1).all()
        assert (sizes < 1e4).all()


def test_drives_are_ideal_by_default():
    drives = [joint.drive for joint in SOUND.joints.values() if joint.drive]
    assert [d.stiffness for d in drives] == [DRIVE] * 3
    assert not any(d.offset or d.pitch for d in drives)
    assert not SOUND.slots

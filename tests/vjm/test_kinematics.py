"""Loop closure, branches and ranges of any mechanism."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.reader import read_robot
from stiffscope.vjm.kinematics.closure import Closure
from stiffscope.vjm.kinematics.configurations import configure, configure_drives
from stiffscope.vjm.kinematics.linkage import Linkage, left_jacobian, rotation_vector
from stiffscope.vjm.model.bodies import Body, member
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from stiffscope.vjm.model.screws import rotation_of
from stiffscope.vjm.statics.analysis import compliance, stiffness
from tests.robots import GEOMETRY, random_poses, reachable, slides
from tests.vjm import oracle
from tests.vjm.files import biglide, read, serial_arm

SPANS = {
    "stewart": [0.006, 0.006, 0.006, 0.06, 0.06, 0.06],
    "linear-delta": [0.1, 0.1, 0.06],
    "braced-gantry": [0.3],
    "biglide": [0.03, 0.2, 0.06],
    "serial arm": [0.05, 0.05, 0.05, 0.3, 0.3, 0.3],
}


def mechanism(name):
    return {"biglide": biglide, "serial arm": serial_arm}.get(
        name, lambda: read(name)
    )()


@pytest.mark.parametrize("name", SPANS)
def test_forward_kinematics_undoes_inverse(name, rng):
    m = mechanism(name)
    poses = m.tool.home + rng.uniform(-1.0, 1.0, (40, len(m.tool.home))) * SPANS[name]
    found = configure(m, poses).require_valid()
    back = configure_drives(m, found.drives).require_valid()
    assert np.allclose(back.poses, poses, rtol=0.0, atol=1e-10)
    for j in m.joints:
        theirs = found.coordinates(j.name)
        gap = (back.coordinates(j.name) - theirs + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(gap).max(initial=0.0) < 1e-8, j.name


@pytest.mark.parametrize("name", SPANS)
def test_every_joint_holds_to_rounding(name, rng):
    """Errors of all joints by the oracle's own equations, overconstrained loops included."""
    m = mechanism(name)
    pose = m.tool.home + rng.uniform(-1.0, 1.0, len(m.tool.home)) * SPANS[name]
    found = configure(m, pose).require_valid()
    bodies = oracle.Bodies(m)
    for b in m.bodies:
        r, p = found.frame(b.nodes[0])
        if b.elastic is not None:
            r = r @ b.elastic.axes.T
            p = p - r[0] @ b.elastic.base
        k = bodies.index[b.name]
        bodies.rotation[k] = r[0]
        bodies.position[k] = p[0]
    assert np.abs(bodies.errors(pose)[1]).max() < 2e-12


def test_biglide_slides_as_its_closed_form_says(rng):
    m = biglide()
    poses = random_poses(rng, 2000)
    found = configure(m, poses).require_valid()
    moved = slides(GEOMETRY, poses) - slides(GEOMETRY, m.tool.home)
    stage, left, right = found.drives.T
    assert np.allclose(
        np.column_stack([-left, right, stage]), moved, rtol=0.0, atol=1e-11
    )


@pytest.mark.extended
def test_out_of_reach_is_told_and_never_taken(rng):
    """A box far beyond the workspace: the same poses are valid that the closed form reaches."""
    m = biglide()
    box = rng.uniform([-0.3, -0.3, 0.1], [0.3, 0.3, 0.7], (4000, 3))
    found = configure(m, box)
    assert (found.valid == reachable(GEOMETRY, box)).all()
    assert np.isnan(stiffness(m, box[~found.valid][:20])).all()
    reasons = {
        found.reason(int(i)).split(":")[0] for i in np.flatnonzero(~found.valid)[::40]
    }
    assert {
        "out of reach",
        'joints."limb1.actuator"',
        'joints."limb2.actuator"',
    } <= reasons
    assert not found.reason(int(np.flatnonzero(found.valid)[0]))


def test_a_drive_outside_its_range_is_named():
    with pytest.raises(
        InputError,
        match=r'pose 1 .*joints\."limb2.actuator": 0.1\d* m is outside its range .* m',
    ):
        configure(biglide(), [[0.0, 0.0, 0.35], [0.17, 0.0, 0.35]]).require_valid()


def test_a_loop_that_does_not_close_is_named():
    with pytest.raises(
        InputError,
        match=r"pose 0 \(x = 0, y = 0, z = 0.9\): out of reach: the loop through joints",
    ):
        configure(biglide(), [0.0, 0.0, 0.9]).require_valid()


def test_an_open_arm_says_how_far_its_tool_gets():
    """A planar 2R on the way from (0.3, 0.2) to (3, 0.2): where a circle of both lengths crosses y = 0.2."""
    joints = (
        Joint(
            "shoulder",
            "ground",
            "upper",
            "revolute",
            [0, 0, 0],
            [0, 0, 1],
            drive=Drive(1e4),
        ),
        Joint(
            "elbow",
            "upper",
            "fore",
            "revolute",
            [0.3, 0, 0],
            [0, 0, 1],
            drive=Drive(1e4),
        ),
    )
    arm = Mechanism(
        (Body("upper"), Body("fore")), joints, Tool("fore", [0.3, 0.2, 0], ("x", "y"))
    )
    farthest = np.sqrt(0.5**2 - 0.2**2)
    said = re.fullmatch(
        r"out of reach: .* than x = ([\d.]+) m, y = 0.2 m",
        configure(arm, [[3, 0.2]]).reason(0),
    )
    assert said
    assert farthest - 2 * 2.7 / 8192 < float(said[1]) < farthest + 1e-4


def five_bar(sign=1.0):
    """A planar five-bar, rigid, its elbows out."""
    a = np.array([0.1, 0, 0])
    b = np.array([0.25, 0.3, 0])
    tip = np.array([0.0, 0.7, 0])
    z = [0.0, 0, 1]
    flip = np.array([-1.0, 1, 1])
    joints = [
        Joint(
            "left.motor",
            "ground",
            "left.crank",
            "revolute",
            a * flip,
            z,
            drive=Drive(1e4),
        ),
        Joint(
            "right.motor", "ground", "right.crank", "revolute", a, z, drive=Drive(1e4)
        ),
        Joint("left.elbow", "left.crank", "left.arm", "revolute", b * flip, z),
        Joint("right.elbow", "right.crank", "right.arm", "revolute", b, z),
        Joint("wrist", "left.arm", "right.arm", "revolute", tip, z),
    ]
    names = ("left.crank", "right.crank", "left.arm", "right.arm")
    return Mechanism(
        tuple(Body(n) for n in names), tuple(joints), Tool("left.arm", tip, ("x", "y"))
    )


def test_five_bar_reaches_what_its_circles_allow(rng):
    m = five_bar()
    poses = np.column_stack(
        [rng.uniform(-0.6, 0.6, 3000), rng.uniform(0.05, 0.9, 3000)]
    )
    found = configure(m, poses)
    crank = np.hypot(0.15, 0.3)
    arm = np.hypot(0.25, 0.4)
    far = [np.hypot(poses[:, 0] - s * 0.1, poses[:, 1]) for s in (1, -1)]
    inside = np.all([(d < crank + arm) & (d > abs(arm - crank)) for d in far], axis=0)
    assert (found.valid <= inside).all()
    assert (
        found.valid.mean() > 0.8 * inside.mean()
    )  # the rest lies beyond a singular pose
    elbow = found.coordinates("right.elbow")[found.valid, 0]
    start = np.arctan2(0.4, -0.25) - np.arctan2(0.3, 0.15)
    assert (np.sin(start + elbow) > 0.0).all()  # always the branch of home


def test_a_bennett_linkage_moves_though_counting_says_it_cannot():
    """Four skew revolutes (a : sin α equal): mobility 1, three of six closure equations redundant."""
    alpha = np.radians(40.0)
    beta = np.radians(70.0)
    a = 0.3
    b = a * np.sin(beta) / np.sin(alpha)
    theta = np.radians(80.0)
    ratio = np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2)
    phi = 2 * np.arctan(ratio / np.tan(theta / 2))

    def link(turn, length, twist):
        c = np.cos(turn)
        s = np.sin(turn)
        ca = np.cos(twist)
        sa = np.sin(twist)
        return np.array(
            [
                [c, -s * ca, s * sa, length * c],
                [s, c * ca, -c * sa, length * s],
                [0, sa, ca, 0],
                [0, 0, 0, 1.0],
            ]
        )

    turns = (theta, phi, -theta, -phi)
    steps = [
        link(t, n, w)
        for t, n, w in zip(turns, (a, b, a, b), (alpha, beta, alpha, beta), strict=True)
    ]
    assert np.abs(np.linalg.multi_dot(steps) - np.eye(4)).max() < 1e-12
    frames = [np.eye(4)]
    for step in steps[:3]:
        frames.append(frames[-1] @ step)
    names = ("ground", "one", "two", "three")
    joints = [
        Joint(
            f"j{k}",
            names[k - 1],
            names[k],
            "revolute",
            frames[k][:3, 3],
            frames[k][:3, 2],
        )
        for k in range(1, 4)
    ]
    joints.append(
        Joint("j0", "three", "ground", "revolute", frames[0][:3, 3], frames[0][:3, 2])
    )
    joints[0] = replace(joints[0], drive=Drive(1e4))
    m = Mechanism(
        tuple(Body(n) for n in names[1:]),
        tuple(joints),
        Tool("one", frames[1][:3, 3], ("rx",)),
    )
    linkage = Linkage(m, "drives")
    closure = Closure(linkage, np.zeros(linkage.size))
    assert closure.redundant == 3
    found = configure_drives(m, np.linspace(-0.3, 0.3, 7)[:, None]).require_valid()
    assert np.ptp(found.coordinates("j2")) > 0.3


def test_a_redundant_arm_takes_the_pose_with_what_it_needs():
    """Seven revolutes, six coordinates: one joint stays at home."""
    m = serial_arm()
    extra = Joint(
        "wrist",
        "link6.tip",
        "hand",
        "revolute",
        [0.9, 0.05, 1.15],
        [0.3, 1, 0.2],
        drive=Drive(1e5),
    )
    tool = Tool("hand", np.array([0.95, 0.05, 1.1]), m.tool.pose)
    m = Mechanism((*m.bodies, Body("hand")), (*m.joints, extra), tool, m.gravity)
    pose = m.tool.home + np.array([0.02, 0.03, -0.02, 0.1, 0.0, 0.1])
    found = configure(m, pose).require_valid()
    assert np.allclose(found.tool[0], pose, atol=1e-11)
    assert np.sum(np.abs(found.drives[0]) < 1e-12) == 1


@pytest.mark.parametrize("elbow", [20.0, 6.0, 3.0])
def test_an_arm_reaches_to_where_it_is_all_but_straight(elbow):
    """Where it is straight two branches meet: the closer to that, the shorter the steps. At home it is bent by 60°."""
    upper = 0.325
    fore = 0.275
    bent = np.radians([60.0, elbow])
    corner = np.array([upper, 0, 0])
    point = np.array([upper + fore * np.cos(bent[0]), fore * np.sin(bent[0]), 0])
    ends = (("ground", "upper", np.zeros(3)), ("upper", "fore", corner))
    joints = [
        Joint(f"to {b}", a, b, "revolute", at, np.array([0.0, 0, 1]), drive=Drive(1e5))
        for a, b, at in ends
    ]
    m = Mechanism(
        (Body("upper"), Body("fore")),
        tuple(joints),
        Tool("fore", point, ("x", "y")),
        np.zeros(3),
    )
    far = np.sqrt(upper**2 + fore**2 + 2 * upper * fore * np.cos(bent[1]))
    towards = [np.arctan2(fore * np.sin(b), upper + fore * np.cos(b)) for b in bent]
    for turned in np.linspace(-0.6, 0.6, 7):
        found = configure(
            m, [far * np.cos(towards[0] + turned), far * np.sin(towards[0] + turned)]
        ).require_valid()
        expected = [towards[0] + turned - towards[1], bent[1] - bent[0]]
        np.testing.assert_allclose(found.drives[0], expected, atol=1e-9)


def test_a_pose_that_the_mechanism_cannot_command_is_refused():
    m = five_bar()
    with pytest.raises(
        InputError, match=r"tool\.pose: expected coordinates .* at home, got z"
    ):
        configure(replace(m, tool=Tool("left.arm", m.tool.at, ("x", "z"))), [0.0, 0.0])


def test_a_loop_of_drives_alone_holds_the_tool_and_takes_no_positions():
    z = [0, 0, 1]
    at = np.array([0.3, 0, 0])
    driven = Drive(1e4)
    joints = (
        Joint("rail", "ground", "base", "prismatic", at, z, drive=driven),
        Joint("shoulder", "base", "upper", "revolute", 0 * at, z, drive=driven),
        Joint("elbow", "upper", "fore", "revolute", at, z, drive=driven),
        Joint("brace", "base", "fore", "fixed", at),
    )
    m = Mechanism(
        tuple(map(Body, ("base", "upper", "fore"))),
        joints,
        Tool("fore", 2 * at, ("x", "z")),
    )
    with pytest.raises(
        InputError,
        match=r"tool\.pose: expected coordinates .* at home, got x, held there",
    ):
        configure(m, [0.0, 0.0])
    with pytest.raises(
        InputError, match=r"joints\.elbow: expected a passive joint in its drive's loop"
    ):
        configure_drives(m, np.zeros((1, 3)))


def test_a_drive_beside_a_welded_member_shares_its_load():
    leaf = member(
        "leaf", [0, 0, 0], [0.2, 0, 0], np.diag([1e-8, 1e-5, 1e-5, 1e-3, 1e-3, 1e-3])
    )
    joints = [
        Joint("foot", "ground", "leaf.base", "fixed", [0, 0, 0]),
        Joint("head", "leaf.tip", "stage", "fixed", [0.2, 0, 0]),
        Joint(
            "piezo",
            "ground",
            "stage",
            "prismatic",
            [0, 0, 0],
            [1, 0, 0],
            drive=Drive(5e7),
        ),
        Joint(
            "turn", "stage", "arm", "revolute", [0.2, 0, 0], [0, 0, 1], drive=Drive(1e4)
        ),
    ]
    arm = Mechanism(
        (leaf, Body("stage"), Body("arm")),
        tuple(joints),
        Tool("arm", [0.3, 0, 0], ("rz",)),
    )
    soft = compliance(arm, [[0.0], [0.5]])
    assert np.allclose(
        configure_drives(arm, [[0.0, 0.5]]).tool, configure(arm, [[0.5]]).tool
    )
    with pytest.raises(
        InputError, match=r"joints\.piezo: expected a passive joint in its drive's loop"
    ):
        configure_drives(arm, [[1e-6, 0.5]])
    assert np.allclose(
        soft[:, 0, 0] - 0.01 * np.sin([0.0, 0.5]) ** 2 / 1e4, 1.0 / (1e8 + 5e7)
    )
    welded = replace(
        arm,
        bodies=arm.bodies[:2],
        joints=arm.joints[:3],
        tool=Tool("stage", [0.2, 0, 0], ("x",)),
    )
    assert compliance(welded, [[0.2]])[0, 0, 0] == pytest.approx(1.0 / (1e8 + 5e7))
    with pytest.raises(InputError, match="joints: expected one that can move"):
        configure_drives(welded, [[0.0]])


def test_coordinates_need_not_fit_a_polynomial(rng):
    """Many poses start from a fit, few from home: the same configurations."""
    m = read("linear-delta")
    poses = m.tool.home + rng.uniform(-1.0, 1.0, (3000, 3)) * SPANS["linear-delta"]
    many = configure(m, poses).require_valid()
    few = configure(m, poses[::50]).require_valid()
    assert np.allclose(many.drives[::50], few.drives, rtol=0.0, atol=1e-12)


def test_rotation_vectors_and_their_rates(rng):
    r = rng.normal(size=(50, 3))
    d = 1e-6 * rng.normal(size=(50, 3))
    change = rotation_of(r + d) @ np.swapaxes(rotation_of(r - d), -1, -2)
    assert np.allclose(
        rotation_vector(change),
        2.0 * (left_jacobian(r) @ d[..., None])[..., 0],
        atol=1e-12,
    )
    half = rotation_of(np.pi * np.array([[0.6, 0.0, 0.8]]))
    assert np.allclose(
        np.abs(rotation_vector(half)), np.pi * np.array([[0.6, 0.0, 0.8]]), atol=1e-6
    )


def test_shapes_and_finiteness():
    with pytest.raises(InputError, match=r"poses: expected \(n, 3\) numbers x, y, z"):
        configure(biglide(), [0.0, 1.0])
    with pytest.raises(InputError, match="poses: row 0: expected finite numbers"):
        configure(biglide(), [0.0, 1.0, np.nan])


RING = """
name = "ring"
[bodies."leg1.crank"]
[bodies."leg1.rod"]
[bodies.platform]
[joints."leg1.motor"]
between = ["{ground}", "leg1.crank"]
type = "revolute"
at = [0.3, 0, 0.1]
axis = [0, 0, 1]
drive = {{ stiffness = 3e4 }}
[joints."leg1.elbow"]
between = ["leg1.crank", "leg1.rod"]
type = "revolute"
at = [0.20909090909090905, 0.17814470856604933, 0.1]
axis = [0, 0, 1]
[joints."leg1.wrist"]
between = ["leg1.rod", "platform"]
type = "revolute"
at = [0.08, 0, 0.1]
axis = [0, 0, 1]
[[copies]]
of = "leg1"
as = ["leg2", "leg3"]
angles = ["120 deg", "240 deg"]
axis = [0, 0, 1]
[tool]
body = "platform"
at = [0, 0, 0.1]
pose = ["x", "y", "rz"]
"""
TABLE = """
[bodies.table]
[joints.turn]
between = ["ground", "table"]
type = "revolute"
at = [0, 0, 0]
axis = [0, 0, 1]
drive = { stiffness = 2e5 }
"""


def test_a_table_that_stays_at_home_lets_no_robot_pass_a_singular_pose():
    """A drive more than coordinates: what the others reach without passing a singular pose is what they reach alone."""
    alone = mechanism_of(
        read_robot(Path("ring.toml"), RING.format(ground="ground")), {}
    )
    turned = mechanism_of(
        read_robot(Path("ring.toml"), RING.format(ground="table") + TABLE), {}
    )
    poses = np.array(
        [[x, 0.0, rz] for x in (0.0, 0.02) for rz in np.linspace(-1.5, 1.5, 13)]
    )
    expected = configure(alone, poses).valid
    assert 0.2 < expected.mean() < 0.9
    assert (configure(turned, poses).valid == expected).all()

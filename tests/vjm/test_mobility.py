"""Textbook mechanisms: their mobility is known, and Grübler's count is off by their redundant constraints."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq

from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.kinematics.mobility import mobility
from stiffscope.vjm.kinematics.reach import reach
from stiffscope.vjm.model.bodies import Body
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from tests.vjm.files import biglide, read

X, Y, Z = np.eye(3)


def chain(names, joints, tool, pose, at, more=()):
    """A closed chain ground - names… - ground with joints (kind, at, axis), the first one driven, and more joints."""
    nodes = ["ground", *names, "ground"]
    made = [
        Joint(
            f"j{k}",
            a,
            b,
            kind,
            np.array(p, float),
            np.array(axis, float),
            drive=Drive(1e6) if k == 0 else None,
        )
        for k, ((a, b), (kind, p, axis)) in enumerate(
            zip(pairwise(nodes), joints, strict=True)
        )
    ]
    return Mechanism(
        tuple(map(Body, names)), (*made, *more), Tool(tool, np.array(at, float), pose)
    )


def four_bar(*more):
    points = ([0, 0, 0], [0.1, 0.3, 0], [0.5, 0.4, 0], [0.6, 0, 0])
    return chain(
        ["crank", "coupler", "rocker"],
        [("revolute", p, Z) for p in points],
        "coupler",
        ("x",),
        points[2],
        more,
    )


def bennett():
    """A skew quadrilateral with half-turn symmetry; at each corner the hinge is square to both sides."""
    p = np.array([[0.3, 0, 0], [0.1, 0.2, 0.15], [-0.3, 0, 0], [-0.1, -0.2, 0.15]])
    axes = [np.cross(p[k] - p[k - 1], p[(k + 1) % 4] - p[k]) for k in range(4)]
    return chain(
        list("abc"),
        [("revolute", *each) for each in zip(p, axes, strict=True)],
        "b",
        ("x",),
        p[2],
    )


def sarrus():
    """Two hinged pairs of plates, square to each other, guide the top straight up."""
    x_side = [
        ("revolute", [0.2, 0, 0], Y),
        ("revolute", [0.35, 0, 0.2], Y),
        ("revolute", [0.2, 0, 0.4], Y),
    ]
    y_side = [
        ("revolute", [0, 0.2, 0.4], X),
        ("revolute", [0, 0.35, 0.2], X),
        ("revolute", [0, 0.2, 0], X),
    ]
    return chain(
        ["x1", "x2", "top", "y2", "y1"], x_side + y_side, "top", ("z",), [0, 0, 0.4]
    )


def parallelogram(bars):
    """Equal parallel bars from the ground to a coupler; each bar beyond two is one more than needed."""
    bodies = [Body("coupler"), *(Body(f"bar{k}") for k in range(bars))]
    joints = []
    for k in range(bars):
        foot = np.array([0.2 * k, 0, 0.01 * k**2])
        drive = Drive(1e6) if k == 0 else None
        joints += [
            Joint(f"a{k}", "ground", f"bar{k}", "revolute", foot, Z, drive=drive),
            Joint(f"b{k}", f"bar{k}", "coupler", "revolute", foot + 0.3 * Y, Z),
        ]
    return Mechanism(tuple(bodies), tuple(joints), Tool("coupler", 0.3 * Y, ("x",)))


def hexapod(head="spherical"):
    """Six legs, spherical - prismatic - spherical (or universal) joints."""
    bodies = [Body("platform")]
    joints = []
    for k in range(6):
        a, b = np.radians(
            [60 * (k // 2 * 2) + 50 * (k % 2), 60 * (k // 2 * 2) - 30 + 110 * (k % 2)]
        )
        foot = np.array([0.5 * np.cos(a), 0.5 * np.sin(a), 0])
        top = np.array([0.3 * np.cos(b), 0.3 * np.sin(b), 0.6])
        along = (top - foot) / np.linalg.norm(top - foot)
        side = np.cross(along, Z)
        axes = (side, np.cross(along, side)) if head == "universal" else (None, None)
        bodies += [Body(f"leg{k}.lower"), Body(f"leg{k}.upper")]
        joints += [
            Joint(f"leg{k}.foot", "ground", f"leg{k}.lower", "spherical", foot),
            Joint(
                f"leg{k}.drive",
                f"leg{k}.lower",
                f"leg{k}.upper",
                "prismatic",
                0.5 * (foot + top),
                along,
                drive=Drive(1e7),
            ),
            Joint(f"leg{k}.head", f"leg{k}.upper", "platform", head, top, *axes),
        ]
    return Mechanism(
        tuple(bodies),
        tuple(joints),
        Tool("platform", 0.6 * Z, ("x", "y", "z", "rx", "ry", "rz")),
    )


@pytest.mark.parametrize(
    ("mechanism", "count", "dof", "tool", "idle"),
    [
        (four_bar(), -2, 1, 1, 0),
        (bennett(), -2, 1, 1, 0),
        (sarrus(), 0, 1, 1, 0),
        (parallelogram(2), -2, 1, 1, 0),
        (parallelogram(3), -6, 1, 1, 0),
        (parallelogram(4), -10, 1, 1, 0),
        (hexapod(), 12, 12, 6, 6),
        (hexapod("universal"), 6, 6, 6, 0),
        (biglide(), -15, 3, 3, 0),
        (read("stewart"), 6, 6, 6, 0),
        (read("linear-delta"), -3, 3, 3, 0),
        (read("braced-gantry"), -2, 3, 1, 2),
    ],
    ids=lambda each: "" if isinstance(each, Mechanism) else None,
)
def test_textbook_count(mechanism, count, dof, tool, idle):
    found = mobility(mechanism)
    assert (found.count, found.dof, len(found.tool), found.idle_count) == (
        count,
        dof,
        tool,
        idle,
    )
    assert found.redundant == dof - count
    assert not found.loose
    assert found.redundant_drives == 0
    assert found.rounding < 1e-14


def test_same_count_at_another_pose():
    mechanism = read("linear-delta")
    there = configure(mechanism, mechanism.tool.home + np.array([0.04, -0.03, 0.05]))
    found = mobility(mechanism, there)
    assert (found.dof, found.redundant, found.idle_count) == (3, 6, 0)
    (one,) = found.redundancies[0].directions
    assert one.kind == "rotation"
    top = mechanism.joint("leg1.rod1.top")
    turn = (
        there.frame("leg1.rod1.base")[0][0] @ mechanism.body("leg1.rod1").elastic.axes.T
    )
    square = np.cross(
        top.axis, turn @ top.axis2
    )  # its four universal joints turn about two directions only
    assert abs(one.axis @ square) / np.linalg.norm(square) == pytest.approx(
        1.0, abs=1e-9
    )


def test_names_of_redundant_constraints():
    (one,) = mobility(four_bar()).redundancies
    assert set(one.bodies) == {"ground", "crank", "coupler", "rocker"}
    assert set(one.joints) == {"j0", "j1", "j2", "j3"}
    assert {str(each) for each in one.directions} == {
        "translation along z",
        "rotation about x",
        "rotation about y",
    }
    assert str(one).startswith("the loop through ")
    assert " has 3 redundant constraints: " in str(one)


def test_bar_too_many_is_shared_by_loops():
    shared = [r for r in mobility(parallelogram(3)).redundancies if r.loops > 1]
    assert [(r.loops, r.count) for r in shared] == [(2, 1)]
    assert set(shared[0].bodies) == {"ground", "bar0", "bar1", "bar2", "coupler"}


def test_names_of_idle_motions():
    found = mobility(hexapod())
    assert (
        sorted(map(str, found.idle))[0]
        == "leg0.lower and leg0.upper spin between leg0.foot and leg0.head"
    )
    gantry = {str(each) for each in mobility(read("braced-gantry")).idle}
    assert gantry == {
        "tie spins between tie.a and tie.b",
        "h3 spins between h3.a and h3.b",
    }


def test_coordinates_of_the_tool():
    assert mobility(sarrus()).coordinates == dict.fromkeys(
        ["x", "y", "rx", "ry", "rz"], "held"
    ) | {"z": "commanded"}
    four = mobility(four_bar()).coordinates
    assert four == {
        "x": "commanded",
        "y": "follows",
        "z": "held",
        "rx": "held",
        "ry": "held",
        "rz": "follows",
    }
    stuck = chain(
        ["a", "b"],
        [("revolute", p, Z) for p in ([0, 0, 0], [1, 0, 0], [0, 1, 0])],
        "a",
        ("x",),
        [1, 0, 0],
    )
    found = mobility(stuck)
    assert (found.dof, found.coordinates["x"], found.tool) == (0, "locked", ())
    assert (found.redundant_drives, found.dependent_drives) == (1, ("j0",))


def test_tool_that_lacks_drives_and_one_that_has_too_many():
    points = ([0, 0, 0], [0.1, 0.3, 0], [0.4, 0.5, 0], [0.7, 0.3, 0], [0.8, 0, 0])
    five = chain(
        list("abcd"), [("revolute", p, Z) for p in points], "b", ("x", "y"), points[2]
    )
    found = mobility(five)
    assert (found.dof, len(found.loose), found.conditioning) == (2, 1, None)
    bar = four_bar()
    both = tuple(
        replace(j, drive=Drive(1e6)) if j.name == "j3" else j for j in bar.joints
    )
    twice = mobility(replace(bar, joints=both))
    assert (twice.dof, twice.redundant_drives, twice.dependent_drives) == (
        1,
        1,
        ("j0", "j3"),
    )


def arm(elbow):
    """Two bars of 1 m, each with a drive; the elbow's angle in rad from straight."""
    knee = X
    tip = knee + np.cos(elbow) * X + np.sin(elbow) * Y
    joints = (
        Joint(
            "a",
            "ground",
            "upper",
            "revolute",
            np.zeros(3),
            Z,
            drive=Drive(1e3, -1.0, 1.0),
        ),
        Joint("b", "upper", "fore", "revolute", knee, Z, drive=Drive(1e3)),
    )
    return Mechanism(
        (Body("upper"), Body("fore")), joints, Tool("fore", tip, ("x", "y"))
    )


def test_singular_and_nearly_singular():
    """Yoshikawa's two-bar arm: singular where straight; the condition number of its Jacobian by hand elsewhere."""
    assert mobility(arm(0.0)).conditioning == 0.0
    for elbow in (1e-3, 0.7, np.pi / 2):
        c = np.cos(elbow)
        s = np.sin(elbow)
        values = np.linalg.svd(np.array([[-s, -s], [1 + c, c]]), compute_uv=False)
        assert mobility(arm(elbow)).conditioning == pytest.approx(
            values[1] / values[0], rel=1e-9
        )


def test_straight_four_bar_has_a_motion_more():
    """A parallelogram flattened to a line: there it can turn into its crossed branch too."""
    points = ([0, 0, 0], [0.3, 0, 0], [0.8, 0, 0], [0.5, 0, 0])
    flat = chain(
        list("abc"), [("revolute", p, Z) for p in points], "b", ("y",), points[1]
    )
    assert mobility(flat).dof == 2


def test_reach_of_a_two_bar_arm():
    """M = (1, 1), elbow at a right angle: straight at x = √3, where x² + 1 = 2²; shoulder at -1 rad below."""
    x, y = reach(arm(np.pi / 2))
    assert x.high == pytest.approx(np.sqrt(3), abs=2e-3)
    assert x.at_high == "out of reach or singular"
    shoulder = brentq(
        lambda at: np.arctan2(at, 1) - np.arccos(np.hypot(1, at) / 2) + 1, -1.5, 0.9
    )
    assert y.low == pytest.approx(shoulder, abs=1e-5)
    assert y.at_low == "a at the end of its range"


def test_reach_is_endless_along_a_free_slide():
    x, y, z = reach(biglide())
    assert (y.at_low, y.at_high) == ("", "")
    assert x.high == -x.low
    assert "actuator" in z.at_low

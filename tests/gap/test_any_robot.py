"""Whole diagnoses of robots that the first format did not know: what was planted is named, with its size."""

import re
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from stiffscope.data import FOLDER
from stiffscope.gap.campaign.campaign import Campaign
from stiffscope.gap.campaign.quantities import DEVIATION
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.campaigns import diagnose
from stiffscope.gap.diagnose import conclude, diagnose_campaign
from stiffscope.gap.effects.vocabulary import apply_effect
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.inference.diagnosis import to_json
from stiffscope.gap.inference.find import find
from stiffscope.gap.inference.residuals import by_sensor
from stiffscope.gap.show.text import sentence
from stiffscope.lab.faults import inject
from stiffscope.lab.measuring import Noise, Plan, Sensor
from stiffscope.lab.measuring import measure as taken
from stiffscope.lab.response import Spot
from stiffscope.vjm.statics.analysis import compliance
from tests.benchmarks.second_lab import campaign_of
from tests.gap.test_robot_model import nominal, readings
from tests.labs import machine

pytestmark = pytest.mark.slow

SHARED = Path(__file__).parents[1] / "vjm" / "robots"


def resized(robot, length, stiffness):
    """A robot so many times as large, and as stiff in N/m."""
    twist = np.repeat([1.0, 1.0 / length], 3)
    m = robot.mechanism

    def soft(c):
        return None if c is None else c * np.outer(twist, twist) / stiffness

    def drive(joint):
        turns = length**2 if joint.kind == "revolute" else 1.0
        return joint.drive and replace(
            joint.drive, stiffness=joint.drive.stiffness * stiffness * turns
        )

    weight = length * stiffness  # weighs as much more as it deflects in proportion

    def move(dynamics):
        twists = np.ones(len(dynamics.mass))  # of own modes, of a modal mass of one
        twists[:12] = np.sqrt(weight) * np.tile(np.repeat([1.0, length], 3), 2)
        mass = dynamics.mass * np.outer(twists, twists)
        squares = dynamics.squares * stiffness / weight
        return replace(dynamics, mass=mass, squares=squares)

    def yielding(e):
        more = {
            "dynamics": e.dynamics and move(e.dynamics),
            "compliance": soft(e.compliance),
        }
        return replace(e, places=length * e.places, **more)

    bodies = tuple(
        replace(
            b,
            mass=weight * b.mass,
            centre=None if b.centre is None else length * b.centre,
            inertia=None if b.inertia is None else weight * length**2 * b.inertia,
            elastic=b.elastic and yielding(b.elastic),
        )
        for b in m.bodies
    )
    joints = tuple(
        replace(j, at=length * j.at, compliance=soft(j.compliance), drive=drive(j))
        for j in m.joints
    )
    mechanism = replace(
        m, bodies=bodies, joints=joints, tool=replace(m.tool, at=length * m.tool.at)
    )
    return replace(robot, mechanism=mechanism)


@pytest.mark.extended_for("1-3", "3-1", "5-1", "0-1", "6-1")
@pytest.mark.parametrize(("number", "seed"), [(0, 1), (1, 3), (3, 1), (5, 1), (6, 1)])
def test_a_robot_of_another_size_and_stiffness_gets_the_same_answer(number, seed):
    """Loads, readings and noise in proportion: no effect has a favourite size."""
    campaign, planted, robot = campaign_of("five-bar", number, seed)
    answers = []
    for length, stiffness in ((1.0, 1.0), (4.0, 1e3), (0.3, 1e-3)):
        c = replace(
            campaign,
            poses=length * campaign.poses,
            wrench=campaign.wrench * length * stiffness * np.repeat([1.0, length], 3),
            value=campaign.value * np.where(campaign.direction < 3, length, 1.0),
            sigma=campaign.sigma * np.where(campaign.direction < 3, length, 1.0),
        )
        model = RobotModel(
            c, resized(robot, length, stiffness), without="part-dimension"
        )  # the file has its own size
        found = conclude(find(model))
        answers.append(
            (
                found.verdict,
                {f"{e.effect} @ {e.place}": e.probability for e in found.effects},
            )
        )
    for verdict, named in answers[1:]:
        assert (verdict, named) == (
            answers[0][0],
            pytest.approx(answers[0][1], abs=0.1),
        )
    assert answers[0][0] == ("identified" if planted.name else "no-gap")


def sagged(robot, true, noise=5e-6, middle=None, spread=(0.1, 0.4)):
    """Deviations of a robot under its own weight at some postures, with noise in m and rad."""
    rng = np.random.default_rng(5)
    middle = (
        np.array(list(robot.robot.poses.values())).mean(axis=0)
        if middle is None
        else middle
    )
    poses = middle + rng.uniform(-1, 1, (16, 6)) * np.repeat(spread, 3)
    pose, direction = np.divmod(np.arange(6 * len(poses)), 6)
    n = len(pose)
    c = Campaign(
        robot.robot.name,
        ("gravity",),
        "beam",
        tuple(map(str, range(len(poses)))),
        poses,
        pose,
        np.zeros((n, 6)),
        6 * DEVIATION + direction,
        np.zeros(n),
        np.full(n, noise),
        ("",),
        np.zeros(n),
        ("readings.csv",),
        np.zeros(n),
        np.arange(2, n + 2),
        coordinates=robot.mechanism.tool.pose,
    )
    return replace(
        c, value=RobotModel(c, true).predict().values + noise * rng.standard_normal(n)
    )


@pytest.mark.extended
@pytest.mark.parametrize(
    ("effect", "place", "parameters"),
    [
        (
            "geometry",
            "robot",
            {
                "J1.zero": 2e-3,
                "J2.ry": -3e-3,
                "J3.z": 1e-3,
                "J5.rz": 4e-3,
                "J4.y": -8e-4,
                "J6.ry": 2e-3,
            },
        ),
        ("joint-axis", "J2", {"y": 6e-4, "z": -4e-4, "ry": 2e-3, "rz": 1e-3}),
        ("mass", "wrist2", {"factor": 2.5}),
        ("payload", "flange", {"mass": 4.0}),
    ],
)
def test_geometry_and_masses_have_no_favourite_size(effect, place, parameters):
    """The sag of a robot s times as large, k times as stiff and s k times as heavy: the same in proportion."""
    robot = nominal("serial-arm")
    c = sagged(robot, apply_effect(robot, effect, place, parameters))
    answers = []
    for length, stiffness in ((1.0, 1.0), (6.0, 300.0), (0.2, 1e-2)):
        scale = np.where(c.direction < 3, length, 1.0)
        poses = c.poses * np.repeat([length, 1.0], 3)
        model = RobotModel(
            replace(c, poses=poses, value=scale * c.value, sigma=scale * c.sigma),
            resized(robot, length, stiffness),
            without="part-dimension",
        )
        found = conclude(find(model))
        answers.append(
            (
                found.verdict,
                {f"{e.effect} @ {e.place}": e.probability for e in found.effects},
            )
        )
    assert answers[0][0] in {"identified", "ambiguous"}
    for answer in answers[1:]:
        assert answer == (answers[0][0], pytest.approx(answers[0][1], abs=0.1))


@pytest.mark.extended
def test_a_mass_that_no_reading_shows_leaves_its_effect_named():
    """On a strut hung in its fixed foot only moments about the foot show, and these are what is reported."""
    robot = nominal(SHARED / "stewart.toml")
    # within the strut's lower body, 75 by 72 by 78 mm with what may stand out of it
    true = {"mass": 1.3, "x": -0.036, "y": 0.034, "z": -0.037}
    loaded = apply_effect(robot, "payload", "strut6.lower", true)
    c = sagged(robot, loaded, 5e-7, robot.mechanism.tool.home, (0.03, 0.1))
    found = diagnose_campaign(c, robot)
    (effect,) = found.effects
    assert (found.verdict, effect.effect, effect.place) == (
        "identified",
        "payload",
        "strut6.lower",
    )
    # the payload's place counts from the middle between the body's joints
    joints = {j.name: np.array(j.at) for j in robot.mechanism.joints}
    middle = (joints["strut6.drive"] - joints["strut6.foot"]) / 2
    moments = true["mass"] * (middle + [true[axis] for axis in "xyz"])
    assert set(effect.parameters) == {"moment_x", "moment_y", "moment_z"}
    for axis, moment in zip("xyz", moments, strict=True):
        shown = effect.parameters[f"moment_{axis}"]
        (low, high) = shown.interval
        assert low < moment < high
        assert shown.sigma < 0.15 * np.linalg.norm(moments)
    for name, value in true.items():
        (low, high) = effect.errors[name].interval
        assert low < value < high


def measured(robot, true, quantities, spread, seed=1):
    rng = np.random.default_rng(seed)
    poses = (
        np.array(list(robot.robot.poses.values())).mean(axis=0)
        + rng.uniform(-1, 1, (8, len(spread))) * spread
    )
    c = readings(robot, quantities, poses)
    return replace(
        c,
        value=RobotModel(c, true).predict().values + 1e-6 * rng.standard_normal(len(c)),
    )


ARTICULATED = """
name = "arm"
[bodies.turret]
[bodies.upper]
[bodies.fore]
[joints.J1]
between = ["ground", "turret"]
type = "revolute"
at = [0, 0, 0.1]
axis = [0, 0, 1]
drive = { stiffness = 2e4 }
[joints.J2]
between = ["turret", "upper"]
type = "revolute"
at = [0, 0, 0.3]
axis = [0, 1, 0]
drive = { stiffness = 2.5e4 }
[joints.J3]
between = ["upper", "fore"]
type = "revolute"
at = [0.346410161514, 0, 0.1]
axis = [0, 1, 0]
drive = { stiffness = 8e3 }
[tool]
body = "fore"
at = [0.346410161514, 0, -0.2]
pose = ["x", "y", "z"]
"""


@pytest.mark.extended
def test_a_cause_is_reported_in_the_form_that_explains_alone(tmp_path):
    """A base that turns about x and y only is one that turns alike about all axes, beside a drive that is stiffer."""
    (tmp_path / "arm.toml").write_text(ARTICULATED)
    robot = nominal(tmp_path / "arm.toml")
    true = apply_effect(robot, "base-compliance", "base", {"rx": 2e-5, "ry": 2e-5})
    poses = [
        [0.346410161514, 0, -0.2],
        [0.45, 0.1, 0.0],
        [0.3, -0.2, 0.05],
        [0.5, 0.0, 0.2],
    ]
    rng = np.random.default_rng(1)
    lines = ["x,y,z,fx,fy,fz,quantity,value,sigma"]
    for pose, c in zip(poses, compliance(true.mechanism, poses), strict=True):
        for k, axis in product(range(3), range(3)):
            force = ["200" if i == k else "0" for i in range(3)]
            value = 200.0 * c[axis, k] + 2e-6 * rng.standard_normal()
            lines.append(
                ",".join(
                    [
                        *map(str, pose),
                        *force,
                        "d" + "xyz"[axis],
                        repr(float(value)),
                        "2e-6",
                    ]
                )
            )
    (tmp_path / "readings.csv").write_text("\n".join(lines))
    (tmp_path / "campaign.toml").write_text(
        'robot = "arm.toml"\nreadings = "readings.csv"\n'
    )
    found = diagnose(tmp_path)
    assert (found.verdict, [(e.effect, e.place) for e in found.effects]) == (
        "identified",
        [("base-compliance", "base")],
    )
    size = [found.effects[0].parameters[name].value for name in ("rx", "ry", "rz")]
    assert size == pytest.approx([2e-5, 2e-5, 0.0], abs=5e-7)


@pytest.mark.extended_for("five-bar-link-stiffness-right.outer-size1-spread1")
@pytest.mark.parametrize(
    ("name", "effect", "place", "size", "spread"),
    [
        (
            "delta",
            "actuator-stiffness",
            "leg2.motor",
            {"factor": 0.75},
            [0.25, 0.25, 0.12],
        ),
        ("five-bar", "link-stiffness", "right.outer", {"factor": 0.6}, [0.05, 0.03]),
    ],
)
def test_gauges_and_a_hook_name_a_soft_element(name, effect, place, size, spread):
    robot = nominal(name)
    c = measured(
        robot,
        apply_effect(robot, effect, place, size),
        ("dx", "dy", "dz", "ex"),
        spread,
    )
    found = diagnose_campaign(c, robot)
    assert found.verdict == "identified"
    (named,) = found.effects
    assert f"{effect} @ {place}" in {
        f"{named.effect} @ {named.place}",
        *named.confused_with,
    }
    (factor,) = named.parameters.values()
    assert abs(factor.value - size["factor"]) < 4.0 * factor.sigma
    assert max(found.where.component, key=found.where.component.get) == place
    shares = found.where.sensor
    residual = (c.value - RobotModel(c, robot).predict().values) / c.sigma
    assert shares == pytest.approx(by_sensor(c, residual))
    assert set(shares) == {"gauge", "level", "x", "y", "z"}
    assert found.where.left_by_sensor == {}
    assert sum(shares.values()) == pytest.approx(1.0)


@pytest.mark.extended
def test_the_gap_lies_where_its_cause_is_named():
    """A first drive that yields is also a base that turns about the same axis."""
    robot = nominal("serial-arm")
    true = apply_effect(robot, "actuator-stiffness", "J1", {"factor": 0.55})
    c = measured(robot, true, ("dx", "dy", "dz"), [0.05] * 6)
    found = diagnose_campaign(c.select(np.flatnonzero(c.sensor < 0)), robot)
    (named,) = found.effects
    assert "base-compliance @ base" in named.confused_with
    assert (
        max(found.where.component, key=found.where.component.get) == named.place == "J1"
    )


@pytest.mark.parametrize(
    ("name", "effect", "place", "size", "spread", "said"),
    [
        pytest.param(
            "stewart",
            "encoder-offset",
            "strut1.drive",
            {"offset": 2e-4},
            [0.05] * 3 + [0.1] * 3,
            r"Next: read (gauge_strut1_lower_tip_\w) .*; new here: \1 on strut1\.lower\.tip at .* mm\) along",
            marks=pytest.mark.extended,
        ),
        pytest.param(
            "delta",
            "thermal",
            "leg1.rod1",
            {"temperature": 30.0},
            [0.25, 0.25, 0.12],
            "Next: none of this campaign's instruments .* nor are gauges on platform, leg1",
            marks=pytest.mark.extended,
        ),
        (
            "five-bar",
            "link-stiffness",
            "right.outer",
            {"factor": 0.6},
            [0.05, 0.03],
            r"Next: no reading distinguishes link-stiffness @ \S+ and .*: names of the same change",
        ),
    ],
)
def test_the_headline_of_a_group_says_which_reading_would_tell_it_apart_if_any(
    name, effect, place, size, spread, said
):
    """Readings at the tool alone: where none of them helps, a gauge on another body may."""
    robot = nominal(name)
    c = measured(
        robot,
        apply_effect(robot, effect, place, size),
        ("dx", "ex", "ey", "ez", "erx", "ery"),
        spread,
    )
    found = diagnose_campaign(c.select(np.flatnonzero(c.sensor < 0)), robot)
    assert any(e.confused_with for e in found.effects)
    assert re.search(said, sentence(found))
    assert to_json(found)["why_no_next"] == found.why_no_next
    assert (found.next_measurement is None) == bool(found.why_no_next)


def test_the_campaign_that_the_documentation_works_through_is_the_lab_s():
    """Three gauges and weights on a hook, on a Delta whose second motor is soft."""
    true = inject(
        machine("delta"), "actuator-stiffness", "leg2.motor", {"factor": 0.72}
    )
    points = {
        "x": [0.06, 0.02, -1.054],
        "y": [-0.02, 0.06, -1.054],
        "z": [0.05, -0.03, -1.069],
    }
    gauges = (
        Sensor(
            f"gauge_{a}",
            "displacement",
            "platform",
            np.array(at),
            np.eye(3)["xyz".index(a)],
        )
        for a, at in points.items()
    )
    weights = [[0.0, 0.0, -49.0], [29.4, 0.0, 0.0], [0.0, 29.4, 0.0]]
    c = load_campaign(FOLDER / "campaigns" / "gauges")
    loads = tuple(("hook", np.array([*weight, 0.0, 0.0, 0.0])) for weight in weights)
    plan = Plan(
        c.poses,
        loads,
        {"hook": Spot("platform", np.array([0.0, 0.0, -1.124]))},
        tuple(gauges),
        False,
    )
    made = taken(true, plan, Noise(displacement=1e-6), np.random.default_rng(17))
    assert len(c) == len(made.value) == 108
    assert (
        np.abs(c.value - made.value).max() < 0.0501e-6
    )  # as read, to a tenth of a micrometre
    assert (c.sigma == 1e-6).all()

"""Readings of any robot and their derivatives, against equilibria of the robot re-assembled with the change."""

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.gap.campaign.campaign import Campaign, LoadPoint, Sensor
from stiffscope.gap.campaign.quantities import QUANTITIES
from stiffscope.gap.campaigns import open_case
from stiffscope.gap.effects.effect import (
    Candidate,
    Effect,
    Influence,
    Parameter,
    Payload,
    Setting,
)
from stiffscope.gap.effects.elements import ElementEffect, change_elements
from stiffscope.gap.effects.vocabulary import apply_effect, find_candidates
from stiffscope.gap.forward import robot_at_poses
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.forward.robot_prediction import Pattern
from stiffscope.gap.inference.fitting import Problem
from stiffscope.gap.inference.hypothesis import Hypothesis, bound_parameters
from stiffscope.gap.inference.plausibility import find_plausible, plausible
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot, Place
from stiffscope.robot.part_dimensions import beam_dimensions
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.kinematics.configurations import configure, configure_drives
from stiffscope.vjm.model.mechanism import Change
from stiffscope.vjm.network.network import place_nodes
from stiffscope.vjm.statics.analysis import compliance, stiffness
from stiffscope.vjm.statics.yielding import Load, respond
from stiffscope.vjm.vibration.modes import frequencies

pytestmark = pytest.mark.slow

LINEAR_DELTA = Path(__file__).parents[1] / "vjm" / "robots" / "linear-delta.toml"
ROBOTS = ("delta", "stewart", "serial-arm", "five-bar")
SENSED = {  # a body that moves, a body that carries it, a point on it
    "carried": ("fore", "upper", (2.02, 0.01, 0.03)),
    "delta": ("platform", "leg1.arm.tip", (0.03, 0.04, -1.0)),
    "stewart": ("platform", "strut1.upper.tip", (0.05, 0.02, 0.3)),
    "tripod": ("head.b", "head.c", (-0.1, 0.17, 0.5)),
    "five-bar": ("left.outer.tip", "right.inner.tip", (0.02, 0.4, 0.01)),
}


def nominal(name, *overrides):
    robot = load_robot(name, overrides)
    return NominalRobot(mechanism_of(robot, part_matrices(robot, "beam")), robot)


def sensed(robot):
    if robot.robot.name in SENSED:
        return SENSED[robot.robot.name]
    bodies = [body for body in robot.mechanism.bodies if body.elastic is not None]
    return (
        robot.mechanism.tool.body,
        f"{bodies[0].name}.tip",
        tuple(robot.mechanism.tool.at + np.array([0.02, 0.01, 0.03])),
    )


def readings(
    robot, quantities=("dx", "drz", "ex", "ery", "kz", "krx", "px", "prz"), poses=None
):
    """Quantities at M under a mixed wrench, a gauge against a moving body, an inclinometer, a hook."""
    body, foot, point = sensed(robot)
    sensors = (
        Sensor("gauge", body, (0.0, 0.6, 0.8), point, against=foot),
        Sensor("level", body, (0.6, 0.0, 0.8), measures="rotation"),
    )
    loads = (
        LoadPoint("hook", body, tuple(np.array(point) + np.array([0.0, 0.03, -0.02]))),
    )
    p = np.array(list(robot.robot.poses.values()) if poses is None else poses)
    rows = []
    for pose in range(len(p)):
        for name in quantities:
            load = {"d": [20.0, -30.0, 50.0, 1.0, 2.0, -1.5], "e": [0.0] * 6}.get(
                name[0], [np.nan] * 6
            )
            rows.append((pose, QUANTITIES.index(name), -1, -1, load))
        for sensor, axis in ((0, 2), (1, 5)):
            for hung, load in (
                (-1, [10.0, 0.0, -40.0, 0.0, 1.0, 0.0]),
                (0, [0.0, 15.0, -25.0, 0.0, 0.0, 0.0]),
            ):
                rows.append((pose, axis, sensor, hung, load))
            rows.append((pose, 6 + axis, sensor, -1, [0.0] * 6))
    pose, quantity, sensor, load, wrench = (
        np.array(column) for column in zip(*rows, strict=True)
    )
    n = len(rows)
    return Campaign(
        robot.robot.name,
        ("gravity",),
        "beam",
        tuple(str(k) for k in range(len(p))),
        p,
        pose,
        wrench,
        quantity,
        np.zeros(n),
        np.full(n, 1e-3),  # so large that first order is enough
        ("",),
        np.zeros(n),
        ("readings.csv",),
        np.zeros(n),
        np.arange(2, n + 2),
        coordinates=robot.mechanism.tool.pose,
        sensors=sensors,
        sensor=sensor,
        loads=loads,
        load=load,
    )


def motion(response, where, node, home, pose):
    """Displacement and rotation (6,) of a point of a body, from the twists at M of a response."""
    twist = response.nodes[node]
    twist = twist[min(pose, len(twist) - 1), :, 0]
    point = where.point(node, np.array(home))
    lever = (point - where.tool)[min(pose, len(point) - 1)]
    return np.concatenate([twist[:3] + np.cross(twist[3:], lever), twist[3:]])


def read(robot, mechanism, c):
    """Every reading (n,) by an equilibrium of its own."""
    found = configure(robot.mechanism, c.poses)
    where = place_nodes(found)
    matrix = stiffness(mechanism, found)
    out = np.zeros(len(c))
    for i in range(len(c)):
        pose = c.pose[i]
        kind = c.kind[i]
        axis = c.direction[i]
        if kind == 2:
            out[i] = matrix[pose, axis, axis]
            continue
        if kind == 3:
            out[i] = 1.0 / np.linalg.inv(matrix[pose])[axis, axis]
            continue
        loads = []
        wrench = c.wrench[i]
        if c.load[i] >= 0:
            load = c.loads[c.load[i]]
            loads = [Load(load.body, wrench, np.array(load.at))]
            wrench = np.zeros(6)
        dead = 1.0 if kind == 1 else 0.0
        response = respond(
            mechanism, found, wrench, loads=loads, gravity=dead, misfit=dead
        )
        if c.sensor[i] < 0:
            out[i] = response.twist[pose, axis, 0]
            continue
        sensor = c.sensors[c.sensor[i]]
        across = motion(response, where, sensor.body, sensor.at, pose)
        if sensor.against != "ground":
            point = where.point(sensor.body, np.array(sensor.at))[pose]
            foot = response.nodes[sensor.against]
            foot = foot[min(pose, len(foot) - 1), :, 0]
            across -= np.concatenate(
                [foot[:3] + np.cross(foot[3:], point - where.tool[pose]), foot[3:]]
            )
        half = across[3:] if sensor.rotates else across[:3]
        out[i] = half @ np.array(sensor.direction)
    return out


@pytest.mark.parametrize("name", ROBOTS)
def test_readings_are_those_of_separate_equilibria(name):
    robot = nominal(name)
    c = readings(robot)
    values = RobotModel(c, robot).predict().values
    assert values == pytest.approx(read(robot, robot.mechanism, c), rel=1e-8, abs=1e-15)


@pytest.mark.extended
@pytest.mark.extended_for("stewart", "delta")
@pytest.mark.parametrize("name", ROBOTS)
def test_derivatives_are_those_of_full_reassembly(name):
    """Every effect on stiffness, at a set and at a single element, one parameter of each."""
    robot = nominal(name)
    pose = next(iter(reversed(robot.robot.poses.values())))
    c = readings(robot, ("dx", "ey", "kz", "prx"), [pose])
    prediction = RobotModel(c, robot).predict()
    known = {}
    for each in find_candidates(RobotModel(c, robot).setting):
        known.setdefault(each.effect, []).append(each)
    candidates = [
        k[i]
        for k in known.values()
        for i in {0, len(k) - 1}
        if isinstance(k[i].action, ElementEffect) and not displaces(k[i])
    ]
    seen = 0
    for candidate in candidates:
        column = prediction.columns(candidate)
        k = len(candidate.scale) // 2
        step = np.zeros(len(candidate.scale))
        step[k] = 3e-4 * candidate.scale[k]
        ahead = read(
            robot, change_elements(robot.mechanism, candidate.action.changes(step)), c
        )
        start = np.zeros(len(step)) if candidate.positive else -step
        behind = read(
            robot, change_elements(robot.mechanism, candidate.action.changes(start)), c
        )
        change = ahead - behind
        rounding = 1e-8 * np.abs(ahead) + 1e-15
        error = np.abs(column[:, k] * (step[k] - start[k]) - change)
        assert (error <= 2e-2 * np.abs(change) + rounding).all(), candidate.name
        seen += (np.abs(change) > 10.0 * rounding).any()
    assert seen > 6


def displaces(candidate):
    """Whether a candidate's changes displace the unloaded robot."""
    changes = candidate.action.changes(np.array(candidate.scale))
    return any(change.displaces for change in changes.values())


@pytest.mark.extended_for("delta", "stewart")
@pytest.mark.parametrize("name", ROBOTS)
def test_derivatives_of_displaced_ends_are_those_of_loads_on_the_displaced_robot(name):
    """Weight, loads and gauges move with the nodes that geometric errors displace."""
    robot = nominal(name)
    pose = next(iter(reversed(robot.robot.poses.values())))
    c = readings(robot, ("dx", "drz", "ey", "kz", "prx"), [pose])
    model = RobotModel(c, robot)
    known = [
        each
        for each in find_candidates(model.setting)
        if isinstance(each.action, ElementEffect) and displaces(each)
    ]
    seen = set()
    for candidate in known:
        column = model.predict().columns(candidate)
        for k in {0, len(candidate.scale) // 2, len(candidate.scale) - 1}:
            step = 0.01 * candidate.scale[k] * np.eye(len(candidate.scale))[k]
            ahead, behind = (
                model.predict(((candidate, tuple(u)),)).values for u in (step, -step)
            )
            slope = (ahead - behind) / (2.0 * step[k])
            for kind in np.unique(c.kind).tolist():
                mine = c.kind == kind
                size = np.linalg.norm(slope[mine])
                # rounding of readings, and of equilibria of displaced robots
                rounding = (1e-9 * np.linalg.norm(ahead[mine]) + 1e-13) / step[k]
                error = np.linalg.norm((column[:, k] - slope)[mine])
                assert error <= 1e-4 * size + rounding, (candidate.name, kind)
                if size > 1e3 * rounding:
                    seen.add(kind)
    assert seen >= {0, 1, 2}


@pytest.mark.parametrize("name", ROBOTS)
def test_errors_of_the_drives_move_the_tool_as_kinematics_says(name):
    """Deviations by large encoder offsets are those of the robot at other drives, without any weight."""
    robot = nominal(name)
    c = replace(readings(robot, ("ex", "ey", "ez", "erx", "ery", "erz")), modelled=())
    drive = robot.mechanism.drives[0]
    candidate = next(
        k
        for k in RobotModel(c, robot).library
        if any(
            w.startswith("encoder-offset") and (k.members == (drive.name,))
            for w in k.signature_of
        )
    )
    values = RobotModel(c, robot).predict(((candidate, (2e-3,)),)).values
    found = configure(robot.mechanism, c.poses)
    moved = found.drives.copy()
    moved[:, 0] += 2e-3 if candidate.effect == "encoder-offset" else np.nan
    there = configure_drives(robot.mechanism, moved)
    away = there.tool - found.tool
    at_tool = np.flatnonzero(c.sensor < 0)
    direction = c.direction[at_tool]
    exact = away[c.pose[at_tool], direction]
    translations = direction < 3
    assert values[at_tool][translations] == pytest.approx(exact[translations], abs=2e-9)


def test_natural_frequencies_are_those_of_the_modes():
    robot = nominal("stewart")
    c = readings(robot, ("f1", "f3"))
    model = RobotModel(c, robot)
    expected = frequencies(robot.mechanism, configure(robot.mechanism, c.poses), 3)
    shaken = c.kind == 4
    assert model.predict().values[shaken] == pytest.approx(
        expected[:, [0, 2]].ravel(), rel=1e-12
    )
    soft = next(k for k in model.library if k.name == "actuator-stiffness @ drives")
    column = model.predict().columns(soft)[shaken, 0]
    changes = {
        j.name: Change(np.diag([1e-4 / j.drive.stiffness, 0, 0, 0, 0, 0]))
        for j in robot.mechanism.drives
    }
    softer = frequencies(
        robot.mechanism.change_elements(changes), configure(robot.mechanism, c.poses), 3
    )
    assert column == pytest.approx(
        ((softer - expected) / 1e-4)[:, [0, 2]].ravel(), rel=5e-3
    )


def test_frequencies_of_a_denser_body_show_its_moments_of_inertia():
    robot = nominal("stewart")
    c = readings(robot, tuple(f"f{k}" for k in range(1, 7)))
    model = RobotModel(c, robot)
    (mass,) = [k for k in find_candidates(model.setting) if k.name == "mass @ platform"]
    column = model.predict().columns(mass)[c.kind == 4, 0]
    step = 1e-4
    shaken = [
        frequencies(
            apply_effect(robot, "mass", "platform", {"factor": 1.0 + s}).mechanism,
            configure(robot.mechanism, c.poses),
            6,
        )
        for s in (step, -step)
    ]
    expected = (shaken[0] - shaken[1]).ravel() / (2.0 * step)
    assert column == pytest.approx(expected, rel=5e-3)


def test_a_zero_of_each_session_is_no_information():
    """Readings of a sensor with unknown zero may be shifted by a constant in every session."""
    robot = nominal("delta")
    c = readings(robot, ("dx",))
    level = replace(c.sensors[1], zero="session")
    c = replace(c, sensors=(c.sensors[0], level))
    rng = np.random.default_rng(0)
    c = replace(
        c,
        value=RobotModel(c, robot).predict().plain_readings
        + 1e-6 * rng.standard_normal(len(c)),
    )
    moved = replace(c, value=c.value + 1e-3 * (c.sensor == 1))
    one, other = (RobotModel(each, robot) for each in (c, moved))
    assert c.value - one.predict().values == pytest.approx(
        moved.value - other.predict().values, abs=1e-15
    )
    assert np.mean((c.value - one.predict().values)[c.sensor == 1]) == pytest.approx(
        0.0, abs=1e-12
    )
    soft = next(k for k in one.library if k.effect == "actuator-stiffness")
    assert one.predict().columns(soft)[c.sensor == 1].sum() == pytest.approx(
        0.0, abs=1e-12
    )


def test_hysteresis_between_sessions_has_a_name():
    """Unloading readings that stay behind by Rayleigh's loop: none at no load and at the largest, most between."""
    robot = nominal("delta")
    one = replace(readings(robot, ("dz",)), sensors=(), loads=())
    one = replace(
        one,
        **{
            k: getattr(one, k)[:1]
            for k in ("pose", "quantity", "sigma", "value", "file")
        },
        session=[0],
        line=[2],
        wrench=[[0, 0, -100.0, 0, 0, 0]],
    )
    share = np.tile([0.25, 0.5, 1.0], 2)
    rows = {
        k: np.repeat(getattr(one, k), 6, axis=0)
        for k in ("pose", "quantity", "sigma", "value", "file")
    }
    c = replace(
        one,
        **rows,
        wrench=share[:, None] * one.wrench,
        session=[0, 0, 0, 1, 1, 1],
        line=np.arange(6),
        session_names=("loading", "unloading"),
    )
    model = RobotModel(c, robot)
    pattern = next(k for k in model.library if "hysteresis" in k.place)
    largest = model.predict().plain_readings[2]
    loops = model.predict().columns(pattern)
    assert loops[:, 1] == pytest.approx(largest * (1 - share**2) * (c.session == 1))


def test_poses_may_be_given_by_joints():
    robot = nominal("stewart")
    c = readings(robot)
    found = configure(robot.mechanism, c.poses)
    by_joints = replace(
        c,
        poses=found.drives[:, ::-1],
        coordinates=tuple(f"q:{j.name}" for j in robot.mechanism.drives[::-1]),
    )
    plain, same = (RobotModel(each, robot).predict().values for each in (c, by_joints))
    assert same == pytest.approx(plain, rel=1e-7, abs=1e-13)


def test_stiffnesses_taken_for_pushes_are_told():
    """A serial arm's K_ii are far above its 1/C_ii."""
    robot = nominal("serial-arm")
    c = readings(robot, tuple(f"k{a}" for a in ("x", "y", "z", "rx", "ry", "rz")))
    model = RobotModel(c, robot)
    pushes = model.predict_as(2, 3)
    stiff = c.kind == 2
    taken = replace(
        c,
        value=np.where(stiff, pushes, model.predict().plain_readings),
        sigma=np.where(stiff, 0.01 * pushes, c.sigma),
    )
    remarks = RobotModel(taken, robot).remarks(_noise(taken), np.zeros(len(taken)))
    assert any("k.. fit far better as p.." in text for text in remarks)
    right = replace(
        c,
        value=model.predict().plain_readings,
        sigma=np.where(stiff, 0.01 * model.predict().plain_readings, c.sigma),
    )
    assert not RobotModel(right, robot).remarks(_noise(right), np.zeros(len(right)))


def _noise(c):
    from stiffscope.gap.forward.forward_model import Noise

    return Noise(
        c.sigma, np.ones(len(c), dtype=bool), np.zeros(len(c), dtype=bool), np.ones(1)
    )


def test_an_inclinometer_on_the_ground_turns_with_what_the_base_yields():
    """By its compliance times the moment of a hung weight about the origin."""
    robot = nominal("serial-arm")
    level = Sensor("level", "ground", (0.0, 1.0, 0.0), measures="rotation")
    p = np.array(list(robot.robot.poses.values()))[:1]
    campaign = Campaign(
        "serial-arm",
        ("gravity",),
        "beam",
        ("p",),
        p,
        np.zeros(1, int),
        np.array([[0, 0, -50.0, 0, 0, 0]]),
        np.array([4]),
        np.zeros(1),
        np.full(1, 1e-6),
        ("",),
        np.zeros(1),
        ("readings.csv",),
        np.zeros(1),
        np.array([2]),
        coordinates=robot.mechanism.tool.pose,
        sensors=(level,),
        sensor=np.array([0]),
        load=np.array([-1]),
    )
    model = RobotModel(campaign, robot)
    assert model.predict().values == pytest.approx([0.0], abs=1e-15)
    base = next(c for c in model.library if c.name == "base-compliance @ base")
    here = configure(robot.mechanism, p).tool[0, :3]
    slope = model.predict().columns(base)[0, base.names.index("ry")]
    assert slope == pytest.approx(np.cross(here, [0, 0, -50.0])[1])


def test_what_is_on_no_body_or_at_no_pose_is_refused():
    robot = nominal("delta")
    c = readings(robot)
    with pytest.raises(
        InputError,
        match=r'sensors.gauge.body: expected a body or an end of one .*got "plate"',
    ):
        RobotModel(
            replace(c, sensors=(replace(c.sensors[0], body="plate"), c.sensors[1])),
            robot,
        )
    with pytest.raises(
        InputError,
        match=r"readings.csv:1: rz: expected the coordinates that command delta: x y z",
    ):
        RobotModel(replace(c, poses=c.poses[:, :1], coordinates=("rz",)), robot)
    far = c.poses.copy()
    far[1] = [3.0, 0.0, 0.0]
    with pytest.raises(
        InputError,
        match=r"readings.csv:\d+: pose: expected a pose that the robot reaches, got 1: ",
    ):
        RobotModel(replace(c, poses=far), robot).predict().values  # noqa: B018 (evaluated where asked for)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_softened_robot_is_that_condensed_anew(name, monkeypatch):
    """Few elements that yield more: by Woodbury's identity on the sound robot, and by the network with them."""
    robot = nominal(name)
    c = readings(robot, ("dx", "dz", "ez", "ky"))
    library = RobotModel(c, robot).library
    soft = [
        k
        for k in library
        if k.effect in {"actuator-stiffness", "joint-compliance", "base-compliance"}
    ]
    pair = tuple((k, tuple(2.0 * s for s in k.scale)) for k in (soft[0], soft[-1]))
    quick = RobotModel(c, robot).predict(pair)
    monkeypatch.setattr(robot_at_poses, "FEW", 0)
    slow = RobotModel(c, robot).predict(pair)
    assert not slow.elastic_state._response.cuts
    assert quick.values == pytest.approx(
        slow.values, rel=1e-8, abs=1e-9 * np.abs(slow.values).max()
    )
    assert quick.columns(soft[1]) == pytest.approx(
        slow.columns(soft[1]), rel=1e-6, abs=1e-12
    )


@pytest.mark.parametrize("counts", [(8, 21), (21, 8)])
def test_a_matrix_with_fewer_entries_stands_beside_the_one_with_all(counts):
    """Derivatives by one of two forms of an effect where the other is at work: those of the changed robot."""
    robot = nominal("five-bar")
    c = readings(robot, ("dx", "ex"))
    forms = {
        len(k.scale): k
        for k in find_candidates(RobotModel(c, robot).setting)
        if k.flexible and k.place == "inner"
    }
    acting, other = (forms[count] for count in counts)
    assert acting.name == other.name
    at_work = ((acting, tuple(np.linspace(0.1, 0.3, counts[0]).tolist())),)
    model = RobotModel(c, robot)
    columns = model.predict(at_work).columns(other)
    step = 1e-4 * np.eye(counts[1])
    sides = [
        [model.predict((*at_work, (other, tuple(s)))).values for s in sign * step]
        for sign in (1.0, -1.0)
    ]
    expected = (np.array(sides[0]) - np.array(sides[1])).T / 2e-4
    assert np.abs(columns - expected).max() < 1e-4 * np.abs(expected).max()


@pytest.mark.parametrize("name", ["biglide", *ROBOTS, LINEAR_DELTA])
def test_a_robot_is_plausible_as_it_is(name):
    """The soft rods of the linear Delta yield 3 mrad/(N·m): a range in units kept their own matrix from being named."""
    robot = nominal(name)
    model = RobotModel(
        readings(robot, poses=[nominal(name).mechanism.tool.home]), robot
    )
    for candidate in model.library:
        count = len(candidate.scale)
        if candidate.scale and not candidate.is_nuisance:
            values = candidate.physical(np.zeros(count))
            assert all(plausible(candidate, values, np.zeros(len(values)))), (
                candidate.name
            )


def test_no_uncertainty_excuses_a_payload_that_is_nowhere():
    """Its centre is moments over mass, which may be next to zero."""
    payload = Candidate(
        "payload",
        "hand",
        ("mass", "x"),
        ("kg", "m"),
        (0.2, 0.02),
        ((0.0, 3.0), (-0.5, 0.5)),
    )
    assert plausible(payload, np.array([0.3, 0.7]), np.array([0.1, 0.1])) == [
        True,
        True,
    ]
    assert plausible(payload, np.array([0.0, 7e7]), np.array([0.2, 5e9])) == [
        True,
        False,
    ]


@pytest.mark.parametrize(("sigma", "expected"), [(4.0, True), (0.3, False)])
def test_a_fit_without_mass_moves_to_the_nearest_plausible_one_along_its_ridge(
    sigma, expected
):
    """Readings show m + 2 p = -0.3 kg m of a mass m and its moment p: p/m is above -0.6 m from m = 1.5 kg on."""
    payload = Candidate(
        "payload",
        "hand",
        ("mass", "x"),
        ("kg", "m"),
        (0.2, 0.05),
        ((0.0, 3.0), (-0.6, 0.6)),
        bounds=(0.0, np.inf),
        physical=lambda u: np.array([u[0], u[1] / max(u[0], 1e-9)]),
        couplings=1,
    )
    ridge = np.array([1.0, -0.5])
    known = SimpleNamespace(
        covariance=sigma**2 * np.outer(ridge, ridge) + 1e-9 * np.eye(2)
    )
    fit = Hypothesis(
        ((payload, (0.0, -0.15)),), np.zeros(0), np.zeros((0, 2)), 0.0, known
    )
    near = find_plausible(fit)
    assert (near is not None) == expected
    if near is not None:
        (mass, moment), cost = near
        assert mass + 2.0 * moment == pytest.approx(-0.3)
        assert 1.5 <= mass < 1.5 + 0.2 * sigma
        assert cost == pytest.approx(0.5 * (mass / sigma) ** 2)


def test_what_is_tried_for_the_next_reading_is_within_reach_by_itself(monkeypatch):
    """Which of two poses beside a singular one is reached may depend on what else is: a diagnosis ended there."""
    robot = nominal("five-bar")
    model = RobotModel(readings(robot), robot)
    whole = model.trial(np.ones(len(model.campaign))).model.campaign.poses

    def beside_others(mechanism, coordinates, poses):
        found = robot_at_poses.configure_robot(mechanism, coordinates, poses)
        return replace(
            found,
            valid=found.valid
            & ((poses[:, 0] < whole[:, 0].max()) | (len(poses) != len(whole))),
        )

    monkeypatch.setattr("stiffscope.gap.forward.trial.configure_robot", beside_others)
    poses = model.trial(np.ones(len(model.campaign))).model.campaign.poses
    assert len(whole) - 9 < len(poses) < len(whole)
    assert beside_others(robot.mechanism, model.campaign.coordinates, poses).valid.all()


def test_a_modulus_is_another_name_for_the_plain_factor_of_its_part():
    """Of a Stewart platform's struts readings at M see the axial compliance: radius and bore are other causes."""
    robot = nominal("stewart")
    c = readings(robot, ("dx", "dy", "dz", "drx", "dry", "drz"))
    rows = np.flatnonzero(c.sensor < 0)
    kept = {
        k: getattr(c, k)[rows]
        for k in (
            "pose",
            "wrench",
            "quantity",
            "value",
            "sigma",
            "session",
            "file",
            "line",
        )
    }
    library = RobotModel(
        replace(c, **kept, sensors=(), sensor=(), loads=(), load=()), robot
    ).library
    known = {
        each.name: each for k in library for each in (k, *(twin for twin, _ in k.twins))
    }
    for part in ("lower", "upper"):  # the upper one's factor is a twin of soft drives
        modulus = f"part-dimension @ {part}.youngs_modulus"
        assert [name for name, k in known.items() if modulus in k.aliases] == [
            f"link-stiffness @ {part}"
        ]
        assert modulus not in known
    names = {"part-dimension @ lower.radius", "part-dimension @ lower.bore"}
    assert names <= set(known["link-stiffness @ lower"].signature_of)


def test_a_former_word_is_no_word_more():
    """Entries of the sliders' matrix, by the first format's word, are as likely as those of the links'."""
    robot = nominal("biglide")
    model = RobotModel(readings(robot, ("kx", "ky", "kz", "krx", "kry", "krz")), robot)
    odds = {
        c.name: Problem(model, None).odds_of(c).sum()
        for c in model.library
        if c.flexible
    }
    assert odds["slider-compliance @ sliders"] == odds["part-compliance @ links"]


@pytest.mark.parametrize("factor", [1.0, 0.6])
def test_experiments_are_made_on_a_part_at_fault(factor):
    """Where its share of the gap is small beside the noise, and beside a soft drive; never for noise alone."""
    robot = nominal("five-bar")
    made = []
    tested = {
        part: lambda part=part: made.append(part) or beam_dimensions(robot.robot, part)
        for part in robot.robot.parts
    }
    campaign = readings(robot, ("dx", "dy", "dz", "drx", "dry", "ex", "ey", "ez"))
    campaign = replace(campaign, sigma=np.full(len(campaign), 1e-9))  # equilibria
    softer = apply_effect(robot, "actuator-stiffness", "left.motor", {"factor": factor})
    rng = np.random.default_rng(3)
    values = {}
    for share in (1.0, 0.9):
        other = apply_effect(
            softer, "part-dimension", "inner.shear_modulus", {"value": share * 26.9e9}
        )
        values[share] = RobotModel(campaign, other).predict().values
    change = float(np.sqrt(np.sum((values[0.9] - values[1.0]) ** 2)))
    sigma = np.full(len(campaign), change / 12.0)
    noise = sigma * rng.standard_normal(len(campaign))
    for share, fault in ((1.0, False), (0.9, True)):
        made.clear()
        measured = replace(campaign, value=values[share] + noise, sigma=sigma)
        assert RobotModel(measured, replace(robot, tested=tested)).library
        assert ("inner" in made) is fault
        assert fault or not made


@pytest.mark.extended_for("stewart")
@pytest.mark.parametrize("name", ["biglide", "stewart"])
def test_patterns_hold_for_readings_to_come(name):
    """At other poses, in directions that were not read: as many derivatives as the pattern has parameters."""
    robot = nominal(name)
    campaign = readings(robot, ("dz", "ez"))
    campaign = replace(
        campaign, session=campaign.pose % 2, session_names=("up", "down")
    )
    model = RobotModel(campaign, robot)
    patterns = [
        candidate
        for candidate in model.library
        if isinstance(candidate.action, Pattern)
    ]
    assert len(patterns) > 8
    trial = model.trial(np.ones(len(campaign))).model
    assert len(trial.campaign.poses) > len(campaign.poses)
    for pattern in patterns:
        assert model.predict().columns(pattern).shape == (
            len(campaign),
            len(pattern.scale),
        )
        prediction = trial.predict(((pattern, pattern.scale),))
        assert prediction.columns(pattern).shape == (
            len(trial.campaign),
            len(pattern.scale),
        )
        assert np.isfinite(prediction.values).all()


def test_derivatives_grow_with_a_gain_of_the_readings():
    """By differences of predictions beside a gain that triples some readings."""
    robot = nominal("stewart")
    campaign = readings(robot, ("dz", "dx", "ez"))
    model = RobotModel(campaign, robot)
    (gain,) = (
        c for c in model.library if c.place == "a gain of its own in every direction"
    )
    drive = next(c for c in model.library if c.effect == "actuator-stiffness")
    beside = (gain, tuple(np.linspace(2.0, 0.5, len(gain.scale))))
    step = 1e-5 * np.array(drive.scale)
    here = model.predict((beside,))
    change = model.predict((beside, (drive, tuple(step)))).values - here.values
    assert np.abs(change).max() > 1e-9 * np.abs(here.values).max()
    assert here.columns(drive) @ step == pytest.approx(
        change, rel=1e-3, abs=1e-4 * np.abs(change).max()
    )


def test_weights_that_hang_beside_their_hook_are_a_pattern():
    """As readings would be if the hook itself were there."""
    robot = load_robot("delta")
    nominal = NominalRobot(mechanism_of(robot, part_matrices(robot, "beam")), robot)
    campaign = open_case("gauges").campaign
    model = RobotModel(campaign, nominal)
    (beside,) = (
        c for c in model.library if c.place == "a wrench that acts beside its point"
    )
    here = model.predict().values
    columns = model.predict().columns(beside)
    for axis in range(3):
        (hook,) = campaign.loads
        moved = replace(
            campaign, loads=(replace(hook, at=tuple(hook.at + 1e-3 * np.eye(3)[axis])),)
        )
        there = RobotModel(moved, nominal).predict().values
        assert np.abs(there - here).max() > 1e-7
        assert there - here == pytest.approx(
            1e-3 * columns[:, axis], rel=1e-6, abs=1e-12
        )


def test_a_tolerance_of_a_mass_bounds_what_may_be_added(tmp_path):
    """Of 2 kg ± 2 % three standard deviations are 0.12 kg, or 6 %; a body without a tolerance may carry thrice
    what the robot weighs.
    """
    text = """[bodies]
known = { mass = "2 kg ± 2 %", centre = [0.5, 0, 0] }
guessed = { mass = "2 kg", centre = [1.5, 0, 0] }
[joints]
J1 = { between = ["ground", "known"], type = "revolute", at = [0, 0, 0], axis = [0, 1, 0], drive.stiffness = 1e5 }
J2 = { between = ["known", "guessed"], type = "revolute", at = [1, 0, 0], axis = [0, 1, 0], drive.stiffness = 1e5 }
[tool]
body = "guessed"
at = [2, 0, 0]
pose = ["x", "z"]
[gravity]
direction = [0, 0, -1]
"""
    (tmp_path / "arm.toml").write_text(text)
    file = load_robot(tmp_path / "arm.toml")
    found = find_candidates(Setting(NominalRobot(mechanism_of(file, {}), file)))
    heavy = {
        (c.name, len(c.scale)): c for c in found if c.effect in ("mass", "payload")
    }
    heaviest = {
        key: bound_parameters([c], np.full(len(c.scale), 1e3))
        for key, c in heavy.items()
    }
    assert heaviest[("payload @ known", 1)] == pytest.approx(0.12)
    assert [key for key in heavy if key[1] == 4] == [("payload @ guessed", 4)]
    assert heavy[("payload @ guessed", 1)].plausible[0][1] == 3.0 * (2.0 + 2.0)
    assert heaviest[("payload @ guessed", 1)] == 1e3
    assert heaviest[("mass @ known", 1)] == pytest.approx(0.06)
    assert heaviest[("mass @ guessed", 1)] > 1.0


ARM = """name = "carried"
[bodies]
upper = { mass = "6 kg", centre = [0.5, 0, 0], inertia = [0.1, 0.4, 0.4, 0, 0, 0] }
fore = { mass = "4 kg", centre = [1.5, 0, 0], inertia = [0.1, 0.3, 0.3, 0, 0, 0] }
[joints]
J1 = { between = ["ground", "upper"], type = "revolute", at = [0, 0, 0], axis = [0, 1, 0], drive.stiffness = 1e5 }
J2 = { between = ["upper", "fore"], type = "revolute", at = [1, 0, 0], axis = [0, 1, 0], drive.stiffness = 1e5 }
[tool]
body = "fore"
at = [2, 0, 0]
pose = ["x", "z"]
[gravity]
direction = [0, 0, -1]
[poses]
home = [2, 0]
bent = [1.5, -0.6]
"""


def test_weight_that_springs_carry_takes_no_inertia_with_it(tmp_path):
    """It takes its share of the sag; a robot that adopts it vibrates as before, and sags as the diagnosis says."""
    (tmp_path / "arm.toml").write_text(ARM)
    file = load_robot(tmp_path / "arm.toml")
    robot = NominalRobot(mechanism_of(file, {}), file)
    own = readings(robot, ("ex", "ez", "f1", "f2"))
    model = RobotModel(own, robot)
    (carried,) = (c for c in model.library if c.name == "mass @ robot")
    left = 0.3
    here = model.predict()
    there = model.predict(((carried, tuple(carried.internal(np.array([left])))),))
    slow = np.isin(own.quantity, [QUANTITIES.index(name) for name in ("f1", "f2")])
    sags = np.isin(own.quantity, [QUANTITIES.index(name) for name in ("ex", "ez")])
    sags &= own.sensor < 0
    assert there.values[slow] == pytest.approx(here.values[slow], rel=1e-9)
    assert there.values[sags] == pytest.approx(left * here.values[sags], rel=1e-6)
    slope = here.columns(carried)[:, 0]
    assert not slope[slow].any()
    assert slope[sags] == pytest.approx(-here.values[sags], rel=1e-6, abs=1e-15)
    adopted = apply_effect(robot, "mass", "robot", {"factor": left})
    again = RobotModel(own, adopted).predict().values
    assert again == pytest.approx(there.values, rel=1e-6, abs=1e-12)


@dataclass(frozen=True)
class Pull(Effect):
    """A constant force on the tool, such as that of a cable."""

    word = "pull"
    precedence = 99
    parameters = tuple(Parameter(f"f{x}", "N", 10.0) for x in "xyz")
    tool: object

    def influence(self, values):
        load = Payload(self.tool.body, self.tool.at, 0.0, np.zeros(3), np.array(values))
        return Influence(payloads=(load,))


@pytest.mark.parametrize("weighed", [True, False])
def test_a_constant_pull_moves_the_resting_tool_by_its_compliance(weighed):
    """C F in deviations, with weight and without, and nothing in deflections."""
    robot = nominal("delta")
    c = readings(robot, ("ex", "ey", "ez", "dx"))
    c = replace(c, modelled=("gravity",) if weighed else ())
    model = RobotModel(c, robot)
    effect = Pull(robot.mechanism.tool)
    candidate = effect.make_candidate(Place("tool"))
    force = np.array([3.0, -2.0, 5.0])
    moved = model.predict(((candidate, force),)).values - model.predict().values
    soft = compliance(robot.mechanism, c.poses)[c.pose, :3, :3]
    right = np.where(
        c.shows_rest, (soft @ force)[np.arange(len(c)), c.direction % 3], 0.0
    )
    at_tool = c.sensor < 0
    assert moved[at_tool] == pytest.approx(right[at_tool], rel=1e-7, abs=1e-15)
    columns = model.predict().columns(candidate)
    assert columns @ force == pytest.approx(moved, rel=1e-7, abs=1e-15)


@pytest.mark.parametrize(
    "pose", [[0, 2, 1, 1, 0, 2], [0, 0, 1, 2, 2, 2], [0, 1, 1, 2, 2, 2, 1]]
)
def test_products_by_pose_are_those_of_each_reading(pose):
    """Readings in any order, as many of each pose or not."""
    pose = np.array(pose)
    rng = np.random.default_rng(1)
    rates = rng.standard_normal((len(pose), 4))
    matrices = rng.standard_normal((3, 4, 5))
    campaign = SimpleNamespace(pose=pose, poses=np.zeros((3, 1)))
    at = robot_at_poses.RobotAtPoses(None, campaign)
    each = np.einsum("nk,nkm->nm", rates, matrices[pose])
    assert at.multiply_by_pose(rates, matrices) == pytest.approx(each)
    own = np.arange(len(pose))
    at.__dict__["distinct_readings"] = ((own, own),) * 2
    for found in at.load_distinct(np.swapaxes(matrices, 1, 2), (rates, rates)):
        assert found == pytest.approx(each)

"""Instruments that stand anywhere: positions and distances of targets, zeros; by laws, and by scipy's least squares."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from stiffscope.gap.campaign.campaign import Campaign, InstrumentFrame, Sensor
from stiffscope.gap.campaign.quantities import FIRST_POSITION
from stiffscope.gap.diagnose import diagnose_campaign
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.show.text import sentence
from stiffscope.vjm.kinematics.configurations import configure, configure_drives
from stiffscope.vjm.model.screws import rotation_of
from tests.gap.test_robot_model import nominal

SIGMA = 2e-5
POSES = 40
TURN, ORIGIN = rotation_of(np.array([1.1, -2.0, 0.7])), np.array([2.0, -3.0, 1.0])


def targets(robot, *, measures="position", frame=None, at_sigma=0.0, count=2):
    """Targets about M on the tool's body, as channels."""
    tool = robot.mechanism.tool
    frame = frame or InstrumentFrame("tracker")
    places = (
        np.array(tool.at)
        + 0.15
        * np.array([[1, 0, 0.5], [-0.4, 1, 0], [0, -0.6, 1.0], [0.7, 0.3, -1.0]])[
            :count
        ]
    )
    axes = [(f".{n}", tuple(e)) for n, e in zip("xyz", np.eye(3), strict=True)]
    axes = [("", (1.0, 0.0, 0.0))] if measures == "distance" else axes
    return (frame,), tuple(
        Sensor(
            f"t{k}{name}",
            tool.body,
            axis,
            tuple(at),
            measures,
            frame=frame.name,
            target=f"t{k}",
            at_sigma=at_sigma,
        )
        for k, at in enumerate(places.tolist())
        for name, axis in axes
    )


def campaign(robot, instruments, drives, seed=0, sigma=SIGMA):
    """What a tracker at TURN, ORIGIN reads of the robot whose drives stand elsewhere than commanded."""
    rng = np.random.default_rng(seed)
    frames, sensors = instruments
    middle = configure(robot.mechanism, np.array([robot.mechanism.tool.home])).drives
    swing = 0.3 if robot.mechanism.drives[0].kind == "revolute" else 0.15
    commanded = middle + rng.uniform(-swing, swing, (POSES, middle.shape[1]))
    there = configure_drives(robot.mechanism, commanded + drives)
    turn, position = there.frame(robot.mechanism.tool.body)
    value = []
    for s in sensors:
        point = np.einsum("pij,j->pi", turn, np.array(s.at)) + position
        seen = (point - ORIGIN) @ TURN
        value.append(
            np.linalg.norm(seen, axis=1)
            if s.measures == "distance"
            else seen @ np.array(s.direction)
        )
    n = POSES * len(sensors)
    each = np.tile(np.arange(len(sensors)), POSES)
    axis = np.array([s.axis for s in sensors])
    return Campaign(
        None,
        (),
        "published",
        tuple(f"p{k}" for k in range(POSES)),
        commanded,
        np.repeat(np.arange(POSES), len(sensors)),
        np.zeros((n, 6)),
        FIRST_POSITION + axis[each],
        np.array(value).T.ravel() + sigma * rng.standard_normal(n),
        np.full(n, max(sigma, 1e-9)),
        ("",),
        np.zeros(n),
        ("r.csv",),
        np.zeros(n),
        np.arange(n),
        coordinates=tuple(f"q:{j.name}" for j in robot.mechanism.drives),
        sensors=sensors,
        sensor=each,
        frames=frames,
    )


def offset_of(model, drive):
    return next(
        c
        for c in model.library
        if any(w == f"encoder-offset @ {drive}" for w in c.signature_of)
    )


@pytest.mark.parametrize("measures", ["position", "distance"])
def test_an_instrument_is_found_without_a_guess(measures):
    robot = nominal("serial-arm")
    c = campaign(robot, targets(robot, measures=measures, count=3), 0.0, sigma=0.0)
    found = RobotModel(c, robot).predict()
    assert found.placed_instruments.setup.origin[0] == pytest.approx(ORIGIN, abs=1e-6)
    assert found.values == pytest.approx(RobotModel(c, robot).campaign.value, abs=1e-9)


def test_where_an_instrument_stands_changes_nothing():
    """Law: turned, shifted, with known or unknown pose, it shows the same effects."""
    robot = nominal("serial-arm")
    c = campaign(robot, targets(robot), 2e-3 * np.eye(6)[2])
    turn = rotation_of(np.array([-2.0, 0.4, 2.2]))
    shift = np.array([10.0, 4.0, -7.0])
    elsewhere = replace(c, value=(c.value.reshape(-1, 3) @ turn + shift).ravel())
    drive = robot.mechanism.drives[2].name
    residuals = []
    columns = []
    for each in (c, elsewhere):
        model = RobotModel(each, robot)
        found = model.predict(((offset_of(model, drive), (2e-3,)),))
        residuals.append(
            (model.campaign.value - found.values).reshape(-1, 3)
            @ found.placed_instruments.setup.rotation[0].T
        )
        columns.append(
            found.columns(offset_of(model, drive)).reshape(-1, 3)
            @ found.placed_instruments.setup.rotation[0].T
        )
    assert residuals[0] == pytest.approx(residuals[1], abs=1e-10)
    assert columns[0] == pytest.approx(columns[1], abs=1e-8)
    assert np.sqrt(np.mean(residuals[0] ** 2)) == pytest.approx(SIGMA, rel=0.1)


def test_large_offsets_are_found_where_they_lead():
    """Second derivation: scipy's least squares of drives, axes and origin, by kinematics alone."""
    robot, true = (
        nominal("serial-arm"),
        np.array([0.0, 0.016, -0.012, 0.009, -0.014, 0.0]),
    )
    c = campaign(robot, targets(robot), true)
    model = RobotModel(c, robot)
    drives = [j.name for j in robot.mechanism.drives]
    here = tuple(offset_of(model, drives[k]) for k in (1, 2, 3, 4))
    places = np.array([s.at for s in c.sensors[::3]])

    def left(x):
        turn, at = configure_drives(
            robot.mechanism, c.poses + np.array([0, *x[:4], 0])
        ).frame(robot.mechanism.tool.body)
        points = np.einsum("pij,kj->pki", turn, places) + at[:, None]
        return ((points - x[7:10]) @ rotation_of(x[4:7])).ravel() - c.value

    found = least_squares(
        left,
        [0, 0, 0, 0, 1.1, -2.0, 0.7, *ORIGIN],
        x_scale="jac",
        xtol=1e-15,
        ftol=1e-15,
    )
    u = np.zeros(4)
    for _ in range(6):  # Gauss-Newton on the model's own derivatives
        prediction = model.predict(
            tuple((k, (v,)) for k, v in zip(here, u, strict=True))
        )
        slopes = np.hstack([prediction.columns(k) for k in here])
        u = (
            u
            + np.linalg.lstsq(
                slopes, model.campaign.value - prediction.values, rcond=None
            )[0]
        )
    assert u == pytest.approx(found.x[:4], abs=2e-7)
    assert u == pytest.approx(true[1:5], abs=1e-4)


def test_a_stated_uncertainty_is_summed_over():
    """The squared residual is that of the readings' covariance with targets and frame as uncertain as is said."""
    robot = nominal("serial-arm")
    pose = (*ORIGIN, 1.1, -2.0, 0.7)
    spread = (1e-4,) * 3 + (5e-5,) * 3
    c = campaign(
        robot,
        targets(robot, frame=InstrumentFrame("tracker", pose, spread), at_sigma=3e-4),
        0.0,
    )
    c = replace(c, value=c.value + 1e-4)  # beyond the noise
    exact = replace(
        c, frames=(InstrumentFrame("tracker", pose),), sensors=targets(robot)[1]
    )
    model = RobotModel(c, robot)
    rigid = RobotModel(exact, robot)
    r = (rigid.campaign.value - rigid.predict().values) / SIGMA
    covariance = np.eye(len(r))
    turn, at = configure_drives(robot.mechanism, c.poses).frame(
        robot.mechanism.tool.body
    )
    points = (
        np.einsum("pij,sj->psi", turn, np.array([s.at for s in c.sensors[::3]]))
        + at[:, None]
    )
    by_origin = -np.broadcast_to(TURN.T, (*points.shape[:2], 3, 3))
    by_turn = np.stack(
        [-np.cross(e, points - ORIGIN) @ TURN for e in np.eye(3)], axis=-1
    )
    columns = [1e-4 * by_origin.reshape(-1, 3), 5e-5 * by_turn.reshape(-1, 3)]
    for k in range(2):
        own = np.zeros((POSES, 2, 3, 3))
        own[:, k] = TURN.T @ turn
        columns.append(3e-4 * own.reshape(-1, 3))
    n = np.hstack(columns) / SIGMA
    expected = r @ np.linalg.solve(covariance + n @ n.T, r)
    found = (model.campaign.value - model.predict().values) / SIGMA
    assert found @ found == pytest.approx(expected, rel=1e-3)


def test_an_outlier_does_not_move_the_instrument():
    robot = nominal("serial-arm")
    c = campaign(robot, targets(robot), 0.0)
    wild = replace(c, value=c.value + np.where(np.arange(len(c)) == 17, 0.8, 0.0))
    one, other = (
        RobotModel(each, robot).predict().placed_instruments.setup for each in (c, wild)
    )
    assert other.origin == pytest.approx(one.origin, abs=2e-5)


def test_a_base_turn_is_not_told_from_a_first_zero():
    """What no posture shows is projected out."""
    robot = nominal("serial-arm")
    model = RobotModel(campaign(robot, targets(robot), 0.0), robot)
    names = {name for c in model.library for name in c.signature_of}
    first, second = (robot.mechanism.drives[k].name for k in (0, 1))
    assert f"encoder-offset @ {second}" in names
    assert f"encoder-offset @ {first}" not in names


@pytest.mark.extended_for("8", "24", "3")
@pytest.mark.parametrize("times", [3, 8, 24])
def test_a_target_elsewhere_than_stated_is_said_and_blames_no_robot(times):
    """The robot is sound; the first target sits some uncertainties beside its stated place."""
    robot = nominal("serial-arm")
    c = campaign(robot, targets(robot, at_sigma=1e-3), 0.0)
    beside = np.array([1e-3 * times, 0.0, 0.0])
    sensors = tuple(
        replace(s, at=tuple(np.array(s.at) + beside * (s.target == "t0")))
        for s in c.sensors
    )
    found = diagnose_campaign(replace(c, sensors=sensors), robot)
    said = [r for r in found.remarks if "from where it is stated" in r]
    assert not found.effects
    assert found.verdict == ("no-gap" if times == 3 else "unexplained")
    assert len(said) == (times > 3)
    assert all(r.startswith(f"t0 is found {times}") for r in said)


@pytest.mark.extended
@pytest.mark.parametrize("size", [0.0, 5e-3])
def test_a_diagnosis_by_an_unknown_tracker(size):
    robot = nominal("serial-arm")
    c = campaign(robot, targets(robot, at_sigma=1e-3), size * np.eye(6)[2])
    diagnosis = diagnose_campaign(c, robot)
    drive = robot.mechanism.drives[2].name
    assert diagnosis.verdict == ("identified" if size else "no-gap")
    assert [(e.effect, e.place) for e in diagnosis.effects] == (
        [("encoder-offset", drive)] if size else []
    )
    left = diagnosis.gap.absolute["position"]
    assert list(diagnosis.gap.absolute) == ["position"]
    assert (left.after, left.noise) == (
        pytest.approx(SIGMA, rel=0.15),
        pytest.approx(SIGMA),
    )
    assert "mm rms" in sentence(diagnosis)
    if size:
        assert left.before > 5 * SIGMA
        assert diagnosis.effects[0].parameters["offset"].value == pytest.approx(
            size, abs=1e-4
        )

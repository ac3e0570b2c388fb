"""Weight acts on every machine, or on nothing: an arm that sags, by its own equilibrium in numpy."""

from __future__ import annotations

import numpy as np
import pytest

from stiffscope.gap.adoption import adopt
from stiffscope.gap.campaign.scatter import find_scatter
from stiffscope.gap.campaigns import diagnose, open_case
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.robot.mechanism_of import rigid_mechanism
from stiffscope.robot.nominal import NominalRobot
from tests import small_arm

AXES = np.array(small_arm.AXES)
POINTS = np.array([[0.0, 0, 0], [0, 0, 0.4], [0, 0, 0.9]])
CENTRES = np.array([[0, 0, 0.25], [0, 0, 0.65], [0.2, 0, 0.9]])
MASSES = np.array([12.0, 8.0, 5.0])
STIFFNESS = np.array([60e3, 50e3, 30e3])
TOOL = np.array([0.45, 0, 0.9])
ARM = small_arm.describe_arm("arm", MASSES, CENTRES, POINTS, STIFFNESS, TOOL)


def turn(axis, angle):
    """Rodrigues."""
    k = np.cross(axis, np.eye(3)).T
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def places(q, points):
    """Points (k, 3), one carried by each link (the last by link 3), at joint angles q (3,)."""
    out = []
    for link, home in points:
        at = np.array(home)
        for j in reversed(range(link + 1)):
            at = POINTS[j] + turn(AXES[j], q[j]) @ (at - POINTS[j])
        out.append(at)
    return np.array(out)


def sag(q, stiffness, force=(0, 0, 0), masses=MASSES, gravity=9.81, centres=CENTRES):
    """Motion (3,) of the tool at the equilibrium reached, by a fixed point on joint torques."""
    heavy = [(k, centres[k]) for k in range(3)]
    away = np.zeros(3)
    for _ in range(60):
        step = 1e-6
        torque = np.zeros(3)
        for j in range(3):
            ahead, behind = (
                energy(
                    q + away + s * step * np.eye(3)[j], heavy, masses, gravity, force
                )
                for s in (1, -1)
            )
            torque[j] = -(ahead - behind) / (2 * step)
        away = torque / stiffness
    return places(q + away, [(2, TOOL)])[0] - places(q, [(2, TOOL)])[0]


def energy(q, heavy, masses, gravity, force):
    at = places(q, [*heavy, (2, TOOL)])
    return gravity * masses @ at[:3, 2] - np.dot(force, at[3])


def write(folder, rows, header="", robot=ARM):
    folder.mkdir()
    (folder / "robot.toml").write_text(robot)
    (folder / "campaign.toml").write_text(
        f'robot = "robot.toml"\nreadings = "readings.csv"\n{header}\n'
    )
    names = "q:J1,q:J2,q:J3,fx,fy,fz,quantity,value,sigma"
    (folder / "readings.csv").write_text("\n".join([names, *rows]) + "\n")
    return folder


def rows_of(q, vector, sigma, rng, force=None, kind="e", stated=True):
    pulled = ",,," if force is None else ",".join(f"{f:.9g}" for f in force) + ","
    at = ",".join(f"{v:.12g}" for v in q)
    told = f"{sigma:g}" if stated else ""
    return [
        f"{at},{pulled}{kind}{axis},{v + sigma * rng.standard_normal():.12g},{told}"
        for axis, v in zip("xyz", vector, strict=True)
    ]


def sagging(folder, factors, header="", poses=24, seed=0, sigma=3e-6):
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(poses):
        q = rng.uniform([-1.5, -0.8, -1.2], [1.5, 0.8, 1.2])
        rows += rows_of(q, sag(q, factors * STIFFNESS), sigma, rng)
    return write(folder, rows, header)


@pytest.mark.extended_for("modelled = []")
@pytest.mark.parametrize("header", ["", "modelled = []"])
def test_sag_of_soft_drives_is_no_payload(tmp_path, header):
    """Absent: the weight is modelled. Stated as absent: it is tried before any payload."""
    folder = sagging(tmp_path / "c", np.array([1.0, 0.5, 0.667]), header)
    assert open_case(folder).campaign.is_weighed is not bool(header)
    found = diagnose(folder)
    names = {f"{e.effect} @ {e.place}" for e in found.effects}
    assert found.verdict in {"identified", "ambiguous"}
    assert not any(e.effect in {"payload", "mass"} for e in found.effects)
    assert ("gravity @ robot" in names) is bool(header)
    assert found.gap.chi2_per_reading[1] == pytest.approx(1.0, abs=0.4)


@pytest.mark.extended
def test_what_shows_of_a_mass_is_its_moment(tmp_path):
    """14 kg hung on a wrist of 5 kg: named, within the body, or as a moment about its joint."""
    rng = np.random.default_rng(4)
    rows = []
    heavier = MASSES + np.array([0, 0, 9.0])
    for _ in range(24):
        q = rng.uniform([-1.5, -0.8, -1.2], [1.5, 0.8, 1.2])
        rows += rows_of(q, sag(q, STIFFNESS, masses=heavier), 3e-6, rng)
    found = diagnose(write(tmp_path / "c", rows))
    (effect,) = found.effects
    group = {f"{effect.effect} @ {effect.place}", *effect.confused_with}
    assert group & {"payload @ link3", "mass @ link3"}
    assert found.gap.chi2_per_reading[1] == pytest.approx(1.0, abs=0.4)
    if "moment_x" in effect.parameters:
        moment = effect.parameters["moment_x"]
        assert moment.value == pytest.approx(9.0 * 0.2, abs=3 * moment.sigma)
    assert all(p.plausible for p in effect.parameters.values())


@pytest.mark.extended
def test_a_mass_beside_its_body_is_told_by_its_moment(tmp_path):
    """5 kg hung 0.9 m beside a link that reaches 0.3 m: 44 N·m about its joint, whatever the mass."""
    rng = np.random.default_rng(1)
    hung = 5.0
    there = np.array([0.9, 0.0, 0.7])
    masses = MASSES + np.array([0.0, hung, 0.0])
    centres = np.array(CENTRES)
    centres[1] = (MASSES[1] * CENTRES[1] + hung * there) / masses[1]
    rows = []
    for _ in range(24):
        q = rng.uniform([-1.2, -0.7, -1.2], [1.2, 0.7, 0.3])
        moved = sag(q, STIFFNESS, masses=masses, centres=centres)
        rows += rows_of(q, moved, 3e-6, rng)
    folder = write(tmp_path / "c", rows)
    found = diagnose(folder)
    (effect,) = found.effects
    assert (found.verdict, effect.effect, effect.place) == (
        "identified",
        "payload",
        "link2",
    )
    lever = there - POINTS[1]
    for axis, name in ((0, "moment_x"), (2, "moment_z")):
        moment = effect.parameters[name]
        assert moment.value == pytest.approx(hung * lever[axis], abs=4 * moment.sigma)
    assert moment.sigma < 0.1
    assert np.isnan(effect.parameters["moment_y"].value)  # about the joints' own axis
    known = effect.errors.values()
    assert max(abs(p.value) for p in known) < 30.0  # a mass and place with this moment
    robot = open_case(folder).robot
    bare = NominalRobot(rigid_mechanism(robot), robot)
    known = {"components": None, "modelled": ("gravity",)}
    adopted = tmp_path / "adopted.toml"
    adopt(adopted, robot, bare, found, campaign="c", **known)
    again = diagnose(folder, str(adopted))
    assert again.gap.nominal == pytest.approx(found.gap.explained, rel=0.02)


def test_deflections_are_those_of_the_equilibrium_reached(tmp_path):
    """J2 soft under 200 N: exact within a hundredth of what first order misses."""
    rng = np.random.default_rng(2)
    rows = []
    exact = []
    for force in 200.0 * np.vstack([np.eye(3), -np.eye(3)]):
        q = rng.uniform([-1.0, -0.6, -1.0], [1.0, 0.6, 1.0])
        moved = sag(q, STIFFNESS, force, masses=0 * MASSES)
        exact += moved.tolist()
        rows += rows_of(q, moved, 1e-9, rng, force=force, kind="d")
    case = open_case(write(tmp_path / "c", rows, "modelled = []"))
    robot = NominalRobot(rigid_mechanism(case.robot), case.robot)
    model = RobotModel(case.campaign, robot)
    first = model.predict().values - exact
    second = model.find_equilibria(()).predict().values - exact
    assert np.abs(second).max() < 0.01 * np.abs(first).max()


def test_a_smooth_load_curve_is_no_noise(tmp_path):
    """Scatter about a cubic through twelve loads, whatever the curve; copies are not repeats."""
    rng = np.random.default_rng(5)
    load = np.linspace(-90, 90, 12)
    value = 1e-3 * (0.4 * load / 90 + 1.2 * (load / 90) ** 3)
    value = value + 3e-6 * rng.standard_normal(12)
    rows = [
        f"0.5,0.3,-0.5,0,0,{f:.9g},dz,{v:.12g},"
        for f, v in zip(load, value, strict=True)
    ]
    campaign = open_case(write(tmp_path / "c", rows)).campaign
    squares, freedom = find_scatter(campaign, np.arange(12), np.ones(12))
    assert freedom == 8
    assert np.sqrt(squares / freedom) == pytest.approx(3e-6, rel=0.6)

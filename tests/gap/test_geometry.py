"""Axes and zeros that are not where they are drawn: exact kinematics, and one cause of many small errors."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.gap.adoption import adopt
from stiffscope.gap.campaigns import diagnose, open_case
from stiffscope.gap.diagnose import diagnose_campaign
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from tests.benchmarks.humanoid import draw, hands, links, write_campaign

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def humanoid(tmp_path_factory):
    """The humanoid and its campaign of a few postures, with the deviations that its true tree has without weight."""
    case = open_case(
        write_campaign(
            tmp_path_factory.mktemp("humanoid"), 3, soft=False, camera=False, poses=5
        )
    )
    robot = NominalRobot(mechanism_of(case.robot, {}), case.robot)
    return replace(case.campaign, modelled=()), robot


def true_values(campaign, tree, zeros):
    """Deviations (n,) of the hands of a true tree, by products of rotations."""
    names = [name.removeprefix("q:") for name in campaign.coordinates]
    commanded = dict(zip(names, campaign.poses.T, strict=True))
    there = hands(
        tree, {name: q + zeros[name] for name, q in commanded.items()}, heavy=False
    )
    drawn = hands(links(), commanded, heavy=False)
    sensors = [(s.name[0], s.axis) for s in campaign.sensors]
    return np.array(
        [
            (there[side] - drawn[side])[pose, axis]
            for pose, (side, axis) in zip(
                campaign.pose, (sensors[k] for k in campaign.sensor), strict=True
            )
        ]
    )


def test_geometry_moves_hands_as_products_of_rotations_say(humanoid):
    campaign, robot = humanoid
    rng = np.random.default_rng(5)
    tree, zeros = draw(rng, soft=False, bent=True)
    model = RobotModel(campaign, robot)
    geometry = next(c for c in model.library if c.name == "geometry @ robot")
    values = dict.fromkeys(geometry.parts, 0.0)
    for link, drawn in zip(tree, links(), strict=True):
        axes = robot.mechanism.joint(link.name).axes
        true = axes.T @ (link.axis / np.linalg.norm(link.axis))
        angle = np.arccos(true[0])
        tilt = angle / np.sin(angle) * np.cross([1.0, 0.0, 0.0], true)
        away = axes.T @ (link.at - drawn.at)
        away = (
            away - true * away[0] / true[0]
        )  # the same axis where it passes beside the drawn point
        for name, value in {
            "y": away[1],
            "z": away[2],
            "ry": tilt[1],
            "rz": tilt[2],
            "zero": zeros[link.name],
        }.items():
            values[f"{link.name}.{name}"] = value
    predicted = model.predict(((geometry, tuple(values.values())),)).plain_readings
    exact = true_values(campaign, tree, zeros)
    assert np.abs(exact).max() > 5e-3
    assert predicted == pytest.approx(exact, abs=1e-8)


def test_derivatives_of_an_axis_are_those_of_its_exact_errors(humanoid):
    campaign, robot = humanoid
    model = RobotModel(campaign, robot)
    for candidate in [c for c in model.library if c.effect == "joint-axis"][:3]:
        columns = model.predict().columns(candidate)
        for k, size in enumerate(candidate.scale):
            step = 0.1 * size * np.eye(len(candidate.scale))[k]
            ahead, behind = (
                model.predict(((candidate, tuple(u)),)).plain_readings
                for u in (step, -step)
            )
            assert columns[:, k] == pytest.approx(
                (ahead - behind) / (0.2 * size), abs=1e-6
            )


@pytest.mark.extended
def test_an_adopted_geometry_leaves_the_gap_that_it_explains(tmp_path):
    """Diagnosed again with the same campaign: what was explained is the gap now, and there is no other."""
    folder = write_campaign(tmp_path / "c", 1, soft=False, camera=False, poses=60)
    case = open_case(folder)
    robot = NominalRobot(mechanism_of(case.robot, {}), case.robot)
    found = diagnose_campaign(case.campaign, robot)
    assert [f"{e.effect} @ {e.place}" for e in found.effects] == ["geometry @ robot"]
    assert found.effects[0].parameters["offset"].value == pytest.approx(1e-3, rel=0.5)
    adopted = tmp_path / "adopted.toml"
    adopt(
        adopted,
        case.robot,
        robot,
        found,
        campaign="c",
        components="fea",
        modelled=["gravity"],
    )
    again = diagnose(folder, str(adopted))
    assert again.gap.nominal == pytest.approx(found.gap.explained, rel=0.01)
    assert again.verdict == "no-gap"

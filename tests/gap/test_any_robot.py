"""Whole diagnoses of robots that the first format did not know: what was planted is named, with its size."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.gap.diagnose import diagnose
from stiffscope.gap.residuals import by_sensor
from stiffscope.gap.robot_model import RobotModel
from stiffscope.robot.effects import adopted
from tests.gap.test_robot_model import nominal, readings


def measured(robot, true, quantities, spread, seed=1):
    rng = np.random.default_rng(seed)
    poses = np.array(list(robot.robot.poses.values())).mean(axis=0) + rng.uniform(-1, 1, (8, len(spread))) * spread
    c = readings(robot, quantities, poses)
    return replace(c, value=RobotModel(c, true).predict().values + 1e-6 * rng.standard_normal(len(c)))


@pytest.mark.parametrize(
    ("name", "effect", "place", "size", "spread"),
    [
        ("delta", "actuator-stiffness", "leg2.motor", {"factor": 0.75}, [0.25, 0.25, 0.12]),
        ("five-bar", "link-stiffness", "right.outer", {"factor": 0.6}, [0.05, 0.03]),
    ],
)
def test_gauges_and_a_hook_name_a_soft_element(name, effect, place, size, spread):
    robot = nominal(name)
    c = measured(robot, adopted(robot, effect, place, size), ("dx", "dy", "dz", "ex"), spread)
    found = diagnose(c, robot)
    assert found.verdict == "identified"
    (named,) = found.effects
    assert f"{effect} @ {place}" in {f"{named.effect} @ {named.place}", *named.confused_with}
    (factor,) = named.parameters.values()
    assert abs(factor.value - size["factor"]) < 4.0 * factor.sigma
    assert max(found.where.component, key=found.where.component.get) == place
    shares = found.where.sensor
    assert shares == by_sensor(c, (c.value - RobotModel(c, robot).predict().values) / c.sigma)
    assert set(shares) == {"gauge", "level", "x", "y", "z"}
    assert found.where.left_by_sensor == {}
    assert sum(shares.values()) == pytest.approx(1.0)

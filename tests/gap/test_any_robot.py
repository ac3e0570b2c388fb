"""Whole diagnoses of robots that the first format did not know: what was planted is named, with its size."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.data import FOLDER
from stiffscope.effects.vocabulary import apply_effect
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.diagnose import diagnose
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.inference.residuals import by_sensor
from stiffscope.gap.lab.faults import inject
from stiffscope.gap.lab.measuring import Noise, Plan, Sensor
from stiffscope.gap.lab.measuring import measure as taken
from stiffscope.gap.lab.response import Spot
from tests.gap.test_robot_model import nominal, readings
from tests.labs import machine


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
    c = measured(robot, apply_effect(robot, effect, place, size), ("dx", "dy", "dz", "ex"), spread)
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


def test_the_campaign_that_the_documentation_works_through_is_the_lab_s():
    """Three gauges and weights on a hook, on a Delta whose second motor is soft."""
    true = inject(machine("delta"), "actuator-stiffness", "leg2.motor", {"factor": 0.72})
    points = {"x": [0.06, 0.02, -1.054], "y": [-0.02, 0.06, -1.054], "z": [0.05, -0.03, -1.069]}
    gauges = (
        Sensor(f"gauge_{a}", "displacement", "platform", np.array(at), np.eye(3)["xyz".index(a)])
        for a, at in points.items()
    )
    weights = [[0.0, 0.0, -49.0], [29.4, 0.0, 0.0], [0.0, 29.4, 0.0]]
    c = load_campaign(FOLDER / "campaigns" / "gauges")
    loads = tuple(("hook", np.array([*weight, 0.0, 0.0, 0.0])) for weight in weights)
    plan = Plan(c.poses, loads, {"hook": Spot("platform", np.array([0.0, 0.0, -1.124]))}, tuple(gauges), False)
    made = taken(true, plan, Noise(displacement=1e-6), np.random.default_rng(17))
    assert len(c) == len(made.value) == 108
    assert np.abs(c.value - made.value).max() < 0.0501e-6  # as read, to a tenth of a micrometre
    assert (c.sigma == 1e-6).all()

"""A body of four interfaces in the diagnosis: readings, derivatives, the laboratory's own mechanics, adoption."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stiffscope.experiments.assembly import assemble
from stiffscope.gap.adoption import adopt
from stiffscope.gap.diagnose import diagnose_campaign
from stiffscope.gap.effects.elements import ElementEffect, change_elements
from stiffscope.gap.effects.vocabulary import apply_effect, find_candidates
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.lab.faults import inject
from stiffscope.lab.machine import machine_of
from stiffscope.lab.measuring import Noise
from stiffscope.lab.plans import draw_plan, workspace
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot
from tests.gap.test_robot_model import displaces, read, readings
from tests.labs import measure
from tests.tripod import tripod

HEAD = {"factor": 0.7}
WARM = {"temperature": 15.0}


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return tripod(tmp_path_factory.mktemp("tripod"), turned=(0.6, 0.8, 0.0))


@cache
def space(path):
    file = load_robot(path)
    return workspace(
        machine_of(file, part_matrices(file)), 24, np.random.default_rng(2)
    )


def weigh(machine, name, factor):
    """The machine with a body of another density."""
    body = machine.bodies[name]
    return machine.change(
        {name: replace(body, mass=factor * body.mass, ends=factor * body.ends)}
    )


def campaign(robot, *faults, **noise):
    """What the laboratory reads of the robot with faults."""
    where = space(robot.robot.path)
    rng = np.random.default_rng(3)
    machine = where.machine
    for effect, place, parameters in faults:
        if effect == "mass":  # no fault of the laboratory's
            machine = weigh(machine, place, **parameters)
        else:
            machine = inject(machine, effect, place, parameters)
    plan = draw_plan(where, rng, poses=8, wrenches=10)[0]
    return measure(machine, plan, Noise(**noise), rng, modelled=("gravity",))


def candidate(robot, effect, place):
    c = readings(robot, ("dx",))
    known = find_candidates(RobotModel(c, robot).setting)
    return next(k for k in known if f"{effect} @ {place}" in (k.name, *k.aliases))


def test_readings_are_those_of_separate_equilibria(robot):
    c = readings(robot)
    assert RobotModel(c, robot).predict().values == pytest.approx(
        read(robot, robot.mechanism, c), rel=1e-8, abs=1e-15
    )


@pytest.mark.parametrize(
    ("word", "value"), [("link-stiffness @ head", 0.6), ("thermal @ head", 4.0)]
)
def test_readings_with_an_effect_are_those_of_the_changed_robot(robot, word, value):
    """By the responses of the sound robot, and by the robot put together anew."""
    c = readings(robot)
    known = candidate(robot, *word.split(" @ "))
    given = tuple(known.internal(np.array([value])))
    model = RobotModel(c, robot)
    changed = change_elements(robot.mechanism, known.action.changes(np.array(given)))
    values = model.predict(((known, given),)).values
    expected = read(robot, changed, c)
    assert np.abs(expected - model.predict().values).max() > 1e-6
    if word.startswith("link"):
        assert model.predict(((known, given),)).elastic_state._response.cuts
        assert values == pytest.approx(expected, rel=1e-8, abs=1e-15)
    else:  # beyond the first order: the ends have moved
        assert values == pytest.approx(expected, rel=1e-3, abs=1e-8)


def test_derivatives_are_those_of_full_reassembly(robot):
    c = readings(robot, ("dx", "ey", "kz", "prx"), [robot.robot.poses["tilted"]])
    model = RobotModel(c, robot)
    prediction = model.predict()
    seen = set()
    for known in find_candidates(model.setting):
        if "head" not in known.members or not isinstance(known.action, ElementEffect):
            continue
        (size,) = known.scale
        steps = [np.array([s]) for s in (3e-4 * size, -3e-4 * size)]
        if displaces(known):  # loads and gauges move with it
            ends = [model.predict(((known, tuple(step)),)).values for step in steps]
        else:
            ends = [
                read(
                    robot, change_elements(robot.mechanism, known.action.changes(s)), c
                )
                for s in steps
            ]
        change = (ends[0] - ends[1]) / (6e-4 * size)
        assert prediction.columns(known)[:, 0] == pytest.approx(
            change, rel=2e-3, abs=1e-5 * np.abs(change).max()
        )
        seen.add(known.effect)
    assert seen == {"link-stiffness", "thermal"}


@pytest.mark.parametrize(
    ("effect", "place", "parameters"),
    [
        ("link-stiffness", "head", HEAD),
        ("thermal", "robot", WARM),
        ("mass", "head", {"factor": 2.0}),
        ("mass", "head", {"factor": 0.2}),
    ],
)
def test_the_laboratory_reads_what_the_model_predicts(robot, effect, place, parameters):
    """Two mechanics that share no code: a frame of multipliers, and the condensed network."""
    quiet = campaign(
        robot, (effect, place, parameters), displacement=1e-12, rotation=1e-12
    )
    known = candidate(robot, effect, place)
    given = tuple(known.internal(np.array(list(parameters.values()))))
    model = RobotModel(quiet, robot)
    change = np.abs(model.predict().values - quiet.value).max()
    assert change > 1e-6
    assert np.abs(model.predict(((known, given),)).values - quiet.value).max() < max(
        2e-3 * change, 2e-9
    )


@pytest.mark.extended
def test_a_soft_head_is_found_adopted_and_found_no_more(robot, tmp_path):
    seen = campaign(
        robot, ("link-stiffness", "head", HEAD), displacement=2e-7, rotation=1e-6
    )
    found = diagnose_campaign(seen, robot)
    assert found.verdict == "identified"
    (effect,) = found.effects
    assert (effect.effect, effect.place) == ("link-stiffness", "star")
    assert effect.parameters["factor"].value == pytest.approx(0.7, rel=0.02)
    adopt(
        tmp_path / "soft.toml",
        robot.robot,
        robot,
        found,
        campaign="c",
        components="file",
    )
    file = load_robot(tmp_path / "soft.toml")
    again = diagnose_campaign(seen, NominalRobot(assemble(file), file))
    assert again.verdict == "no-gap"


def test_words_for_what_has_a_length_do_not_act_on_more_ends(robot):
    words = {
        k.effect
        for k in find_candidates(RobotModel(readings(robot, ("dx",)), robot).setting)
        if "head" in k.members
    }
    assert words == {"mass", "link-stiffness", "thermal"}
    softer = (
        apply_effect(robot, "part-compliance", "head", {"factor": 2.0})
        .mechanism.body("head")
        .elastic
    )
    np.testing.assert_allclose(
        softer.compliance, 2.0 * robot.elastic_sources["head"].compliance
    )

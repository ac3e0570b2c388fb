"""A planned hammer test resolves its question, and its campaign is valid; measured, it names the cause."""

import json

import numpy as np
import pytest

from stiffscope.cli.main import _guarded
from stiffscope.gap.campaign.campaign_header import load_header
from stiffscope.gap.campaigns import diagnose
from stiffscope.lab.closure import locate
from stiffscope.lab.faults import inject
from stiffscope.lab.hammer import (
    MODES,
    HammerNoise,
    HammerPlan,
    record,
    space_lines,
    strike,
    triaxial,
    write_responses,
)
from stiffscope.lab.machine import machine_of
from stiffscope.lab.response import Spot
from stiffscope.responses.model import Direction
from stiffscope.responses.tables import read_direction
from stiffscope.responses.uff_writing import write_uff
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot

pytestmark = pytest.mark.slow


@pytest.mark.long
def test_a_planned_test_names_what_it_is_planned_for(tmp_path):
    goal = tmp_path / "test"
    facts = tmp_path / "plan.json"
    order = ["campaign", "new", "serial-arm", "--ask", "J2 from base"]
    done = _guarded(
        [*order, "--with", "hammer", "--out", str(goal), "--json", str(facts)]
    )
    assert done == 0
    plan = json.loads(facts.read_text())["plan"]
    asked = [pair for pair in plan["pairs"] if pair["asked"]]
    assert asked
    assert all(p["ln_odds"] >= plan["enough"] and not p["hidden"] for p in asked)
    assert {setup.name for setup in load_header(goal).responses} == {*plan["bands"]}
    robot = load_robot("serial-arm")
    machine = machine_of(robot, part_matrices(robot, "beam"))
    faulty = inject(machine, "actuator-stiffness", "J2", {"factor": 0.7})
    noise = HammerNoise()
    rng = np.random.default_rng(2)
    damping = noise.draw_damping(rng, MODES)
    points = {
        name: Spot(at["body"], np.array(at["at"]))
        for name, at in plan["points"].items()
    }
    for pose, (low, high) in plan["bands"].items():
        rows = []
        for tap in plan["hits"]:
            if tap["pose"] != pose:
                continue
            test = HammerPlan(
                poses=np.array([robot.poses[pose]]),
                points=points,
                hits=(read_direction(tap["force"]),),
                motions=tuple(d for point in tap["listen"] for d in triaxial(point)),
                hertz=space_lines(low, high, 1000),
            )
            true = strike(faulty, test, locate(machine, test.poses), damping)
            rows += record(true, test, noise, rng)[0]
        places = {name: spot.at for name, spot in points.items()}
        write_uff(goal / f"{pose}.uff", rows, places)
    found = diagnose(goal)
    assert found.effects
    assert "actuator-stiffness @ J2" in {
        name
        for e in found.effects
        for name in (f"{e.effect} @ {e.place}", *e.confused_with)
    }
    assert not any(e.effect == "base-compliance" for e in found.effects)


def test_one_accelerometer_says_what_it_tells_and_what_not(tmp_path, capsys):
    """The hits and channels of a campaign, no others, and each cause in a line."""
    robot = load_robot("five-bar")
    machine = machine_of(robot, part_matrices(robot, "beam"))
    pose = list(robot.poses)[-1]
    test = HammerPlan(
        poses=np.array([robot.poses[pose]]),
        points={"1": Spot(machine.tool, machine.at)},
        hits=(Direction("1", 0),),
        motions=triaxial("1"),
        hertz=space_lines(5.0, 400.0, 100),
    )
    true = strike(machine, test, locate(machine, test.poses), np.array([0.01]))
    noise = record(true, test, HammerNoise(), np.random.default_rng(1))
    own = tmp_path / "own"
    write_responses(
        own, test, noise, robot="five-bar", names={"tap": pose}, components="beam"
    )
    facts = tmp_path / "plan.json"
    order = ["campaign", "new", "five-bar", "--ask", "all", "--with", str(own)]
    goal = str(tmp_path / "test")
    assert _guarded([*order, "--out", goal, "--json", str(facts)]) == 0
    plan = json.loads(facts.read_text())["plan"]
    assert [hit["force"] for hit in plan["hits"]] == ["1:+x"]
    assert {*plan["points"]} == {"1"}
    names = {pair["first"] for pair in plan["pairs"]}
    told = capsys.readouterr().out
    assert f"Of {len(names)} causes" in told
    seen = {p["first"] for p in plan["pairs"] if p["ln_odds"] >= plan["enough"]}
    missing = told.split("do not show.")[1]
    assert not any(f" {name}," in missing for name in seen)


@pytest.mark.extended
def test_a_question_that_no_hit_answers_is_refused(tmp_path, capsys):
    order = ["campaign", "new", "stewart", "--ask", "thermal", "--with", "hammer"]
    assert _guarded([*order, "--out", str(tmp_path / "test")]) == 2
    assert "--ask: expected causes that readings show" in capsys.readouterr().err
    assert not (tmp_path / "test").exists()

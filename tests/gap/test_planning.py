"""A plan answers its question: what it promises is what least squares leave, and its readings name the cause."""

import csv

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.gap.campaign.campaign_header import load_header
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.campaign.template import write_template
from stiffscope.gap.diagnose import diagnose_campaign
from stiffscope.gap.planning.candidates import ENOUGH, propose_plan, read_question
from stiffscope.gap.planning.reading_choice import Pair, choose_readings, judge_pairs
from stiffscope.lab import measuring
from stiffscope.lab.blind.laboratory import BlindRobot, Lab
from stiffscope.lab.faults import inject
from stiffscope.lab.response import Spot
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def lab():
    robot = load_robot("five-bar")
    parts = part_matrices(robot, "beam")
    return Lab(
        BlindRobot(NominalRobot(mechanism_of(robot, parts), robot), parts, "beam"), 4
    )


@pytest.fixture(scope="module")
def proposal(lab):
    return propose_plan(lab.robot.nominal, "base-compliance from actuator-stiffness")


def fill(folder, plan, machine, rng):
    """Take a plan's readings in the virtual laboratory."""
    sensors = tuple(
        measuring.Sensor(
            s.name, s.measures, s.body, np.array(s.at), np.array(s.direction), s.against
        )
        for s in plan.sensors
    )
    loads = [
        (plan.hooks[h].name, np.concatenate([f, np.zeros(3)]))
        for h, f in plan.pulls
        if h >= 0
    ]
    hooks = {hook.name: Spot(hook.body, np.array(hook.at)) for hook in plan.hooks}
    read = measuring.measure(
        machine,
        measuring.Plan(plan.poses, tuple(loads), hooks, sensors),
        measuring.Noise(),
        rng,
    )
    order = [k for k, (hook, _) in enumerate(plan.pulls) if hook >= 0]
    known = {
        (p, order[k] if k >= 0 else -1, c): v
        for p, k, c, v in zip(
            read.pose.tolist(),
            read.load.tolist(),
            read.channel.tolist(),
            read.value,
            strict=True,
        )
    }
    with (folder / "readings.csv").open() as file:
        rows = list(csv.DictReader(file))
    for row, (pose, pull, sensor) in zip(rows, plan.settings.tolist(), strict=True):
        assert row["sensor"] == plan.sensors[sensor].name
        row["value"] = repr(
            float(known[pose, pull if plan.pulls[pull][0] >= 0 else -1, sensor])
        )
    with (folder / "readings.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


@pytest.mark.extended_for(
    "base-compliance-base-parameters0", "actuator-stiffness-left.motor-parameters1"
)
@pytest.mark.parametrize(
    ("effect", "place", "parameters"),
    [
        ("base-compliance", "base", {"rz": 2e-5}),
        ("actuator-stiffness", "left.motor", {"factor": 0.8}),
    ],
)
def test_a_plan_s_question_is_answered_by_its_readings(
    effect, place, parameters, lab, proposal, tmp_path
):
    folder = tmp_path / "plan"
    _, readings = write_template(
        lab.robot.nominal.robot, "five-bar", folder, proposal.plan
    )
    assert readings < 64
    fill(
        folder,
        proposal.plan,
        inject(lab.sound, effect, place, parameters),
        np.random.default_rng(4),
    )
    found = diagnose_campaign(load_campaign(folder), lab.robot.nominal)
    assert [(e.effect, e.place) for e in found.effects] == [(effect, place)]
    assert found.verdict == "identified"


def test_only_the_instruments_that_are_there_are_planned(lab, tmp_path):
    sensors = "[sensors.dial]\nmeasures = 'displacement'\n"
    sensors += "body = 'left.outer.tip'\nat = [0, '1 mm', 0]\ndirection = [0, 1, 0]\n"
    (tmp_path / "campaign.toml").write_text(
        f'robot = "five-bar"\nreadings = "r.csv"\n{sensors}'
    )
    made = propose_plan(
        lab.robot.nominal, "left.motor from base", load_header(tmp_path)
    )
    assert {sensor.name for sensor in made.plan.sensors} == {"dial"}
    (tmp_path / "campaign.toml").write_text(
        'robot = "five-bar"\nreadings = "r.csv"\nframes.t.pose = "unknown"\n[sensors.p]\nmeasures = "position"\n'
        'frame = "t"\nbody = "left.outer.tip"\nat = [0, 0, 0]\n'
    )
    with pytest.raises(
        InputError,
        match=r"sensors\.p\.x\.measures: expected displacement or rotation in a plan",
    ):
        propose_plan(lab.robot.nominal, "left.motor from base", load_header(tmp_path))


def test_the_forces_of_a_campaign_are_those_that_are_planned(lab, tmp_path):
    """What larger pulls resolve is proved by planning with them."""
    header = (
        'robot = "five-bar"\nreadings = "r.csv"\n[sensors.dial]\nmeasures = "displacement"\n'
        'body = "left.outer.tip"\nat = [0, "1 mm", 0]\ndirection = [0, 1, 0]\n'
        '[loads.hook]\nbody = "left.outer.tip"\nat = [0, 0, 0]\n'
    )
    robot = lab.robot.nominal.robot
    names = ",".join(robot.tool.pose)
    zeros = ",".join(f"{value!r}" for value in robot.home)

    def propose(newtons):
        (tmp_path / "campaign.toml").write_text(header)
        (tmp_path / "r.csv").write_text(
            f"{names},load,fy,sensor,value\n{zeros},hook,{newtons},dial,\n"
        )
        campaign = load_campaign(tmp_path, robot, planned=True)
        made = propose_plan(lab.robot.nominal, "left.motor from base", campaign)
        forces = {tuple(force) for hook, force in made.plan.pulls if hook >= 0}
        assert forces == {(0.0, newtons, 0.0)}
        return {(p.first, p.second): p for p in made.pairs}

    weak = propose(2.0)
    strong = propose(10.0)
    cured = [key for key, pair in weak.items() if pair.hidden and pair.larger == 5.0]
    assert cured
    assert not any(strong[key].hidden for key in cured)


def test_every_pair_of_the_question_reaches_its_ln_odds(proposal):
    asked = [pair for pair in proposal.pairs if pair.asked]
    assert asked
    assert all(pair.log_odds >= ENOUGH or pair.hidden for pair in proposal.pairs)


def test_what_readings_add_is_what_least_squares_leave():
    """Against an augmented least-squares fit, in which the rival's prior stands as rows of their own."""
    rng = np.random.default_rng(3)
    own = rng.standard_normal(30)
    rival = rng.standard_normal((30, 3))
    pair = Pair("a", "b", "p", own, rival)
    rows = [3, 7, 8, 20, 29]
    for row in rows:
        pair.add(row)
    a = np.vstack([rival[rows], 0.1 * np.eye(3)])
    y = np.append(own[rows], np.zeros(3))
    left = y - a @ np.linalg.lstsq(a, y, rcond=None)[0]
    assert pair.log_odds == pytest.approx(0.5 * left @ left)
    assert judge_pairs([pair], rows) == pytest.approx(pair.log_odds)


def test_no_reading_of_a_choice_is_in_vain():
    rng = np.random.default_rng(5)
    pairs = [
        Pair("a", f"b{k}", "p", rng.standard_normal(60), rng.standard_normal((60, 2)))
        for k in range(6)
    ]
    settings = np.column_stack(
        [np.arange(60) // 20, np.arange(60) // 5 % 4, np.arange(60) % 5]
    )
    rows = choose_readings(pairs, settings, ENOUGH)
    assert (judge_pairs(pairs, rows) >= ENOUGH).all()
    for row in rows:
        rest = [other for other in rows if other != row]
        assert (judge_pairs(pairs, rest) < ENOUGH).any()


def test_questions_name_effects_places_and_patterns():
    known = (
        "base-compliance @ base",
        "actuator-stiffness @ J1",
        "actuator-stiffness @ J2",
        "payload @ tool",
    )
    assert read_question("base from actuator-stiffness", known) == (
        known[:1],
        known[1:3],
    )
    assert read_question("*@ J1, payload from base-*", known) == (
        (known[1], known[3]),
        known[:1],
    )
    assert read_question("all", known) == (known, known)
    causes = "--ask: expected causes that readings show of this robot"
    for question, got in (
        ("base from colum", "'colum'"),
        ("", "none in ''"),
        ("J2,", "none in 'J2,'"),
        ("[", "'\\['"),
        ("J2 from ", "none in ''"),
    ):
        with pytest.raises(
            InputError,
            match=rf"^{causes}, got {got} \(base-compliance, base, .*payload, tool\)$",
        ):
            read_question(question, known)
    for question in ("J2 from J2", "J1, base from base-compliance,J1"):
        with pytest.raises(
            InputError,
            match=r"^--ask: expected other causes after from than before, got",
        ):
            read_question(question, known)

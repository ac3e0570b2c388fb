"""Is the right parameter of a part found, with an honest interval, where a new virtual experiment is the truth?

``STIFFSCOPE_CAMPAIGNS=45 STIFFSCOPE_SEED=1 pytest -m benchmark -s tests/benchmarks/test_part_dimensions.py``.
The part that is planted is built, meshed and tested at the planted value; the virtual lab reads the machine with its
matrix, by mechanics of its own, at M or by five gauges and a hook; half of the machines have a soft drive besides. What
counts is where ln-odds of the parameter, beside the soft drive, exceed EVIDENT.

The five-bar's tubes have thicker walls than in its file, which take less time to mesh. ``STIFFSCOPE_KEPT`` names a
folder for the experiments, which are most of the time of a first run.

Measured with that command: 38 of 41 right, 29 of 32 intervals hold the value; the other three have four causes alike.
"""

import math
import os
import time
from dataclasses import dataclass

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.experiments import part_dimensions
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.experiments.experiments import solve_parts
from stiffscope.experiments.orders import order_part
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.diagnose import conclude
from stiffscope.gap.effects.part_dimension import find_dimensions
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.inference.find import find
from stiffscope.lab.blind.laboratory import BlindRobot, Lab
from stiffscope.lab.blind.scores import EVIDENT
from stiffscope.lab.faults import ENTRIES, inject
from stiffscope.lab.measuring import Noise, measure, write_readings
from stiffscope.lab.plans import draw_plan
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_dimensions import FOUNDATION, part_parameters, with_parameter
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.workshop import workshop

pytestmark = pytest.mark.slow

CAMPAIGNS, SEED = (
    int(os.environ.get(f"STIFFSCOPE_{name}", value))
    for name, value in (("CAMPAIGNS", 18), ("SEED", 1))
)
KEPT = os.environ.get("STIFFSCOPE_KEPT")
ROBOTS = {"biglide": (), "five-bar": ("inner.bore=12mm", "outer.bore=0mm")}
STYLES = ("tool", "gauges")
OFF = (0.03, 0.15)  # of a parameter, to either side
FOUNDATIONS = (2e10, 5e11)  # N/m³
SOFTER = (0.6, 0.9)  # times a drive's stiffness


@dataclass(frozen=True)
class Answer:
    """What a campaign's diagnosis says of the parameter that was planted, and of the soft drive beside it."""

    odds: float
    right: bool
    covered: tuple[bool, ...]
    """Of the parameter, where it is named itself."""
    beside: tuple[bool, ...]
    """Of the drive, likewise."""


def planted(number, robot):
    """Part, parameter and value of a campaign, and whether a drive is soft besides."""
    places = [
        (part, key)
        for part in robot.parts
        for key in (*part_parameters(robot, part), FOUNDATION)
    ]
    part, key = places[number % len(places)]
    rng = np.random.default_rng([SEED, number])
    if key == FOUNDATION:
        return part, key, float(np.exp(rng.uniform(*np.log(FOUNDATIONS)))), rng
    nominal = part_parameters(robot, part)[key][0]
    while True:  # Poisson's ratio may leave what there is
        value = float(nominal * (1.0 + rng.choice([-1, 1]) * rng.uniform(*OFF)))
        try:
            order_part(with_parameter(robot, part, key, value), part)
        except InputError:
            continue
        return part, key, value, rng


def answered(name, number, lab, folder, shop):
    """The answer to one campaign, and a line about it."""
    robot = lab.robot.nominal.robot
    style = STYLES[number % 2]
    part, key, value, rng = planted(number, robot)
    label = f"{part}.{key}"
    (tested,) = solve_parts(
        [order_part(with_parameter(robot, part, key, value), part, label=label)],
        shop,
        whole=False,
    )
    compliance = tested.experiment.compliance
    entries = {
        entry: float(compliance[int(entry[1]) - 1, int(entry[2]) - 1])
        for entry in ENTRIES
    }
    machine = inject(lab.sound, "part-dimension", label, entries)
    truth = {f"part-dimension @ {label}": {"value": value}}
    if number // 2 % 2:
        drive = str(rng.choice(lab.places("actuator-stiffness")))
        factor = float(rng.uniform(*SOFTER))
        machine = inject(machine, "actuator-stiffness", drive, {"factor": factor})
        truth[f"actuator-stiffness @ {drive}"] = {"factor": factor}
    plan, located = draw_plan(lab.workspace, rng, style)
    write_readings(
        measure(machine, plan, Noise(), rng, located),
        folder,
        robot=name,
        pose=machine.pose,
        components="fea",
    )
    model = RobotModel(load_campaign(folder), lab.robot.nominal)
    begun = time.perf_counter()
    found = find(model)
    diagnosis = conclude(found)
    taken = time.perf_counter() - begun
    odds = _odds(found, lab.robot.nominal, truth)
    own, *rest = truth
    names = {f"{e.effect} @ {e.place}": e for e in diagnosis.effects}
    right = any(own in (effect, *e.confused_with) for effect, e in names.items())
    inside = [
        tuple(_covered(names[each], truth[each])) if each in names else ()
        for each in truth
    ]
    said = "; ".join(
        f"{effect} ({', '.join(e.confused_with)}) {' '.join(_fitted(p) for p in e.parameters.values())}"
        for effect, e in names.items()
    )
    line = (
        f"{number:3d} {name:8s} {style:6s} {label} = {value:.6g} {' + '.join(['', *rest])}| ln-odds {odds:7.1f} "
        f"{'right' if right else 'WRONG'} {diagnosis.verdict} {taken:.1f} s | {said} | {inside}"
    )
    return Answer(odds, right, inside[0], inside[1] if rest else ()), line


def _odds(found, nominal, truth):
    """Ln-odds of the planted parameter against its absence, beside what else was planted."""
    own, *rest = truth
    candidates = [
        c
        for c in found.model.library
        if c.name in rest or set(rest) & {*c.aliases, *c.signature_of[1:]}
    ]
    part = own.split(" @ ")[1].split(".")[0]
    new = next(c for c in find_dimensions(nominal, part) if c.name == own)
    start = np.array(
        [
            v
            for c in candidates
            for v in c.internal(np.array(list(truth[rest[0]].values())))
        ]
    )
    without = found.problem.fit(candidates, start)
    both = np.concatenate([start, new.internal(np.array([truth[own]["value"]]))])
    return found.problem.fit([*candidates, new], both).evidence - without.evidence


def _covered(effect, truth):
    for name, fit in effect.parameters.items():
        low, high = fit.interval
        yield low <= truth[name] <= high


def _fitted(fit):
    return f"{fit.value:.5g} [{fit.interval[0]:.5g}, {fit.interval[1]:.5g}]"


@pytest.mark.benchmark
@pytest.mark.timeout(7200)
def test_planted_parameters_of_parts_are_found_with_honest_intervals(
    tmp_path, monkeypatch
):
    if KEPT:
        monkeypatch.setenv("STIFFSCOPE_CACHE", KEPT)
    answers = {}
    with workshop() as shop:
        labs = {name: _lab(name, overrides, shop) for name, overrides in ROBOTS.items()}
        for number in range(CAMPAIGNS):
            name = list(ROBOTS)[number % len(ROBOTS)]
            answer, line = answered(
                name, number // len(ROBOTS), labs[name], tmp_path / str(number), shop
            )
            answers.setdefault(name, []).append(answer)
            print(line, flush=True)
    print("robot     ln-odds > 10   right            interval holds it    of the drive")
    for name, some in {
        **answers,
        "all": [a for each in answers.values() for a in each],
    }.items():
        right, covered, beside = scores(some)
        print(
            f"{name:8s} {len(right):4d} of {len(some):4d}   {_share(right)}   {_share(covered)}   {_share(beside)}"
        )
    assert np.mean(right) >= 0.9
    assert np.mean(covered) >= 0.9


def scores(answers):
    """Flags of what is evident: right; intervals of parameters that hold; those of drives."""
    evident = [a for a in answers if a.odds > EVIDENT]
    return (
        [a.right for a in evident],
        [c for a in evident for c in a.covered],
        [c for a in evident for c in a.beside],
    )


def _lab(name, overrides, shop):
    robot = load_robot(name, overrides)
    nominal = assemble_robots({name: robot}, "fea", shop)[name]
    carrying = NominalRobot(
        nominal.mechanism, robot, part_dimensions.tested_dimensions(nominal, shop)
    )
    return Lab(BlindRobot(carrying, nominal.matrices, "fea"), 36)


def _share(flags):
    return f"{sum(flags):3d} of {len(flags):3d} ({np.mean(flags) if flags else math.nan:.0%})"

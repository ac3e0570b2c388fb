"""Speed of the diagnosis: the search alone, a hexapod with its whole library, a campaign filled in by a lab."""

import csv
import resource
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from stiffscope.gap.campaign import template as campaign_template
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.campaigns import open_case
from stiffscope.gap.diagnose import conclude, diagnose_campaign
from stiffscope.gap.effects.vocabulary import apply_effect
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.inference.find import find
from stiffscope.lab.blind.laboratory import Lab
from stiffscope.lab.faults import inject
from stiffscope.lab.measuring import Noise, measure, true_readings, write_readings
from stiffscope.lab.plans import draw_plan
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.reader import load_robot
from tests.gap.synthetic import linear_model
from tests.gap.test_inference import planted
from tests.lab.test_blind import blind_robot

pytestmark = pytest.mark.slow

POSES = 111
STANCES = 32  # of the hexapod, and of a template
FAULTS = (
    (
        "platform-compliance",
        "tool",
        {"x": 1e-7, "y": 5e-8, "z": 8e-8, "rx": 1e-6, "ry": 8e-7, "rz": 4e-7},
    ),
    ("instrument-misalignment", "instrument", {"rx": 0.01, "ry": -0.015, "rz": 0.008}),
    ("actuator-stiffness", "drives", {"factor": 0.8}),
    ("encoder-offset", "strut3.drive", {"offset": 6e-5}),
)


def now():
    """Wall time, processor time of this process and processor time of its children, s."""
    return np.array(
        [
            time.perf_counter(),
            time.process_time(),
            resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime,
        ]
    )


@pytest.mark.benchmark
@pytest.mark.parametrize(("poses", "loads", "effects"), [(111, 12, 200), (14, 6, 200)])
def test_four_effects_among_two_hundred(poses, loads, effects):
    """On a linear forward model that costs nothing itself."""
    model = linear_model(np.random.default_rng(1), poses, loads, effects)
    model = planted(model, e0=(0.2,), e7=(0.1, 0.1), e20=(0.1, -0.1, 0.2), e51=(0.15,))
    before = now()
    diagnosis = conclude(find(model))
    wall, taken, _ = now() - before
    print(
        f"{len(model.campaign)} readings, {effects} effects: {taken:.1f} s of processor ({wall:.1f} s)"
    )
    assert {e.effect for e in diagnosis.effects} == {
        "effect-0",
        "effect-7",
        "effect-20",
        "effect-51",
    }


@pytest.mark.benchmark
@pytest.mark.parametrize(
    "faults", [FAULTS[:1], FAULTS], ids=["one effect", "four effects"]
)
def test_eight_thousand_readings_of_a_hexapod(faults, tmp_path):
    lab = Lab(blind_robot("stewart"), POSES)
    rng = np.random.default_rng(3)
    plan, located = draw_plan(lab.workspace, rng, poses=POSES, wrenches=11)
    machine = lab.sound
    for fault in faults:
        machine = inject(machine, *fault)
    alike = true_readings(machine, plan, located)
    write_readings(
        measure(machine, plan, Noise(), rng, located),
        tmp_path,
        robot="stewart",
        pose=machine.pose,
        components="beam",
    )
    before = now()
    campaign = load_campaign(tmp_path)
    after = now()
    found = diagnose_campaign(campaign, lab.robot.nominal)
    read = after - before
    taken = now() - after
    library = RobotModel(campaign, lab.robot.nominal).library
    print(
        f"{len(alike.value)} readings, {len(library)} effects and patterns: {taken[1]:.1f} s of processor "
        f"({taken[0]:.1f} s), and {read[1]:.1f} s to read them; {found.verdict}: "
        f"{[(e.effect, e.place, e.confused_with) for e in found.effects]}"
    )
    assert (
        found.effects[0].effect == "platform-compliance"
    )  # the last two have more than two twins


@pytest.mark.benchmark
@pytest.mark.parametrize("robot", ["biglide", "delta"])
def test_a_template_filled_in(robot, tmp_path, monkeypatch):
    """As a command, of 512 readings; parts by virtual experiments that are in the cache (the first run makes them)."""
    monkeypatch.setattr(campaign_template, "POSES", STANCES)
    folder = tmp_path / "campaign"
    file = load_robot(robot)
    campaign_template.write_template(file, robot, folder)
    case = open_case(folder, planned=True)
    blind = blind_robot(robot)
    drive = next(iter(blind.nominal.driven))
    soft = apply_effect(
        NominalRobot(blind.nominal.mechanism, file),
        "actuator-stiffness",
        drive,
        {"factor": 0.7},
    )
    empty = replace(
        case.campaign, value=np.zeros(len(case.campaign))
    )  # an inclinometer's zero is what it reads
    values = RobotModel(empty, soft).predict().values
    values = values + case.campaign.sigma * np.random.default_rng(1).standard_normal(
        len(values)
    )
    with (folder / "readings.csv").open(newline="") as text:
        rows = list(csv.DictReader(text))
    with (folder / "readings.csv").open("w", newline="") as text:
        writer = csv.DictWriter(text, list(rows[0]))
        writer.writeheader()
        writer.writerows(
            {**row, "value": float(value)}
            for row, value in zip(rows, values, strict=True)
        )
    for k in range(2):
        before = now()
        command = [
            sys.executable,
            "-m",
            "stiffscope",
            "diagnose",
            str(folder),
            "--out",
            str(tmp_path / f"out{k}"),
        ]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        wall, _, taken = now() - before
        print(
            f"{robot}, {len(values)} readings, run {k + 1}: {taken:.1f} s of processor ({wall:.1f} s): "
            f"{done.stdout.strip().splitlines()[0]}"
        )

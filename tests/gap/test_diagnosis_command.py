"""`stiffscope diagnose`: what it writes and says, the robot file that carries the answer, and what it refuses."""

import csv
import errno
import json
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

import stiffscope as ss
from stiffscope.cli.main import _guarded
from stiffscope.cli.output import Output, emit
from stiffscope.gap import command as campaigns
from stiffscope.gap.campaigns import diagnose
from stiffscope.lab import measuring
from stiffscope.lab.faults import inject
from stiffscope.lab.measuring import Noise, write_readings
from stiffscope.robot.library import find_robot
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.statics.yielding import Load, respond
from tests.labs import biglide, default_plan

pytestmark = pytest.mark.slow

POSE = ("x", "y", "z", "rx", "ry", "rz")


def measured(machine, folder, seed, robot="biglide"):
    rng = np.random.default_rng(seed)
    readings = measuring.measure(machine, default_plan(machine, rng), Noise(), rng)
    write_readings(readings, folder, robot=robot, pose=machine.pose)


@pytest.fixture(scope="module")
def soft_drive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab") / "soft-drive"
    measured(
        inject(biglide(), "actuator-stiffness", "limb1", {"factor": 0.8}), folder, 5
    )
    return folder


def test_the_published_experiment(tmp_path, capsys):
    out = tmp_path / "out"
    assert _guarded(["diagnose", "published", "--out", str(out), "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found | {"made_by": "stiffscope"} == json.loads(
        (out / "diagnosis.json").read_text()
    )
    assert found["verdict"] == "identified"
    page = (out / "report.html").read_text()
    assert (
        page.count('<img alt="')
        == page.count('src="data:image/')
        == len(re.findall("<img[^>]* src=", page))
        == 6
    )
    assert "scale (all)" in page
    listed = json.loads((out / "manifest.json").read_text())
    assert sorted([*listed["files"], "manifest.json"]) == sorted(
        p.name for p in out.iterdir()
    )
    assert set(listed["inputs"]) == {"campaign.toml", "readings.csv"}


def test_what_is_adopted_is_written_though_nobody_reads_the_tables():
    """`diagnose … --adopt FILE | head`: the tables meet a closed pipe, at which rich ends the process."""
    written = []

    def stop():
        raise SystemExit

    with pytest.raises(SystemExit):
        emit(Output(), {}, stop, also=lambda: written.append("adopted"))
    assert written


@pytest.mark.extended
def test_nothing_is_adopted_where_the_results_cannot_be_written(
    soft_drive, tmp_path, monkeypatch, capsys
):
    def fill_disk(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(campaigns, "write_posterior", fill_disk)
    words = [
        "diagnose",
        str(soft_drive),
        "--out",
        str(tmp_path / "out"),
        "--adopt",
        str(tmp_path / "adopted.toml"),
        "--quiet",
    ]
    assert _guarded(words) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_an_adopted_effect_closes_the_gap(soft_drive, tmp_path, capsys):
    found = tmp_path / "found"
    adopted = tmp_path / "adopted.toml"
    assert (
        _guarded(
            ["diagnose", str(soft_drive), "--out", str(found), "--adopt", str(adopted)]
        )
        == 0
    )
    said = capsys.readouterr().out
    assert said.splitlines()[1].startswith(
        "Identified: actuator stiffness (limb1), factor 0.8"
    )
    assert "# Tables 1 to 3" in adopted.read_text()  # comments are kept
    (effect,) = load_robot(adopted).effects
    value = json.loads((found / "diagnosis.json").read_text())["effects"][0][
        "parameters"
    ]["factor"]["value"]
    assert effect.parameters == {"factor": value}
    assert effect.provenance["campaign"] == "soft-drive"
    assert effect.provenance["gap_before"] > effect.provenance["gap_after"]
    header = (
        (soft_drive / "campaign.toml")
        .read_text()
        .replace('"biglide"', '"../adopted.toml"')
    )
    again = tmp_path / "again"
    again.mkdir()
    (again / "campaign.toml").write_text(header)
    (again / "readings.csv").write_bytes((soft_drive / "readings.csv").read_bytes())
    assert diagnose(again).verdict == "no-gap"
    page = (found / "report.html").read_text()
    assert page.count('src="data:image/svg+xml') == 6
    data = json.loads(
        page.partition('<script type="application/json">')[2].partition("</script>")[0]
    )
    assert data["quantity"] == "share of the gap"
    assert "limb1.actuator" in data["elements"]
    sizes = [float(pose["cases"][0]["note"].split()[1]) for pose in data["poses"]]
    assert sizes == sorted(sizes, reverse=True)
    assert len(sizes) == len(
        json.loads((found / "diagnosis.json").read_text())["where"]["poses"]
    )


@pytest.mark.extended
def test_pictures_of_a_diagnosis_are_kept(soft_drive, tmp_path):
    """The same readings show the same; others, whose answer is the same, have figures of their own."""
    other = tmp_path / "other"
    shutil.copytree(soft_drive, other)
    table = (other / "readings.csv").read_text().splitlines(keepends=True)
    (other / "readings.csv").write_text("".join(table[:-1]))
    reused = []
    for k, campaign in enumerate((soft_drive, soft_drive, other)):
        assert (
            _guarded(
                ["diagnose", str(campaign), "--out", str(tmp_path / f"{k}"), "--quiet"]
            )
            == 0
        )
        results = json.loads((tmp_path / f"{k}" / "manifest.json").read_text())[
            "results"
        ]
        reused.append({name: each["reused"] for name, each in results.items()})
    assert reused[1:] == [
        {"figures": True, "robot": True},
        {"figures": False, "robot": False},
    ]
    first, second = (
        {f.name: f.read_bytes() for f in (tmp_path / k).glob("*.[ps][nv]g")}
        for k in "01"
    )
    assert len(first) == 13
    assert first == second
    assert json.loads((tmp_path / "0/diagnosis.json").read_text()) == json.loads(
        (tmp_path / "1/diagnosis.json").read_text()
    )


@pytest.mark.long
def test_gravity_and_expansion_come_from_the_robot_file(tmp_path):
    machine = biglide(
        "gravity.acceleration=3.71 m/s^2", "materials.steel.expansion=23.6e-6 1/K"
    )
    folder = tmp_path / "mars"
    measured(
        inject(machine, "thermal", "links", {"temperature": 9.0}),
        folder,
        3,
        "mars.toml",
    )
    text = find_robot("biglide").read_text(encoding="utf-8")
    for old, new in (("9.81 m/s^2", "3.71 m/s^2"), ("11.7e-6 1/K", "23.6e-6 1/K")):
        assert old in text
        text = text.replace(old, new)
    (folder / "mars.toml").write_text(text, encoding="utf-8")
    assert (
        _guarded(["diagnose", str(folder), "--out", str(tmp_path / "out"), "--quiet"])
        == 0
    )
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    names = {e["effect"]: e["parameters"] for e in found["effects"]}
    group = {
        *names,
        *(
            other.split(" @ ")[0]
            for e in found["effects"]
            for other in e["confused_with"]
        ),
    }
    assert "thermal" in group
    assert found["gap"]["held_out"] < 1.1 * found["gap"]["noise"]
    if "thermal" in names:
        temperature = names["thermal"]["temperature"]
        assert temperature["value"] == pytest.approx(9.0, abs=4 * temperature["sigma"])
    else:
        error = names["link-length"]["error"]
        assert error["value"] == pytest.approx(
            9.0 * 23.6e-6 * 0.5, abs=4 * error["sigma"]
        )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["nosuch"],
            "no such campaign; give a folder with a campaign.toml or one of the names",
        ),
        (["published", "--adopt", "robot.toml"], "predictions instead of one"),
        (
            ["SOFT", "--adopt", "notes.toml"],
            "--adopt: notes.toml: expected a file that is not there yet, got one that is",
        ),
        (
            ["SOFT", "--adopt", "nosuch/robot.toml"],
            "--adopt: nosuch/robot.toml: cannot be written",
        ),
        (
            ["NOROBOT"],
            "campaign.toml:1: robot: expected a robot file, seen from its folder, or one of biglide, delta, ",
        ),
        (["BADCELL"], "readings.csv:2"),
    ],
)
def test_bad_input_writes_nothing(
    arguments, message, soft_drive, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.toml").write_text("a = 1")
    for name, old, new in (
        ("NOROBOT", '"biglide"', '"gantry"'),
        ("BADCELL", "dx,", "qq,"),
    ):
        folder = tmp_path / name
        folder.mkdir()
        for file in ("campaign.toml", "readings.csv"):
            (folder / file).write_text(
                (soft_drive / file).read_text().replace(old, new)
            )
    words = [str(soft_drive) if word == "SOFT" else word for word in arguments]
    assert _guarded(["diagnose", *words, "--out", "out", "--quiet"]) == 2
    said = capsys.readouterr()
    assert message in said.err
    assert len(said.err.splitlines()) == 1
    assert not (tmp_path / "out").exists()
    assert tomllib.loads((tmp_path / "notes.toml").read_text()) == {"a": 1}


@pytest.mark.long
def test_backlash_of_a_rotary_drive_with_two_slopes_is_found_adopted_and_found_no_more(
    tmp_path, monkeypatch
):
    """The arm that mills the pocket, J3 by its curve; readings from the linear arm's torques and the axis of J3."""
    nominal = 20e3
    stiffer = 40e3
    half = 10e-6
    rng = np.random.default_rng(7)
    text = find_robot("serial-arm").read_text()
    assert 'stiffness = "20 kN*m/rad"' in text
    curve = 'curve = [["0.5 mrad", "10 N*m"], ["1.5 mrad", "50 N*m"]]'
    (tmp_path / "arm.toml").write_text(text.replace('stiffness = "20 kN*m/rad"', curve))
    linear = ss.assemble(ss.load_robot("serial-arm"), "beam")
    source = Path("examples/pocket/machine")
    at = np.array([0.579707026, 0.10915, 0.210103364])
    rows = list(csv.DictReader((source / "readings.csv").read_text().splitlines()))
    for row in rows:
        pose = [
            float(row[k]) * unit
            for k, unit in zip(POSE, np.repeat([1e-3, np.pi / 180], 3), strict=True)
        ]
        force = [float(row[k]) for k in ("fx", "fy", "fz")]
        found = respond(
            linear, [pose], np.zeros(6), loads=[Load("flange", [*force, 0, 0, 0], at)]
        )
        joint = found.elements["J3"]
        there = found.where.frame(found.elements["J3"].element)
        torque = joint.wrench[0, 3, 0]
        point = found.where.point("flange", at)[0] - found.where.tool[0]
        size = abs(torque)
        twist = found.nodes["flange"][0, :, 0]
        bent = min(size, 10.0) / nominal + max(size - 10.0, 0.0) / stiffer
        more = np.sign(torque) * (half + bent - size / nominal) if size > 1e-9 else 0.0
        turned = np.cross(there.rotation[0, :, 0], point - there.translation[0])
        moved = twist[:3] + np.cross(twist[3:], point) + more * turned
        row["value"] = (
            f"{1e6 * moved['xyz'.index(row['sensor'][-1])] + rng.normal():.1f}"
        )
    with (tmp_path / "readings.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, rows[0])
        table.writeheader()
        table.writerows(rows)
    campaign = (source / "campaign.toml").read_text()
    assert 'modelled   = ["gravity"]' in campaign
    # the torques above are the loads' alone; under its weight J3 would rest elsewhere on its curve
    weightless = campaign.replace('modelled   = ["gravity"]', "modelled = []")
    (tmp_path / "campaign.toml").write_text(
        weightless.replace('"serial-arm"', '"arm.toml"')
    )
    monkeypatch.chdir(tmp_path)
    assert (
        _guarded(
            ["diagnose", ".", "--out", "first", "--adopt", "machine.toml", "--quiet"]
        )
        == 0
    )
    first = json.loads(Path("first/diagnosis.json").read_text())
    (effect,) = first["effects"]
    width = effect["parameters"]["half_width"]
    assert (first["verdict"], effect["effect"], effect["place"]) == (
        "identified",
        "backlash",
        "J3",
    )
    assert width["value"] == pytest.approx(half, abs=4.0 * width["sigma"])
    assert width["sigma"] < 0.1 * half
    assert (
        _guarded(
            ["diagnose", ".", "--robot", "machine.toml", "--out", "second", "--quiet"]
        )
        == 0
    )
    assert json.loads(Path("second/diagnosis.json").read_text())["verdict"] == "no-gap"

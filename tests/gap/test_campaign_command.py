"""`stiffscope campaign new` and `campaign check`: a template that is understood, what is said, what is refused."""

import json

import numpy as np
import pytest

from stiffscope.cli.main import _guarded
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.robot.library import robot_names
from stiffscope.robot.reader import load_robot

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", sorted(robot_names()))
def test_the_template_of_every_robot_is_a_plan_within_reach(tmp_path, name):
    folder = tmp_path / "mine"
    assert _guarded(["campaign", "new", name, "--out", str(folder), "--quiet"]) == 0
    report = tmp_path / "check.json"
    assert (
        _guarded(["campaign", "check", str(folder), "--quiet", "--json", str(report)])
        == 0
    )
    said = json.loads(report.read_text())
    robot = load_robot(name)
    assert load_campaign(folder, robot, planned=True).components is None
    assert said["coordinates"] == list(robot.tool.pose)
    assert len(said["poses"]) == 8
    assert said["readings"] == said["empty"] == 8 * 4 * 4
    assert said["sensors"]["level"]["zero"] == "session"
    assert said["largest_wrench"]["fz"] == 100.0


def test_a_filled_template_is_read(tmp_path, capsys):
    folder = tmp_path / "mine"
    _guarded(["campaign", "new", "delta", "--out", str(folder), "--quiet"])
    capsys.readouterr()
    assert _guarded(["campaign", "new", "delta", "--out", str(folder)]) == 2
    assert "expected a folder that is not there yet" in capsys.readouterr().err
    (folder / "notes.txt").write_text("mine")
    forced = ["campaign", "new", "delta", "--out", str(folder), "--quiet", "--force"]
    assert _guarded(forced) == 0
    assert (folder / "notes.txt").read_text() == "mine"
    assert (
        _guarded(["diagnose", str(folder), "--out", str(tmp_path / "none"), "--quiet"])
        == 2
    )
    assert (
        "readings.csv:2: value: expected a finite reading in SI, got an empty cell"
        in capsys.readouterr().err
    )
    lines = (folder / "readings.csv").read_text().splitlines()
    value = lines[0].split(",").index("value")
    for k, line in enumerate(lines[1:], start=1):
        cells = line.split(",")
        cells[value] = f"{k}e-7"
        lines[k] = ",".join(cells)
    (folder / "readings.csv").write_text("\n".join(lines))
    c = load_campaign(folder, load_robot("delta"))
    assert c.value == pytest.approx(1e-7 * np.arange(1, len(lines)))
    assert _guarded(["campaign", "check", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "96 deflections, 32 deviations) at 8 poses" in said
    assert "gauge_x" in said
    assert "hook" in said
    assert "repeat" not in said
    (folder / "readings.csv").write_text("\n".join([*lines, lines[1], lines[2]]))
    assert _guarded(["campaign", "check", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "2 readings repeat others exactly" in said
    assert f"readings.csv:{len(lines) + 1} is readings.csv:2" in " ".join(said.split())

"""Every target carries all its facts, and the command asks it."""

import json

import pytest

from stiffscope.cli.main import _guarded
from stiffscope.exports.target import load_target, target_names

pytestmark = pytest.mark.slow


ARM = """
name = "arm"
[bodies.link]
{mass}
centre = ["0.5 m", 0, 0]
[joints.hinge]
between = ["ground", "link"]
type = "{kind}"
at = [0, 0, 0]
{axis}
{drive}
[tool]
body = "link"
at = ["0.5 m", 0, 0]
pose = {pose}
[gravity]
acceleration = 9.81
direction = [0, 0, -1]
"""
HINGED = {"kind": "revolute", "axis": "axis = [0, 1, 0]", "pose": '["z"]'}
WELDED = {"kind": "fixed", "axis": "", "pose": "[]"}
MASS = 'mass = "2 kg"'
DRIVE = 'drive = { stiffness = "10 kN*m/rad" }'
LACKING = {
    "no drives": ({**HINGED, "mass": MASS, "drive": ""}, "drives or springs, got none"),
    "rigid": ({**WELDED, "mass": MASS, "drive": ""}, "yields, got a rigid robot"),
    "no masses": ({**HINGED, "mass": "", "drive": DRIVE}, "masses, got none; give"),
}


@pytest.mark.parametrize("name", target_names())
def test_a_target_has_its_name_a_sentence_and_files(name):
    target = load_target(name)
    assert target.name == name
    assert target.help.endswith(".")
    assert target.files
    assert all(target.files.values())


@pytest.mark.parametrize("name", ["exudyn", "mjcf", "urdf"])
def test_the_command_writes_the_files_that_a_target_states(name, tmp_path):
    folder = tmp_path / "out"
    answer = tmp_path / "answer.json"
    words = ["export", "serial-arm", "--to", name, "--at", "home", "--quiet"]
    assert _guarded([*words, "--out", str(folder), "--json", str(answer)]) == 0
    stated = {file.format(robot="serial-arm") for file in load_target(name).files}
    assert stated == set(json.loads(answer.read_text())["files"])
    assert stated < {file.name for file in folder.iterdir()}


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (["--highest", "fast"], "--highest fast"),
        (["--highest", "-2 Hz"], "expected a frequency above 0"),
        (["--at", "nowhere"], "--at nowhere"),
    ],
)
def test_a_wrong_option_leaves_nothing_behind(option, message, tmp_path, capsys):
    folder = tmp_path / "out"
    words = ["export", "serial-arm", "--to", "mjcf", *option, "--out", str(folder)]
    assert _guarded(words) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not folder.exists()


@pytest.mark.parametrize("target", ["mjcf", "statespace"])
@pytest.mark.parametrize("case", LACKING)
def test_one_line_names_what_a_robot_lacks(case, target, tmp_path, capsys):
    given, message = LACKING[case]
    path = tmp_path / "arm.toml"
    path.write_text(ARM.format(**given))
    folder = tmp_path / "out"
    words = ["export", str(path), "--to", target, "--out", str(folder), "--quiet"]
    assert _guarded(words) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not folder.exists()

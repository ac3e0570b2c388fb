"""`stiffscope check`, `robots` and `new`."""

import json

import pytest

from stiffscope.cli.check import check_robot
from stiffscope.cli.robots import list_robots, new_robot
from stiffscope.errors import InputError


def test_tables_fit_80_columns_and_say_what_matters(capsys):
    check_robot("delta")
    said = capsys.readouterr().out
    assert max(map(len, said.splitlines()[1:])) <= 80  # the first line has the path
    assert "leg1.rod1 spins between leg1.rod1.top and leg1.rod1.end" in said
    assert "9 (39 joint freedoms - 6 × 5), 6 of them idle" in said
    for words in ("beam theory", "leg1.motor", "-45 deg", "commanded: x, y, z; held: rx, ry, rz"):
        assert words in said


def test_json_alone_on_standard_output(capsys):
    check_robot("five-bar", overrides=["left.motor.drive.stiffness=9 kN*m/rad"], target="-")
    written = json.loads(capsys.readouterr().out)
    assert written["usable"] is True
    assert [drive["stiffness"] for drive in written["drives"]] == [9000.0, 5000.0]
    assert written["poses"]["side"]["reached"] is True


def test_folder_with_pictures(tmp_path):
    out = tmp_path / "out"
    check_robot("five-bar", out=out, quiet=True)
    assert {path.name for path in out.iterdir()} == {"check.json", "manifest.json", "robot_home.png", "robot_side.png"}
    with pytest.raises(InputError, match="is in"):
        check_robot("five-bar", out=out, target=str(out / "x.json"), quiet=True)


def test_unusable_robot_is_shown_and_refused(tmp_path, capsys):
    path = tmp_path / "bar.toml"
    new_robot("five-bar", path)
    text = path.read_text().replace('pose = ["x", "y"]', 'pose = ["x", "z"]').replace("\nx = [", "\nx = [", 1)
    path.write_text(text[: text.index("[map]")])
    with pytest.raises(InputError, match="cannot move along z"):
        check_robot(str(path))
    assert "commands z, which the mechanism holds" in " ".join(capsys.readouterr().out.split())


def test_list_and_copy(tmp_path, capsys):
    list_robots()
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [
        "biglide",
        "delta",
        "five-bar",
        "orthoglide",
        "serial-arm",
        "stewart",
    ]
    new_robot("delta", tmp_path / "mine.toml")
    check_robot(str(tmp_path / "mine.toml"), quiet=True)
    with pytest.raises(InputError, match="not there yet"):
        new_robot("delta", tmp_path / "mine.toml")

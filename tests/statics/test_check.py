"""`stiffscope check`, `robots` and `new`."""

import json

import pytest

from stiffscope.cli.main import _guarded
from tests.experiments.one_part import MATRIX, ROD, STEP, one_part, write_bar

pytestmark = pytest.mark.slow


def run(*words):
    """Exit code of a command."""
    return _guarded([str(word) for word in words])


def test_tables_fit_80_columns_and_say_what_matters(capsys):
    assert run("check", "delta") == 0
    said = capsys.readouterr().out
    assert max(map(len, said.splitlines()[1:])) <= 80  # the first line has the path
    assert "leg1.rod1 spins between leg1.rod1.top and leg1.rod1.end" in said
    assert "9 (39 joint freedoms - 6 × 5), 6 of them idle" in said
    for words in (
        "beam theory",
        "leg1.motor",
        "-45 deg",
        "commanded: x, y, z; held: rx, ry, rz",
    ):
        assert words in said


def test_json_alone_on_standard_output(capsys):
    assert (
        run(
            "check",
            "five-bar",
            "--set",
            "left.motor.drive.stiffness=9 kN*m/rad",
            "--json",
            "-",
        )
        == 0
    )
    written = json.loads(capsys.readouterr().out)
    assert written["usable"] is True
    assert [drive["stiffness"] for drive in written["drives"]] == [9000.0, 5000.0]
    assert written["poses"]["side"]["reached"] is True


def test_folder_with_pictures(tmp_path, capsys):
    out = tmp_path / "out"
    assert run("check", "five-bar", "--out", out, "--quiet") == 0
    pictures = {"robot_home.png", "robot_side.png"}
    assert {path.name for path in out.iterdir()} == {
        "check.json",
        "manifest.json",
        "report.html",
        *pictures,
    }
    page = (out / "report.html").read_text()
    assert "independent loops" in page
    assert "closed at home to" in page
    assert (
        page.count('"name": "home"') == page.count('"name": "side"') == 1
    )  # poses of the robot that turns
    assert (
        run("check", "five-bar", "--out", out, "--json", out / "x.json", "--quiet") == 2
    )
    assert "is replaced as a whole" in capsys.readouterr().err


def test_unusable_robot_is_shown_and_refused(tmp_path, capsys):
    path = tmp_path / "bar.toml"
    assert run("new", "five-bar", path) == 0
    text = path.read_text().replace('pose = ["x", "y"]', 'pose = ["x", "z"]')
    path.write_text(text[: text.index("[map]")])
    assert run("check", path) == 2
    shown = capsys.readouterr()
    assert "commands z, which the mechanism locks" in " ".join(shown.out.split())
    assert "can move in at home, got z" in shown.err
    assert "can move in at home, got z" in shown.out


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        ('effect = "nonsense"', "effects[0]: effect: expected one of"),
        (
            'effect = "link-stiffness"\nparameters = { factor = -2 }',
            "factor: expected more than 0, got -2",
        ),
    ],
)
def test_an_effect_that_no_robot_can_have_is_refused(tmp_path, capsys, effect, message):
    assert run("new", "five-bar", tmp_path / "robot.toml") == 0
    with (tmp_path / "robot.toml").open("a") as file:
        file.write(f'\n[[effects]]\nplace = "tool"\n{effect}\n')
    assert run("check", tmp_path / "robot.toml") == 2
    assert message in capsys.readouterr().err


def test_list_and_copy(tmp_path, capsys):
    assert run("robots") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [
        "biglide",
        "delta",
        "five-bar",
        "orthoglide",
        "serial-arm",
        "stewart",
    ]
    assert run("new", "delta", tmp_path / "mine.toml") == 0
    assert run("check", tmp_path / "mine.toml", "--quiet") == 0
    assert run("new", "delta", tmp_path / "mine.toml") == 2
    assert "not there yet" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("part", "words"), [(STEP, "on a STEP file"), (MATRIX, "the file"), (ROD, "FEA")]
)
def test_every_kind_of_part_is_told(tmp_path, capsys, part, words):
    one_part(tmp_path, part)
    write_bar(tmp_path / "bar.step")
    assert run("check", tmp_path / "robot.toml") == 0
    assert words in capsys.readouterr().out


def test_a_step_file_that_does_not_fit_is_refused_as_a_run_refuses_it(tmp_path, capsys):
    one_part(tmp_path, STEP)
    assert run("check", tmp_path / "robot.toml") == 2
    write_bar(tmp_path / "bar.step")
    assert (
        run(
            "check",
            tmp_path / "robot.toml",
            "--set",
            'arm.tip=["61 mm", 0, 0]',
            "--json",
            "-",
        )
        == 2
    )
    told, said = capsys.readouterr()
    assert "file: expected a STEP file, got no file" in said
    assert "expected a tip 60 mm from the base" in said.splitlines()[-1]
    assert '"usable": false' in told

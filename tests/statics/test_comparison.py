"""Two robots side by side."""

import json

import numpy as np
import pytest
from PIL import Image

from stiffscope.cli.main import cli
from stiffscope.errors import InputError
from stiffscope.experiments.comparison import _list_sources
from stiffscope.robot.reader import load_robot

pytestmark = pytest.mark.slow


def test_twice_the_drives_of_a_robot_of_drives_alone_is_twice_the_stiffness(
    tmp_path, capsys
):
    text = "\n".join(
        [
            'name = "stage"',
            "[bodies.x]",
            "[bodies.table]",
            "mass = 2",
            "centre = [0, 0, 0]",
            "[joints.x]",
            'between = ["ground", "x"]',
            'type = "prismatic"',
            "at = [0, 0, 0]",
            "axis = [1, 0, 0]",
            "drive = { stiffness = 1e6 }",
            "[joints.y]",
            'between = ["x", "table"]',
            'type = "prismatic"',
            "at = [0, 0, 0]",
            "axis = [0, 1, 0]",
            "drive = { stiffness = 2e6 }",
            "[tool]",
            'body = "table"',
            "at = [0, 0, 0]",
            'pose = ["x", "y"]',
            "[poses]",
            "home = [0, 0]",
            "[gravity]",
            "direction = [1e-6, -1, 0]",
            "acceleration = 10",
        ]
    )
    (tmp_path / "one.toml").write_text(text)
    (tmp_path / "two.toml").write_text(text.replace("1e6", "3e6"))
    cli(
        [
            "compare",
            str(tmp_path / "one.toml"),
            str(tmp_path / "two.toml"),
            "--json",
            "-",
        ],
        standalone_mode=False,
    )
    answer = json.loads(capsys.readouterr().out)
    assert answer["robots"] == ["one", "two"]
    assert answer["mass"] == [2.0, 2.0]
    np.testing.assert_allclose(
        np.array(answer["push"], dtype=float)[:, 0, :2], [[1e6, 2e6], [3e6, 2e6]]
    )
    np.testing.assert_allclose(
        np.array(answer["sag"], dtype=float)[:, 0, :2],
        [[2e-11, -1e-5], [2e-11 / 3, -1e-5]],
    )
    cli(
        ["compare", str(tmp_path / "one.toml"), str(tmp_path / "two.toml")],
        standalone_mode=False,
    )
    along, across = capsys.readouterr().out.split("Sag under")[1].splitlines()[3:5]
    assert along.split() == [
        "home",
        "x",
        "µm",
        "0",
        "0",
    ]  # beside 10 µm along y, 0.00002 µm is rounding
    assert across.split() == ["y", "µm", "-10", "-10"]


@pytest.mark.extended
def test_a_picture_shows_the_first_robot_in_outlines_beside_the_second(tmp_path):
    wide = [
        "compare",
        "biglide",
        "biglide",
        "--components",
        "published",
        "--quiet",
        "--out",
    ]
    same = tmp_path / "same"
    changed = tmp_path / "changed"
    cli([*wide, str(same)], standalone_mode=False)
    cli([*wide, str(changed), "--set", "slider.thickness=60mm"], standalone_mode=False)
    one, other = (
        np.asarray(Image.open(folder / "both.png").convert("RGB")).astype(int)
        for folder in (same, changed)
    )
    assert np.mean(np.abs(one - other).max(axis=2) > 24) > 0.002
    assert "both.png" in (changed / "report.html").read_text()


def test_robots_of_other_coordinates_are_refused():
    with pytest.raises(InputError, match="same coordinates"):
        cli(["compare", "biglide", "serial-arm"], standalone_mode=False)


@pytest.mark.parametrize(
    "arguments", [["compare", "one.toml", "one.toml"], ["campaign", "new", "one.toml"]]
)
def test_a_pose_that_cannot_be_commanded_is_refused_at_its_line(
    arguments, tmp_path, monkeypatch
):
    text = (
        'name = "slide"\n[bodies.x]\n[joints.x]\nbetween = ["ground", "x"]\ntype = "prismatic"\nat = [0, 0, 0]\n'
        'axis = [1, 0, 0]\ndrive = { stiffness = 1e6 }\n[tool]\nbody = "x"\nat = [0, 0, 0]\npose = ["y"]\n'
    )
    (tmp_path / "one.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        InputError,
        match=r"one.toml:12: tool.pose: expected coordinates that the mechanism can move in",
    ):
        cli([*arguments, "--out", "out"], standalone_mode=False)


@pytest.mark.parametrize(
    "change",
    [
        "slider.thickness=25mm",
        "slider.rib_count=3",
        "materials.steel.youngs_modulus=200GPa",
    ],
)
def test_a_part_of_another_shape_or_material_has_no_published_matrix(change):
    def printed(part, *changes):
        return _list_sources(load_robot("biglide", changes), part)["published"]

    assert printed("slider") is not None
    assert printed("link") is not None
    assert printed("slider", change) is None
    assert (printed("link", change) is None) == ("materials" in change)
    assert printed("link", "link.bore=5mm") is None
    assert printed("slider", "slider.rib_height=9mm") is not None

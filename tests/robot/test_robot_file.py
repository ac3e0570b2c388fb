"""The robot file says exactly what is wrong, where, and what would be valid."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from stiffscope.data import FOLDER
from stiffscope.errors import InputError
from stiffscope.robot.robot_file import find_robot, load_robot
from stiffscope.robot.schema import PARTS, RobotFile

TEXT = (FOLDER / "biglide.toml").read_text(encoding="utf-8")


def line_with(start: str, text: str) -> int:
    return next(
        i for i, line in enumerate(text.splitlines(), 1) if line.replace(" ", "").startswith(start.replace(" ", ""))
    )


@pytest.fixture
def load(tmp_path):
    def from_text(text: str) -> RobotFile:
        (tmp_path / "robot.toml").write_text(text, encoding="utf-8")
        return load_robot(tmp_path / "robot.toml")

    return from_text


def test_tables_1_to_4_of_the_paper():
    robot = load_robot("biglide")
    g = robot.geometry
    assert (robot.link.length, g.l, g.l1, g.l2, g.h, g.d) == pytest.approx((0.5, 0.075, 0.04, 0.015, 0.0175, 0.07))
    assert (robot.link.mass, robot.platform.mass, robot.drive.stiffness) == pytest.approx((1.95, 7.93, 1.27e7))
    assert (g.a_min, g.a_max, robot.link.radius) == pytest.approx((0.2, 0.55, 0.0125))
    steel = robot.material("link")
    assert (steel.youngs_modulus, steel.shear_modulus) == pytest.approx((211e9, 81e9))
    assert (robot.slider.depth, robot.slider.width, robot.slider.thickness) == pytest.approx((0.085, 0.32, 0.02))
    for name, q in (("Q1", 35.8), ("Q2", 64.3)):
        assert robot.poses[name][2] == pytest.approx(0.055 + 0.5 * np.sin(np.radians(q)), abs=1e-7)


def test_keys_of_a_part_are_those_of_its_parameters():
    robot = load_robot("biglide")
    for name in PARTS:
        parameters = robot.parameters(name)
        assert robot.part(name).shape() == dataclasses.asdict(parameters)


def test_nothing_changes_after_loading():
    robot = load_robot("biglide")
    with pytest.raises(ValueError, match="frozen"):
        robot.drive.stiffness = 1.0


THICKNESS = 'thickness  = "20 mm"'


@pytest.mark.parametrize(
    ("old", "new", "at", "message"),
    [
        (THICKNESS, 'thikness = "20 mm"', "thikness", r'unknown key; did you mean "thickness"\? \(valid: .*width'),
        (THICKNESS, 'thickness = "12 kg"', "thickness", 'such as "20 mm", got "12 kg", which is a mass'),
        (THICKNESS, 'thickness = "20"', "thickness", "has no unit"),
        (THICKNESS, "thickness = -0.02", "thickness", "must not be negative"),
        (THICKNESS, "thickness = 0", "thickness", "slider.thickness: expected a length"),
        (THICKNESS, "thickness = nan", "thickness", "not a finite number"),
        (THICKNESS, "thickness = inf", "thickness", "not a finite number"),
        (THICKNESS, "thickness = true", "thickness", "expected a length"),
        (THICKNESS, 'thickness = "20 mm', "thickness", "not valid TOML"),
        (THICKNESS, "thickness = ", "thickness", "not valid TOML"),
        ('mass = "7.93 kg"', "", "[platform]", "platform.mass: is missing"),
        ('mass       = "1.95 kg"', 'mass = "cadd"', "mass", 'or "cad"'),
        ('compliance = "fea" ', 'compliance = "fem" ', "compliance", "expected 'fea', 'beam' or 'published', got"),
        ('material   = "steel"', 'material = "stell"', "material", "link.material: expected one of steel.*titanium"),
        ('shear_modulus  = "81 GPa"', 'shear_modulus = "20 GPa"', "shear_modulus", "Poisson"),
        ('Q1 = ["0 mm", "0 mm", "347.4788 mm"]', 'Q1 = ["0 mm"]', "Q1", "expected three lengths"),
        ('bore       = "0 mm"', 'bore = "26 mm"', "bore", "link.bore: expected a diameter"),
        ('name = "biglide"', 'name = "biglide"\nname = "twice"', "name=\"twice\"", "not valid TOML"),
    ],
)  # fmt: skip
def test_refusals_name_line_key_and_what_is_valid(load, tmp_path, old, new, at, message):
    assert old in TEXT
    text = TEXT.replace(old, new, 1)
    with pytest.raises(InputError, match=message) as refused:
        load(text)
    first, *more = str(refused.value).splitlines()
    assert not more
    assert first.startswith(f"{tmp_path / 'robot.toml'}:{line_with(at, text)}: ")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('loaded = [{index = 1}, {kind = "blob"}]', "loaded.1.kind: expected one of plane, .* got 'blob'"),
        ("loaded = [{}]", "loaded.0: expected at least one of kind, normal, .* got none"),
        ("loaded = [{normal = [0, 0, 0]}]", "loaded.0.normal: expected a direction"),
        ("clamped = [{position = [1e300, 0, 0]}]", "clamped.0.position: expected one of min x, "),
        ("clamped = []", "clamped: expected at least one face selector, got none"),
        ("x = [0, 0, 0]", "x: expected a direction"),
        ("x = [1e300, 0, 0]", "x: expected a direction"),
        ("z = [1, 0, 0]", "z: expected a direction at right angles to x"),
        ("origin = [1e300, 0, 0]", "origin: expected a point of three numbers"),
    ],
)
def test_choices_in_a_step_file_are_refused_by_line_and_field(load, tmp_path, line, message):
    text = f'{TEXT}\n[slider.step]\nfile = "part.step"\n{line}\n'
    with pytest.raises(InputError, match=message) as refused:
        load(text)
    where = f"{tmp_path / 'robot.toml'}:{text.count(chr(10))}: slider.step.{message.split(':')[0]}: expected "
    assert str(refused.value).startswith(where)


def test_set_overrides_anything():
    robot = load_robot(
        "biglide",
        ["slider.thickness=25mm", "link.mesh.size=6 mm", "slider.compliance=beam", "slider.interface=distributed",
         "poses.P=[0, 0, 0.4]", "drive.stiffness=2e7", "link.mass=cad"],
    )  # fmt: skip
    assert robot.slider.thickness == pytest.approx(0.025)
    assert robot.part("link").mesh.size == pytest.approx(0.006)
    assert (robot.part("slider").compliance, robot.part("slider").interface) == ("beam", "distributed")
    assert robot.poses["P"] == (0, 0, 0.4)
    assert (robot.drive.stiffness, robot.link.mass) == (2e7, "cad")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("slider.thikness=3mm", "unknown key; did you mean"),
        ("slider.thickness=12kg", "--set slider.thickness: .* a mass"),
        ("slider.thickness=-1mm", "--set slider.thickness: .*negative"),
        ("slider.thickness", "part.parameter=VALUE"),
        ("slider=3", "--set slider: expected a table of material, .*, thickness, "),
        ("a.b.c=3", "--set a.b.c: a: unknown key"),
        ("slider.material=wood", "--set slider.material: .*titanium"),
        ("link.bore=30mm", "--set link.bore: "),
        ("slider.mesh.size.x=3", "is a value, not a table"),
        ("slider.step={}", "^--set slider.step: slider.step.file: is missing"),
        ("geometry.a_max=0.1", "^--set geometry.a_max: expected more than geometry.a_min, 0.2 m, got 0.1 m"),
    ],
)
def test_set_is_checked_alike(override, message):
    with pytest.raises(InputError, match=message):
        load_robot("biglide", [override])


def test_files_that_cannot_be_robots(tmp_path):
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    for path, message in [("nosuch", "biglide"), (tmp_path, "is a folder"), (tmp_path / "binary.toml", "UTF-8")]:
        with pytest.raises(InputError, match=message):
            load_robot(path)


def test_a_name_is_found_and_a_path_wins(tmp_path, monkeypatch):
    assert find_robot("biglide") == FOLDER / "biglide.toml"
    monkeypatch.chdir(tmp_path)
    Path("biglide").write_text("here")
    assert find_robot("biglide") == Path("biglide")

"""`stiffscope sensitivity` of a robot whose part is a STEP file's solid: its material beside experiments made anew."""

import json

import numpy as np
import pytest

from stiffscope.cli.main import _guarded
from stiffscope.experiments.assembly import assemble_robots, at_named_poses
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.workshop import workshop
from tests.experiments.one_part import DEPTH, LENGTH, STEP, WIDTH, one_part, write_bar

pytestmark = pytest.mark.slow

CHANGE = 0.02
VOLUME = LENGTH * WIDTH * DEPTH
MATERIAL = """
[materials.iron]
youngs_modulus = "211 GPa"
shear_modulus  = "81 GPa"
density        = "7850 kg/m^3"
"""
CONSTANTS = {"youngs_modulus": 211e9, "shear_modulus": 81e9}


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.setenv("STIFFSCOPE_CACHE", str(tmp_path / "cache"))
    write_bar(tmp_path / "bar.step")
    path = one_part(tmp_path, STEP).path
    path.write_text(path.read_text().replace('"steel"', '"iron"') + MATERIAL)
    return path


def answer(file, *words):
    out = file.parent / "answer.json"
    assert (
        _guarded(["sensitivity", str(file), *words, "--quiet", "--json", str(out)]) == 0
    )
    return json.loads(out.read_text())


@pytest.mark.long
def test_a_step_part_has_derivatives_by_the_constants_of_its_material_only(file):
    part = answer(file, "--part", "bar 1")["parameters"]
    assert set(part) == {*CONSTANTS, "density"}
    assert part["density"]["mass"] == pytest.approx(VOLUME, rel=1e-4)
    robot = answer(file)["parameters"]
    states = {}
    with workshop() as shop:
        for name, value in CONSTANTS.items():
            for sign in (1, -1):
                changed = load_robot(
                    file, [f"materials.iron.{name}={value * (1 + sign * CHANGE)!r}"]
                )
                made = assemble_robots({"now": changed}, None, shop, whole=False)["now"]
                states[name, sign] = (
                    made.results["bar 1"],
                    at_named_poses(made, changed.poses),
                )
    for name, value in CONSTANTS.items():
        (up, above) = states[name, 1]
        (down, below) = states[name, -1]
        assert part[name]["value"] == pytest.approx(value)
        size = np.sqrt(np.outer(up.compliance.diagonal(), up.compliance.diagonal()))
        got, bound = (
            value * np.array(part[name][key]) / size for key in ("compliance", "error")
        )
        expected = (up.compliance - down.compliance) / (2 * CHANGE) / size
        noise = 2e-4 / CHANGE  # of a compliance from mesh to mesh
        assert (
            np.abs(got - expected) < bound + 0.01 * np.abs(expected) + noise
        ).all(), name
        assert part[name]["mass"] == 0
        row = robot[f"materials.iron.{name}"]
        stiffer = (above.matrix - below.matrix)[0] / (2 * CHANGE)
        scale = np.sqrt(np.outer(*[np.diagonal(above.matrix[0])] * 2))
        off = (value * np.array(row["stiffness"])[0] - stiffer) / scale
        assert np.abs(off).max() < 0.01 + noise, name

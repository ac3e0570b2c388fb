"""Each benchmark that the documentation names, in small: what it calls is there, and what it compares agrees."""

import json
import re
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from stiffscope.gap.diagnose import conclude
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.inference.find import find
from stiffscope.robot.library import find_robot
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.statics.analysis import stiffness
from tests.benchmarks import (
    test_assembly_speed,
    test_codes,
    test_fea_coverage,
    test_gap_speed,
    test_humanoid,
    test_modes_speed,
    test_part_dimensions,
    test_rerun_speed,
    test_sensitivity,
    test_solvers,
    test_vjm_speed,
)
from tests.benchmarks.codes import CODES, measured, meshed
from tests.benchmarks.second_lab import campaign_of, names_of, scored
from tests.experiments.one_part import ROD, one_part
from tests.robots import random_poses

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def coarse():
    return meshed("link", 2.0)


@pytest.mark.parametrize("code", ["CalculiX", "MFEM"])
@pytest.mark.parametrize(
    "part", ["link", "slider"]
)  # of curved elements, and of straight ones
def test_other_codes_on_one_mesh(code, part, coarse):
    test_codes.need(code)
    mesh = coarse if part == "link" else meshed(part, 2.0)
    ours, theirs = (CODES[each](mesh, {"order": 2}) for each in ("ours", code))
    scale = np.sqrt(np.outer(ours.diagonal(), ours.diagonal()))
    assert (np.abs(ours - theirs) / scale).max() < 2e-5  # CalculiX prints seven digits


@pytest.mark.extended
def test_a_process_of_a_stored_mesh(coarse, tmp_path):
    np.savez(tmp_path / "mesh.npz", **asdict(coarse))
    found = measured(code="ours", mesh=str(tmp_path / "mesh.npz"), order=2)[
        "compliance"
    ]
    assert np.allclose(
        found,
        CODES["ours"](coarse, {"order": 2}),
        rtol=1e-9,
        atol=1e-9 * np.abs(found).max(),
    )


@pytest.mark.extended
def test_a_whole_process_from_the_cad(monkeypatch):
    done = measured(code="experiment", part="link", settings={"tolerance": 0.02})
    assert done["seconds"] > 0
    assert done["megabytes"] > 100
    monkeypatch.setattr(test_codes, "measured", lambda **_: dict(done))
    assert (
        test_codes.cheapest(done["compliance"], [{"code": "experiment"}], "link")["off"]
        == 0.0
    )


@pytest.mark.extended
def test_two_levels_and_a_large_mesh(monkeypatch, coarse, capsys):
    monkeypatch.setattr(test_solvers, "meshed", lambda *_: coarse)
    test_solvers.test_two_levels_beside_a_factorization("link", 2.0)
    monkeypatch.setattr(sys, "argv", ["-c", "0.03", "compliance"])
    capsys.readouterr()
    exec(test_solvers.LARGE, {})  # noqa: S102
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["dofs"] > 1000


@pytest.mark.extended
def test_bounds_of_a_random_part(monkeypatch):
    monkeypatch.setattr(test_fea_coverage, "FINER", 1.2)
    (true, bound, size), said = test_fea_coverage.compare(4)
    assert np.mean((true <= bound)[size > test_fea_coverage.SIGNIFICANT]) >= 0.9, (
        said
    )  # they are 95 % bounds


@pytest.mark.extended
def test_poses_modes_and_a_map(rng, capsys, monkeypatch):
    robots = (test_vjm_speed.elastic_hexapod(), test_vjm_speed.thirty_bodies())
    assert all(np.isfinite(stiffness(robot, robot.tool.home)).all() for robot in robots)
    exec(test_vjm_speed.TEN_MILLION.replace("10_000_000", "1_000"), {})  # noqa: S102
    assert float(capsys.readouterr().out.split()[1]) > 0
    monkeypatch.setattr(
        test_modes_speed, "random_poses", lambda rng, _: random_poses(rng, 30)
    )
    test_modes_speed.test_first_six_frequencies_of_many_poses(rng, capsys)


@pytest.mark.extended
def test_effects_of_a_linear_model():
    test_gap_speed.test_four_effects_among_two_hundred(14, 6, 60)


@pytest.mark.extended
def test_campaigns_of_a_hexapod_and_of_a_template(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(test_gap_speed, "POSES", 8)
    monkeypatch.setattr(test_gap_speed, "STANCES", 8)
    for folder in (tmp_path / "hexapod", tmp_path / "template"):
        folder.mkdir()
    test_gap_speed.test_eight_thousand_readings_of_a_hexapod(
        test_gap_speed.FAULTS[:1], tmp_path / "hexapod"
    )
    test_gap_speed.test_a_template_filled_in(
        "delta", tmp_path / "template", monkeypatch
    )
    assert "delta, 128 readings, run 2" in capsys.readouterr().out


@pytest.mark.extended
def test_a_campaign_of_the_second_laboratory():
    campaign, planted, nominal = campaign_of("five-bar", 0)
    model = RobotModel(campaign, nominal)
    assert scored(conclude(find(model)), names_of(model, planted.name)) in {
        "right",
        "honest",
    }


@pytest.mark.extended
def test_a_humanoid_with_nothing_wrong(tmp_path, monkeypatch):
    monkeypatch.setattr(test_humanoid, "POSES", 60)
    test_humanoid.test_humanoid("nothing wrong", 1, tmp_path)


@pytest.mark.extended
def test_a_dimension_of_a_part(tmp_path, monkeypatch):
    monkeypatch.setenv("STIFFSCOPE_CACHE", str(tmp_path / "cache"))
    one_part(tmp_path, ROD)
    with workshop() as shop:
        lab = test_part_dimensions._lab(str(tmp_path / "robot.toml"), (), shop)
        answer, said = test_part_dimensions.answered(
            "robot.toml", 1, lab, tmp_path / "campaign", shop
        )
    assert answer.right, said


@pytest.mark.extended
def test_derivatives_of_a_part():
    rows = test_sensitivity.table("link", only=("radius",))
    assert [entry for _, entry, *_ in rows] == [f"C{k}{k}" for k in range(1, 7)]


def test_what_a_watched_run_changes_is_in_the_file():
    text = find_robot("biglide").read_text()
    assert all(
        re.search(pattern, text)
        for pattern, _ in (test_rerun_speed.DRIVE, test_rerun_speed.THICKNESS)
    )
    assert test_rerun_speed.timed("-c", "pass")[0] > 0


@pytest.mark.extended
def test_four_interfaces_beside_two(monkeypatch):
    monkeypatch.setattr(test_solvers, "RUNS", 1)
    monkeypatch.setattr(test_solvers, "MOST", 9.0)  # beside other tests
    test_solvers.test_four_interfaces_take_less_than_1_6_times_as_long_as_two_on_the_same_mesh()


def test_every_benchmark_that_the_documentation_names_is_here():
    pages = [
        path.read_text()
        for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    ]
    named = set(re.findall(r"benchmarks/(\w+)\.py", " ".join(pages)))
    assert named
    assert named <= set(re.findall(r"\w+", Path(__file__).read_text()))


@pytest.mark.extended
def test_joints_of_an_assembly(tmp_path):
    test_assembly_speed.test_seconds_to_the_joints_of_a_machine(1, tmp_path)

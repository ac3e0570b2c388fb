"""`stiffscope run`: complete output, reuse of what was computed, and pictures that cannot be drawn."""

import json
import os
import subprocess
import sys
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from stiffscope.cli.main import _guarded
from stiffscope.experiments.experiments import PartResult, compliance_json
from stiffscope.experiments.orders import order_part
from stiffscope.fea.experiment import Experiment
from stiffscope.report.part_tables import show_compliance
from stiffscope.robot.part_matrices import beam_compliance
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.cache import CONDENSED, WHOLE
from tests.experiments.one_part import ROD, one_part

pytestmark = pytest.mark.slow

RUN = "import sys; from stiffscope.cli.main import _guarded; code = _guarded(sys.argv[1:]); print(sorted(set(sys.modules) & {'OCP', 'pytetwild', 'skfem'})); sys.exit(code)"  # noqa: E501


def run(cache, out, *arguments):
    environment = {**os.environ, "STIFFSCOPE_CACHE": str(cache)}
    command = [
        sys.executable,
        "-c",
        RUN,
        "run",
        "biglide",
        "--out",
        str(out),
        *arguments,
    ]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env=environment
    )


def manifest(out):
    return json.loads((out / "manifest.json").read_text())


def test_published_robot_needs_no_experiment(tmp_path):
    done = run(
        os.environ["STIFFSCOPE_CACHE"],
        tmp_path / "out",
        "--components",
        "published",
        "--quiet",
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"
    out = tmp_path / "out"
    assert sorted(os.listdir(out)) == sorted([*manifest(out)["files"], "manifest.json"])
    stiffness = np.array(json.loads((out / "stiffness.json").read_text())["stiffness"])
    assert np.diagonal(stiffness[0]) / 1e6 == pytest.approx(
        [23.835, 1.9674, 12.40, 1.451, 0.139, 2.833], rel=3e-3
    )
    with np.load(out / "matrices.npz", allow_pickle=False) as held:
        assert np.array_equal(held["stiffness"], stiffness)


@pytest.mark.usefixtures("drawn_anew")
def test_without_graphics_the_run_is_done_and_says_what_to_install(
    tmp_path, monkeypatch, caplog
):
    broken = tmp_path / "broken" / "pyvista.py"
    broken.parent.mkdir()
    broken.write_text(
        "raise ImportError('libGL.so.1: cannot open shared object file: No such file or directory')"
    )
    monkeypatch.setenv("STIFFSCOPE_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(broken.parent)
    words = [
        "run",
        "biglide",
        "--components",
        "published",
        "--quiet",
        "--out",
        str(tmp_path / "out"),
    ]
    assert _guarded(words) == 0
    assert len(caplog.messages) == 1
    assert "libegl1" in caplog.text
    assert (tmp_path / "out" / "map.png").exists()


@pytest.mark.long
def test_a_change_of_the_slider_reruns_the_slider_alone(tmp_path):
    coarse = [
        word
        for name in ("link", "slider")
        for word in ("--set", f"{name}.mesh.size=20mm")
    ]
    cold = run(tmp_path / "cache", tmp_path / "cold", *coarse, "--quiet")
    assert cold.returncode == 0, cold.stderr
    warm = run(tmp_path / "cache", tmp_path / "warm", *coarse)
    assert warm.stdout.splitlines()[-1] == "[]"
    assert all(
        result["reused"] for result in manifest(tmp_path / "warm")["results"].values()
    )
    changed = run(
        tmp_path / "cache",
        tmp_path / "changed",
        *coarse,
        "--set",
        "slider.thickness=25mm",
    )
    reused = {
        name: result["reused"]
        for name, result in manifest(tmp_path / "changed")["results"].items()
    }
    assert (reused["link"], reused["slider"]) == (True, False)
    assert "before" in changed.stdout
    names = os.listdir(tmp_path / "cold" / "slider")
    assert {
        "slider.step",
        "slider.stl",
        "fields.vtu",
        "loads.png",
        "mesh.png",
        "compliance.json",
    } <= set(names)


@pytest.mark.parametrize("solid", ["parametric", "part.step"])
def test_beam_theory_is_beside_the_own_shape_alone(tmp_path, capsys, solid):
    robot = load_robot("biglide")
    beam = beam_compliance(robot, "slider")
    own = solid == "parametric"
    (tmp_path / "part.step").write_text("")
    order = order_part(robot, "slider", None if own else tmp_path / solid)
    empty = np.zeros((0, 3))
    made = {field.name: empty for field in fields(Experiment)} | {
        "part": "slider",
        "interface": "rigid",
        "full_compliance": beam,
        "full_error": 0.01 * abs(beam),
        "reference_points": np.zeros((1, 3)),
        "mesh": SimpleNamespace(points=empty, cells=empty),
        "note": "",
    }
    experiment = Experiment(**made)
    facts = {"mass": 1.0, "mass_centre": [0, 0, 0], "inertia": np.eye(3)}
    result = PartResult(
        order, "", tmp_path, experiment, facts, reused=True, seconds=0.0
    )
    written = compliance_json(robot, result)
    assert written["solid"] == solid
    assert (written["beam"] is None) != own
    assert not own or np.array_equal(written["beam"], beam)
    show_compliance(robot, result)
    shown = capsys.readouterr().out
    assert f"{beam[3, 3]:.5g}" in shown
    assert ("Timoshenko" in shown) == own
    assert ("No comparison with beam theory" in shown) != own


@pytest.mark.extended
def test_what_yields_most_under_a_push_stands_first(tmp_path, capsys):
    """Two blocks in a row, 3 and 1 um/N along x, y and z: three quarters are of the second one."""
    lines = ['name = "row"']
    for name, soft in (("stiff", 1e-6), ("soft", 3e-6)):
        matrix = np.diag([soft] * 3 + [1e-9] * 3).tolist()
        lines += [f"[parts.{name}]", 'shape = "matrix"', f"matrix = {matrix}"]
        at = 0.1 if name == "soft" else 0.0
        lines += [f"[bodies.{name}]", f'part = "{name}"', f"base = [{at}, 0, 0]"]
        lines += [f"tip = [{at + 0.1}, 0, 0]", "y = [0, 1, 0]"]
    ends = {"foot": ("ground", "stiff.base"), "waist": ("stiff.tip", "soft.base")}
    for k, (name, both) in enumerate(ends.items()):
        lines += [f"[joints.{name}]", f"between = {list(both)}", 'type = "fixed"']
        lines += [f"at = [{0.1 * k}, 0, 0]"]
    lines += ["[tool]", 'body = "soft.tip"', "at = [0.2, 0, 0]", "pose = []"]
    (tmp_path / "row.toml").write_text("\n".join(lines))
    assert (
        _guarded(["run", str(tmp_path / "row.toml"), "--out", str(tmp_path / "o")]) == 0
    )
    shown = capsys.readouterr().out.partition("What yields most")[2].splitlines()
    first, second = (line.split() for line in shown if line.startswith("s"))
    assert (first[0], float(first[1])) == ("soft", pytest.approx(75.0, abs=0.1))
    assert (second[0], float(second[1])) == ("stiff", pytest.approx(25.0, abs=0.1))
    page = (tmp_path / "o" / "report.html").read_text()
    assert "What yields most" in page
    assert "home: its one pose" in page


@pytest.mark.extended
def test_stiffness_needs_no_modes_of_the_parts(tmp_path, monkeypatch, capsys):
    """The same stiffness and sag as with the modes that `modes` adds to the same mesh."""
    monkeypatch.setenv("STIFFSCOPE_CACHE", str(tmp_path / "cache"))
    one_part(tmp_path, ROD)
    ask = ["stiffness", str(tmp_path / "robot.toml"), "--json", "-"]
    assert _guarded(ask) == 0
    without = json.loads(capsys.readouterr().out)
    kept = "".join(str(each) for each in (tmp_path / "cache").rglob("*"))
    assert CONDENSED in kept
    assert WHOLE not in kept.replace(str(tmp_path), "").replace("experiment.npz", "")
    assert _guarded(["modes", str(tmp_path / "robot.toml"), "--json", "-"]) == 0
    capsys.readouterr()
    assert _guarded(ask) == 0
    whole = json.loads(capsys.readouterr().out)
    for key in ("stiffness", "sag"):
        assert without[key] == pytest.approx(np.array(whole[key]), rel=1e-9)

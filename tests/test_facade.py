"""`import stiffscope as ss`: what it has, what it costs, and what it does for a robot whose mass is CAD's."""

import ast
import pydoc
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import stiffscope as ss


def test_importing_it_imports_nothing_heavy():
    code = "import sys, stiffscope; print(sorted({'numpy', 'pydantic', 'click'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_help_has_a_line_for_each_name():
    listed = [line.split()[0] for line in ss.__doc__.splitlines() if line.startswith("    ")]
    assert sorted(listed) == sorted(ss.__all__) == [name for name in dir(ss) if name != "__version__"]
    assert len(set(listed)) == len(listed)
    shown = pydoc.render_doc(ss, renderer=pydoc.plaintext)
    assert all(f"{name}" in shown for name in listed)


def test_type_checkers_see_the_same_names_in_the_same_modules():
    tree = ast.parse(Path(ss.__file__).read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {alias.name: node.module for node in block.body for alias in node.names}
    assert {name: f"stiffscope.{module}" for name, module in ss._HOME.items()} == seen
    for name in ss.__all__:
        assert getattr(ss, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'nosuch'"):
        _ = ss.nosuch


def test_a_link_with_the_mass_of_its_solid_can_be_assembled(monkeypatch, tmp_path):
    monkeypatch.setenv("STIFFSCOPE_CACHE", str(tmp_path))
    robot = ss.load_robot("biglide", ["link.mass=cad", "link.mesh.size=60mm"])
    machine = ss.assemble(robot, "published")
    assert machine.link_mass == pytest.approx(np.pi * 0.0125**2 * 0.5 * robot.material("link").density, rel=1e-9)


def test_parts_come_from_words_and_matrices():
    robot = ss.load_robot("biglide")
    slider = 2 * ss.beam_compliance(robot, "slider")
    machine = ss.assemble(robot, {"link": "beam", "slider": slider})
    assert np.array_equal(machine.slider, slider)
    assert np.array_equal(machine.link, ss.beam_compliance(robot, "link"))
    for wrong, message in (
        ({"links": slider}, "expected parts among link, slider, got 'links'"),
        ({"link": "fem"}, "expected fea, beam, published or a matrix, got 'fem'"),
        ({"link": "beam", "slider": np.eye(3)}, "slider compliance"),
        ("fem", "expected fea, beam, published or a matrix, got 'fem'"),
    ):
        with pytest.raises(ss.InputError, match=message):
            ss.assemble(robot, wrong)
    with pytest.raises(ss.InputError, match="expected one of link, slider, got 'arm'"):
        ss.build_part(robot, "arm")


def test_a_campaign_folder_is_diagnosed():
    found = ss.diagnose("published")
    assert isinstance(found, ss.Diagnosis)
    assert (found.verdict, found.effects[0].effect) == ("identified", "scale")

"""`import stiffscope as ss`: what it has, what it costs, and what it does for robots of files and of Python."""

import doctest
import pydoc
import re
import subprocess
import sys

import numpy as np
import pytest

import stiffscope as ss


def test_importing_it_imports_nothing_heavy():
    code = "import sys, stiffscope; print(sorted({'numpy', 'pydantic', 'click'} & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_help_has_a_line_for_each_name():
    listed = [
        line.split()[0] for line in ss.__doc__.splitlines() if line.startswith("    ")
    ]
    assert (
        sorted(listed)
        == sorted(ss.__all__)
        == [name for name in dir(ss) if name != "__version__"]
    )
    assert len(set(listed)) == len(listed)
    shown = pydoc.render_doc(ss, renderer=pydoc.plaintext)
    assert all(f"{name}" in shown for name in listed)


def test_every_name_is_loaded_and_documented():
    for name in ss.__all__:
        assert getattr(ss, name).__doc__
    with pytest.raises(AttributeError, match="No stiffscope attribute nosuch"):
        _ = ss.nosuch


EXAMPLES = "analyse assemble build_part configure deflection diagnose load_robot modes sag stiffness"


@pytest.mark.parametrize("name", EXAMPLES.split())
def test_examples_give_what_they_print(name):
    found = getattr(ss, name)
    (example,) = doctest.DocTestFinder(recurse=False).find(
        found, name, globs={name: found}
    )
    assert example.examples
    assert doctest.DocTestRunner().run(example).failed == 0


def test_a_part_weighs_what_its_solid_does():
    robot = ss.load_robot("biglide", ["link.mass=cad"])
    machine = ss.assemble(robot, "published")
    expected = np.pi * 0.0125**2 * 0.5 * robot.material("link").density
    assert machine.body("limb1.link1").mass == pytest.approx(expected, rel=1e-9)


def test_parts_come_from_words_and_matrices():
    robot = ss.load_robot("biglide")
    slider = 2 * ss.beam_compliance(robot, "slider")
    machine = ss.assemble(robot, {"link": "beam", "slider": slider})
    assert np.array_equal(machine.body("limb2.slider").elastic.compliance, slider)
    assert np.array_equal(
        machine.body("limb2.link3").elastic.compliance,
        ss.beam_compliance(robot, "link"),
    )
    for wrong, message in (
        ({"links": slider}, "expected parts among link, slider, got 'links'"),
        ({"link": "fem"}, "expected fea, beam, published or a matrix, got 'fem'"),
        ({"link": "beam", "slider": np.eye(3)}, "components: slider: expected a 6x6"),
        ("fem", "expected fea, beam, published or a matrix, got 'fem'"),
        (
            ["beam"],
            "components: expected a source, or by part a source or a matrix, got",
        ),
    ):
        with pytest.raises(ss.InputError, match=message):
            ss.assemble(robot, wrong)
    with pytest.raises(ss.InputError, match="expected one of link, slider, got 'arm'"):
        ss.build_part(robot, "arm")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda _: ss.load_robot("biglide", "slider.thickness=25mm"),
            'overrides: expected a list such as ["',
        ),
        (
            lambda _: ss.build_part("biglide", "slider"),
            "robot: expected what `load_robot` returns, got str",
        ),
        (lambda _: ss.assemble("biglide", "beam"), "robot: expected what `load_robot`"),
        (
            lambda _: ss.run_experiment("slider"),
            "part: expected what `build_part` returns, got str",
        ),
        (lambda _: ss.deformed(None), "experiment: expected what `run_experiment`"),
        (
            lambda _: ss.analyse(ss.load_robot("biglide"), [[0, 0, 0.4]]),
            "mechanism: expected what `assemble` returns",
        ),
        (
            lambda robot: ss.analyse(robot, [[0, 0, 0.4]], gravity="yes"),
            "gravity: expected none or exact, got 'yes'",
        ),
        (
            lambda robot: ss.stiffness(robot, [[0, 0, 0.4]], gravity="literal"),
            "gravity: expected none or exact",
        ),
        (
            lambda robot: ss.modes(robot, [[0, 0, 0.4]], drives="locked"),
            "drives: expected held or free, got 'locked'",
        ),
        (
            lambda robot: ss.modes(robot, [[0, 0, 0.4]], -1),
            "count: expected at least 1 mode, a whole number, got -1",
        ),
        (
            lambda robot: ss.modes(robot, [[0, 0, 0.4]], "3"),
            "count: expected at least 1 mode, a whole number, got '3'",
        ),
    ],
)
def test_arguments_that_are_none_are_refused_by_their_names(call, message):
    with pytest.raises(ss.InputError, match=f"^{re.escape(message)}"):
        call(ss.assemble(ss.load_robot("biglide"), "published"))


def test_a_robot_is_made_in_python():
    """A beam on a stiff slide: the tool's compliance is the beam's and, along the slide, the drive's."""
    beam = np.diag([1e-9, 4e-8, 4e-8, 1e-5, 1e-5, 1e-5])
    machine = ss.Mechanism(
        bodies=(
            ss.member("beam", [0, 0, 0], [0.3, 0, 0], beam, y=[0, 1, 0]),
            ss.Body("hand", 2.0, [0.3, 0, 0]),
        ),
        joints=(
            ss.Joint(
                "slide",
                "ground",
                "beam.base",
                "prismatic",
                [0, 0, 0],
                [1, 0, 0],
                drive=ss.Drive(1e7, -0.1, 0.1),
            ),
            ss.Joint("weld", "beam.tip", "hand", "fixed", [0.3, 0, 0]),
        ),
        tool=ss.Tool("hand", [0.3, 0, 0], ("x",)),
        gravity=[0, 0, -9.81],
    )
    found = ss.configure(machine, [[0.3], [0.35]]).require_valid()
    expected = np.linalg.inv(beam + np.diag([1e-7, 0, 0, 0, 0, 0]))
    np.testing.assert_allclose(
        ss.stiffness(machine, found), [expected] * 2, rtol=1e-9, atol=1e-3
    )
    assert ss.sag(machine, found)[1, 2] == pytest.approx(-4e-8 * 2.0 * 9.81)
    assert ss.analyse(machine, found).mobility.tolist() == [0, 0]
    assert ss.deflection(machine, found, [10, 0, 0, 0, 0, 0]).shares["slide"][
        0
    ] == pytest.approx(100 / 101)
    assert "range" in ss.configure(machine, [[0.5]]).reason(0)


def test_a_campaign_folder_is_diagnosed():
    found = ss.diagnose("published")
    assert isinstance(found, ss.Diagnosis)
    assert (found.verdict, found.effects[0].effect) == ("identified", "scale")


def test_results_have_names_in_xarray_and_pandas_and_are_told_in_a_line():
    robot = ss.load_robot("biglide")
    machine = ss.assemble(robot, "published")
    poses = [(0.0, 0.0, 0.4), (0.01, 0.0, 0.45)]
    pushed = ss.deflection(machine, poses, [0, 3, 0, 0, 0, 0])
    state = ss.analyse(machine, poses)
    compliance = state.to_xarray().compliance.sel(twist="rx", wrench="fy")
    assert 3 * compliance.values == pytest.approx(
        pushed.to_xarray().twist_at_M.sel(twist="rx").values, rel=1e-9
    )
    table = pushed.to_pandas()
    assert table[["x", "y", "z"]].to_numpy().tolist() == [list(pose) for pose in poses]
    assert table.filter(like="share_").sum(axis=1).to_numpy() == pytest.approx(1.0)
    found = ss.modes(machine, poses, 2)
    assert (
        found.to_pandas()["frequency_2"].tolist()
        == found.to_xarray().frequency.sel(mode=2).values.tolist()
    )
    assert all(
        len(repr(each)) < 600
        for each in (robot, machine, state, pushed, found, state.configurations)
    )

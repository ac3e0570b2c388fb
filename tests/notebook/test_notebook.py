"""Notebooks: every object that the façade gives shows as a table, jobs as bars, the robot as a page that turns."""

import re
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output

import stiffscope as ss
from stiffscope.experiments.comparison import Comparison, Entry
from stiffscope.fea.derivatives import Derivative, PartSensitivity
from stiffscope.imports.import_assembly import Imported
from stiffscope.imports.simulator_model import ModelJoint, SimulatorModel
from stiffscope.notebook.objects import SHOWN, as_html, open_bar, register
from stiffscope.report import part_tables
from stiffscope.robot.inspection import Doubt
from stiffscope.runtime.progress import LISTENERS, silence
from tests.gap.test_diagnosis_report import HOSTILE, Page
from tests.report.browser import CHROMIUM, browser
from tests.report.test_terminal import diagnosed, state

pytestmark = pytest.mark.slow


def experiment():
    matrix = np.diag([5.8e-11, 1.9e-10, 4.3e-9, 1.3e-7, 1.7e-6, 7e-9])
    matrix[0, 1] = matrix[1, 0] = 1e-15
    return SimpleNamespace(
        part=HOSTILE,
        interface="rigid",
        compliance=matrix,
        error=1e-3 * np.abs(matrix) + 1e-14,
        mass=4.2,
        reference_point=np.array([0.085, 0.0, -0.0]),
        relative_bound=0.001,
        note="",
    )


def test_an_experiment_shows_every_entry_with_its_bound():
    page = Page(as_html(experiment(), part_tables.show_experiment))
    assert page.tags.count("td") == 36 + 1
    assert page.words.count("·") == 30
    assert "5.800e-11 ± 7e-14" in page.words
    assert "script" not in page.tags
    assert "(85, 0, 0) mm" in " ".join(page.words)
    assert len(re.findall("zero within its error bound", " ".join(page.words))) == 1


@pytest.fixture(scope="module")
def machine():
    return ss.assemble(ss.load_robot("biglide"), "published")


def objects(machine):
    """Each object of the façade, with words that its table must have."""
    robot = ss.load_robot("biglide")
    poses = list(robot.poses.values())
    zeros = np.zeros((6, 6))
    tested = ss.Experiment(
        **dict.fromkeys(field.name for field in fields(ss.Experiment))
        | {
            "part": "plate",
            "interface": "rigid",
            "full_compliance": np.eye(6),
            "full_error": zeros,
            "reference_points": np.zeros((1, 3)),
            "mass": 2.5,
            "note": "",
            "unknowns": 6,
            "imbalance": 0.0,
            "volume": 1.0,
            "cad_volume": 1.0,
        }
    )
    derivative = Derivative(0.02, "m", zeros, zeros, None, None, 1.5, *[None] * 4)
    entry = Entry("C35", "m/(N·m)", -7.3e-8, 2.2e-11, -8e-8, -8e-8, -8e-8)
    drive = next(joint for joint in machine.joints if joint.drive)
    yield ss.material("steel"), ("Material steel, SI", "youngs_modulus", "2.11e+11")
    yield ss.build_part(robot, "link"), ("Part link", "1.92", "kg", "clamped")
    yield tested, ("plate, rigid", "2.5 kg")
    yield (
        PartSensitivity("slider", {"thickness": derivative}),
        ("thickness", "0.02", "1.5"),
    )
    yield ss.Settings(tolerance=0.01), ("Settings, SI", "tolerance", "0.01")
    yield diagnosed(), ("Identified", "Alternatives", "data:image/svg+xml")
    yield (
        ss.study(Path(__file__).parents[2] / "examples" / "rod-study.toml"),
        ("rod.radius", "designs"),
    )
    yield (
        Comparison("slider", (entry,), ("a finding",)),
        ("C35", "Timoshenko", "a finding"),
    )
    yield robot, ("degrees of freedom", "limb1.actuator")
    joints = (ModelJoint("a/b", "a", "b", "revolute", np.zeros(3)),)
    model = SimulatorModel("m", (), joints, "b", np.zeros(3), (), np.zeros(3), ())
    yield (
        Imported(Path("m.toml"), model, (Doubt(("a", "b"), "a pin or a screw"),)),
        ("revolute", "a pin or a screw"),
    )
    yield (
        ss.sensitivity(robot, components="published"),
        ("Sensitivity at x, y, z (mm) = 0, 0, 347.48", "link.length"),
    )
    yield (
        ss.configure(machine, [poses[0], (0.0, 0.0, 9.0)]),
        ("yes", "no", "out of reach"),
    )
    yield machine.bodies[0], (f"Body {machine.bodies[0].name}", "mass")
    yield drive.drive, ("Drive, SI", "stiffness", "1.27e+07")
    yield drive, (f"Joint {drive.name}", "prismatic", "stiffness 1.27e+07")
    yield machine, ("Bodies", "Joints", "limb1.actuator", "gravity (0, 0, 9.81)")
    yield machine.tool, ("Tool, SI", "x, y, z")
    yield ss.modes(machine, poses, 2), ("Natural frequencies", "Hz")
    yield ss.analyse(machine, poses), ("Stiffness at M", "23.")
    yield (
        ss.deflection(machine, poses, [0, 0, 100, 0, 0, 0]),
        ("Deflection at M", "8.06", "limb1.actuator"),
    )


@pytest.fixture
def shell():
    yield InteractiveShell.instance()
    InteractiveShell.clear_instance()


@pytest.mark.extended
def test_every_object_shows_as_a_table(machine, shell):
    """In IPython, by the classes' names as registered; none is left out, and none is a mere repr."""
    register()
    seen = set()
    for value, words in objects(machine):
        formats, _ = shell.display_formatter.format(value)
        assert "<table>" in formats["text/html"]
        Page(formats["text/html"])
        assert [word for word in words if word not in formats["text/html"]] == [], value
        seen.add(
            f"{type(value).__module__.removeprefix('stiffscope.')}.{type(value).__name__}"
        )
    assert seen == set(SHOWN) - {"cad.materials.TransverselyIsotropic"}
    facade = {
        f"{v.__module__.removeprefix('stiffscope.')}.{n}"
        for n in ss.__all__
        if isinstance(v := getattr(ss, n), type)
    }
    assert facade - set(SHOWN) == {"errors.InputError", "errors.StiffscopeError"}


def test_a_stack_shows_its_first_poses():
    many = state(
        np.zeros((30, 2)),
        np.tile(1e6 * np.eye(6), (30, 1, 1)),
        np.full((30, 6), 3e-6),
        ("x", "rz"),
    )
    found = SimpleNamespace(
        poses=many.poses,
        tool=many.tool,
        mechanism=many.configurations.mechanism,
        linkage=SimpleNamespace(length=1.0),
    )

    class Stack(SimpleNamespace):
        def __getitem__(self, some):
            return Stack(
                poses=self.poses[some],
                tool=self.tool[some],
                mechanism=self.mechanism,
                linkage=self.linkage,
            )

    object.__setattr__(many, "configurations", Stack(**vars(found)))
    page = Page(as_html(many))
    assert page.tags.count("tr") == 1 + 2 * 20  # K_ii, and 1/C_ii below
    assert "and 10 more poses" in page.words
    assert {"x, rz (mm, deg)", "|sag| µm", "5.20"} <= set(page.words)


def test_a_job_is_a_bar_until_it_is_done(shell):
    with capture_output() as said:
        report = open_bar("<slider>")
        report("mesh", 0.4)
        report("solve", 1.0)
        open_bar("kept")("done", 1.0)
    first, last = (each.data["text/html"] for each in said.outputs)
    assert "&lt;slider&gt;" in first
    assert 'value="0.400"' in first
    assert last == ""
    assert LISTENERS.open_line("job") is silence  # outside a notebook


@pytest.mark.extended
@pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is missing: apt-get install chromium"
)
def test_the_robot_turns_inside_a_cell(machine, tmp_path):
    robot = ss.load_robot("biglide")
    shown = ss.view(ss.modes(machine, list(robot.poses.values()), 2), robot)
    (tmp_path / "cell.html").write_text(
        f"<!doctype html><meta charset='utf-8'><body>{shown._repr_html_()}", "utf-8"
    )
    shown.save(tmp_path / "view.html")
    assert (tmp_path / "view.html").read_text("utf-8") == shown.html
    with browser() as tab:
        tab.open(tmp_path / "cell.html")
        tab.wait(
            "document.querySelector('iframe').contentDocument.querySelector('.robot-view')?.dataset.drawn === 'yes'"
        )
        seen = tab.shot("iframe")
        assert len(np.unique(seen.reshape(-1, 3), axis=0)) > 500
        assert tab.requests() == [(tmp_path / "cell.html").as_uri()]


def test_a_robot_without_a_file_turns():
    compliance = np.diag([1e-9, 4e-8, 4e-8, 1e-5, 1e-5, 1e-5])
    arm = ss.Mechanism(
        bodies=(
            ss.member("beam", [0, 0, 0], [0.3, 0, 0], compliance, y=[0, 1, 0]),
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
    )
    assert '"element": "beam"' in ss.view(arm).html
    with pytest.raises(
        ss.InputError,
        match=r"^view: expected a mechanism, as `assemble` makes it, .* got RobotFile$",
    ):
        ss.view(ss.load_robot("delta"))

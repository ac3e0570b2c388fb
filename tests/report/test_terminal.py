"""Tables on terminals: never cut off, whole numbers, zeros as zeros, ASCII where a terminal knows no more."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace as Stub

import numpy as np
import pytest

from stiffscope.experiments.comparison import Comparison, Entry
from stiffscope.gap.inference.diagnosis import (
    Alternative,
    Diagnosis,
    Effect,
    Gap,
    NextMeasurement,
    Parameter,
    Where,
)
from stiffscope.gap.show.tables import show_diagnosis
from stiffscope.gap.show.text import sentence
from stiffscope.lab.blind.scores import Outcome, Scores
from stiffscope.lab.show import show_scores
from stiffscope.parts.show import show_interfaces
from stiffscope.report import part_tables, tables
from stiffscope.report.numbers import find_resolved, name_pose
from stiffscope.report.progress import progress
from stiffscope.report.terminal import in_encoding, show_line, show_table
from stiffscope.vjm.statics.analysis import Stiffness

PAIR = "actuator-stiffness + slider-compliance", "limb1 + sliders"


def parts():
    facts = {
        "mesh": {"nodes": 1_049_572, "tetrahedra": 730_571},
        "seconds": {"cad": 15.4, "mesh": 1008.5, "solve": 10810.2},
        "tolerance": 1e-3,
        "volume": 1 - 1e-9,
        "cad_volume": 1.0,
        "mass": 14.27,
        "relative_bound": 6.3e-4,
    }
    part_tables.show_parts(
        [Stub(name="slider", facts=facts, note="", reused=False, seconds=12810.8)]
    )


def comparison():
    entry = Entry(
        "C35", "m/(N·m)", -7.34875e-8, 2.2e-11, -8.0254e-8, -8.0254e-8, -8.0255e-8
    )
    part_tables.show_comparison(
        Comparison(
            "slider",
            (entry, entry),
            ("C22 as published is 10.7 times too stiff: no shear",),
        )
    )


def interfaces():
    choices = [
        Stub(
            choice=Stub(
                name=name,
                words="the loaded face carries the load evenly",
                overrides=("slider.pads=apart",),
            )
        )
        for name in (
            "rigid face, rigid clamp",
            "even traction",
            "three pads",
            "bolt holes",
            "foundation",
        )
    ]
    entry = Stub(
        name="C66",
        unit="rad/(N·m)",
        own=7.00122e-9,
        error=2e-12,
        changes=(3.625,) * 4,
        bars=(9.3e-3,) * 4,
    )
    show_interfaces(
        Stub(
            part="slider",
            own=choices[0],
            others=choices[1:],
            entries=[entry],
            left_out=(),
        )
    )


def state(poses, matrix, sag, pose=("x", "y", "z")):
    """What a robot does at tool poses (n, k)."""
    poses = np.asarray(poses, dtype=float)
    found = Stub(
        poses=poses,
        tool=np.zeros((len(poses), 6)),
        mechanism=Stub(tool=Stub(pose=pose)),
        linkage=Stub(length=1.0),
    )
    n = len(poses)
    k = np.asarray(matrix)
    rigid = (np.zeros((0, 6)),) * n
    return Stiffness(
        found,
        k,
        np.asarray(sag),
        np.zeros(n, dtype=int),
        np.ones(n),
        np.linalg.pinv(np.nan_to_num(k)),
        rigid,
    )


def stiffness():
    matrix = np.diag([23.8718, 1.9639, 12.4172, 1.3612, 0.1401, 2.675]) * 1e6
    matrix[1, 3] = matrix[3, 1] = -1e-3
    poses = [[0.0, -0.0, 0.3475], [-0.125, 0.1125, 0.5055]]
    names = ["Q1", "-0.125,0.1125,0.5055"]
    tables.show_stiffness(
        names,
        state(poses, [matrix] * 2, np.full((2, 6), 1.098e-5)),
        [1e-4 * np.abs(matrix)] * 2,
    )
    soft = 1e-3 * matrix
    turned = np.hstack([poses, -0.0 * np.ones((2, 1)), 0.1047 * np.ones((2, 2))])
    tables.show_stiffness(
        names,
        state(turned, [soft] * 2, np.zeros((2, 6)), ("x", "y", "z", "rx", "ry", "rz")),
    )
    tables.show_change(
        names, [matrix] * 2, [matrix * (1 - 1e-9)] * 2, ["slider.thickness=25mm"]
    )


def matrices():
    matrix = np.diag([5.8e-11, 1.9e-10, 4.3e-9, 1.3e-7, 1.7e-6, 7e-9])
    matrix[1, 5] = matrix[5, 1] = -2.97536e-10
    part_tables.show_matrices(
        {"Compliance of the slider, SI": (matrix, 1e-4 * np.abs(matrix))}
    )


def deflection():
    names = [f"pose {k}" for k in range(12)]
    tables.show_deflection(
        names,
        np.full((12, 6), -1.23456e-5),
        {"limb1.actuator": [0.4699] * 12},
        "0,0,100,0,0,0",
    )


def faces():
    row = {
        "index": 12,
        "kind": "cylinder",
        "area_mm2": 12345.6,
        "centroid_mm": [-123.456, -123.456, -123.456],
        "axis": [-0.7071, -0.7071, -0.7071],
        "radius_mm": 12.25,
    }
    part_tables.show_faces("part.step", [row])


def diagnosed(**more):
    effect = Effect(
        *PAIR,
        0.9979,
        1.25,
        {
            "factor": Parameter(-1e-4, 5e-3, "1", nominal=1.0),
            "c33": Parameter(4.3e-9, 1e-10, "m/N", nominal=1.0),
        },
    )
    alternative = Alternative(
        *PAIR,
        1.9e-6,
        6.66,
        "ln-evidence 16.1 below that of the diagnosis, χ² per reading 3.53",
    )
    gap = Gap(9.19, 1.25, 1.18, 1.37, (1044.91, 0.8348))
    where = Where(
        {"x": 0.5, "y": 0.5},
        {},
        ("A", "B"),
        ((1.0,) * 6, (2.0,) * 6),
        ((1.0,) * 6, (1.0,) * 6),
    )
    facts = {
        "next_measurement": NextMeasurement(("a", "b"), 3.2, pose="A"),
        "remarks": ("12 readings",),
    } | more
    return Diagnosis(
        "identified", gap, (effect, effect), (alternative,), where, **facts
    )


def test_where_the_stiffness_is_infinite_the_compliance_is_shown(capsys):
    """A plane arm yields along x and y and about z alone."""
    found = state(
        [[0.3, 0.2]], np.full((1, 6, 6), np.nan), np.zeros((1, 6)), ("x", "y")
    )
    yields = np.diag([1e-6, 2e-6, 0.0, 0.0, 0.0, 1e-4])
    tables.show_stiffness(
        ["A"], replace(found, compliance=yields[None], rigid=(np.eye(6)[2:5],))
    )
    words = capsys.readouterr().out.split()
    assert words.count("rigid") == 3
    assert {"1000.0000", "500.0000", "10.0000"} <= set(words)


def test_the_headline_names_the_group_and_the_reading_that_would_tell():
    found = diagnosed(
        next_measurement=NextMeasurement(("a", "b"), 3.2, pose="A", quantity="dx")
    )
    alike = replace(found.effects[0], confused_with=("column-compliance @ column",))
    said = sentence(replace(found, effects=(alike,)))
    assert "cannot distinguish" in said
    assert "from column compliance (column)" in said
    assert "Next: read dx at pose A: distinguishes a from b" in said
    assert "Next" not in sentence(found)  # nothing is confused with it


def diagnosis():
    show_diagnosis(diagnosed())


def blind():
    wrong = Outcome(
        7,
        "pair",
        ("actuator-stiffness @ limb1", "slider-compliance @ sliders"),
        "identified",
        ("backlash @ limb2",),
        ((),),
        1030.9,
        (3.93, 1.68, 1.7, 1.73),
        (True,) * 60,
    )
    show_scores(Scores((wrong,), None, 0.958, 0.861, None, 0.03, 0.0, 1.0, 0.908, 1.07))


SHOWN = [
    parts,
    comparison,
    interfaces,
    stiffness,
    matrices,
    deflection,
    faces,
    diagnosis,
    blind,
]
NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\d,.]*(?:e[-+]\d+)?(?![\w.])")


@pytest.mark.parametrize("show", SHOWN, ids=lambda f: f.__name__)
@pytest.mark.parametrize("width", [80, 44])
def test_no_number_is_cut_off(show, width, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "500")
    show()
    whole = set(NUMBER.findall(capsys.readouterr().out))
    monkeypatch.setenv("COLUMNS", str(width))
    show()
    said = capsys.readouterr().out
    assert "…" not in said
    assert set(NUMBER.findall(said)) == whole
    if width == 80:
        rules = [line for line in said.splitlines() if line and set(line) <= {"─", " "}]
        assert rules
        assert max(map(len, rules)) <= width


@pytest.mark.parametrize("show", SHOWN, ids=lambda f: f.__name__)
def test_no_zero_has_a_sign(show, capsys):
    show()
    assert not re.search(r"-0(\.0*)?(?![\d.])", capsys.readouterr().out)


def test_the_first_columns_are_repeated_and_empty_ones_left_out(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "30")
    show_table(
        "Title",
        (("pose",), ("one", "two"), ("three", "four")),
        [("Q1", "1" * 8, "2" * 8, "3" * 8, "")],
    )
    lines = [
        line.split()
        for line in capsys.readouterr().out.splitlines()
        if line.strip("─ ")
    ]
    assert lines == [
        ["Title"],
        ["pose", "one", "two"],
        ["Q1", "1" * 8, "2" * 8],
        ["pose", "three"],
        ["Q1", "3" * 8],
    ]


@pytest.mark.parametrize(
    "groups", [[["kg", "first", "second"]], [["kg"], [], ["first", "second"]]]
)
def test_a_table_shows_its_rows_however_its_columns_are_grouped(capsys, groups):
    show_table("Mass", groups, [["solids", "12.3", "4.56"]])
    title, heads, _, row = capsys.readouterr().out.rstrip().splitlines()
    assert title == "Mass"
    assert heads.split() == ["kg", "first", "second"]
    assert row.split() == ["solids", "12.3", "4.56"]


def test_brackets_in_names_are_brackets(capsys):
    show_table("[/b] [red]", (("pose",), ("[bold]",)), [("[/x]", ":smile:")])
    show_line("[/b]")
    said = capsys.readouterr().out
    assert all(text in said for text in ("[/b] [red]", "[bold]", "[/x]", ":smile:"))


def test_mesh_noise_is_shown_as_zero(capsys):
    matrix = np.diag([1e-9, 1e-9, 1e-9, 1e-6, 1e-6, 1e-6])
    matrix[0, 1] = matrix[1, 0] = 1e-12  # within its bound
    matrix[2, 4] = matrix[4, 2] = 1e-15  # below 1e-6 of sqrt(1e-9 1e-6)
    matrix[1, 5] = matrix[5, 1] = 1e-13  # small, but beyond bound and noise
    error = np.full((6, 6), 2e-12)
    error[1, 5] = error[5, 1] = 1e-14
    assert np.argwhere(np.triu(find_resolved(matrix, error), 1)).tolist() == [[1, 5]]
    part_tables.show_matrices({"C": (matrix, error)})
    said = capsys.readouterr().out
    assert said.count("·") == 28 + 1
    assert len(re.findall("zero within its error bound", said)) == 1


def test_deflection_below_its_bound_is_zero(capsys):
    tables.show_deflection(
        ["Q"],
        np.array([[3e-12, 2e-9, 8e-6, 0, 1e-9, 2e-7]]),
        {},
        "w",
        np.full((1, 6), 1e-8),
    )
    row = next(
        line for line in capsys.readouterr().out.splitlines() if line.startswith("Q")
    )
    assert row.split() == ["Q", "0", "0", "8", "0", "0", "0.2"]


@pytest.mark.extended_for("ascii")
@pytest.mark.parametrize(
    "encoding",
    [
        "ascii",
        "utf-8",
        *(pytest.param(e, marks=pytest.mark.long) for e in ("latin-1", "cp1252")),
    ],
)
def test_every_terminal_can_show_the_tables(encoding):
    code = "from tests.report import test_terminal as t\nfor show in t.SHOWN: show()"
    environment = os.environ | {
        "PYTHONIOENCODING": encoding,
        "NO_COLOR": "1",
        "COLUMNS": "80",
        "PYTHONUTF8": "0",
    }
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr.decode()
    said = done.stdout.decode(encoding)
    assert ("10⁶ N·m/rad" in said) == (encoding == "utf-8")
    assert encoding == "utf-8" or "10^6 N*m/rad" in said
    assert "?" not in said


def test_ascii_spelling():
    assert in_encoding("10⁻⁶ µm² ± 3·σ", "ascii") == "10^-6 um^2 +/- 3*sigma"
    assert in_encoding("10⁻⁶ µm² ± 3·σ", "utf-8") == "10⁻⁶ µm² ± 3·σ"
    assert in_encoding("µm ± 3", "latin-1") == "µm ± 3"


def test_displacements_of_drives_are_in_their_own_units():
    assert (
        name_pose((0.25, 1.5), ("q:slide", "q:elbow"))
        == "q:slide, q:elbow (m or rad) = 0.25, 1.5"
    )
    assert name_pose((0.25, np.pi / 2), ("x", "rz")) == "x, rz (mm, deg) = 250, 90"


def test_long_work_without_a_terminal_writes_lines_now_and_then(monkeypatch, capsys):
    clock = [0.0]
    monkeypatch.setattr("stiffscope.report.progress.time.monotonic", lambda: clock[0])
    for quiet, lines in ((False, 3), (True, 0)):
        clock[0] = 0.0
        with progress(quiet=quiet) as open_line:
            report = open_line("slider")
            for second in range(80):
                clock[0] = float(second)
                report("mesh", second / 80)
        written = capsys.readouterr().err.splitlines()
        assert len(written) == lines
    with progress(quiet=False) as open_line:
        open_line("link")("solve", 0.5)
    assert capsys.readouterr().err == ""

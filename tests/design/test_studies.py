"""Studies: known optima, fronts and tables; failed, stored and resumed designs; study files that are refused."""

import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stiffscope.cli.main import _guarded
from stiffscope.design import making
from stiffscope.design.show.studies import show_study
from stiffscope.design.studies import study
from stiffscope.design.study_reading import load_study
from stiffscope.design.verdicts import find_nearest
from stiffscope.errors import InputError
from stiffscope.robot.reader import load_robot
from tests.experiments.one_part import PLATE, ROD, one_part

pytestmark = pytest.mark.slow

E = 211e9
RHO = 7850.0  # of the built-in steel
BEAM = '\ncompliance = "beam"'
HEAD = 'robot = "robot.toml"\n'


@pytest.fixture
def rod(tmp_path):
    """A folder with a rod on a slide, and a function that writes a study of it."""
    one_part(tmp_path, ROD + BEAM)
    return _writer(tmp_path)


def _writer(folder):
    def write(text):
        (folder / "study.toml").write_text(HEAD + text)
        return folder / "study.toml"

    return write


def test_rod_of_least_mass_for_an_axial_stiffness(rod):
    file = rod(
        'method = "optimum"\ndesigns = 60\nminimize = "mass"\nconstraints = ["stiffness >= 200 N/um"]\n'
        '[parameters]\n"bar 1.radius" = ["2 mm", "20 mm"]\n"bar 1.bore" = ["0 mm", "3 mm"]\n'
        '[responses]\nmass = "mass"\nstiffness = { of = "1/(C11 - 1e-7)", unit = "N/m" }\n'
    )
    made = study(file)
    assert len(made.best) == 1
    mass, stiffness = made.designs[made.best[0]].responses
    assert stiffness >= 2e8 * (1 - 2e-6)
    assert mass == pytest.approx(
        RHO * 2e8 * 0.060**2 / E, rel=5e-3
    )  # k = E A / L, m = rho A L
    assert len(made.designs) <= 60


@pytest.mark.extended
def test_plate_thickness_under_a_mass_limit(tmp_path):
    one_part(tmp_path, PLATE + BEAM)
    file = _writer(tmp_path)(
        'method = "optimum"\ndesigns = 40\nminimize = "bending"\nconstraints = ["mass <= 600 g"]\n'
        '[parameters]\n"bar 1".thickness = ["4 mm", "30 mm"]\n[responses]\nmass = "mass"\nbending = "C33"\n'
    )
    made = study(file)
    thickness = made.designs[made.best[0]].values[0]
    assert thickness == pytest.approx(0.6 / (RHO * 0.060 * 0.090), rel=5e-3)
    assert (
        load_robot(file.parent / "robot.toml")
        .parts["bar 1"]
        .parameters()
        .lengths()["thickness"]
        == 0.010
    )


GRID = (
    'method = "grid"\n[parameters]\n"bar 1.radius" = { range = ["4 mm", "8 mm"], steps = 3 }\n'
    '"bar 1.bore" = { values = ["0 mm", "9 mm"] }\n[responses]\nmass = "mass"\nK = "K_tx"\nsag = "sag"\n'
)


def test_a_design_that_cannot_be_is_a_row_with_its_reason(rod):
    table = study(rod(GRID)).table
    assert list(table["bar 1.radius [m]"]) == [0.004, 0.004, 0.006, 0.006, 0.008, 0.008]
    assert list(table["state"]) == [
        "feasible",
        "failed",
        "feasible",
        "feasible",
        "feasible",
        "feasible",
    ]
    assert "bore" in table["reason"][1]
    assert math.isnan(table["K [N/m]"][1])
    radius, bore = (table[f"bar 1.{name} [m]"].drop(1) for name in ("radius", "bore"))
    area = math.pi * (radius**2 - bore**2 / 4)
    assert np.allclose(
        table["K [N/m]"].drop(1), 1 / (1e-7 + 0.060 / (E * area)), rtol=1e-9
    )
    assert np.allclose(table["mass [kg]"].drop(1), RHO * area * 0.060, rtol=1e-9)


def test_finished_designs_are_stored_and_not_made_again(rod, tmp_path, monkeypatch):
    made = []
    make = making.make_design

    def count(file, values):
        if values is not None:  # those of the present design, made each time
            made.append(values)
        return make(file, values)

    monkeypatch.setattr(making, "make_design", count)
    first = study(rod(GRID), folder=tmp_path / "kept").table
    (journal,) = (tmp_path / "kept").iterdir()
    head, *rows = journal.read_text().splitlines(keepends=True)
    assert len(made) == len(rows) == 6
    assert "K [N/m]" in json.loads(head)["columns"]
    strange = "[[1], [2]]\n", '[[[1], 0], [1, 2, 3], "", 0]\n'
    journal.write_text(
        "".join([head, *strange, *rows[1:-1], rows[-1][:30]])
    )  # one lost, the last torn
    assert study(rod(GRID), folder=tmp_path / "kept").table.equals(first)
    assert len(made) == 8
    assert study(rod(GRID), folder=tmp_path / "kept").table.equals(first)
    assert len(made) == 8
    finer = GRID.replace("steps = 3", "steps = 5").replace(
        '"grid"', '"grid"\nmaximize = "K"'
    )
    assert len(study(rod(finer), folder=tmp_path / "kept").designs) == 10
    assert len(made) == 12  # those at new values
    study(rod(GRID.replace('"K_tx"', '"K_ty"')), folder=tmp_path / "kept")
    assert len(made) == 18  # another study's designs are not this one's


def test_a_study_that_is_stopped_says_what_it_keeps(rod, tmp_path, monkeypatch, capsys):
    def stop(file, store, *_, **__):
        if store.parent.name == "some":
            study(file.path, folder=store)
        raise KeyboardInterrupt

    monkeypatch.setattr("stiffscope.design.command.run_study", stop)
    for name, said in (
        ("some", "6 finished designs are kept in"),
        ("none", "nothing half-written is left"),
    ):
        out = tmp_path / name / "out"
        assert _guarded(["study", str(rod(GRID)), "--out", str(out), "--quiet"]) == 1
        assert (
            capsys.readouterr().err.strip().startswith(f"stiffscope: stopped; {said}")
        )


@pytest.mark.parametrize(
    ("method", "part"),
    [
        ("optimum", "1/2"),
        ("grid", "0/2"),
        ("grid", "3/2"),
        ("grid", "x"),
        ("grid", "1/7"),
    ],
)
def test_shares_that_are_none_are_refused(rod, tmp_path, capsys, method, part):
    file = rod(GRID.replace('"grid"', f'"{method}"\nminimize = "mass"'))
    assert (
        _guarded(["study", str(file), "--part", part, "--out", str(tmp_path / "out")])
        == 2
    )
    assert "--part: expected " in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_present_design_stands_beside_the_others(rod, capsys):
    made = study(rod(GRID))
    radius, bore = made.present.values
    area = math.pi * (radius**2 - bore**2 / 4) if bore != "as in the file" else 0.0
    area = area or math.pi * radius**2
    by_name = dict(
        zip([r.name for r in made.file.responses], made.present.responses, strict=True)
    )
    assert by_name["mass"] == pytest.approx(RHO * area * 0.060, rel=1e-9)
    assert by_name["K"] == pytest.approx(1 / (1e-7 + 0.060 / (E * area)), rel=1e-9)
    show_study(made)
    assert "0, as it is" in capsys.readouterr().out


def test_a_limit_that_no_parameter_changes_is_told_after_a_few_designs(rod, caplog):
    text = (
        'method = "grid"\nminimize = "K_rx"\nconstraints = ["weight >= 1 kg", "K >= 1 N/m"]\n'
        '[parameters]\n"bar 1.radius" = { range = ["4 mm", "8 mm"], steps = 5 }\n'
        '[responses]\nweight = { of = "mass - mass", unit = "kg" }\nK = "K_tx"\nK_rx = "K_rx"\n'
    )
    study(rod(text))
    told = [line for line in caplog.messages if "does any of its parameters" in line]
    assert len(told) == 1
    assert "weight is 0 kg in the present design and in the first 4" in told[0]


@pytest.mark.parametrize(("succeed", "told"), [(3, False), (4, True)])
def test_only_designs_that_were_computed_count_as_unchanged(
    rod, tmp_path, caplog, succeed, told
):
    def run(*bores):
        caplog.clear()
        values = ", ".join(f'"{bore} mm"' for bore in bores)
        text = (
            'method = "grid"\nconstraints = ["weight >= 1 kg"]\n'
            f'[parameters]\n"bar 1.bore" = {{ values = [{values}] }}\n'
            '[responses]\nweight = { of = "mass - mass", unit = "kg" }\n'
        )
        made = study(rod(text), folder=tmp_path / "kept")
        return made, "does any of its parameters" in caplog.text

    # a bore beyond the diameter of 12 mm cannot be
    failing = (13, 14, 15, 16)
    made, warned = run(*failing, *range(1, succeed + 1))
    assert list(made.outcomes.states).count("failed") == 4
    assert warned == told
    # all but one of them are stored
    assert not run(*failing, *range(1, succeed + 2))[1]


def test_a_study_says_why_nothing_is_feasible(rod, capsys):
    """K = 1/(1e-7 + L/(EA)) is at most 10 N/um whatever the rod: no design reaches 9.9."""
    made = study(
        rod(
            GRID.replace(
                '"grid"', '"grid"\nconstraints = ["K >= 9.9 N/um", "mass <= 66 g"]'
            )
        )
    )
    nearest = find_nearest(made)
    shortfall = made.outcomes.excess
    assert nearest.design == np.nanargmin(shortfall)
    assert nearest.met == (0, 4)
    show_study(made)
    told = capsys.readouterr().out
    assert (
        f"No design is feasible: the nearest, design {nearest.design + 1}, has K"
        in told
    )
    assert "K >= 9.9 N/um: met by none of 5 designs" in told


@pytest.mark.extended
def test_a_study_of_which_every_design_failed_is_refused_beside_its_reasons(
    rod, tmp_path, capsys
):
    file = rod(GRID.replace('"0 mm", "9 mm"', '"9 mm"').replace('"8 mm"', '"4.4 mm"'))
    share = "--part", "1/2", "--out", str(tmp_path / "share")
    assert _guarded(["study", str(file), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert "3 failed" in said.out
    assert (
        "study.toml: expected a design that can be computed, got none; the first: --set"
        in said.err
    )
    assert (tmp_path / "out" / "designs.csv").exists()
    assert not (tmp_path / "out.designs").exists()
    assert _guarded(["study", str(file), *share, "--quiet"]) == 0


@pytest.mark.extended
def test_a_study_says_what_ended_on_a_bound_and_whether_it_converged(rod, capsys):
    """The lightest rod above a stiffness that the thinnest has: its radius ends on its lower bound."""
    text = (
        'method = "optimum"\ndesigns = {}\nminimize = "mass"\nconstraints = ["stiffness >= 1 N/um"]\n'
        '[parameters]\n"bar 1.radius" = ["2 mm", "20 mm"]\n'
        '[responses]\nmass = "mass"\nstiffness = {{ of = "1/C11", unit = "N/m" }}\n'
    )
    show_study(study(rod(text.format(60))))
    told = capsys.readouterr().out
    assert "bar 1.radius of the best design is at its lower bound, 2 mm" in told
    assert "the search converged (local search 1" in told
    show_study(study(rod(text.format(9))))  # enough for one local search, not for two
    assert "local search 1" in capsys.readouterr().out
    show_study(study(rod(text.format(8))))
    assert "the search did not converge" in capsys.readouterr().out


@pytest.mark.parametrize("method", ["sobol", "latin-hypercube"])
def test_sweeps_fill_the_ranges_and_repeat(rod, method):
    file = rod(
        f'method = "{method}"\ndesigns = 16\n[parameters]\nslide.drive.stiffness = ["5 N/um", "25 N/um"]\n'
        '"materials.steel.youngs_modulus" = ["200 GPa", "220 GPa"]\n[responses]\nK = "kx"\n'
    )
    table = study(file).table
    assert table.equals(study(file).table)
    drive = table["slide.drive.stiffness [N/m]"]
    modulus = table["materials.steel.youngs_modulus [Pa]"]
    assert sorted(((drive - 5e6) / 20e6 * 16).astype(int)) == list(
        range(16)
    )  # one of each sixteenth
    assert np.allclose(
        table["K [N/m]"],
        1 / (1 / drive + 0.060 / (modulus * math.pi * 0.006**2)),
        rtol=1e-9,
    )


REFUSED = {
    (
        '"kx"',
        '"kq"',
    ): r"study.toml:9: responses.K: expected a quantity \(mass, K_tx.*got \"kq\"",
    (
        '"5 N/um"',
        '"5 kg"',
    ): r"study.toml:5: parameters.slide.drive.stiffness: expected a range .*both ends in N/m",
    (
        "slide.drive",
        "slid.drive",
    ): r"study.toml:5: parameters.slid.drive.stiffness: .*did you mean \"slide\"",
    (
        '["5 N/um", "25 N/um"]',
        '{ values = ["5 N/um", "stiff"] }',
    ): r"study.toml:5: .*: expected values that are all num",
    (
        '["5 N/um", "25 N/um"]',
        '{ values = ["5 N/um", "5 kg"] }',
    ): r"study.toml:5: .*: expected values that are all in N/m, got",
    (
        'radius" = { values = ["5 mm", "6 mm"] }',
        'material" = { values = ["steel", "stell", "titanium"] }',
    ): r"study.toml:6: .*material: expected one of steel.* got .stell.",
    (
        '"5 N/um", "25 N/um"',
        '"5 N/um"',
    ): r"study.toml:5: .*: expected a range such as .*two ends",
    (
        '"5 N/um", "25 N/um"',
        '"25 N/um", "5 N/um"',
    ): r"study.toml:5: .*the lower end first",
    (
        "slide.drive",
        'parts."bar 1.radius" = ["5 mm", "6 mm"]\nslide.drive',
    ): r"study.toml:5: .*expected each value once, got \"bar 1.radius\" too",
    (
        '"sobol"',
        '"sobel"',
    ): r"study.toml:2: method: expected 'grid', 'latin-hypercube', 'sobol', 'optimum' or 'pareto'",
    (
        '"sobol"',
        '"optimum"',
    ): r"study.toml:2: method: expected one response to minimize or maximize",
    (
        "K <=",
        "L <=",
    ): r"study.toml:3: constraints\[0\]: expected a response \(K, f\), got \"L\"",
    (
        "3 N/m",
        "3 kg",
    ): r"study.toml:3: constraints\[0\]: expected a value of K such as .* got \"3 kg\", which is a mass",
    (
        "robot.toml",
        "robt.toml",
    ): r"study.toml:1: robot: .*robt.toml: expected a robot file",
    (
        '"sobol"',
        '"sobol"\nset = []\ntolerance = "5 kg"',
    ): r"study.toml:4: tolerance: --tolerance 5 kg: .* is a mass",
    (
        '"sobol"',
        '"sobol"\ndesigns = 0',
    ): r"study.toml:3: designs: expected 1 to 1000000, got 0",
    ("[responses]", "[response]"): r"study.toml:8: response: expected a known key",
    (
        '"home"',
        '"away"',
    ): r"study.toml:10: responses.f.at: expected a pose \(home\), got \"away\"",
    (
        '"home"',
        '["away"]',
    ): r"study.toml:10: responses.f.at: expected a pose \(home\), got \"away\"",
    ('"f1/K_tx"', '"f1/"'): r"study.toml:10: responses.f.of: expected an expression",
    (
        'unit = "1"',
        'unit = "kg"',
    ): r'responses.f.unit: expected a unit of kg\^-1 s\^1, which f1/K_tx measures, got "kg"',
    (
        'unit = "1"',
        'unit = "s*m/"',
    ): r'study.toml:10: responses.f.unit: expected a product of SI units .* "s\*m/"',
    (
        'unit = "1"',
        'unit = "s*um/N"',
    ): r'study.toml:10: responses.f.unit: expected a product of SI units .* "s\*um/N"',
    (', unit = "1"', ""): r"study.toml:10: responses.f.unit: expected the SI unit",
}


@pytest.mark.parametrize("change", REFUSED, ids=lambda pair: pair[1])
def test_bad_study_files_name_line_and_field(rod, change):
    text = (
        'method = "sobol"\nconstraints = ["K <= 3 N/m"]\n[parameters]\n'
        'slide.drive.stiffness = ["5 N/um", "25 N/um"]\n"bar 1.radius" = { values = ["5 mm", "6 mm"] }\n\n'
        '[responses]\nK = "kx"\nf = { of = "f1/K_tx", at = "home", unit = "1" }\n'
    )
    file = rod(text)
    load_study(file)
    assert change[0] in file.read_text()
    file.write_text(file.read_text().replace(*change))
    with pytest.raises(InputError, match=REFUSED[change]):
        load_study(file)


def test_the_file_in_the_guide_is_one(tmp_path):
    guide = (Path(__file__).parents[2] / "docs" / "guides" / "study.md").read_text(
        encoding="utf-8"
    )
    (block,) = re.findall(r"```toml\n(.*?)```", guide, re.DOTALL)
    (tmp_path / "study.toml").write_text(block)
    file = load_study(tmp_path / "study.toml")
    assert (
        len(file.variables),
        len(file.responses),
        len(file.limits),
        len(file.goals),
    ) == (5, 5, 2, 2)


def test_command_writes_table_pictures_and_robots_that_run(rod, tmp_path, capsys):
    file = rod(
        GRID.replace('"grid"', '"grid"\nmaximize = "K"\nconstraints = ["mass <= 66 g"]')
    )
    out = tmp_path / "out"
    notes = tmp_path / "out.designs" / "notes.txt"
    notes.parent.mkdir()
    notes.write_text("mine")
    assert _guarded(["study", str(file), "--out", str(out), "--json", "-"]) == 0
    assert list(notes.parent.iterdir()) == [
        notes
    ]  # designs are gone from there, what is not ours is not
    assert notes.read_text() == "mine"
    told = json.loads(capsys.readouterr().out)
    here = study(file).table
    for table in (
        pd.read_parquet(out / "designs.parquet"),
        pd.read_csv(out / "designs.csv"),
    ):
        kept = table.drop(columns="reason")
        pd.testing.assert_frame_equal(
            kept, here.drop(columns="reason"), check_exact=True, check_dtype=False
        )
    assert told["columns"] == list(here.columns)
    assert told["best"] == [6]  # 8 mm, hollow: of those of at most 66 g the stiffest
    assert {"parallel.png", "progress.svg", "report.html", "manifest.json"} <= {
        each.name for each in out.iterdir()
    }
    best = load_robot(out / "best-1.toml")
    assert best.parts["bar 1"].parameters().lengths()["bore"] == 0.009
    assert (
        _guarded(
            [
                "stiffness",
                str(out / "best-1.toml"),
                "--quiet",
                "--json",
                str(tmp_path / "k.json"),
            ]
        )
        == 0
    )
    stiffness = json.loads((tmp_path / "k.json").read_text())["stiffness"][0][0][0]
    assert stiffness == pytest.approx(here["K [N/m]"][5], rel=1e-12)
    shutil.rmtree(tmp_path / "out.designs", ignore_errors=True)
    assert _guarded(["study", str(tmp_path / "none.toml"), "--out", str(out)]) == 2

"""What README and the documentation show works: their Python runs, and each of their commands.

README's commands run by default; those that only the documentation shows are extended tests.
"""

import itertools
import re
import shlex
import subprocess
import sys
import tomllib
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from packaging.specifiers import SpecifierSet

from stiffscope.cad.solid import build
from stiffscope.cad.step import write_step
from stiffscope.cli.main import _guarded
from stiffscope.notebook.objects import as_html
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.executor import Here

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
TEXT = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
COARSE = "--set slider.mesh.size=60mm"  # the same everywhere, so that its experiment is made once
SMALL = {
    "run": f"{COARSE} --set link.mesh.size=40mm",
    "compare": COARSE,
    "compliance": f"{COARSE} --set slider.mesh.most_unknowns=9000 --set slider.rib_count=0 --set slider.fillet=0mm",
    "interfaces": f"{COARSE} --set slider.width=160mm --set slider.pad_spacing=45mm",
    "modes": "--components published --count 1 --at Q2",
    "modes --at": "--components published --count 1",
    "frf": "--components published",
    "deflection": "--components published",
    "map": "--components published --gravity none --points 9",
    "blind": "--campaigns 1",
    "lobes --map": "--points 9",
    "sensitivity": "--components beam",
    "sensitivity --part": COARSE,
}
"""Options added to those shown for the Biglide, so that its commands take seconds."""
ARM = """<robot name="arm">
  <link name="stand"/>
  <link name="arm"><inertial>
    <mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="stand"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="0" velocity="0"/></joint>
</robot>
"""


def blocks(language: str) -> list[str]:
    """Blocks of code in a language, each once."""
    return list(
        dict.fromkeys(
            re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
        )
    )


def lines(program: str) -> list[str]:
    found = (
        line
        for block in blocks("sh")
        for line in block.splitlines()
        if line.startswith(f"{program} ")
    )
    return list(dict.fromkeys(found))


def test_the_first_two_lines_set_up_and_run_everything():
    first, second = blocks("sh")[:2]
    assert first.count("\n") == second.count("\n") == 1
    assert first.rstrip().endswith(".venv/bin/stiffscope run biglide --out out")
    assert second.rstrip().endswith(".venv/bin/python -m pytest -n auto")
    set_up = "python3 -m venv .venv && .venv/bin/python -m pip install -q -c constraints.txt -e "
    assert first.startswith(f"{set_up}. && ")
    assert second.startswith(f"{set_up}'.[dev]' && ")


def test_pinned_versions_run_on_the_oldest_python():
    """What pip would refuse there: a version that the newest Python of a fresh machine has, and an older one not."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    oldest = project["requires-python"].removeprefix(">=") + ".0"
    pins = [
        line.partition("==")[0]
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if "==" in line
    ]
    needs = {
        each.name.lower(): each.metadata.get("Requires-Python") or ""
        for each in metadata.distributions()
    }
    known = {pin: needs[pin.lower()] for pin in pins if pin.lower() in needs}
    assert len(known) > 100
    assert not {
        pin: need for pin, need in known.items() if oldest not in SpecifierSet(need)
    }


def test_no_pattern_is_possessive():
    """Python before 3.11.5 matches possessive and atomic groups wrongly: it took `%` for no unit."""
    files = [
        path
        for room in ("cad", "fea", "vjm", "stiffscope")
        for path in (ROOT / room).rglob("*.py")
    ]
    assert len(files) > 300
    assert not [
        path
        for path in files
        if re.search(r"[\])*+?}w][*+?}]\+|\(\?>", path.read_text(encoding="utf-8"))
    ]


def test_no_command_is_left_out():
    known = ("stiffscope ", "python -m examples.", "python3 -m venv .venv && ")
    assert all(
        line.startswith(known) for block in blocks("sh") for line in block.splitlines()
    )


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a part.step; experiments are made in this process, so that CAD is imported once."""
    robot = load_robot("biglide")
    folder = tmp_path_factory.mktemp("readme")
    write_step(
        build(robot.parts["slider"].parameters(), robot.material("slider")),
        folder / "part.step",
    )
    (folder / "data").symlink_to(ROOT / "data")
    (folder / "examples").symlink_to(ROOT / "examples")
    (folder / "mine.toml").write_text(
        (ROOT / "data" / "robots" / "delta.toml").read_text()
    )
    (folder / "arm.urdf").write_text(ARM)
    rows = [f"{hertz},{1e-3 * hertz**2},0.0" for hertz in range(1, 50)]
    (folder / "bench.csv").write_text("\n".join(["frequency,H.re,H.im", *rows]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stiffscope.runtime.workshop.Processes", Here)
        for room in ("lab", "design"):  # one process for blind cases and designs
            patch.setattr(f"stiffscope.{room}.command.processors", lambda: 1)
        yield folder


COMMANDS = list(
    dict.fromkeys(["stiffscope run biglide --out out", *lines("stiffscope")])
)
WRITERS = {"--out", "--adopt"}
MAKERS = {
    file: line
    for line in COMMANDS
    for option, file in itertools.pairwise(shlex.split(line))
    if option in WRITERS and line.split()[2:].count(file) == 1
}
"""The command that makes a file which another reads: it runs first, whatever process has run it before."""


def _mark(line: str):
    """Leave a command that only the documentation shows to the extended tests."""
    if f"{line}\n" in README:
        return line
    without = "exudyn" in line and find_spec("exudyn") is None and "blind" in line
    skipped = pytest.mark.skipif(without, reason="EXUDYN is an extra")
    return pytest.param(line, marks=[pytest.mark.extended, skipped])


@pytest.mark.parametrize("line", [_mark(line) for line in COMMANDS])
def test_commands(line, place, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(place)
    for option, file in itertools.pairwise(shlex.split(line)[1:]):
        if option not in WRITERS and file in MAKERS and not Path(file).exists():
            _run(MAKERS[file], tmp_path, monkeypatch, capsys)
    _run(line, tmp_path, monkeypatch, capsys)


def _run(line, tmp_path, monkeypatch, capsys):
    place = Path.cwd()
    _, name, *words = shlex.split(line)
    if name == "cache":  # of others' results nothing is cleared
        monkeypatch.setenv("STIFFSCOPE_CACHE", str(tmp_path))
    kind = next((f"{name} {word}" for word in words if f"{name} {word}" in SMALL), name)
    small = SMALL.get(kind, "").split() if "mine.toml" not in words else []
    if name == "new":
        (place / words[-1]).unlink()
    outside = _list_clone()  # in which the first command may have been run before
    assert _guarded([name, *words, *small]) == 0, capsys.readouterr().err
    said = capsys.readouterr()
    assert not said.err.startswith("stiffscope: unexpected")
    assert len(said.out) > 10
    for option, file in itertools.pairwise(words):
        if option == "--out":
            assert _list_clone() == outside
            planned = name == "campaign" and words[0] == "new"
            written = "campaign.toml" if planned else "manifest.json"
            kept = Path(file) if Path(file).suffix else Path(file) / written
            assert kept.stat().st_size > 0
            if kept.name == "manifest.json" and name != "export":
                page = kept.with_name("report.html")
                assert "</html>" in page.read_text(encoding="utf-8")
        if option == "--json":
            assert Path(file).stat().st_size > 0


def _list_clone():
    """What stands in the clone, without what tools keep there under hidden names while the tests run."""
    return sorted(path for path in ROOT.iterdir() if not path.name.startswith("."))


@pytest.mark.parametrize("line", lines("python"))
def test_examples(line):
    done = subprocess.run(
        [sys.executable, *shlex.split(line)[1:]],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert len(done.stdout) > 20


def test_the_python_way(place, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    names: dict = {}
    for block in blocks("python"):
        exec(compile(block, "README.md", "exec"), names)  # noqa: S102
    assert names["state"].mobility.tolist() == [0, 0]
    assert np.diagonal(names["state"].matrix[0]) / 1e6 == pytest.approx(
        [24.21, 1.965, 12.59, 1.411, 0.1427, 2.76], rel=5e-3
    )
    swept = names["robot"].map.ranges()
    assert (
        names["ss"].stiffness_map(names["machine"], swept, 9).png.startswith(b"\x89PNG")
    )
    assert "<table" in as_html(names["test"])
    assert "<table" in as_html(names["state"])
    assert names["found"].verdict == "identified"
    assert names["found"].gap.nominal == pytest.approx(9.19, abs=0.01)

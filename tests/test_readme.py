"""What README shows works: its Python runs, its commands are the command line's."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from stiffscope.cli.main import cli

TEXT = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def test_the_first_two_lines_set_up_and_run_everything():
    first, second = blocks("sh")[:2]
    assert first.count("\n") == second.count("\n") == 1
    assert first.rstrip().endswith(".venv/bin/stiffscope run biglide --out out")
    assert second.rstrip().endswith(".venv/bin/python -m pytest -n auto")


@pytest.mark.parametrize("line", [li for b in blocks("sh") for li in b.splitlines() if li.startswith("stiffscope ")])
def test_commands_are_those_of_the_command_line(line):
    _, name, *arguments = shlex.split(line)
    with cli.commands[name].make_context(name, arguments):
        pass


def test_the_python_way(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for block in blocks("python"):
        exec(compile(block, "README.md", "exec"), names)  # noqa: S102
    assert names["state"].mobility.tolist() == [0, 0]
    assert np.diagonal(names["state"].matrix[0]) / 1e6 == pytest.approx(
        [24.21, 1.965, 12.59, 1.411, 0.1427, 2.76], rel=5e-3
    )
    assert names["stiffness_map"](names["machine"], 9).png.startswith(b"\x89PNG")
    assert "<table" in names["test"]._repr_html_()
    assert "<table" in names["state"]._repr_html_()

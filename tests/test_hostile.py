"""Mutated files of every kind are answered, or refused in one line that names the file: a seeded sample."""

from pathlib import Path

import pytest

import stiffscope.gap.command
import stiffscope.statics.command.check
import stiffscope.statics.command.poses  # noqa: F401 (what is imported here, the forked commands have)
from stiffscope.robot.reader import read_robot
from tests.hostile import run
from tests.hostile_families import PLAIN, SECTIONS, families


@pytest.mark.parametrize("name", PLAIN)
def test_a_sample_of_mutants(name):
    read_robot(
        Path("robot.toml"), SECTIONS.decode()
    )  # so that the forked commands have the units, too
    cases = [run(PLAIN[name], seed) for seed in range(3)]
    assert [case for case in cases if case.wrong] == []


@pytest.mark.extended
@pytest.mark.parametrize(
    "name",
    [
        "stewart",
        "sections",
        "check",
        "csv",
        "study",
        "urdf",
        "mjcf",
        "xlsx",
        "assembly",
        "solids",
        "faces",
        "step",
    ],
)
def test_mutants_of_every_family(name):
    cases = [run(families()[name], seed) for seed in (None, *range(10, 15))]
    assert cases[0].code == 0, cases[0].said
    assert [case for case in cases if case.wrong] == []

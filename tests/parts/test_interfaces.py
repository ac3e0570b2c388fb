"""Choices of interfaces for rods, plates and STEP files of any robot."""

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.parts.interfaces import (
    choices,
    compare_interfaces,
    interfaces_columns,
    interfaces_json,
)
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.workshop import workshop
from tests.experiments.one_part import MATRIX, PLATE, ROD, STEP, one_part, write_bar

pytestmark = pytest.mark.slow

NAME = "bar 1"
RATE = 5.0  # N/mm³


@pytest.mark.extended
def test_a_rod_on_a_foundation_sinks_in_by_force_over_area(tmp_path, monkeypatch):
    """1/(k A) more along x, 1/(k I) more about y; the bed is a layer of the material as deep as the rod is thick."""
    monkeypatch.setenv("STIFFSCOPE_CACHE", str(tmp_path / "cache"))
    robot = one_part(tmp_path, ROD)
    with workshop() as shop:
        compared = compare_interfaces(robot, NAME, shop)
    assert compared.own.choice.name == "rigid face, rigid clamp"
    assert compared.left_out == ()
    traction, foundation = compared.others
    assert [each.choice.name for each in compared.others] == [
        "even traction",
        "foundation",
    ]
    area = np.pi * 0.006**2
    inertia = np.pi * 0.006**4 / 4
    bed = 211e9 / 0.012
    added = np.diag(foundation.compliance - compared.own.compliance)
    assert added[0] == pytest.approx(1 / (bed * area), rel=0.1)
    assert added[4] == pytest.approx(1 / (bed * inertia), rel=0.1)
    assert foundation.choice.overrides == (
        f"{NAME}.foundation={float(f'{bed:.3g}') / 1e9:.12g} N/mm^3",
    )
    assert traction.compliance[0, 0] > 0
    assert load_robot(robot.path, foundation.choice.overrides).part(
        NAME
    ).foundation == pytest.approx(bed, rel=1e-3)
    columns = interfaces_columns(compared)
    assert {len(each) for each in columns.values()} == {3 * len(compared.entries)}
    told = interfaces_json(compared)
    assert [each["set"] for each in told["choices"][:2]] == [
        [],
        [f"{NAME}.interface=distributed"],
    ]


def test_a_plate_has_pads_and_holes_besides_wherever_it_stands(tmp_path):
    """The plate's body does not follow its pads here; the choice is of the part alone."""
    found = {
        each.name: dict(each.values)
        for each in choices(one_part(tmp_path, PLATE), NAME)
    }
    assert list(found) == [
        "rigid face",
        "even traction",
        "three pads",
        "rigid clamp",
        "bolt holes",
        "foundation",
    ]
    assert found["three pads"] == {"pad_height": pytest.approx(0.0025)}
    assert found["bolt holes"] == {"hole_count": 2, "clamp": "holes"}


def test_choices_that_a_part_cannot_take_are_left_out_with_the_reason(
    tmp_path, monkeypatch
):
    from stiffscope.parts import interfaces

    monkeypatch.setattr(
        interfaces, "solve_parts", lambda orders, _shop, **_: list(orders)
    )
    monkeypatch.setattr(
        interfaces,
        "_compare_choices",
        lambda _robot, _part, found, left_out: (list(found), left_out),
    )
    _, left_out = compare_interfaces(one_part(tmp_path, PLATE), NAME, None)
    assert left_out == [
        next(line for line in left_out if line.startswith("three pads: left out; "))
    ]
    assert 'robot.toml:4: parts."bar 1".pad_' in left_out[0]
    write_bar(tmp_path / "bar.step")
    tested, left_out = compare_interfaces(one_part(tmp_path, STEP), NAME, None)
    assert [choice.name for choice in tested] == [
        "rigid face, rigid clamp",
        "even traction",
    ]
    assert [line.partition(":")[0] for line in left_out] == [
        "three pads",
        "bolt holes",
        "foundation",
    ]
    tested, left_out = compare_interfaces(
        one_part(tmp_path, f'{STEP}\nfoundation = "{RATE} N/mm^3"'), NAME, None
    )
    assert [choice.name for choice in tested] == [
        "rigid face, foundation",
        "even traction",
        "rigid clamp",
    ]


def test_a_matrix_has_no_interfaces(tmp_path):
    for part in (NAME, "nosuch"):
        with pytest.raises(InputError, match="expected"):
            compare_interfaces(one_part(tmp_path, MATRIX), part, None)

"""The five-bar's stiffness from its assembly, against a robot file by hand from the design's dimensions."""

from __future__ import annotations

import re

import numpy as np
import pytest

from examples.assembly import five_bar as example
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.experiments.orders import order_part
from stiffscope.imports.import_assembly import import_assembly
from stiffscope.imports.user_settings import ImportSettings
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.statics.analysis import stiffness
from tests.imports import assemblies

MESH = 'mesh = { size = "12 mm" }'
LEVELS = {
    "crank_left": 0,
    "crank_right": 0,
    "coupler_left": 8,
    "coupler_right": 16,
}  # mm, their lower faces


def _place(point, z, more=0.0):
    return f'["{float(point[0]) + more!r} mm", "{float(point[1])!r} mm", "{z} mm"]'


def _part(name):
    return [
        f"[parts.{name}]",
        'shape = "step"',
        f'file = "machine-parts/{name}.step"',
        'material = "steel"',
        MESH,
    ]


def by_hand():
    """Robot file of the design: links between pins, a plate on three screws, bearings of 22 mm, drives in the frame."""
    left, right, top = example.place_pins()
    ends = {
        "crank_left": {"frame": example.LEFT, "coupler": left},
        "crank_right": {"frame": example.RIGHT, "coupler": right},
        "coupler_left": {"crank": left, "coupler": top},
        "coupler_right": {"coupler": top, "crank": right},
    }
    screws = ", ".join(
        f'{{ kind = "cylinder", position = {_place((x, -40.0), -6, 2.75)} }}'
        for x in (-120.0, 0.0, 120.0)
    )
    lines = ['name = "five-bar"', *_part("frame"), f"interfaces.foot = [{screws}]"]
    for name, point in (("left", example.LEFT), ("right", example.RIGHT)):
        lines += [
            f'interfaces.crank_{name} = {{ radius = "11 mm", position = {_place(point, -3.5, 11)} }}'
        ]
    for name, places in ends.items():
        lines += _part(name)
        for end, point in places.items():
            lines += [
                f'interfaces.{end} = {{ radius = "4 mm", position = {_place(point, LEVELS[name] + 4, 4)} }}'
            ]
    for name in ("frame", *ends):
        lines += [
            f"[bodies.{name}]",
            f'part = "{name}"',
            "at = [0, 0, 0]",
            "x = [1, 0, 0]",
            "y = [0, 1, 0]",
        ]
    lines += [
        "[joints.screwed]",
        'between = ["ground", "frame.foot"]',
        'type = "fixed"',
        "at = [0, 0, 0]",
    ]
    for name, one, other, point, z in (
        ("hip1", "frame.crank_left", "crank_left.frame", example.LEFT, 0),
        ("hip2", "frame.crank_right", "crank_right.frame", example.RIGHT, 0),
        ("knee1", "crank_left.coupler", "coupler_left.crank", left, 8),
        ("knee2", "crank_right.coupler", "coupler_right.crank", right, 8),
        ("top", "coupler_left.coupler", "coupler_right.coupler", top, 16),
    ):
        lines += [
            f"[joints.{name}]",
            f'between = ["{one}", "{other}"]',
            'type = "revolute"',
        ]
        lines += [f"at = {_place(point, z)}", "axis = [0, 0, -1]"]
        if name.startswith("hip"):
            lines += ['drive = { stiffness = "9 kN*m/rad" }']
    lines += [
        "[tool]",
        'body = "coupler_left.coupler"',
        f"at = {_place(top, 16)}",
        'pose = ["x", "y"]',
    ]
    return "\n".join(
        [
            *lines,
            "[poses]",
            f'home = ["{float(top[0])!r} mm", "{float(top[1])!r} mm"]',
            "",
        ]
    )


@pytest.mark.long
def test_the_stiffness_of_an_assembly_is_that_of_a_file_by_hand(tmp_path):
    """The same faces are chosen; with the same matrices of the parts both robots have the same stiffness."""
    assemblies.five_bar().write(tmp_path / "machine.step")
    said = ImportSettings(
        ground="foot",
        tool="coupler_left",
        material=("*=steel",),
        drive=("frame/crank*=9 kN*m/rad",),
    )
    import_assembly(tmp_path / "machine.step", tmp_path / "machine.toml", said)
    text = (tmp_path / "machine.toml").read_text()
    (tmp_path / "machine.toml").write_text(
        re.sub(r'(material = "steel")', rf"\1\n{MESH}", text)
    )
    (tmp_path / "hand.toml").write_text(by_hand())
    machine, hand = (
        load_robot(tmp_path / f"{name}.toml") for name in ("machine", "hand")
    )
    for name in machine.parts:
        one, other = (order_part(robot, name).build() for robot in (machine, hand))
        assert one.clamped == other.clamped
        assert {i.name: i.faces for i in one.loaded} == {
            i.name: i.faces for i in other.loaded
        }
    with workshop() as shop:
        imported = assemble_robots({"": machine}, None, shop)[""]
    matrices = part_matrices(hand, None, imported.results)
    found, wanted = (
        stiffness(mechanism, [robot.poses["home"]])[0]
        for mechanism, robot in (
            (imported.mechanism, machine),
            (mechanism_of(hand, matrices), hand),
        )
    )
    sizes = np.sqrt(np.diag(wanted))
    difference = np.abs((found - wanted) / np.outer(sizes, sizes)).max()
    assert difference < 1e-6

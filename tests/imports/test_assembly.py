"""STEP assemblies: the joints of machines whose joints are known, wherever they stand, in any unit, named or not."""

from __future__ import annotations

import math
import re
from pathlib import Path
from types import SimpleNamespace

import build123d as b
import numpy as np
import pytest
from OCP.BRep import BRep_Builder
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeSolid,
    BRepBuilderAPI_NurbsConvert,
    BRepBuilderAPI_Sewing,
)
from OCP.TopoDS import TopoDS_Shell

from stiffscope import cad
from stiffscope.cad.assembly import read_assembly
from stiffscope.cad.built_assembly import read_built
from stiffscope.cad.contacts import find_contacts
from stiffscope.cad.materials import MATERIALS
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.imports.assembly_parts import choose_materials
from stiffscope.imports.contact_joints import find_joints
from stiffscope.imports.hardware import find_hardware
from stiffscope.imports.import_assembly import from_assembly, import_assembly
from stiffscope.imports.loaded_patches import find_patches
from stiffscope.imports.part_estimates import estimate_part
from stiffscope.imports.user_settings import ImportSettings, settings_beside
from stiffscope.robot.inspection import inspect_robot
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.statics.analysis import stiffness
from tests.experiments.one_part import write_bar
from tests.imports import assemblies

pytestmark = pytest.mark.slow

STANDING = {  # place (mm, degrees), unit and whether solids have names
    "five-bar": ((13.7, -220.3, 71.1), (31, -47, 113), "MM", True),
    "delta": ((-513.7, 20.3, 1000), (-131, 17, -13), "INCH", True),
    "hexapod": ((0, 0, 0), (0, 0, 0), "M", False),
    "slider": ((1, 2, 3), (90, 0, 45), "MM", False),
    "3-prs": ((88, -9, 40), (12, 65, -170), "M", True),
    "finger": ((-7, 0, 12), (3, 2, 1), "INCH", False),
    "lever": ((31, -4, 7), (71, -33, 5), "MM", False),
    "gears": ((5, 60, -9), (12, -120, 8), "INCH", False),
    "dovetail": ((-3, 70, -900), (-20, 140, 77), "INCH", False),
}


@pytest.mark.extended_for(
    "3-prs", "delta", "dovetail", "finger", "hexapod", "slider", "five-bar", "gears"
)
@pytest.mark.parametrize("machine", STANDING)
def test_every_joint_is_found_and_none_invented(machine, tmp_path):
    where, turns, unit, named = STANDING[machine]
    place = b.Location(where, turns)
    made = assemblies.ALL[machine]()
    made.write(tmp_path / "machine.step", unit, place, named)
    written = {
        "MM": "SI_UNIT(.MILLI.,.METRE.)",
        "INCH": "CONVERSION_BASED_UNIT('INCH'",
        "M": "SI_UNIT($,.METRE.)",
    }[unit]
    assert written in (tmp_path / "machine.step").read_text()
    solids = read_assembly(tmp_path / "machine.step")
    _check(made, solids, place)


@pytest.mark.parametrize("machine", assemblies.SMALL)
def test_details_of_real_machines_make_the_joints_that_they_are(machine):
    """As a STEP file would give them, but without writing it; names only where one is to be no reason."""
    place = b.Location((-31, 7, 120), (23, -140, 61))
    made = machine()
    solids = _place_solids(made, place, named=machine is assemblies.drive)
    doubts = _check(made, solids, place)
    laid = sum("taken as fixed" in doubt.text for doubt in doubts)
    assert laid == (2 if machine is assemblies.case else 0)


def test_solids_that_differ_by_a_translation_share_a_product(tmp_path):
    """Brackets drawn where they stand: two alike, and one in a mirror."""

    def bracket(x, side):
        foot = b.Pos(x, 0, 0) * b.Box(30, 20, 4)
        hole = b.Pos(x + side * 8, 5, 0) * b.Cylinder(3, 10)
        return (foot - hole).solid()

    drawn = [bracket(0, 1), bracket(50, 1), bracket(100, -1)]
    for name, each in zip("abc", drawn, strict=True):
        each.label = name
    b.export_step(b.Compound(children=drawn), tmp_path / "three.step")
    one, two, three = read_assembly(tmp_path / "three.step")
    assert one.product is two.product
    assert three.product is not one.product
    for own, each in zip(drawn, (one, two, three), strict=True):
        box = own.bounding_box()
        assert 1e3 * each.box == pytest.approx(np.array([[*box.min], [*box.max]]))
        off = cad.kernel.distance(each.solid, np.array([*own.vertices()[5]]))
        assert off < 1e-6


@pytest.mark.parametrize(("free", "role"), [(4, "pin"), (40, None)])
def test_a_pin_that_is_free_between_its_bores_is_a_part_that_bends(free, role):
    """Two plates of 10 mm on a pin of 8 mm in diameter: 40 mm between them are five diameters."""
    hole = b.Cylinder(4, 100)
    plates = [b.Pos(0, 0, z) * b.Box(40, 40, 10) - hole for z in (0, 10 + free)]
    pin = b.Pos(0, 0, 0.5 * (10 + free)) * b.Cylinder(4, 20 + free)
    children = [each.solid() for each in (*plates, pin)]
    for name, each in zip(("low", "high", "pin"), children, strict=True):
        each.label = name
    solids = read_built(b.Compound(children=children), "two plates", [])[0]
    hardware = find_hardware(solids, find_contacts(solids), {})
    assert hardware.roles.get(2) == role


def test_sheet_metal_is_softer_than_a_bar_of_its_extents():
    """A square bar has one estimate; a channel of 1 mm is estimated by its wall, too."""
    bar = b.Box(100, 10, 10).solid()
    channel = (b.Box(100, 30, 30) - b.Pos(0, 0, 1) * b.Box(100, 28, 30)).solid()
    bar, channel = read_built(b.Compound(children=[bar, channel]), "two", [])[0]
    steel = MATERIALS["steel"]
    found = estimate_part(bar, steel)
    tip = 4 * 0.1**3 / (steel.youngs_modulus * 0.01**4)
    assert found.compliance == pytest.approx(tip, rel=1e-3)
    assert found.wall == pytest.approx(found.compliance, rel=0.25)  # its ends count
    found = estimate_part(channel, steel)
    assert found.wall > 20 * found.compliance


def test_a_bent_sheet_is_as_soft_as_its_developed_strip():
    """A U of 2 mm sheet, 50 mm wide: the energy of a force at its upper lip's end, by Castigliano."""
    foot, wall, lip = (
        b.Pos(x, 0, z) * b.Box(length, 50, height)
        for x, z, length, height in ((20, 1, 40, 2), (1, 30, 2, 60), (20, 59, 40, 2))
    )
    solid = (foot + wall + lip).solid()
    (only, _) = read_built(
        b.Compound(children=[solid, b.Pos(0, 0, 100) * b.Box(9, 9, 9)]), "two", []
    )[0]
    steel = MATERIALS["steel"]
    bending = steel.youngs_modulus * 0.05 * 0.002**3 / 12.0
    # sideways force at the upper end, the foot clamped at its end: wall, foot (m)
    sideways = (0.058**3 / 3 + 0.058**2 * 0.039) / bending
    found = estimate_part(only, steel)
    assert 0.3 < found.compliance / sideways < 3


def _place_solids(made, place, named=True):
    children = []
    for name, solid in made.solids.items():
        children.append(place * b.Solid(solid.wrapped))
        children[-1].label = name if named else ""
    return read_built(b.Compound(children=children), "machine", [])[0]


def _check(made, solids, place):
    contacts = find_contacts(solids)
    hardware = find_hardware(solids, contacts, {})
    joints, doubts = find_joints(solids, contacts, hardware)
    names = _true_names(made, solids, place)
    assert {names[n] for n in hardware.roles} == made.hardware
    found = {frozenset((names[j.first], names[j.second])): j for j in joints}
    assert {pair: j.kind for pair, j in found.items()} == {
        frozenset(t[:2]): t[2] for t in made.joints
    }
    turn, origin = _frame(place)
    for first, second, _, at, axis in made.joints:
        joint = found[frozenset((first, second))]
        if axis is not None:
            assert np.linalg.norm(np.cross(joint.axis, turn @ axis)) < 1e-9
        if at is not None:
            off = joint.at - 1e-3 * (turn @ at + origin)
            assert (
                np.linalg.norm(off if axis is None else np.cross(joint.axis, off))
                < 1e-9
            )
    return doubts


def _frame(place):
    change = place.wrapped.Transformation()
    matrix = np.array([[change.Value(i, k) for k in (1, 2, 3, 4)] for i in (1, 2, 3)])
    return matrix[:, :3], matrix[:, 3]


def _true_names(made, solids, place):
    """Names of the solids by where their centres are, and their volumes."""
    turn, origin = _frame(place)
    true = {
        name: (
            *(turn @ np.array(tuple(solid.center(b.CenterOf.MASS))) + origin),
            solid.volume ** (1 / 3),
        )
        for name, solid in made.solids.items()
    }
    seen = [
        (*(1e3 * solid.centre), 1e3 * solid.product.volume ** (1 / 3))
        for solid in solids
    ]
    return [min(true, key=lambda name: math.dist(each, true[name])) for each in seen]


def test_a_bearing_of_rings_and_balls_turns(tmp_path):
    made = assemblies.Made()
    shaft = assemblies.rod(10, 60) + assemblies.at(b.Box(40, 40, 8), (0, 0, 64))
    made.add("rotor", shaft)
    made.add(
        "stator", b.Box(70, 70, 14, align=assemblies.LOW) - assemblies.rod(23.5, 14)
    )
    groove = b.Torus(16.75, 4)
    made.buy("inner", assemblies.ring(10, 14, 14) - assemblies.at(groove, (0, 0, 7)))
    made.buy(
        "outer", assemblies.ring(19.5, 23.5, 14) - assemblies.at(groove, (0, 0, 7))
    )
    for number in range(8):
        turn = 2 * math.pi * number / 8
        made.buy(
            f"element{number}",
            assemblies.at(
                b.Sphere(3.9), (16.75 * math.cos(turn), 16.75 * math.sin(turn), 7)
            ),
        )
    made.write(tmp_path / "machine.step")
    solids = read_assembly(tmp_path / "machine.step")
    contacts = find_contacts(solids)
    hardware = find_hardware(solids, contacts, {})
    assert {solids[n].name for n in hardware.roles} == made.hardware
    (joint,), _ = find_joints(solids, contacts, hardware)
    assert joint.kind == "revolute"


@pytest.mark.extended
@pytest.mark.parametrize(
    ("name", "kind", "doubts"),
    [("", "revolute", 1), ("Bolzen", "revolute", 0), ("M8", "fixed", 0)],
)
def test_a_headed_pin_in_holes_of_its_diameter_is_told_with_both_readings(
    name, kind, doubts, tmp_path
):
    made = assemblies.Made()
    hole = assemblies.at(assemblies.rod(4, 40), (0, 0, -20))
    made.add("lower", b.Box(80, 30, 10, align=assemblies.TOP) - hole)
    made.add(
        "upper",
        assemblies.at(b.Box(80, 30, 8, align=assemblies.LOW), (30, 0, 0)) - hole,
    )
    made.buy("piece", assemblies.at(assemblies.screw(8, 18), (0, 0, 8)))
    made.solids = {
        name if each == "piece" and name else each: solid
        for each, solid in made.solids.items()
    }
    made.write(tmp_path / "machine.step")
    solids = read_assembly(tmp_path / "machine.step")
    contacts = find_contacts(solids)
    said = {2: "screw"} if name == "M8" else {}
    (joint,), told = find_joints(
        solids, contacts, find_hardware(solids, contacts, said)
    )
    assert joint.kind == kind
    assert [each.solids for each in told] == [("piece",)] * doubts


@pytest.mark.parametrize(
    ("nut", "name", "kind"),
    [
        (
            assemblies.ring(6, 11, 6)
            - assemblies.at(assemblies.rod(1, 6), (8.5, 0, 0)),
            "piece",
            "revolute",
        ),
        (
            b.Box(18, 18, 6, align=assemblies.LOW) - assemblies.rod(6, 6),
            "piece",
            "revolute",
        ),
        (
            b.Box(18, 18, 6, align=assemblies.LOW) - assemblies.rod(6, 6),
            "Vierkantmutter",
            "",
        ),
    ],
)
def test_what_may_be_a_nut_on_a_thread_of_its_radius_is_told_with_both_readings(
    nut, name, kind
):
    """Unless its name says so: then it holds the bar, and no part is left that moves."""
    made = assemblies.Made()
    made.add(
        "plate",
        b.Box(80, 60, 10, align=assemblies.TOP)
        - assemblies.at(assemblies.rod(6, 10), (0, 0, -10)),
    )
    made.add("bar", assemblies.at(assemblies.rod(6, 50), (0, 0, -10)))
    made.add(name, nut)
    solids = _place_solids(made, b.Location())
    contacts = find_contacts(solids)
    joints, told = find_joints(solids, contacts, find_hardware(solids, contacts, {}))
    assert [joint.kind for joint in joints] == [kind] * bool(kind)
    assert [each.solids for each in told] == [("piece",)] * bool(kind)
    assert all('if it is a nut, say --weld "piece"' in each.text for each in told)


@pytest.mark.parametrize(
    ("upper", "name", "told"),
    [
        (
            "plate",
            "piece",
            'revolute: taken as a screw with a nut; if it is a pin, say --joint "lower/upper=',
        ),
        (
            "bearing",
            "piece",
            'own between: taken as a screw with a nut; if it is a shaft, say --part "piece"',
        ),
        (
            "none",
            "piece",
            'no joint: taken as a shaft with a nut; if it is a screw, say --weld "piece"',
        ),
        ("plate", "Schraube", ""),
    ],
)
def test_a_headed_bar_with_a_nut_is_told_with_both_readings(upper, name, told):
    """A screw of its holes' diameter, an axle in a bearing on an arm, or a shaft in a bearing of a housing."""
    made = assemblies.Made()
    hole = assemblies.at(assemblies.rod(8, 80), (0, 0, -40))
    ring = assemblies.at(assemblies.ring(8, 17, 10), (0, 0, -10))
    lower = b.Box(90, 50, 10, align=assemblies.TOP) - (
        ring + hole if upper == "none" else hole
    )
    made.add("lower", lower)
    if upper != "none":
        plate = (
            assemblies.at(b.Box(120, 50, 10, align=assemblies.LOW), (30, 0, 0)) - hole
        )
        made.add(
            "upper", plate - assemblies.rod(17, 10) if upper == "bearing" else plate
        )
    if upper != "plate":
        made.buy("bearing", ring if upper == "none" else assemblies.ring(8, 17, 10))
    top = 0.0 if upper == "none" else 10.0
    made.add(
        name, assemblies.at(assemblies.rod(8, 60) + assemblies.rod(14, 8), (0, 0, -18))
    )
    made.buy(
        "nut",
        assemblies.at(assemblies.hexagon(24, 10) - assemblies.rod(8, 30), (0, 0, top)),
    )
    solids = _place_solids(made, b.Location())
    contacts = find_contacts(solids)
    _, doubts = find_joints(solids, contacts, find_hardware(solids, contacts, {}))
    assert [each.solids for each in doubts] == [(name,)] * bool(told)
    assert all(told in each.text for each in doubts)


def test_the_tool_is_a_part_that_moves_and_the_settings_are_not_written_over(tmp_path):
    """Whatever is stacked on the ground, and however small what turns at the end is."""
    made = assemblies.Made()
    hole = assemblies.at(assemblies.rod(5, 99), (0, 0, -30))
    made.add("base", b.Box(300, 60, 20, align=assemblies.TOP) - hole)
    for n in range(3):
        made.add(
            f"block{n}",
            assemblies.at(b.Box(40, 40, 20, align=assemblies.LOW), (120, 0, 20 * n)),
        )
    eye = assemblies.at(assemblies.rod(1.5, 40), (-60, 0, -5))
    made.add(
        "arm",
        assemblies.at(b.Box(120, 20, 16, align=assemblies.LOW), (-50, 0, 0))
        - hole
        - eye,
    )
    made.buy("pin", assemblies.at(assemblies.rod(5, 36), (0, 0, -20)))
    made.add("peg", assemblies.at(assemblies.screw(3, 10), (-60, 0, 16)))
    made.write(tmp_path / "machine.step")
    said = ImportSettings(material=("*=steel",))
    found = import_assembly(tmp_path / "machine.step", tmp_path / "robot.toml", said)
    assert found.model.tool_body.partition(".")[0] == "arm"
    with pytest.raises(
        InputError,
        match=r"assembly\.toml: expected another name, as assembly\.toml holds settings",
    ):
        import_assembly(tmp_path / "machine.step", tmp_path / "assembly.toml", said)


def test_an_import_runs_and_keeps_what_is_said(tmp_path):
    made = assemblies.five_bar()
    made.write(tmp_path / "machine.step")
    (tmp_path / "assembly.toml").write_text(
        'ground = "foot"\nmaterial = { "*" = "steel" }\n'
    )
    said = ImportSettings(
        tool="coupler_left", rigid=("frame",), drive=("frame/crank*=9 kN*m/rad",)
    )
    found = import_assembly(tmp_path / "machine.step", tmp_path / "robot.toml", said)
    robot = load_robot(tmp_path / "robot.toml")
    assert found.model.pose == ("x", "y")
    assert sorted(robot.parts) == [
        "coupler_left",
        "coupler_right",
        "crank_left",
        "crank_right",
    ]
    assert not found.doubts


@pytest.mark.parametrize("kind", ["Revolute", "Linear", "Cylindrical", "Ball", "Rigid"])
def test_joints_of_build123d_are_taken_as_they_are(kind, tmp_path):
    """Whatever touches: a block beside a plate, in an assembly of an assembly that is moved and turned."""
    at = (12.0, -7.0, 5.0)
    along = (0.0, 0.6, 0.8)
    line = {} if kind in {"Ball", "Rigid"} else {"axis": b.Axis(at, along)}
    plate, block, foot = (
        solid.solid()
        for solid in (b.Box(80, 60, 10), b.Box(30, 20, 10), b.Box(99, 99, 9))
    )
    plate.label = "plate"
    block.label = "block"
    foot.label = "foot"
    point = {} if line else {"joint_location": b.Location(at)}
    joint = getattr(b, f"{kind}Joint")("hinge", plate, **line, **point)
    slid = {"position": 0} if kind in {"Linear", "Cylindrical"} else {}
    joint.connect_to(b.RigidJoint("hole", block, b.Location((3, 4, -5))), **slid)
    bottom = b.RigidJoint("bottom", plate, b.Location((0, 0, -5)))
    bottom.connect_to(b.RigidJoint("top", foot, b.Location((0, 0, 4.5))))
    place = b.Location((100, -20, 30), (20, 40, 10))
    machine = b.Compound(
        label="machine",
        children=[b.Compound(label="unit", children=[plate, block]), foot],
    )
    machine.locate(place)
    if kind == "Rigid":
        said = {"material": {"*": "steel"}, "ground": "foot"}
        refused = "expected a tool that joints let move, .* imports a frame"
        with pytest.raises(InputError, match=refused):
            from_assembly(machine, tmp_path / "m.toml", **said)
        frame = from_assembly(machine, tmp_path / "m.toml", **said, tool="block")
        assert frame.model.pose == ()
        assert load_robot(tmp_path / "m.toml").tool.pose == ()
        return
    found = from_assembly(
        machine,
        tmp_path / "m.toml",
        material={"*": "steel"},
        ground="foot",
        tool="block",
    )
    (joint,) = [each for each in found.model.joints if each.name == "plate/block"]
    kinds = {
        "Revolute": "revolute",
        "Linear": "prismatic",
        "Cylindrical": "cylindrical",
        "Ball": "spherical",
    }
    assert joint.kind == kinds[kind]
    turn, origin = _frame(place)
    point = 1e-3 * (turn @ np.array(at) + origin)
    axis = turn @ np.array(along)
    if kind == "Ball":
        assert np.linalg.norm(joint.at - point) < 1e-9
        return
    assert np.linalg.norm(np.cross(joint.axis, axis)) < 1e-9
    if kind != "Linear":
        assert np.linalg.norm(np.cross(axis, joint.at - point)) < 1e-9
    robot = load_robot(found.file)
    assert robot.tool.body == "block"


def test_a_joint_of_build123d_that_contacts_contradict_is_told(tmp_path):
    plate = b.Box(80, 60, 10).solid()
    block = b.Box(30, 20, 10).solid()
    plate.label = "plate"
    block.label = "block"
    hinge = b.RevoluteJoint("hinge", plate, axis=b.Axis((0, 0, 5), (0, 0, 1)))
    hinge.connect_to(b.RigidJoint("hole", block, b.Location((0, 0, -5))))
    machine = b.Compound(label="machine", children=[plate, block])
    said = {"material": "*=steel", "ground": "plate"}
    found = from_assembly(machine, tmp_path / "m.toml", **said)
    assert [doubt.solids for doubt in found.doubts] == [("plate", "block")]
    assert "makes it revolute, what touches makes it fixed" in found.doubts[0].text
    assert [doubt.text for doubt in inspect_robot(load_robot(found.file)).doubts] == [
        found.doubts[0].text
    ]
    other = from_assembly(
        machine, tmp_path / "other.toml", **said, joint={"pl*/bl*": "planar"}
    )
    assert (other.model.joints[0].kind, other.doubts) == ("planar", ())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("a text", {}), "expected a build123d Compound of solids, got str"),
        (
            (b.Compound(children=[b.Face.make_rect(1, 1)]), {}),
            "expected at least one closed solid, got 1 shape ",
        ),
        (
            (b.Pos(1e400, 0, 0) * b.Solid.make_box(1, 1, 1), {}),
            "expected solids at places, got .* at infinity",
        ),
        (
            (assemblies.rod(1, 2), {"floor": "x"}),
            'floor: expected one of ground, .*, got "floor"',
        ),
        ((assemblies.rod(1, 2), {"ground": []}), "ground: expected a name, got .."),
        ((assemblies.rod(1, 2), {"weld": 3}), "weld: expected a list of texts, got 3"),
    ],
)
def test_what_is_no_assembly_of_build123d_is_refused(given, message, tmp_path):
    assembly, said = given
    with pytest.raises(InputError, match=message):
        from_assembly(assembly, tmp_path / "m.toml", **said)
    assert not [*tmp_path.iterdir()]


@pytest.mark.extended
def test_a_new_export_says_what_changed(tmp_path):
    made = assemblies.lever()
    out = tmp_path / "robot.toml"
    said = ImportSettings(material=("*=steel",), ground="Platte")
    made.write(tmp_path / "machine.step")
    found = import_assembly(tmp_path / "machine.step", out, said)
    assert found.changes is None
    files = {
        path.name: path.read_bytes() for path in (tmp_path / "robot-parts").iterdir()
    }
    assert import_assembly(tmp_path / "machine.step", out, said).changes == ()
    assert files == {
        path.name: path.read_bytes() for path in (tmp_path / "robot-parts").iterdir()
    }
    made.add(
        "Hebel",
        made.solids["Hebel"] - assemblies.at(assemblies.rod(6.4, 40), (0, 0, -5)),
    )
    made.add(
        "Block", assemblies.at(b.Box(10, 10, 10, align=assemblies.LOW), (20, 20, 0))
    )
    del made.solids["Mutter"]
    made.write(tmp_path / "machine.step")
    found = import_assembly(tmp_path / "machine.step", out, said)
    assert found.changes is not None
    assert [re.sub(r" \(.*", "", change) for change in found.changes] == [
        "Block is new",
        "Mutter is gone",
        "Hebel has another shape",
        "the fixed joint Platte/Block is new",
        "the joint Achse/Hebel was revolute, is planar",
        "the joint Platte/Achse was fixed, is planar",
    ]
    out.write_text(out.read_text() + "# by hand\n")
    with pytest.raises(
        InputError, match=r"robot\.toml: expected the file as the last import wrote it"
    ):
        import_assembly(tmp_path / "machine.step", out, said)


@pytest.mark.extended
@pytest.mark.parametrize(
    ("said", "message"),
    [
        (
            ImportSettings(),
            r"machine\.step: expected a material for finger, pad, got none",
        ),
        (
            ImportSettings(material=("*=wood",)),
            r"--material \*=wood: expected PATTERN=NAME",
        ),
        (
            ImportSettings(material=("*=steel",), joint=("palm/pad=revolute",)),
            "expected two solids that touch",
        ),
        (
            ImportSettings(material=("*=steel",), joint=("palm/finger=welded",)),
            r"expected A/B=KIND",
        ),
        (
            ImportSettings(material=("*=steel",), ground="bed"),
            "--ground bed: expected the name of a solid",
        ),
        (
            ImportSettings(material=("*=steel",), joint=("pa*/arm*=fixed",)),
            r"--joint pa\*/arm\*=fixed: solid arm\*: expected",
        ),
    ],
)
def test_what_is_not_said_well_is_refused(said, message, tmp_path):
    assemblies.finger().write(tmp_path / "machine.step")
    with pytest.raises(InputError, match=message):
        import_assembly(tmp_path / "machine.step", tmp_path / "robot.toml", said)
    assert [each.name for each in tmp_path.iterdir()] == ["machine.step"]


HOSTILE = {
    "cut": (
        lambda text: re.sub(r"(?s)(\n#2\d\d = .*?;)", "", text),
        "expected a whole STEP file, got one of which",
    ),
    "parts elsewhere": (
        lambda text: text.replace(
            "DATA;", "DATA;\n#9001 = DOCUMENT_FILE('arm.stp','',$,$,'',$);", 1
        ),
        'expected the files that it refers to beside it, got none called "arm.stp"',
    ),
    "negative unit": (
        lambda text: text.replace(
            "DATA;",
            "DATA;\n#9001 = LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(-25.4),#10);",
            1,
        ),
        r"machine\.step:\d+: LENGTH_MEASURE_WITH_UNIT: expected a number from 1e-09 to 1e\+06 .*, got -25\.4",
    ),
    "within itself": (
        lambda text: re.sub(
            r"(USAGE_OCCURRENCE\('\d+','.+?','',)#\d+,(#\d+)", r"\1\2,\2", text, count=1
        ),
        r"machine\.step: expected a tree of products, got one within itself \(#(\d+) in #\1\)",
    ),
    "a coordinate lost": (
        lambda text: re.sub(r"(POINT\('',\(-14\.,0\.),8\.\)", r"\1)", text, count=1),
        r"machine\.step: #\d+: expected three coordinates in space, got \(-14\.,0\.\)",
    ),
    "a coordinate that is none": (
        lambda text: re.sub(
            r"(POINT\('',\(-14\.,0\.),8\.\)", r"\1,1.E400)", text, count=1
        ),
        r"machine\.step: #\d+: expected three coordinates in space, got \(-14\.,0\.,1\.E400\)",
    ),
    "no solid": (
        lambda text: re.sub(r"(?s)DATA;.*?ENDSEC;", "DATA;\nENDSEC;", text),
        "at least one closed solid",
    ),
    "fixed": (
        lambda text: text,
        "expected a tool that joints let move, got pad, which they fix to the ground, palm",
    ),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_files_that_are_no_whole_machine_are_refused(case, tmp_path):
    change, message = HOSTILE[case]
    assemblies.finger().write(tmp_path / "machine.step")
    (tmp_path / "machine.step").write_text(
        change((tmp_path / "machine.step").read_text())
    )
    with pytest.raises(InputError, match=message) as told:
        import_assembly(
            tmp_path / "machine.step",
            tmp_path / "robot.toml",
            ImportSettings(material=("*=steel",)),
        )
    assert "\n" not in str(told.value)


def test_solids_without_names_are_named_after_their_product(tmp_path):
    """As of products with a solid and its sketch, or with several solids; an assembly's name alone names none."""
    plate = b.Box(10, 10, 1)
    foot = b.Box(2, 2, 2)
    bar = b.Box(1, 1, 9)
    other = b.Box(1, 1, 8)
    sketch = b.Pos(0, 0, 5) * b.Face.make_rect(1, 1)
    plates = [
        b.Compound(
            label="plate", children=[b.Pos(0, 0, 40 * n) * plate.solid(), sketch]
        )
        for n in range(2)
    ]
    plates[1].children[0].label = ""
    bars = b.Compound(
        label="bars",
        children=[b.Pos(30, 0, 0) * bar.solid(), b.Pos(60, 0, 0) * other.solid()],
    )
    b.export_step(
        b.Compound(label="machine", children=[*plates, bars, foot.solid()]),
        tmp_path / "machine.step",
    )
    left_out = []
    solids = read_assembly(tmp_path / "machine.step", left_out)
    assert [solid.name for solid in solids] == [
        "plate1",
        "plate2",
        "bars1",
        "bars2",
        "solid1",
    ]
    assert left_out == []


def test_bores_that_are_splines_guide(tmp_path):
    """As of programs that write all curved faces as B-splines."""
    made = assemblies.lever()
    splines = {
        name: b.Solid(BRepBuilderAPI_NurbsConvert(solid.wrapped).Shape())
        for name, solid in made.solids.items()
    }
    solids = _place_solids(assemblies.Made(splines), b.Location())
    assert not {f.kind for solid in solids for f in solid.faces} & {"other"}
    _check(made, solids, b.Location())


@pytest.mark.extended
def test_exponents_of_three_digits_are_read(tmp_path):
    """As older programs on Windows write them, 1.E+001."""
    assemblies.finger().write(tmp_path / "machine.step")
    text = re.sub(
        r"(?<=[(,])0\.(?=[,)])", "0.E+000", (tmp_path / "machine.step").read_text()
    )
    text = text.replace("(-14.,0.E+000,", "(-1.4E+001,0.E+000,")
    assert "(-1.4E+001,0.E+000," in text
    before = read_assembly(tmp_path / "machine.step")
    (tmp_path / "machine.step").write_text(text)
    after = read_assembly(tmp_path / "machine.step")
    assert all(
        np.allclose(one.centre, two.centre)
        for one, two in zip(before, after, strict=True)
    )


def test_a_solid_that_is_not_manifold_is_refused_by_that_name(tmp_path):
    sewing = BRepBuilderAPI_Sewing(1e-6, True, True, True, True)
    builder = BRep_Builder()
    shell = TopoDS_Shell()
    for face in (
        b.Box(10, 10, 10).faces()
        + b.Box(10, 10, 10, align=(b.Align.MAX,) * 3).move(b.Pos(-5, -5)).faces()
    ):
        sewing.Add(face.wrapped)
    sewing.Perform()
    builder.MakeShell(shell)
    for face in cad.kernel.faces(sewing.SewedShape()):
        builder.Add(shell, face)
    cad.kernel_files.write_step(
        BRepBuilderAPI_MakeSolid(shell).Solid(), tmp_path / "machine.step"
    )
    with pytest.raises(
        InputError, match=r"expected manifold solids, got 1 that fall into 2, as edges"
    ):
        read_assembly(tmp_path / "machine.step")


def test_a_step_of_one_solid_is_refused_by_its_name(tmp_path):
    write_bar(tmp_path / "bar.step")
    with pytest.raises(
        InputError,
        match=r'bar\.step: expected parts that joints connect, got one solid; .* "step"$',
    ):
        import_assembly(tmp_path / "bar.step", tmp_path / "robot.toml")


@pytest.mark.extended
def test_what_assembly_toml_says_wrongly_is_refused_with_its_line(tmp_path):
    assemblies.finger().write(tmp_path / "machine.step")
    (tmp_path / "assembly.toml").write_text(
        'ground = "palm"\n[material]\n"*" = "steel"\n"pad" = "unobtainium"\n'
    )
    message = r"assembly\.toml:4: material: expected PATTERN=NAME with a name of .*, got \"pad=unobtainium\""
    with pytest.raises(InputError, match=message):
        import_assembly(tmp_path / "machine.step", tmp_path / "robot.toml")
    (tmp_path / "assembly.toml").write_text(
        'ground = "palm"\n[material]\n"*" = "steel"\n"paad" = "titanium"\n'
    )
    with pytest.raises(
        InputError,
        match=r'assembly\.toml:4: material: expected the name of a solid, .*got "paad"',
    ):
        import_assembly(tmp_path / "machine.step", tmp_path / "robot.toml")
    words = 'ground = "palm"\njoint = ["palm/finger=revolute"]\ndrive = ["*=9 kg"]\nmaterial = { "*" = "steel" }\n'
    (tmp_path / "assembly.toml").write_text(words)
    with pytest.raises(
        InputError,
        match=r'assembly\.toml:3: drive: expected a torsional stiffness .*got "9 kg"',
    ):
        import_assembly(tmp_path / "machine.step", tmp_path / "robot.toml")


def test_a_name_counts_more_than_a_pattern_wherever_it_stands():
    solids = [
        SimpleNamespace(name=name, product=SimpleNamespace(material=""))
        for name in ("arm", "armrest")
    ]
    for said in (["arm=titanium", "arm*=steel"], ["arm*=steel", "arm=TiAl6V4"]):
        assert choose_materials([0, 1], solids, said, Path("a.step")) == {
            0: "titanium",
            1: "steel",
        }


def test_designations_of_materials_are_known():
    solid = SimpleNamespace(name="arm", product=SimpleNamespace(material="EN AW-6082"))
    assert choose_materials([0], [solid], (), Path("a.step")) == {0: "aluminium-6082"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b'ground = "palm"\ntool = \n', r"assembly\.toml:2: expected valid TOML"),
        (
            b'ground = "palm"\n# \xff\n',
            r"assembly\.toml:2: expected .* in UTF-8, got byte 0xff",
        ),
    ],
)
def test_an_assembly_toml_that_is_no_toml_is_refused_with_its_line(
    tmp_path, text, message
):
    (tmp_path / "assembly.toml").write_bytes(text)
    with pytest.raises(InputError, match=message):
        settings_beside(tmp_path / "machine.step", ImportSettings())


def test_what_an_assembly_has_beside_its_solids_is_told(tmp_path):
    made = assemblies.lever()
    made.add("twin", made.solids["Hebel"])
    made.write(tmp_path / "machine.step")
    found = import_assembly(
        tmp_path / "machine.step",
        tmp_path / "robot.toml",
        ImportSettings(material=("*=steel",), ground="Platte"),
    )
    assert any(
        "the same solid twice in one place" in doubt.text for doubt in found.doubts
    )


def _slide_on_rod(blocks=(-130, 130), clearance=0.02):
    """A rod of 10 mm in end blocks on a base, a head on it that slides; mm."""
    base = b.Pos(0, 0, -10) * b.Box(60, 300, 20)
    parts = {"base": base}
    for number, y in enumerate(blocks, 1):
        block = b.Pos(0, y, 20) * b.Box(40, 20, 40)
        block -= b.Pos(0, y, 20) * b.Rot(90, 0, 0) * b.Cylinder(5, 20)
        parts[f"block{number}"] = block
    parts["rod"] = b.Pos(0, 0, 20) * b.Rot(90, 0, 0) * b.Cylinder(5, 280)
    bore = b.Pos(0, 0, 20) * b.Rot(90, 0, 0) * b.Cylinder(5 + clearance, 50)
    parts["head"] = b.Pos(0, 0, 20) * b.Box(40, 50, 30) - bore
    solids = []
    for name, shape in parts.items():
        solid = shape.solid()
        solid.label = name
        solids.append(solid)
    return b.Compound(label="slide", children=solids)


@pytest.mark.parametrize("clearance", [0.0, 0.02])
def test_a_rod_in_end_blocks_is_held_by_them_and_bends_between_its_joints(
    tmp_path, clearance
):
    found = from_assembly(
        _slide_on_rod(clearance=clearance),
        tmp_path / "slide.toml",
        material="*=steel",
        ground="base",
        tool="head",
    )
    kinds = {frozenset(j.name.split("/")): j.kind for j in found.model.joints}
    assert kinds[frozenset(("rod", "block1"))] == "fixed"
    assert kinds[frozenset(("rod", "block2"))] == "fixed"
    assert kinds[frozenset(("rod", "head"))] == "cylindrical"
    assert kinds[frozenset(("base", "block1"))] == "fixed"
    assert kinds[frozenset(("base", "block2"))] == "fixed"
    assert any("a rod that nothing else holds" in d.text for d in found.doubts)
    assert not any(d.warning for d in found.doubts)
    assert any(
        note.startswith("softest parts") and "rod (" in note
        for note in found.model.notes
    )
    robot = load_robot(tmp_path / "slide.toml")
    rod = robot.parts["rod"]
    assert set(rod.interfaces) == {"block1", "block2", "head"}
    solid = cad.kernel_files.read_step(tmp_path / "slide-parts" / "rod.step")
    areas = sorted(
        f.area for f in cad.faces.face_geometries(solid) if f.kind == "cylinder"
    )
    long = (280 - 2 * 20 - 50) / 2
    expected = sorted(2 * np.pi * 5 * each for each in (20, 20, 50, long, long))
    assert areas == pytest.approx([1e-6 * each for each in expected], rel=1e-9)


@pytest.fixture(scope="module")
def gantry(tmp_path_factory):
    """The gantry as imported, without further words."""
    folder = tmp_path_factory.mktemp("gantry")
    assemblies.gantry().write(folder / "gantry.step")
    said = ImportSettings(ground="base", tool="head", material=("*=steel",))
    return import_assembly(folder / "gantry.step", folder / "gantry.toml", said)


def test_rods_of_a_gantry_are_named_as_its_softest_parts(gantry):
    assert not any(doubt.warning for doubt in gantry.doubts)
    softest = next(n for n in gantry.model.notes if n.startswith("softest parts"))
    assert re.findall(r"(\w+) \(", softest)[:2] == ["rod1", "rod2"]


@pytest.mark.long
def test_a_gantry_is_as_stiff_as_its_rods(gantry):
    """Rods of 280 x 10 mm clamped at both ends: 192 EI/L^3 = 1.44 N/um, with the middle 50 mm held 2.9."""
    robot = load_robot(gantry.file)
    with workshop() as shop:
        found = assemble_robots({"": robot}, None, shop, whole=False)[""]
    matrix = stiffness(found.mechanism, [robot.poses["home"]])[0]
    assert 2.9e6 < matrix[2, 2] < 5.8e6


def compound(name, parts):
    """Return a labelled assembly of shapes by name."""
    children = [shape.solid() for shape in parts.values()]
    for label, solid in zip(parts, children, strict=True):
        solid.label = label
    return b.Compound(label=name, children=children)


def test_equal_rods_in_halves_of_blocks_are_one_part(tmp_path):
    """A half's patch has its centroid at -0.0 on one rod and at 0.0 on the other."""
    parts = {"base": b.Pos(0, 0, -10) * b.Box(400, 120, 20)}
    for j, y in enumerate((-30, 30)):
        rod = b.Pos(0, y, 30) * b.Rot(0, 90, 0) * b.Cylinder(4, 340)
        parts[f"rod{j}"] = rod
        for i, x in enumerate((-160, 160)):
            parts[f"lower{i}{j}"] = b.Pos(x, y, 15) * b.Box(24, 30, 30) - rod
            parts[f"upper{i}{j}"] = b.Pos(x, y, 36) * b.Box(24, 30, 12) - rod
    head = b.Pos(0, 0, 40) * b.Box(60, 100, 36)
    for y in (-30, 30):
        head -= b.Pos(0, y, 30) * b.Rot(0, 90, 0) * b.Cylinder(4.02, 60)
    parts["head"] = head
    found = from_assembly(
        compound("halves", parts),
        tmp_path / "halves.toml",
        material="*=steel",
        ground="base",
        tool="head",
    )
    assert not any(doubt.warning for doubt in found.doubts)
    robot = load_robot(tmp_path / "halves.toml")
    ends = {"lower", "upper"}
    rods = {name: part for name, part in robot.parts.items() if name.startswith("rod")}
    assert len(rods) == 1
    (part,) = rods.values()
    assert {name[:5] for name in part.interfaces} >= ends


def test_a_slender_tool_that_nothing_touches_is_warned_of(tmp_path):
    """A rod of 6 mm, 150 mm free, bends by 60 um/N: as a rigid tool it would not."""
    rod = b.Pos(75, 0, 30) * b.Rot(0, 90, 0) * b.Cylinder(3, 200)
    parts = {
        "base": b.Pos(0, 0, -10) * b.Box(200, 100, 20),
        "slide": b.Pos(0, 0, 30) * b.Box(50, 60, 60) - rod,
        "probe": rod,
    }
    found = from_assembly(
        compound("probe", parts),
        tmp_path / "probe.toml",
        material="*=steel",
        ground="base",
        tool="probe",
    )
    told = [d.text for d in found.doubts if d.warning and d.solids == ("probe",)]
    assert len(told) == 1
    assert "no part touches it where it is loaded" in told[0]


@pytest.mark.parametrize("length", [30, 36])
def test_a_rod_that_alone_joins_two_parts_stays_their_joint(length):
    """It ends in the bores or stands out of them; the longer bore holds it."""
    bore = assemblies.at(assemblies.rod(5, 40), (0, 0, -5))
    made = assemblies.Made()
    made.add("base", b.Box(80, 40, 20, align=assemblies.LOW) - bore)
    arm = assemblies.at(b.Box(100, 20, 10, align=assemblies.LOW), (35, 0, 20))
    made.add("arm", arm - bore)
    low = 15 - length / 2
    made.add("rod", assemblies.at(assemblies.rod(5, length), (0, 0, low)))
    solids = [shape.solid() for shape in made.solids.values()]
    for name, solid in zip(made.solids, solids, strict=True):
        solid.label = name
    whole = b.Compound(label="hinge", children=solids)
    instances, _ = read_built(whole, "hinge", [])
    contacts = find_contacts(instances)
    hardware = find_hardware(instances, contacts, {2: "part"})
    joints, doubts = find_joints(instances, contacts, hardware)
    kinds = {joint.ends: joint.kind for joint in joints}
    assert kinds == {(0, 2): "fixed", (1, 2): "cylindrical"}
    told = next(doubt.text for doubt in doubts if "press fit in base;" in doubt.text)
    assert told.endswith('if it is pressed into arm, too, say --joint "rod/arm=fixed"')


def _joints_on_rods(plates, rods):
    """Return the kinds of joints, by parts, of blocks (z, height; mm) on rods (x, y, radius, z, length)."""
    solids = []
    for name, (z, height, only) in plates.items():
        plate = b.Pos(0, 0, z) * b.Box(120, 120, height, align=assemblies.LOW)
        for rod, (x, y, radius, low, length) in rods.items():
            if rod in only:
                bore = b.Cylinder(radius, length, align=assemblies.LOW)
                plate -= b.Pos(x, y, low) * bore
        solids.append((name, plate.solid()))
    for name, (x, y, radius, low, length) in rods.items():
        rod = b.Pos(x, y, low) * b.Cylinder(radius, length, align=assemblies.LOW)
        solids.append((name, rod.solid()))
    for name, solid in solids:
        solid.label = name
    whole = b.Compound(label="rods", children=[solid for _, solid in solids])
    instances, _ = read_built(whole, "rods", [])
    contacts = find_contacts(instances)
    numbers = range(len(plates), len(solids))
    hardware = find_hardware(instances, contacts, dict.fromkeys(numbers, "part"))
    joints, _ = find_joints(instances, contacts, hardware)
    names = [name for name, _ in solids]
    return {tuple(names[n] for n in joint.ends): joint.kind for joint in joints}


@pytest.mark.parametrize("count", [2, 4])
@pytest.mark.parametrize("beyond", [0.0, 8.0])
def test_plates_on_tie_rods_are_held_by_all_of_them(count, beyond):
    """Rods apart that end in both plates leave no motion but off the rods; a third plate slides."""
    places = [(40, 40), (-40, -40), (40, -40), (-40, 40)][:count]
    low = -beyond
    length = 150 + 2 * beyond
    rods = {f"r{n}": (x, y, 5, low, length) for n, (x, y) in enumerate(places)}
    ends = {"base": (0, 20, rods), "top": (130, 20, rods)}
    kinds = _joints_on_rods(ends, rods)
    assert kinds == {(end, rod): "fixed" for end in ends for rod in rods}
    middle = {"base": ends["base"], "nut": (70, 20, rods), "top": ends["top"]}
    kinds = _joints_on_rods(middle, rods)
    for rod in rods:
        assert kinds["nut", rod] == "cylindrical"
        assert kinds["base", rod] == kinds["top", rod] == "fixed"


def test_a_plate_on_rods_that_stand_in_a_base_slides_on_them():
    rods = {"r1": (40, 40, 5, 0, 150), "r2": (-40, -40, 5, 0, 150)}
    kinds = _joints_on_rods({"base": (0, 20, rods), "table": (60, 20, rods)}, rods)
    for rod in rods:
        assert (kinds["base", rod], kinds["table", rod]) == ("fixed", "cylindrical")


def test_two_pins_on_one_axis_are_a_hinge():
    rods = {"r1": (0, 0, 5, 0, 40), "r2": (0, 0, 5, 60, 40)}
    blocks = {
        "low": (0, 20, ["r1"]),
        "arm1": (20, 20, ["r1"]),
        "arm2": (60, 20, ["r2"]),
        "high": (80, 20, ["r2"]),
    }
    kinds = _joints_on_rods(blocks, rods)
    assert sorted(kinds.values()) == ["cylindrical", "cylindrical", "fixed", "fixed"]


def test_the_halves_of_a_split_bearing_act_on_their_own_sides_of_a_rod():
    """The seam of the rod's face may part one of them once more; their borders touch."""
    rod = b.Rot(90, 0, 0) * b.Cylinder(5, 280)
    sleeves = []
    for name, side in (("left", -1), ("right", 1)):
        half = b.Box(30, 280, 30) - b.Rot(90, 0, 0) * b.Cylinder(5, 280)
        half &= b.Pos(side * 50, 0, 0) * b.Box(100, 400, 400)
        solid = half.solid()
        solid.label = name
        sleeves.append(solid)
    inner = rod.solid()
    inner.label = "rod"
    whole = b.Compound(label="sleeves", children=[*sleeves, inner])
    solids, _ = read_built(whole, "sleeves", [])
    contacts = find_contacts(solids)
    joints, _ = find_joints(solids, contacts, find_hardware(solids, contacts, {}))
    loaded = find_patches(2, solids, [j for j in joints if 2 in j.ends])
    areas = [face.area for face in loaded.solid.faces]
    whole = 2 * np.pi * 5e-3 * 0.28
    for own in loaded.faces.values():
        assert 0.1 * whole < sum(areas[k] for k in own) < 0.5 * whole * (1 + 1e-9)
    assert loaded.touching

"""Bearings, guides and screws of joints from their data sheets, from the robot file to the robot."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from stiffscope.design.sensitivity import robot_sensitivity
from stiffscope.errors import InputError
from stiffscope.robot.file.element_sections import read_element
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.parameters import parameters
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import read_robot
from stiffscope.vjm.model.screws import rotation_of, shift
from stiffscope.vjm.statics.analysis import stiffness

BALLS = 'kind = "angular-contact", balls = 16, ball = "12 mm", pitch = "80 mm", angle = "25 deg", preload = "500 N"'
ARM = """
[bodies.arm]
[joints.root]
between = ["ground", "arm"]
type = "revolute"
at = [0, 0, 0]
axis = [0, 0, 1]
drive = { stiffness = "24 kN*m/rad" }
bearing = BEARING
[tool]
body = "arm"
at = ["300 mm", 0, "100 mm"]
pose = ["rz"]
"""
SLIDE = """
[bodies.table]
[joints.x]
between = ["ground", "table"]
type = "prismatic"
at = [0, 0, 0]
axis = [1, 0, 0]
drive = { stiffness = "100 N/um" }
[[joints.x.bearing]]
kind = "linear-guide"
vertical = "300 N/um"
lateral = "200 N/um"
rails = 2
rail_spacing = "200 mm"
carriages = 2
carriage_spacing = "150 mm"
normal = [0, -1, 0]
[[joints.x.bearing]]
kind = "ball-screw"
diameter = "20 mm"
length = "600 mm"
nut = "300 N/um"
support = "150 N/um"
[tool]
body = "table"
at = [0, 0, 0]
pose = ["x"]
"""


def element(text):
    return read_element(Path("e.toml"), text.replace(", ", "\n")).element()


def robot_of(text, bearing="", **names):
    return read_robot(Path("robot.toml"), text.replace("BEARING", bearing), **names)


def k_of(robot):
    return stiffness(mechanism_of(robot, part_matrices(robot)), [[0.0]])[0]


def test_a_joint_yields_as_its_bearing_and_drive_do():
    k = element(BALLS).stiffness
    k[3, 3] = 24e3
    turn = np.kron(
        np.eye(2), np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    )  # x along z, y along x
    carry = np.linalg.inv(shift([0.3, 0.0, 0.1]))
    expected = carry.T @ turn @ k @ turn.T @ carry
    found = k_of(robot_of(ARM, f"{{ {BALLS} }}"))
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())


def test_two_bearings_on_a_shaft_are_a_pair():
    """Two singles at offsets, the second the other way round by its partner's: as the pair's own sum."""
    single = element(BALLS).stiffness
    pair = robot_of(
        ARM, f'[{{ {BALLS}, offset = "-50 mm" }}, {{ {BALLS}, offset = "50 mm" }}]'
    )
    carry = [shift([x, 0.0, 0.0]) for x in (-0.05, 0.05)]
    held = [0, 1, 2, 4, 5]
    expected = sum(c.T @ single @ c for c in carry)[np.ix_(held, held)]
    found = pair.joints["root"].yielding(np.eye(3))[np.ix_(held, held)]
    assert np.linalg.inv(found) == pytest.approx(
        expected, rel=1e-9, abs=1e-9 * np.abs(expected).max()
    )


def test_a_guide_and_a_screw_make_a_slide():
    shaft = 206e9 * np.pi * 0.02**2 / 4 / 0.6
    axial = 1 / (1 / 100e6 + 1 / shaft + 1 / 300e6 + 1 / 150e6)
    k = k_of(robot_of(SLIDE))
    expected = [
        axial,
        4 * 300e6,
        4 * 200e6,
        4 * 300e6 * 0.1**2,
        4 * 200e6 * 0.075**2,
        4 * 300e6 * 0.075**2,
    ]
    assert np.diag(k) == pytest.approx(expected, rel=1e-9)


GUIDE = """
[bodies.spindle]
[joints.turn]
between = ["ground", "spindle"]
type = "revolute"
at = [0, 0, 0]
axis = AXIS
drive = { stiffness = 2e5 }
[bodies.table]
[joints.slide]
between = ["spindle", "table"]
type = "prismatic"
at = [0, 0, 0]
axis = AXIS
SPRING
[[joints.slide.bearing]]
kind = "linear-guide"
vertical = 3e8
lateral = 2e8
rails = 2
rail_spacing = 0.2
carriages = 2
carriage_spacing = 0.15
normal = NORMAL
[tool]
body = "table"
at = [0, 0, 0]
pose = ["POSE"]
"""


def guided(axis, normal, spring, more=""):
    text = (
        GUIDE.replace("AXIS", str(list(axis)))
        .replace("NORMAL", str(list(normal)))
        .replace("SPRING", spring)
    )
    text = text.replace("POSE", "r" + "xyz"[np.argmax(np.abs(axis))])
    return robot_of(text + more)


@pytest.mark.parametrize("spring", ["drive = { stiffness = 1e7 }", "spring = 1e7"])
def test_a_guide_is_as_stiff_in_any_direction(spring):
    """The robot with axis x and normal z, turned: K is turned with it; the screw axis is the rail."""
    k = np.diag(
        [1e7, 8e8, 12e8, 1 / (1 / 2e5 + 1 / 12e6), 12e8 * 0.075**2, 8e8 * 0.075**2]
    )
    turns = [
        rotation_of(each) for each in np.random.default_rng(3).normal(size=(20, 3))
    ]
    ways = [
        (x, y)
        for x, y in product(np.vstack([np.eye(3), -np.eye(3)]), repeat=2)
        if x @ y == 0.0
    ]
    turns += [
        np.column_stack([x, np.cross(z, x), z])
        for x, z in [*ways, ([1, 1, 0], [0, 0, 1])]
    ]
    for turn in turns:
        robot = guided(
            turn[:, 0].tolist(), (turn[:, 2] + 0.3 * turn[:, 0]).tolist(), spring
        )
        both = np.kron(np.eye(2), turn / np.linalg.norm(turn, axis=0))
        expected = both @ k @ both.T
        found = stiffness(
            mechanism_of(robot, part_matrices(robot)), [robot.poses["home"]]
        )[0]
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * k.max())


@pytest.mark.parametrize("axis", [[1, 1, 0], [0, 0, 1], [0.3, -0.5, 0.8]])
@pytest.mark.parametrize("normal", ["", "normal = [1, -1, 0.2]"])
def test_a_copied_guide_is_its_original_turned(axis, normal):
    copies = """
[[copies]]
of = "slide"
as = ["other"]
axis = [0, 0, 1]
angles = ["6 deg"]  # rounding makes y the largest component of [1, 1, 0], turned and back
"""
    text = (
        GUIDE[: GUIDE.index("[bodies.spindle]")]
        + GUIDE[GUIDE.index("[bodies.table]") :]
    )
    text = (
        text.replace("normal = NORMAL", normal)
        .replace("AXIS", str(axis))
        .replace("SPRING", "")
    )
    text = text.replace("POSE", "x")
    text = (
        text.replace("bodies.table", "bodies.slide")
        .replace('"table"', '"slide"')
        .replace("spindle", "ground")
    )
    robot = robot_of(text + copies)
    turn = robot.copied["other"].rotation
    one, other = (
        np.kron(np.eye(2), each.axes)
        @ each.compliance
        @ np.kron(np.eye(2), each.axes).T
        for each in mechanism_of(robot, {}).joints
    )
    both = np.kron(np.eye(2), turn)
    assert other == pytest.approx(
        both @ one @ both.T, rel=1e-9, abs=1e-9 * np.abs(one).max()
    )


def test_a_normal_along_the_rail_is_refused():
    with pytest.raises(
        InputError,
        match=r"robot.toml:\d+: joints.slide.bearing.normal: expected a direction across the",
    ):
        guided([0, 1, 0], [0, -2, 0], "spring = 1e7")


def test_its_numbers_can_be_set_and_varied():
    robot = robot_of(ARM, f"{{ {BALLS} }}")
    names = {each.name for each in parameters(robot)}
    assert {
        "root.bearing.preload",
        "root.bearing.ball",
        "root.bearing.pitch",
        "root.bearing.angle",
    } <= names
    softer = robot_of(ARM, f"{{ {BALLS} }}", overrides=["root.bearing.preload=62.5 N"])
    ratio = k_of(softer)[2, 2] / k_of(robot)[2, 2]
    assert ratio == pytest.approx(0.5, abs=0.06)  # the third root of an eighth


def test_every_number_of_several_bearings_can_be_varied():
    robot = robot_of(SLIDE)
    found = robot_sensitivity(robot, np.array([[0.0]]))
    rows = {row.parameter.name: row for row in found.rows}
    assert {"x.bearing.0.vertical", "x.bearing.1.nut", "x.drive.stiffness"} <= set(rows)
    assert not found.notes
    high, low = (
        k_of(robot_of(SLIDE, overrides=[f"x.bearing.1.nut={k} N/um"]))
        for k in (303, 297)
    )
    assert rows["x.bearing.1.nut"].by.stiffness[0, 0, 0] == pytest.approx(
        (high - low)[0, 0] / 6e6, rel=1e-3
    )
    assert np.isnan(found.at.frequency).all()  # without masses


def test_a_number_set_of_a_bearing_that_is_not_there_is_blamed():
    bare = ARM.replace("bearing = BEARING\n", "")
    with pytest.raises(
        InputError,
        match=r"^--set root.bearing.preload=3 N: joints.root.bearing: expected a kind",
    ):
        robot_of(bare, overrides=["root.bearing.preload=3 N"])


def test_a_sheets_stiffness_follows_the_load():
    sheet = 'kind = "crossed-roller", radial = "500 N/um", axial = "700 N/um", tilting = "1 MN*m/rad"'
    k = element(f'{sheet}, at_load = "1 kN", preload = "2 kN"').stiffness
    assert np.diag(k) == pytest.approx(2**0.1 * np.array([7e8, 5e8, 5e8, 0, 1e6, 1e6]))


DEEP = BALLS.replace("angular-contact", "deep-groove").replace(', angle = "25 deg"', "")
REFUSED = {
    '{ kind = "deep" }': r'joints.root.bearing: expected a kind of bearing \(.*\), got "deep"',
    '{ kind = "deep-groove", balls = 8 }': "joints.root.bearing.*ball: expected a value beside the others",
    f"{{ {BALLS}, ring = 3 }}": r"ring: expected a known key \(kind, offset, radial, .*arrangement",
    f"{{ {BALLS} }}\ncompliance = {{ radial = 1e-9 }}": "joints.root.compliance: expected none beside a bearing",
    '{ kind = "cylindrical-roller", rollers = 20, length = "10 mm", pitch = "80 mm", clearance = "-3 um" }': "joints.root.bearing: expected bearings that hold x too, got cylindrical-roller",
    f'[{{ {BALLS} }}, {{ kind = "ball-screw", axial = "1 N/um" }}]': None,
    '{ kind = "cylindrical-roller", rollers = 20, length = "10 mm", pitch = "80 mm", clearance = "3 um" }': "bearing.*load: expected a preload, a load or an interference",
    f"{{ {BALLS.replace('500 N', '0 N')} }}": "bearing.*load: expected a preload, a load or an interference",
    f'{{ {BALLS}, radial = "100 N/um", axial = "50 N/um", tilting = "1 kN*m/rad" }}': "balls: expected none beside the sheet's own radial, got one",
    '{ kind = "ball-screw", axial = "1 N/um", length = "1 m" }': "length: expected none beside the sheet's own axial, got one",
    '{ radial = "100 N/um" }': "joints.root.bearing: expected a kind of bearing .*, got nothing",
    f"{{ {BALLS.replace('25 deg', '-25 deg')} }}": "angle: expected a contact angle from 0 to below 90 degrees, got -25",
    f'{{ {BALLS}, clearance = "10 um" }}': "clearance: expected none beside a contact angle, got 10 um",
    f'{{ {DEEP}, clearance = "2 mm" }}': "clearance: expected less than 1.2 mm",
    f"{{ {BALLS.replace('500 N', '1e9 N')} }}": "load: expected elastic contacts, got elements pressed together by",
    '{ kind = "crossed-roller", rollers = 20, length = "10 mm", pitch = "80 mm", clearance = "-3 mm" }': "load: expected elastic contacts, got elements pressed together by",
    f'{{ {BALLS}, load = ["-5 kN", 0, 0] }}': "load: expected a thrust .* of an angular-contact bearing, got -4500 N",
    '{ kind = "crossed-roller", rollers = 1e8, length = "10 mm", pitch = "80 mm", clearance = "-3 um" }': "rollers: expected 1 to 1000, got 100000000",
    '{ kind = "linear-guide", vertical = "9 N/um", lateral = "9 N/um", rails = 2, carriages = 2 }': "bearing.*rail_spacing: expected the distance of one of 2 from the next, got none",
    '{ kind = "linear-guide", vertical = "9 N/um", lateral = "9 N/um", rails = 2, rail_spacing = "1 m" }': "bearing.*tilt: expected a carriage's own beside one of carriages, got nothing",
    '{ kind = "deep-groove", radial = "9 N/um", axial = "9 N/um", tilting = "1 kN*m/rad", preload = "9 N" }': "at_load: expected the load of the sheet's own stiffness beside preload, got nothing",
}


@pytest.mark.parametrize("bearing", REFUSED)
def test_what_cannot_hold_the_joint_is_refused(bearing):
    if REFUSED[bearing] is None:
        assert k_of(robot_of(ARM, bearing))[0, 0] > 0.0
        return
    with pytest.raises(InputError, match=REFUSED[bearing]) as refused:
        robot_of(ARM, bearing)
    assert str(refused.value).startswith("robot.toml:")

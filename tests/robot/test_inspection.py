"""What `stiffscope check` finds in shipped robots and in broken ones."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from stiffscope.data import FOLDER
from stiffscope.robot.inspection import inspect_robot, inspection_json
from stiffscope.robot.mechanism_of import rigid_mechanism
from stiffscope.robot.reader import load_robot, read_robot
from stiffscope.runtime.json_text import to_json
from stiffscope.vjm.kinematics.configurations import configure
from tests.robot.test_reader import TEXT

ROBOTS = FOLDER / "robots"
SHIPPED = {  # degrees of freedom of mechanism and tool, redundant constraints, idle motions
    "biglide": (3, 3, 18, 0),
    "delta": (9, 3, 0, 6),
    "five-bar": (2, 2, 3, 0),
    "orthoglide": (3, 3, 12, 0),
    "serial-arm": (6, 6, 0, 0),
    "stewart": (6, 6, 0, 0),
}


def changed(name, tmp_path, *pairs):
    """A shipped robot with some of its text replaced."""
    text = (ROBOTS / f"{name}.toml").read_text()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / f"{name}.toml"
    path.write_text(text)
    return read_robot(path, text)


SOFT = '[materials.soft]\nyoungs_modulus = "70 MPa"\nshear_modulus = "26 GPa"\ndensity = 7.85\n\n'


def test_every_shipped_robot_is_known():
    assert set(SHIPPED) == {path.stem for path in ROBOTS.glob("*.toml")}


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_robot(name):
    found = inspect_robot(load_robot(name))
    m = found.mobility
    assert (m.dof, len(m.tool), m.redundant, m.idle_count) == SHIPPED[name]
    assert found.error == ""
    assert found.residual < 1e-12
    assert not m.loose
    assert m.redundant_drives == 0
    assert all(pose.is_reached for pose in found.poses)
    assert np.allclose(found.poses[0].drives, 0.0, atol=1e-12)
    for way, home in zip(found.reach, found.mechanism.tool.home, strict=True):
        assert way.low < home < way.high
    written = json.loads(to_json(inspection_json(found)))
    assert written["degrees_of_freedom"]["tool"] == SHIPPED[name][1]
    assert list(written["reach"]) == list(found.mechanism.tool.pose)


@pytest.mark.parametrize(
    ("edits", "remark"),
    [
        (
            {'type = "universal"\nat = ["= 0.18': 'type = "universal"\nat = ["= 0.19'},
            r"joint leg1.elbow is 10 mm from leg1.arm.tip: a rigid arm",
        ),
        (
            {"6e-6": "6e-9", "3e-5": "3e-11"},
            r"part strut: √\(3·C22/C66\) = 447 m, the length of a slender part, contradicts its length 0.52",
        ),
        (
            {
                "2e-6": "1e5",
                "6e-6": "1e5",
                "3e-5": "1.1e6",
            },  # a stiffness of which √(3·K22/K66) is the length too
            r"part strut: one newton moves its tip by 1e\+05 m, more than its length 0.52",
        ),
        (
            {"0, 6e-6]": "0, -6e-6]", "[0, 6e-6,": "[0, -6e-6,"},
            r"part strut: C26 = -6e-06 contradicts its length, by which it is 5.7.e-06; is it clamped at its base",
        ),
        (
            {"-6e-6": "6e-6"},
            r"part strut: C35 = 6e-06 contradicts its length, by which it is -5.7.e-06; is it clamped at its base",
        ),
        (
            {"[parts.arm]": SOFT + "[parts.arm]", '"steel"': '"soft"'},
            r"material soft: its Poisson's ratio, E/2G - 1, is -0.999, solids have -0.8 to 0.5; is its unit right\?",
        ),
        (
            {"[parts.arm]": SOFT + "[parts.arm]", '"steel"': '"soft"'},
            r"material soft: its density is 7.85 kg/m³, solids have 20 to 23000 kg/m³; is its unit right\?",
        ),
        ({"[parts.arm]": SOFT + "[parts.arm]"}, r"^nothing is made of materials.soft$"),
        (
            {'"-60 deg", "80 deg"': "-60, 80"},
            r"drive leg1.motor: its range is -60 to 80 rad; is its unit right\?",
        ),
    ],
)
def test_what_contradicts_lengths_or_solids_is_remarked(tmp_path, edits, remark):
    text = TEXT
    for old, new in edits.items():
        text = text.replace(old, new)
    found, before = (
        inspect_robot(read_robot(tmp_path / "a.toml", each)).remarks
        for each in (text, TEXT)
    )
    assert any(re.search(remark, each) for each in found)
    assert not any(
        "stands" in each or "contradicts" in each or "unit" in each for each in before
    )


def test_biglide_reaches_as_its_carriages_allow():
    """Carriages at 200 to 550 mm, links of 500 mm, x = 0: a = l + L cos q, z = l1 + l2 + L sin q."""
    z = inspect_robot(load_robot("biglide")).reach[2]
    low, high = (
        0.055 + 0.5 * np.sqrt(1 - ((a - 0.075) / 0.5) ** 2) for a in (0.55, 0.2)
    )
    assert z.low == pytest.approx(low, abs=1e-3)
    assert z.high == pytest.approx(high, abs=1e-3)


def test_delta_weighs_what_its_rods_do():
    """Aluminium tubes by their sections, and what the file gives; copies count."""
    found = inspect_robot(load_robot("delta"))
    rods = [mass for name, mass in found.masses.items() if ".rod" in name]
    arms = [mass for name, mass in found.masses.items() if name.endswith(".arm")]
    assert (len(rods), len(arms)) == (6, 3)
    written = inspection_json(found)
    assert written["mass"] == pytest.approx(
        sum(rods) + sum(arms) + found.masses["platform"]
    )


def test_pose_that_the_mechanism_cannot_do(tmp_path):
    robot = changed(
        "five-bar",
        tmp_path,
        ('["x", "y"]', '["x", "y", "rx"]'),
        ('[0, "= y_M"]\nside', '[0, "= y_M", 0]\nside'),
        ('["60 mm", "= y_M - 0.06"]', '["60 mm", "= y_M - 0.06", 0]'),
    )
    found = inspect_robot(robot)
    assert re.search(
        r":\d+: tool\.pose: expected coordinates that the mechanism can move in at home, got rx",
        found.error,
    )
    assert any(
        "[tool] pose commands rx, which the mechanism locks" in each
        for each in found.remarks
    )
    assert found.configurations is None
    assert inspection_json(found)["usable"] is False


def test_missing_drive_and_pose_out_of_range(tmp_path):
    drive = 'drive   = { stiffness = "5 kN*m/rad", range = ["-60 deg", "60 deg"] }\n\n[joints."right'
    one = inspect_robot(changed("five-bar", tmp_path, (drive, '\n[joints."right')))
    assert len(one.mobility.loose) == 1
    assert any("1 more needed" in each for each in one.remarks)
    short = inspect_robot(
        changed("five-bar", tmp_path, ('"-60 deg", "60 deg"', '"-5 deg", "5 deg"'))
    )
    assert [pose.name for pose in short.poses if not pose.is_reached] == ["side"]
    assert any(
        each.startswith("pose side is not reached: ") and "range" in each
        for each in short.remarks
    )


def test_wrist_that_loses_a_direction(tmp_path):
    """The serial arm with J5 parallel to J6: no joint turns about x."""
    robot = changed(
        "serial-arm", tmp_path, ("axis    = [1, 0, 0]", "axis    = [0, 0, 1]")
    )
    found = inspect_robot(robot)
    assert found.mobility.conditioning == 0.0
    assert found.mobility.coordinates["rx"] == "locked"


def test_nearly_singular_home(tmp_path):
    """A five-bar whose outer bars are almost in line across: pushing M along y turns no drive."""
    pairs = (
        ('th = "110 deg" ', 'th = "90 deg" '),
        ('length     = "320 mm"', 'length     = "120.0006 mm"'),
    )
    found = inspect_robot(changed("five-bar", tmp_path, *pairs))
    assert any(
        each.startswith("pose home is nearly singular: ") for each in found.remarks
    )
    # With s = y / x_E of the outer bars, drives turn by dx and s dy over the inner bars' length: condition number 1/s.
    slope = np.sqrt(120.0006**2 - 120.0**2) / 120.0
    assert found.mobility.conditioning == pytest.approx(slope, rel=1e-6)


def test_rounded_coordinates_are_told(tmp_path):
    """A Biglide one of whose hinges is off by 10 nm to a side that its loop does not allow."""
    old = 'axis    = [0, 1, 0]\n\n[joints."limb2.link3.joint_b"]'
    found = inspect_robot(
        changed("biglide", tmp_path, (old, old.replace("[0, 1, 0]", "[1e-6, 1, 0]")))
    )
    assert any("are coordinates rounded?" in each for each in found.remarks)
    assert not any(
        "are coordinates rounded?" in each
        for each in inspect_robot(load_robot("biglide")).remarks
    )


FLEXURE = """
[bodies.table]
[bodies.head]
[joints.motor]
between = ["ground", "table"]
type = "revolute"
at = [0, 0, 0]
axis = [0, 0, 1]
drive = { stiffness = "50 kN*m/rad" }
[joints.hinge]
between = ["table", "head"]
type = "revolute"
at = [0.3, 0, 0]
axis = [0, 0, 1]
spring = "30 kN*m/rad"
[tool]
body = "head"
at = [0.4, 0.1, 0]
pose = ["rz"]
[poses]
turned = ["30 deg"]
"""


@pytest.mark.parametrize("pose", ["rz", "y"])
def test_drives_reach_a_pose_before_flexures_bend(pose):
    """A motor and a flexure that both turn the tool: the flexure stays at rest, which is told."""
    text = FLEXURE.replace('"rz"', f'"{pose}"').replace(
        '"30 deg"', {"rz": '"30 deg"', "y": "0.2"}[pose]
    )
    robot = read_robot(Path("flexure.toml"), text)
    at = configure(rigid_mechanism(robot), [robot.poses["turned"]])
    assert at.coordinates("hinge") == pytest.approx(0.0, abs=1e-12)
    assert at.valid.all()
    assert abs(at.drives[0, 0]) > 0.2
    remarks = inspect_robot(robot).remarks
    assert any(
        "leaves 1 of 2 motions open: hinge stays as at home" in each for each in remarks
    )


def test_a_flexure_bends_where_no_drive_reaches():
    """A motor about z and a flexure about y, with the pose ry: the flexure alone turns the tool so."""
    across = FLEXURE.replace('"rz"', '"rz", "ry"').replace(
        '["30 deg"]', '["30 deg", "5 deg"]'
    )
    robot = read_robot(
        Path("flexure.toml"), across.replace("0, 0, 1]\nspring", "0, 1, 0]\nspring")
    )
    at = configure(rigid_mechanism(robot), [robot.poses["turned"]])
    assert at.valid.all()
    assert abs(at.coordinates("hinge")).max() > 0.05


def test_drives_that_a_pose_does_not_tell_are_named():
    """A planar arm of three hinges whose poses are points: it keeps one hinge as it is, and says which."""
    links = "".join(
        f'[bodies.l{k}]\n[joints.j{k}]\nbetween = ["{f"l{k - 1}" if k else "ground"}", "l{k}"]\ntype = "revolute"\n'
        f"at = {at}\naxis = [0, 0, 1]\ndrive = {{ stiffness = 1e4 }}\n"
        for k, at in enumerate(([0, 0, 0], [0.3, 0.1, 0], [0.5, 0.4, 0]))
    )
    text = f'{links}[tool]\nbody = "l2"\nat = [0.7, 0.3, 0]\npose = ["x", "y"]\n[poses]\nhere = [0.65, 0.35]\n'
    found = inspect_robot(read_robot(Path("arm.toml"), text))
    told = [each for each in found.remarks if "leaves 1 of 3 motions open" in each]
    assert len(told) == 1
    still = [
        name
        for name, moved in zip(("j0", "j1", "j2"), found.poses[1].drives, strict=True)
        if moved == 0.0
    ]
    assert told[0].endswith(f": {still[0]} stays as at home")
    assert not any(
        "motions open" in each for each in inspect_robot(load_robot("stewart")).remarks
    )


def test_a_singular_home_is_said_with_where_tool_poses_start(tmp_path):
    """A spherical wrist that is straight at home."""
    joints = "".join(
        f'[bodies.b{k}]\n[joints.j{k}]\nbetween = ["{f"b{k - 1}" if k else "ground"}", "b{k}"]\ntype = "revolute"\n'
        f"at = {at}\naxis = {axis}\ndrive = {{ stiffness = 20000 }}\n"
        for k, (at, axis) in enumerate(
            [
                ([0, 0, 0], [0, 0, 1]),
                ([0, 0, 0.4], [0, 1, 0]),
                ([0.35, 0, 0.6], [0, 1, 0]),
                ([0.5, 0, 0.6], [1, 0, 0]),
                ([0.7, 0, 0.6], [0, 1, 0]),
                ([0.75, 0, 0.6], [1, 0, 0]),
            ]
        )
    )
    tool = '[tool]\nbody = "b5"\nat = [0.85, 0, 0.6]\npose = ["x", "y", "z", "rx", "ry", "rz"]\n'
    path = tmp_path / "wrist.toml"
    path.write_text(
        f'name = "wrist"\n{joints}{tool}[poses]\nhome = [0.85, 0, 0.6, 0, 0, 0]\n'
    )
    found = inspect_robot(load_robot(path))
    assert not found.error
    assert any(
        r.startswith("home is singular: tool poses start from joints.")
        for r in found.remarks
    )
    assert not any("which the mechanism locks" in r for r in found.remarks)

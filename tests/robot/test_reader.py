"""A robot file of any mechanism: what it means, and that errors name file, line, field and what would be valid."""

import re
from pathlib import Path

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.robot.file.override import TypedOverride
from stiffscope.robot.file.sections import AXES
from stiffscope.robot.file.validate import read_pose
from stiffscope.robot.library import copy_robot, find_robot, robot_names
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.parameters import parameters
from stiffscope.robot.part_matrices import PartMatrix, needed_experiments, part_matrices
from stiffscope.robot.reader import load_robot, read_robot
from tests.robot import at_home

TEXT = """name = "delta"

[parameters]
a = "220 mm"
th = "25 deg"
z = "= -a*sin(th)"

[parts.arm]
shape = "rod"
length = "= a"
radius = "15 mm"
material = "steel"
compliance = "beam"

[parts.strut]
shape = "matrix"
mass = "80 g"
matrix = [
  [4e-9, 0, 0, 0, 0, 0],
  [0, 2e-6, 0, 0, 0, 6e-6],
  [0, 0, 2e-6, 0, -6e-6, 0],
  [0, 0, 0, 4e-5, 0, 0],
  [0, 0, -6e-6, 0, 3e-5, 0],
  [0, 6e-6, 0, 0, 0, 3e-5],
]

[bodies."leg1.arm"]
part = "arm"
base = ["180 mm", 0, 0]
tip = ["= 0.18 + a*cos(th)", 0, "= z"]
y = [0, 1, 0]

[bodies."leg1.rod"]
part = "strut"
base = ["= 0.18 + a*cos(th)", 0, "= z"]
tip = ["50 mm", 0, "-0.5 m"]
y = [0, 1, 0]

[joints."leg1.motor"]
between = ["ground", "leg1.arm.base"]
type = "revolute"
at = ["180 mm", 0, 0]
axis = [0, 2, 0]
drive = { stiffness = "24 kN*m/rad", range = ["-60 deg", "80 deg"] }
compliance = { radial = "0.01 um/N", axial = "0.02 um/N", tilting = "1e-6 rad/(N*m)" }

[joints."leg1.elbow"]
between = ["leg1.arm.tip", "leg1.rod.base"]
type = "universal"
at = ["= 0.18 + a*cos(th)", 0, "= z"]
axis = [0, 1, 0]
axis2 = [1, 0, -1]

[joints."leg1.wrist"]
between = ["leg1.rod.tip", "platform"]
type = "spherical"
at = ["50 mm", 0, "-0.5 m"]

[[copies]]
of = "leg1"
as = ["leg2", "leg3"]
axis = [0, 0, 1]
angles = ["120 deg", "240 deg"]

[bodies.platform]
mass = "600 g"
centre = [0, 0, "-500 mm"]
inertia = [1e-3, 2e-3, 3e-3, 1e-4, 0, 0]

[groups]
arms = ["leg1.arm", "leg2.arm", "leg3.arm"]
all = ["arms", "leg1.motor"]

[tool]
body = "platform"
at = [0, 0, "-500 mm"]
pose = ["x", "y", "z"]

[gravity]
direction = [0, 0, -2]

[poses]
home = [0, 0, "-500 mm"]

[map]
x = ["-150 mm", "150 mm"]
z = ["-600 mm", "-400 mm"]
"""


@pytest.fixture
def read(tmp_path):
    def from_text(text, *overrides, **options):
        (tmp_path / "robot.toml").write_text(text, encoding="utf-8")
        return load_robot(tmp_path / "robot.toml", overrides, **options)

    return from_text


def line_with(start, text):
    return next(
        i for i, line in enumerate(text.splitlines(), 1) if line.startswith(start)
    )


def test_units_expressions_and_defaults(read):
    robot = read(TEXT)
    assert robot.bodies["leg1.arm"].tip == pytest.approx(
        (0.18 + 0.22 * np.cos(np.radians(25)), 0, robot.parameters["z"])
    )
    assert (
        robot.parts["arm"].parameters().lengths()["length"]
        == robot.parameters["a"]
        == 0.22
    )
    drive = robot.joints["leg1.motor"].drive
    assert (drive.stiffness, *drive.range) == pytest.approx(
        (24e3, *np.radians([-60, 80]))
    )
    assert robot.joints["leg1.motor"].yielding(np.eye(3)).diagonal() == pytest.approx(
        [2e-8, 1e-8, 1e-8, 0, 1e-6, 1e-6]
    )
    assert robot.gravity.acceleration == 9.81
    assert robot.poses["home"] == (0, 0, -0.5)
    assert robot.map.ranges() == {"x": (-0.15, 0.15), "z": (-0.6, -0.4)}
    assert robot.members("all") == ("leg1.arm", "leg2.arm", "leg3.arm", "leg1.motor")
    assert robot.members("arm") == robot.groups["arms"]
    assert robot.members("drives") == ("leg1.motor", "leg2.motor", "leg3.motor")
    pose = read_pose(["10 mm", 0, -0.5], robot.tool, ("at",))
    assert pose == (0.01, 0, -0.5)


def test_groups_that_name_another_twice_take_no_time(read):
    text = (
        "\n".join(f'g{k} = ["g{k + 1}", "g{k + 1}"]' for k in range(30))
        + '\ng30 = ["platform"]'
    )
    assert read(TEXT.replace("[groups]", f"[groups]\n{text}")).members("g0") == (
        "platform",
    )


def test_a_file_without_poses_has_its_home(read):
    text = TEXT.replace('[poses]\nhome = [0, 0, "-500 mm"]\n', "")
    assert read(text).poses == {"home": pytest.approx((0.0, 0.0, -0.5))}


def test_copies_are_turned_and_renamed(read):
    robot = read(TEXT)
    turn = at_home.double(
        np.array([[-0.5, -(0.75**0.5), 0], [0.75**0.5, -0.5, 0], [0, 0, 1]])
    )[:3, :3]
    assert robot.bodies["leg2.arm"].tip == pytest.approx(
        turn @ robot.bodies["leg1.arm"].tip
    )
    assert robot.joints["leg2.motor"].axis == pytest.approx(turn @ [0, 2, 0])
    assert robot.joints["leg2.wrist"].between == ("leg2.rod.tip", "platform")
    assert robot.joints["leg3.motor"].between == ("ground", "leg3.arm.base")
    assert robot.copied["leg3.arm"].name == "leg1.arm"


def _nest(entries, each):
    sets = [[f"q.{k}{n}" for n in range(each)] for k in range(entries)]
    turns = [f'"{n + 1} deg"' for n in range(each)]
    copies = (
        f"[[copies]]\nof = 'q'\nas = {names}\naxis = [0, 0, 1]\nangles = [{', '.join(turns)}]\n"
        for names in sets
    )
    joint = '[joints.q]\nbetween = ["ground", "q"]\ntype = "fixed"\nat = [0, 0, 0]\n'
    tool = '[tool]\nbody = "q"\nat = [0, 0, 0]\npose = ["x"]\n'
    return f"[bodies.q]\n{joint}{tool}{''.join(copies)}"


def test_copies_within_their_own_set_do_not_multiply():
    """Three entries that copy each other's copies are refused (it did not end); thirty copies of a set are thirty."""
    with pytest.raises(
        InputError,
        match=r"^r.toml:\d+: copies\[0\].of: expected a set that is no copy of its copy",
    ):
        read_robot(Path("r.toml"), _nest(3, 4))
    assert len(read_robot(Path("r.toml"), _nest(1, 30)).bodies) == 31
    one = "[[copies]]\nof = 'q'\nas = ['x{}']\naxis = [0, 0, 1]\nangles = [1]\n"
    assert (
        len(
            read_robot(
                Path("r.toml"), _nest(0, 0) + "".join(map(one.format, range(300)))
            ).bodies
        )
        == 301
    )
    with pytest.raises(
        InputError,
        match=r"^r.toml:\d+: copies\[2000\]: expected at most 2,000 copies, got 4,000",
    ):
        read_robot(Path("r.toml"), _nest(0, 0) + "".join(map(one.format, range(4000))))


def test_a_copy_of_a_copy_and_a_copy_within_a_set(read):
    more = """
[[copies]]
of = "leg3"
as = ["leg4"]
axis = [0, 0, -1]
angles = ["180 deg"]

[[copies]]
of = "leg1.rod"
as = ["leg1.stay"]
axis = [0, 0, 1]
angles = ["10 deg"]

[joints."leg1.hold"]
between = ["leg1.stay.tip", "platform"]
type = "fixed"
at = [0, 0, 0]
compliance = [1e-9, 2e-9, 3e-9, 1e-6, 2e-6, 3e-6]

[joints."leg1.hold2"]
between = ["leg1.stay.base", "leg1.arm.tip"]
type = "planar"
at = [0, 0, 0]
axis = [1, 0, 0]
"""
    robot = read(TEXT + more)
    assert robot.copied["leg4.stay"].name == "leg1.rod"
    assert robot.bodies["leg4.arm"].tip == pytest.approx(  # 240 and -180 degrees
        np.array([[0.5, -(0.75**0.5), 0], [0.75**0.5, 0.5, 0], [0, 0, 1]])
        @ robot.bodies["leg1.arm"].tip
    )
    zero = {name: PartMatrix(np.zeros((6, 6))) for name in robot.parts}
    mechanism = mechanism_of(robot, zero)
    c = -0.5
    s = (
        0.75**0.5
    )  # a fixed joint's six numbers are in base axes, those of its copy turn with it
    written = mechanism.joint("leg1.hold").compliance
    turn = at_home.double(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]))
    np.testing.assert_allclose(np.diag(written), [1e-9, 2e-9, 3e-9, 1e-6, 2e-6, 3e-6])
    np.testing.assert_allclose(
        mechanism.joint("leg2.hold").compliance, turn @ written @ turn.T, atol=1e-18
    )


def test_a_joint_may_have_a_body_s_name(read, tmp_path):
    text = TEXT.replace('joints."leg1.motor"', 'joints."leg1.arm"').replace(
        '"leg1.motor"]', '"joints.leg1.arm"]'
    )
    robot = read(
        text.replace('["leg1.arm", ', '["bodies.leg1.arm", ').replace(
            '"leg2.arm", "leg3.arm"]', '"bodies.leg2.arm"]'
        )
    )
    assert robot.joints["joints.leg2.arm"].between == ("ground", "leg2.arm.base")
    assert robot.drives() == ("joints.leg1.arm", "joints.leg2.arm", "joints.leg3.arm")
    assert robot.members("all") == ("leg1.arm", "leg2.arm", "joints.leg1.arm")
    assert robot.members("bodies.leg1.arm") == ("leg1.arm",)
    with pytest.raises(
        InputError,
        match=r'expected bodies.leg1.arm or joints.leg1.arm, got "leg1.arm", which both',
    ):
        robot.members("leg1.arm")
    mechanism = mechanism_of(robot, part_matrices(robot))
    assert len(mechanism.joints) == 9
    found = {each.name: each for each in parameters(robot)}
    stiffer = found["leg1.arm.drive.stiffness"].set_to(robot, 5e4)
    assert [
        joint.drive.stiffness
        for joint in stiffer.joints.values()
        if getattr(joint, "drive", None)
    ] == [5e4] * 3
    with pytest.raises(
        InputError,
        match=rf'robot.toml:{line_with("drive", text)}: joints."leg1.arm".drive.stiffness',
    ):
        read(text.replace("24 kN*m/rad", "24 kg"))
    with pytest.raises(
        InputError,
        match=r"groups.arms\[0\]: expected bodies.leg1.arm or joints.leg1.arm",
    ):
        read(text)


def test_a_six_number_bearing_turns_with_its_copy(read):
    six = "[1e-9, 2e-9, 3e-9, 0, 2e-6, 3e-6]"
    robot = read(
        TEXT.replace(
            '{ radial = "0.01 um/N", axial = "0.02 um/N", tilting = "1e-6 rad/(N*m)" }',
            six,
        )
    )
    mechanism = mechanism_of(
        robot, {name: PartMatrix(np.zeros((6, 6))) for name in robot.parts}
    )
    angle = np.radians(120)
    turn = np.array(
        [
            [np.cos(angle), -np.sin(angle), 0],
            [np.sin(angle), np.cos(angle), 0],
            [0, 0, 1],
        ]
    )
    in_base = {}
    for name in ("leg1.motor", "leg2.motor"):
        joint = mechanism.joint(name)
        axes = at_home.double(joint.axes)
        in_base[name] = axes @ joint.compliance @ axes.T
    both = at_home.double(turn)
    np.testing.assert_allclose(
        in_base["leg2.motor"], both @ in_base["leg1.motor"] @ both.T, atol=1e-20
    )


def test_the_mechanism_has_the_file_s_values(read):
    robot = read(TEXT)
    assert needed_experiments(robot) == ()
    mechanism = mechanism_of(robot, part_matrices(robot))
    arm = mechanism.body("leg1.arm")
    assert arm.mass == pytest.approx(np.pi * 0.015**2 * 0.22 * 7850)
    np.testing.assert_allclose(
        arm.elastic.axes[:, 0],
        np.subtract(robot.bodies["leg1.arm"].tip, (0.18, 0, 0)) / 0.22,
    )
    np.testing.assert_allclose(arm.elastic.axes[:, 1], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(mechanism.gravity, [0, 0, -9.81])
    np.testing.assert_allclose(mechanism.body("platform").inertia[0], [1e-3, 1e-4, 0])
    assert mechanism.joint("leg1.motor").drive.high == pytest.approx(np.radians(80))
    assert mechanism.body("leg1.rod").mass == pytest.approx(0.08)


def test_nothing_changes_after_reading(read):
    robot = read(TEXT)
    with pytest.raises(TypeError):
        robot.bodies["new"] = None
    with pytest.raises(ValueError, match="frozen"):
        robot.bodies["platform"].mass = 1.0


@pytest.mark.parametrize(
    ("old", "new", "at", "message"),
    [
        (
            'radius = "15 mm"',
            'radios = "15 mm"',
            "radios",
            'parts.arm.radios: expected a known key .*, got "radios"; did you mean "radius"?',
        ),
        (
            'radius = "15 mm"',
            'radius = "15 kg"',
            "radius",
            'parts.arm.radius: expected a length such as "20 mm", got "15 kg", which is a mass',
        ),
        (
            'radius = "15 mm"\n',
            "",
            "[parts.arm]",
            'parts.arm.radius: expected a length such as "20 mm", got nothing',
        ),
        (
            'radius = "15 mm"',
            'radius = "15 mm"\nbore = "40 mm"',
            "bore",
            "parts.arm.bore: expected a diameter up to",
        ),
        (
            'shape = "rod"',
            'shape = "rods"',
            "shape",
            r'parts.arm.shape: expected a shape \(rod, plate, tube, .*, matrix\), got "rods"; did you mean "rod"?',
        ),
        (
            'shape = "rod"\n',
            "",
            "[parts.arm]",
            r"parts.arm.shape: expected a shape \(rod, .*\), got nothing",
        ),
        (
            'material = "steel"',
            'material = "stell"',
            "material",
            "parts.arm.material: expected one of steel, .*titanium",
        ),
        (
            'compliance = "beam"',
            'compliance = "fem"',
            "compliance",
            'parts.arm.compliance: expected .fea., .beam. or .published., got "fem"',
        ),
        (
            "  [0, 2e-6, 0, 0, 0, 6e-6],",
            "  [0, 2e-6, 0, 0, 6e-6],",
            "matrix",
            "parts.strut.matrix: expected six rows",
        ),
        (
            "  [0, 2e-6, 0, 0, 0, 6e-6],",
            "  [0, 2e-6, 0, 0, 0, 7e-6],",
            "matrix",
            "parts.strut.matrix: expected a symmetric, positive semidefinite compliance, got another: not symmetric",
        ),
        (
            "  [4e-9, 0, 0, 0, 0, 0],",
            "  [4e9, 0, 0, 0, 0, 0],",
            "matrix",
            r"parts.strut.matrix: expected a compliance, not a stiffness, got 4e.09 for entry 11, .* beyond",
        ),
        ('mass = "80 g"', 'mass = "cad"', "mass", "parts.strut.mass: expected a mass"),
        (
            'z = "= -a*sin(th)"',
            'z = "= -a*sin(tz)"',
            "z =",
            'parameters.z: expected a name .*, got "tz"',
        ),
        (
            'a = "220 mm"',
            'a = "= z"',
            "a =",
            "parameters.a: expected no parameter that depends on itself, got ",
        ),
        (
            'a = "220 mm"',
            'a = "= arm.length"',
            "a =",
            "parameters.a: expected no parameter that depends on itself, got .*arm.length",
        ),
        (
            'a = "220 mm"',
            'a = "220 mmm"',
            "a =",
            'parameters.a: expected a quantity .*"mmm" is not a unit',
        ),
        (
            'a = "220 mm"',
            'lambda = 1\na = "220 mm"',
            "lambda",
            "parameters.lambda: expected a name that expressions",
        ),
        (
            'a = "220 mm"',
            'sin = 1\na = "220 mm"',
            "sin",
            "parameters.sin: expected another name",
        ),
        (
            'part = "arm"',
            'part = "arms"',
            "part",
            r'bodies."leg1.arm".part: expected a part \(arm, strut\), got "arms"; did you mean "arm"?',
        ),
        (
            'part = "arm"',
            'part = "arm"\nmass = 3',
            "mass = 3",
            'bodies."leg1.arm".mass: expected no mass of a body with a',
        ),
        (
            'part = "arm"\n',
            "",
            '[bodies."leg1.arm"]',
            'bodies."leg1.arm".part: expected a name, got nothing',
        ),
        (
            'tip = ["= 0.18 + a*cos(th)", 0, "= z"]',
            'tip = ["= 0.19 + a*cos(th)", 0, "= z"]',
            "tip",
            'bodies."leg1.arm".tip: expected a tip 220 mm from the base, as part arm is long, to 0.01%, got 229.1',
        ),
        (
            'tip = ["= 0.18 + a*cos(th)", 0, "= z"]',
            'tip = ["180 mm", 0, 0]',
            "tip",
            'bodies."leg1.arm".tip: expected a point away from the base',
        ),
        (
            'tip = ["= 0.18 + a*cos(th)", 0, "= z"]',
            'tip = ["3 kg", 0, "= z"]',
            "tip",
            r'bodies."leg1.arm".tip\[0\]: expected a length .*which is a mass',
        ),
        (
            'tip = ["= 0.18 + a*cos(th)", 0, "= z"]',
            'tip = ["= z", 0]',
            "tip",
            'bodies."leg1.arm".tip: expected three lengths',
        ),
        (
            'tip = ["50 mm", 0, "-0.5 m"]\ny = [0, 1, 0]',
            'tip = ["50 mm", 0, "-0.5 m"]\ny = [0, 0, 0]',
            "y = [0, 0, 0]",
            'bodies."leg1.rod".y: expected a direction such as .*length 0',
        ),
        (
            'tip = ["50 mm", 0, "-0.5 m"]\ny = [0, 1, 0]',
            'tip = ["1 m", 0, "= z"]\ny = [-2, 0, 0]',
            "y = [-2",
            'bodies."leg1.rod".y: expected a direction across the line from base to tip, got one along it',
        ),
        (
            'tip = ["50 mm", 0, "-0.5 m"]\ny = [0, 1, 0]',
            'tip = ["50 mm", 0, "-0.5 m"]',
            '[bodies."leg1.rod"]',
            'bodies."leg1.rod".y: expected a direction across a matrix part, .* got nothing',
        ),
        (
            '"ground", "leg1.arm.base"',
            '"ground", "leg1.arm.bass"',
            "between",
            r'joints."leg1.motor".between\[1\]: expected a body or an end of one .*; did you mean "leg1.arm.base"',
        ),
        (
            '"ground", "leg1.arm.base"',
            '"ground", "leg1.arm"',
            "between",
            r'joints."leg1.motor".between\[1\]: expected an end of the elastic body, "leg1.arm.base" or "leg1.arm.tip"',
        ),
        (
            '["leg1.rod.tip", "platform"]',
            '["leg1.rod.tip", "platform.base"]',
            'between = ["leg1.rod.tip"',
            r'joints."leg1.wrist".between\[1\]: expected "platform", which is rigid and has no ends, got "platform.base"',
        ),
        (
            '"ground", "leg1.arm.base"',
            '"leg1.arm.tip", "leg1.arm.base"',
            "between",
            "expected two bodies, got leg1",
        ),
        (
            '"ground", "leg1.arm.base"',
            '"ground"',
            "between",
            "expected two bodies or ends of bodies such as",
        ),
        (
            'type = "revolute"',
            'type = "hinge"',
            "type",
            r'joints."leg1.motor".type: expected a type \(fixed, revolute, .*planar\), got "hinge"',
        ),
        (
            "axis = [0, 2, 0]\n",
            "",
            '[joints."leg1.motor"]',
            'joints."leg1.motor".axis: expected three numbers .* got nothing',
        ),
        (
            "axis = [0, 2, 0]",
            "axis = [0, 0, 0]",
            "axis",
            'joints."leg1.motor".axis: expected a direction .*length 0',
        ),
        (
            "axis = [0, 2, 0]",
            "axis = [0, 2, 0]\naxis2 = [0, 0, 1]",
            "axis2",
            'joints."leg1.motor".axis2: expected a known',
        ),
        (
            "axis2 = [1, 0, -1]",
            "axis2 = [0, -3, 0]",
            "axis2",
            "axis2: expected a direction other than axis",
        ),
        (
            'stiffness = "24 kN*m/rad"',
            'stiffness = "24 N/um"',
            "drive",
            'joints."leg1.motor".drive.stiffness: expected a torsional stiffness .*, got "24 N/um", which is a',
        ),
        (
            'stiffness = "24 kN*m/rad"',
            'stiffness = "-24 kN*m/rad"',
            "drive",
            "must be greater than zero",
        ),
        (
            '"-60 deg", "80 deg"',
            '"80 deg", "-60 deg"',
            "drive",
            "drive.range: expected a lower and a higher value",
        ),
        (
            'type = "universal"',
            'type = "universal"\ndrive = {stiffness = 1}',
            "drive = {stiffness = 1}",
            r'joints."leg1.elbow".drive: expected a joint that a drive can move \(revolute, .*\), got a',
        ),
        (
            'axial = "0.02 um/N"',
            'axial = "0.02 N/um"',
            "compliance = {",
            "compliance.axial: expected a compliance",
        ),
        (
            '{ radial = "0.01 um/N", axial = "0.02 um/N", tilting = "1e-6 rad/(N*m)" }',
            "[0, 0, 0, 1e-6, 0, 0]",
            "compliance = [",
            r"compliance\[3\]: expected 0 along what the drive moves",
        ),
        (
            'of = "leg1"',
            'of = "leg"',
            "of",
            r'copies\[0\].of: expected a set .*leg1.*, got "leg"',
        ),
        (
            'as = ["leg2", "leg3"]',
            'as = ["leg2"]',
            "angles",
            r"copies\[0\].angles: expected an angle for each of 1 names",
        ),
        (
            'as = ["leg2", "leg3"]',
            'as = ["leg2", "platform"]',
            "as",
            r"copies\[0\].as\[1\]: expected a name that is new",
        ),
        (
            'as = ["leg2", "leg3"]',
            f"as = {[f'leg{k}' for k in range(2, 999)]}".replace("'", '"'),
            "as = ",
            r"copies\[0\].as: expected copies to a robot of at most 2,000 bodies and joints, got \d,",
        ),
        (
            '"24 kN*m/rad"',
            '"24 kN*m/rd ± 10 %"',
            "drive",
            'stiffness: expected a quantity with its tolerance .*: "24 kN.m/rd", and "kN.m/rd" is not a unit',
        ),
        (
            "angles = [",
            "angles = [120, 240] #",
            "angles",
            r"copies\[0\].angles\[0\]: expected an angle within a turn such as",
        ),
        (
            'as = ["leg2", "leg3"]\n',
            "",
            "[[copies]]",
            r"copies\[0\].as: expected names such as .*, got nothing",
        ),
        (
            'as = ["leg2", "leg3"]',
            'as = "leg2"',
            "as = ",
            r"copies\[0\].as: expected a list such as",
        ),
        (
            'centre = [0, 0, "-500 mm"]\n',
            "",
            "[bodies.platform]",
            "bodies.platform.centre: expected a point where the mass",
        ),
        (
            'mass = "600 g"\n',
            "",
            "[bodies.platform]",
            "bodies.platform.mass: expected a mass above 0 kg beside an inertia",
        ),
        (
            "inertia = [1e-3,",
            "inertia = [-1e-3,",
            "inertia",
            "bodies.platform.inertia: expected no negative principal",
        ),
        (
            "3e-3, 1e-4, 0, 0]",
            "9e-3, 0, 0, 0]",
            "inertia",
            "bodies.platform.inertia: expected principal moments of which none exceeds the sum of the others, got 0.001",
        ),
        (
            'mass = "80 g"',
            f"error = [{', '.join(['[-1e-9, 0, 0, 0, 0, 0]'] * 6)}]",
            "error",
            "parts.strut.error: expected bounds of at least 0, got -1e-09",
        ),
        (
            'mass = "80 g"',
            f"error = [{', '.join(['[1e-9, 0, 0, 0, 0, 0]'] * 6)}]",
            "error",
            "parts.strut.error: expected symmetric bounds, got .* entries 12 and 21",
        ),
        (
            'a = "220 mm"',
            'a = "220 mm"\n"\u00b5" = 1\n"\u03bc" = 2',
            '"\u03bc"',
            "expected a name of its own, got .*, one letter with",
        ),
        (
            'name = "delta"',
            'name = "de\\u001b[31m"',
            "name",
            "name: expected a name in quotes, one printable line",
        ),
        (
            'length = "= a"',
            'length = nan\nbore = "= arm.length"',
            "length",
            "parts.arm.length: expected a length .*, got nan",
        ),
        (
            'length = "= a"',
            'length = "5 kg"\nbore = "= sqrt(0.1 - arm.length)"',
            "length",
            'parts.arm.length: expected a length .*, got "5 kg"',
        ),
        (
            'length = "= a"',
            'length = [1]\nbore = "= arm.length"',
            "length",
            "parts.arm.length: expected a length ",
        ),
        (
            "inertia = [1e-3, ",
            "inertia = [",
            "inertia",
            "bodies.platform.inertia: expected six moments of inertia",
        ),
        (
            "[bodies.platform]",
            "[bodies.loose]\n[bodies.platform]",
            "[bodies.loose]",
            "bodies.loose: expected joints that connect it with the ground, got none",
        ),
        (
            "[bodies.platform]",
            "[bodies.ground]\n[bodies.platform]",
            "[bodies.ground]",
            "bodies.ground: expected a name",
        ),
        (
            '["leg1.arm", "leg2.arm", "leg3.arm"]',
            '["leg1.arm", "leg4.arm"]',
            "arms",
            r'groups.arms\[1\]: expected a body, a joint or a group .*got "leg4.arm"; did you mean "leg',
        ),
        (
            "[bodies.platform]",
            '[bodies."leg1.arm.tip"]\n[bodies.platform]',
            '[bodies."leg1.arm.tip"]',
            'bodies."leg1.arm.tip": expected another name, got .*, which is an end of the elastic body "leg1.arm"',
        ),
        (
            "[bodies.platform]",
            '[bodies.platform]\nmesh = "no.stl"',
            "mesh",
            "bodies.platform.mesh: expected a file for pictures, got none at .*no.stl",
        ),
        (
            "[bodies.platform]",
            '[bodies.platform]\nmesh = "/etc/passwd"',
            "mesh",
            r"bodies.platform.mesh: expected a file for pictures \(.stl, .*\), got",
        ),
        (
            'home = [0, 0, "-500 mm"]',
            '"a/b" = [0, 0, "-500 mm"]',
            '"a/b"',
            'poses."a/b": expected a name that a file of results can have, got "a/b"',
        ),
        (
            'pose = ["x", "y", "z"]',
            "pose = []",
            "home",
            "poses.home: expected a pose of 0, as tool.pose has none, got",
        ),
        (
            '["arms", "leg1.motor"]',
            '["all2"]\nall2 = ["all"]',
            "all =",
            "groups.all: expected no group within itself, got",
        ),
        (
            "[groups]",
            "[groups]\n"
            + "\n".join(f'g{k} = ["g{k + 1}"]' for k in range(40))
            + "\ng40 = []",
            "g0 =",
            "groups.g0: expected at most 30 groups within each other, got more",
        ),
        (
            "arms = [",
            "platform = [",
            "platform = [",
            "groups.platform: expected a name that no body or joint has",
        ),
        (
            'body = "platform"',
            'body = "plat"',
            "body",
            'tool.body: expected a body or an end of one .*got "plat"',
        ),
        (
            'body = "platform"',
            'body = "ground"',
            "body",
            "tool.body: expected a body or an end of one",
        ),
        (
            'pose = ["x", "y", "z"]\n',
            "",
            "[tool]",
            "tool.pose: expected coordinates such as .*, got nothing",
        ),
        (
            'pose = ["x", "y", "z"]',
            'pose = ["x", "y", "w"]',
            "pose",
            r"tool.pose\[2\]: expected .x., .y., .z., .*got \"w\"",
        ),
        (
            'pose = ["x", "y", "z"]',
            'pose = ["x", "y", "x"]',
            "pose",
            "tool.pose: expected each of x y z rx ry rz at most",
        ),
        (
            '[tool]\nbody = "platform"\nat = [0, 0, "-500 mm"]\npose = ["x", "y", "z"]\n',
            "",
            "name",
            "tool: expected a table of body, at, pose, got nothing",
        ),
        (
            "direction = [0, 0, -2]\n",
            "",
            "[gravity]",
            "gravity.direction: expected three numbers such as .* got nothing",
        ),
        (
            'home = [0, 0, "-500 mm"]',
            "home = [0, 0]",
            "home",
            "poses.home: expected a pose of 3, x y z, got",
        ),
        (
            'home = [0, 0, "-500 mm"]',
            'home = [0, 0, "5 deg"]',
            "home",
            r"poses.home\[2\]: expected a length",
        ),
        (
            'z = ["-600 mm", "-400 mm"]',
            "",
            "[map]",
            "map: expected two .* to sweep, got x",
        ),
        (
            'z = ["-600 mm", "-400 mm"]',
            "rz = [0, 1]",
            "rz",
            r"map.rz: expected coordinates of the pose \(x y z\), got rz",
        ),
        (
            "arms =",
            '"ar\\u001bms" =',
            '"ar',
            r"expected a name of printable characters, got .ar",
        ),
        (
            "[groups]",
            "[grupps]",
            "[grupps]",
            'grupps: expected a known key .*, got "grupps"; did you mean "groups"?',
        ),
        (
            "[groups]",
            "[materials.mine]\nyoungs_modulus = 1e9\n[groups]",
            "[materials.mine]",
            "materials.mine.shear_modulus: expected an elastic modulus",
        ),
        (
            "[groups]",
            "[materials.mine]\nyoungs_modulus = 4e9\nshear_modulus = 1e9\ndensity = 1\n[groups]",
            "shear_modulus",
            "materials.mine.shear_modulus: expected more than .*Poisson",
        ),
        ("[groups]", "[groups", "[groups", r'expected valid TOML, got "\[groups" '),
    ],
)
def test_refusals_name_line_field_and_what_is_valid(
    read, tmp_path, old, new, at, message
):
    assert old in TEXT
    text = TEXT.replace(old, new, 1)
    with pytest.raises(InputError, match=message) as refused:
        read(text)
    first, *more = str(refused.value).splitlines()
    assert not more
    assert first.startswith(f"{tmp_path / 'robot.toml'}:{line_with(at, text)}: "), first
    assert ": expected " in first
    assert ", got " in first


def test_an_error_of_a_copy_names_the_line_of_what_is_copied(read, tmp_path):
    text = TEXT.replace(
        '"leg1.rod.tip", "platform"', '"leg1.rod.tip", "leg2.rod.tip"', 1
    )
    with pytest.raises(
        InputError, match=r'joints."leg2.wrist".between: expected two bodies'
    ) as refused:
        read(text)
    line = line_with('between = ["leg1.rod.tip"', text)
    assert str(refused.value).startswith(f"{tmp_path / 'robot.toml'}:{line}: ")


def test_a_wrong_value_of_a_part_is_blamed_and_not_the_expression_that_uses_it(
    read, tmp_path
):
    text = TEXT.replace('a = "220 mm"', 'a = "= 15*arm.radius"', 1).replace(
        '"15 mm"', '"15 mm*9"', 1
    )
    with pytest.raises(
        InputError, match=r'parts.arm.radius: expected a length .*, got "15 mm\*9"'
    ) as refused:
        read(text)
    assert str(refused.value).startswith(
        f"{tmp_path / 'robot.toml'}:{line_with('radius', text)}: "
    )


def test_set_reaches_parts_parameters_joints_bodies_and_copies(read):
    robot = read(
        TEXT,
        "arm.radius=20 mm",
        "parameters.th=30 deg",
        "leg1.motor.drive.stiffness=2e4",
        "platform.mass=1 kg",
        "leg2.motor.drive.stiffness=1 kN*m/rad",
        "parts.arm.mesh.size=6mm",
        "poses.P=[0.1, 0, -0.5]",
        "gravity.acceleration=1.62",
        'bodies."leg3.rod".y=[0, 1, 1]',
        "strut.mass= = 2.0*a",
        "map.x=[0, 0.1]",
    )
    assert robot.parts["arm"].parameters().lengths()["radius"] == 0.02
    assert robot.bodies["leg1.arm"].tip[2] == pytest.approx(-0.11)
    stiffness = [robot.joints[f"leg{i}.motor"].drive.stiffness for i in (1, 2, 3)]
    assert stiffness == [
        2e4,
        1e3,
        2e4,
    ]  # a copy follows what it is a copy of, unless it is named itself
    assert robot.bodies["platform"].mass == 1.0
    assert robot.parts["arm"].mesh.size == pytest.approx(0.006)
    assert robot.poses["P"] == (0.1, 0, -0.5)
    assert robot.gravity.acceleration == 1.62
    assert robot.bodies["leg3.rod"].y == (0, 1, 1)
    assert robot.parts["strut"].mass == pytest.approx(0.44)
    assert read(TEXT, tolerance="0.1 %").parts["arm"].mesh.tolerance == pytest.approx(
        1e-3
    )


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "arm.radios=3mm",
            '^--set arm.radios=3mm: parts.arm.radios: expected a known key .* did you mean "radius"',
        ),
        (
            "arm.radius=3kg",
            "^--set arm.radius=3kg: parts.arm.radius: expected a length .* which is a mass",
        ),
        ("arm.bore=60mm", "^--set arm.bore=60mm: parts.arm.bore: expected a diameter"),
        ("arm.radius", "^--set arm.radius: expected NAME.KEY=VALUE such as"),
        ("arm=3", "^--set arm=3: expected NAME.KEY=VALUE"),
        (
            "amr.radius=3",
            r'^--set amr.radius=3: expected NAME.KEY=VALUE with a NAME of arm, .*; did you mean "arm"',
        ),
        ("arm.radius.x=3", "^--set arm.radius.x=3: expected a key of a table"),
        (
            "leg2.motor.axis=[0,0,0]",
            r'^--set leg2.motor.axis=\[0,0,0\]: joints."leg2.motor".axis: expected a direction',
        ),
        (
            "leg2.motor.drive.range=3",
            '^--set .*: joints."leg2.motor".drive.range: expected two angles',
        ),
        (
            "parameters.thh=30 deg",
            r'^--set .*: expected a parameter of the file .*, got "thh"; did you mean "th"',
        ),
        (
            "parameters.th=nix",
            "^--set parameters.th=nix: parameters.th: expected a quantity",
        ),
        (
            "arm.length=230mm",
            r'robot.toml:\d+: bodies."leg1.arm".tip: expected .* \(with --set arm.length=230mm\)$',
        ),
        (
            "arm.fitting_radius=9mm",
            r"robot.toml:8: .*fitting_length: .* \(with --set arm.fitting_radius=9mm\)$",
        ),
    ],
)
def test_set_is_checked_alike(read, override, message):
    with pytest.raises(InputError, match=message) as refused:
        read(TEXT, override)
    assert "\n" not in str(refused.value)


def test_robots_that_come_with_it_close_move_as_posed_and_are_held_by_their_drives():
    names = robot_names()
    assert set(names) >= {
        "biglide",
        "delta",
        "stewart",
        "orthoglide",
        "serial-arm",
        "five-bar",
    }
    for name, line in names.items():
        assert line.split(":")[0].lower().replace(" ", "-") == name
        robot = load_robot(name)
        free, held = (at_home.motions(robot, driven=driven) for driven in (False, True))
        rows = [AXES.index(coordinate) for coordinate in robot.tool.pose]
        assert (free.shape[1], held.shape[1]) == (len(rows), 0), name
        assert np.linalg.svd(free[rows])[1].min() > 0.05, name
        assert len(robot.drives()) == len(rows), name
        assert robot.gravity is not None
        assert robot.poses


def test_biglide_has_tables_1_to_4_of_the_paper():
    robot = load_robot("biglide")
    given = {
        key: robot.parameters[key]
        for key in ("l", "l1", "l2", "h", "d", "a_min", "a_max", "K_ac")
    }
    expected = {
        "l": 0.075,
        "l1": 0.04,
        "l2": 0.015,
        "h": 0.0175,
        "d": 0.07,
        "a_min": 0.2,
        "a_max": 0.55,
        "K_ac": 1.27e7,
    }
    assert given == pytest.approx(expected)
    assert robot.parts["link"].dimensions() == pytest.approx(
        {
            "length": 0.5,
            "radius": 0.0125,
            "bore": 0,
            "fitting_radius": 0,
            "fitting_length": 0,
        }
    )
    assert [
        robot.parts["slider"].parameters().lengths()[key]
        for key in ("depth", "width", "thickness")
    ] == [0.085, 0.32, 0.02]
    assert (robot.parts["link"].mass, robot.bodies["platform"].mass) == (1.95, 7.93)
    steel = robot.material("link")
    assert (steel.youngs_modulus, steel.shear_modulus) == (211e9, 81e9)
    assert needed_experiments(robot) == ("link", "slider")
    assert needed_experiments(robot, "published") == ()


def test_biglide_at_36_degrees_is_the_method_s_row():
    """The method's table: K at M for x = y = 0 with Euler-Bernoulli links and Eq. (29)."""
    robot = load_robot("biglide", ["parameters.q=36 deg"])
    matrices = {
        name: part.compliance
        for name, part in part_matrices(robot, "published").items()
    }
    k = np.linalg.inv(at_home.compliance(robot, matrices)) * 1e-6
    expected = [23.82111, 1.96743, 12.574307, 1.464912, 0.141031, 2.819319]
    np.testing.assert_allclose(np.diag(k), expected, rtol=5e-6)
    assert (k[0, 4], k[1, 3]) == pytest.approx((0.922902, 0.325959), rel=5e-6)
    off = np.abs(np.delete(k.ravel(), [0, 7, 14, 21, 28, 35, 4, 24, 9, 19]))
    assert off.max() < 1e-6


def test_stewart_at_the_cube_s_centre_is_the_closed_form():
    """Struts of stiffness k along edges of length H, H/√2 from the centre: diag(2, 2, 2, H²/2, H²/2, 2 H²) k."""
    robot = load_robot("stewart")
    height = robot.parameters["z_2"]  # of the cube's centre
    centred = load_robot(
        "stewart",
        [f"tool.at=[0, 0, {height!r}]", f"poses.home=[0, 0, {height!r}, 0, 0, 0]"],
    )
    matrices = {name: part.compliance for name, part in part_matrices(centred).items()}
    area = np.pi * (0.025**2 - 0.015**2), np.pi * 0.010**2
    strut = 1 / (1 / 40e6 + sum(0.16 / (211e9 * each) for each in area))
    expected = strut * np.diag([2, 2, 2, 0.5 * 0.4**2, 0.5 * 0.4**2, 2 * 0.4**2])
    np.testing.assert_allclose(
        np.linalg.inv(at_home.compliance(centred, matrices)),
        expected,
        rtol=1e-7,
        atol=strut * 1e-7,
    )


def test_a_robot_is_found_and_copied_by_name(tmp_path, monkeypatch):
    assert (
        copy_robot("delta", tmp_path / "my.toml").read_text()
        == find_robot("delta").read_text()
    )
    assert load_robot(tmp_path / "my.toml").name == "delta"
    with pytest.raises(InputError, match="expected a file that is not there yet"):
        copy_robot("delta", tmp_path / "my.toml")
    with pytest.raises(InputError, match='got no file; did you mean "delta"'):
        find_robot("detla")
    with pytest.raises(InputError, match=r'got no file; did you mean ".*my\.toml"'):
        find_robot(tmp_path / "my.tml")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "delta").write_text("here")
    assert find_robot("delta").read_text() == "here"


def test_files_that_cannot_be_robots(tmp_path):
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "empty.toml").write_text("")
    (tmp_path / "deep.toml").write_text("a = " + "[" * 5000 + "]" * 5000)
    for name, message in [
        ("binary", "UTF-8"),
        ("empty", "tool: expected a table"),
        ("deep", "nested too deeply|known key"),
    ]:
        with pytest.raises(InputError, match=message):
            load_robot(tmp_path / f"{name}.toml")


@pytest.mark.parametrize(
    ("robot", "override", "unit"),
    [
        ("biglide", "slider.thickness=16", "16 mm"),
        ("delta", "leg1.motor.drive.stiffness=30", "30 kN*m/rad"),
        ("delta", "leg2.motor.drive.stiffness=30", "30 kN*m/rad"),
    ],
)
def test_a_typed_bare_number_is_refused_where_the_file_states_a_unit(
    robot, override, unit
):
    with pytest.raises(InputError, match=re.escape(f"such as {unit}")):
        load_robot(robot, [TypedOverride(override)])
    with_unit = override.partition("=")[0] + "=" + unit
    load_robot(robot, [with_unit])

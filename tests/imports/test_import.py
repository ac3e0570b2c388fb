"""URDF and MJCF become robot files: geometry, masses, joints and closures, and nothing of a simulator's dynamics."""

import re
import sys
from itertools import product

import numpy as np
import pytest

from stiffscope.cli.main import _guarded
from stiffscope.errors import InputError
from stiffscope.imports.compiled_model import compile_at_home
from stiffscope.imports.import_model import import_model
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.statics.analysis import analyse
from tests.robot import at_home

pytest.importorskip("mujoco")

FOUR_BAR = """<mujoco model="four bar">
  <compiler angle="degree"/>
  <option gravity="0 -3 -4"/>
  <default><joint damping="7" stiffness="11" type="hinge" axis="0 1 0"/><equality solref="0.02 1"/></default>
  <asset><mesh name="lost" file="lost.stl"/></asset>
  <worldbody>
    <body name="frame" pos="0 0 1">
      <body name="crank" pos="0 0 0">
        <joint name="motor" range="-30 50"/>
        <inertial pos="0 0 0.1" mass="2" diaginertia="0.02 0.03 0.01"/>
        <geom type="mesh" mesh="lost"/>
        <body name="flange" pos="0 0 0.2" euler="0 0 90">
          <inertial pos="0.1 0 0" mass="1" diaginertia="0.001 0.002 0.003"/>
        </body>
        <body name="coupler" pos="0 0 0.2">
          <joint name="elbow"/>
          <inertial pos="0.2 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
          <site name="tcp" pos="0.5 0 0.1"/>
        </body>
      </body>
      <body name="rocker" pos="0.4 0 0">
        <joint name="pivot"/>
        <inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/>
      </body>
    </body>
  </worldbody>
  <equality>
    <connect name="pin" body1="coupler" body2="rocker" anchor="0.4 0.05 0"/>
    <connect body1="coupler" body2="rocker" anchor="0.4 -0.05 0"/>
    <connect body1="coupler" body2="rocker" anchor="0.4 0 0" active="false"/>
    <joint joint1="motor" joint2="pivot"/>
  </equality>
  <actuator><position name="servo" joint="motor" kp="1234"/></actuator>
</mujoco>
"""

ARM = """<robot name="arm">
  <link name="base_link"/>
  <link name="upper">
    <inertial><origin xyz="0.1 0 0"/><mass value="2"/>
      <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://nowhere/upper.dae"/></geometry></visual>
  </link>
  <link name="plate">
    <inertial><origin xyz="0 0.3 0"/><mass value="1"/>
      <inertia ixx="0.004" iyy="0.003" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="carriage">
    <inertial><mass value="0.5"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base_link"/><child link="upper"/><origin xyz="0 0 0.5" rpy="0 0 1.5707963267948966"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="2" effort="10" velocity="1"/><dynamics damping="99"/>
  </joint>
  <joint name="weld" type="fixed">
    <parent link="upper"/><child link="plate"/><origin xyz="0.2 0 0" rpy="0 0 3.141592653589793"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="plate"/><child link="carriage"/><origin xyz="0.1 0 0"/><axis xyz="1 0 0"/>
    <limit lower="-0.1" upper="0.2" effort="10" velocity="1"/>
  </joint>
</robot>
"""


@pytest.fixture
def imported(tmp_path):
    def from_text(text, suffix, path="robot.toml", **options):
        (tmp_path / f"model{suffix}").write_text(text, encoding="utf-8")
        model = import_model(tmp_path / f"model{suffix}", tmp_path / path, **options)
        return model, load_robot(tmp_path / path), (tmp_path / path).read_text()

    return from_text


def test_a_four_bar_with_two_connects_on_a_line(imported):
    model, robot, text = imported(FOUR_BAR, ".xml", drives=["motor=5 kN*m/rad"])
    assert robot.name == "four bar"
    pin = robot.joints["pin"]
    assert (pin.type, pin.between) == ("revolute", ("coupler", "rocker"))
    assert np.abs(pin.axis) == pytest.approx([0, 1, 0])
    assert np.cross(np.subtract(pin.at, (0.4, 0, 1.2)), pin.axis) == pytest.approx(
        [0, 0, 0]
    )
    assert robot.joints["motor"].between == (
        "ground",
        "crank",
    )  # a body without joints is part of the ground
    assert (
        robot.joints["motor"].drive.stiffness,
        *robot.joints["motor"].drive.range,
    ) == pytest.approx((5e3, *np.radians([-30, 50])))
    assert robot.tool.at == pytest.approx((0.5, 0, 1.3))
    assert robot.tool.pose == ("x",)
    assert mechanism_of(robot, {}).gravity == pytest.approx([0, -3, -4])
    assert at_home.motions(robot, driven=False).shape[1] == 1
    assert at_home.motions(robot, driven=True).shape[1] == 0
    told = " ".join(model.notes)
    assert "without its meshes" in told
    assert "not active" in told
    assert "couples the coordinates of joints motor and pivot (mimic)" in told
    assert "stiffness and damping of motor, elbow, pivot are not taken" in told
    assert 'actuator "servo"' in text
    assert "# the source has stiffness 11, damping 7 here (SI), not taken" in text
    for number in ("1234", "11 ", "7 ", "0.02 1"):  # gains, springs, damping, solver
        assert number not in " ".join(
            line for line in text.splitlines() if not line.startswith("#")
        )


def test_what_is_welded_is_weighed_together(imported):
    _, robot, _ = imported(
        FOUR_BAR.replace('-4"/>', '-4"><flag equality="disable"/></option>'), ".xml"
    )
    assert robot.tool.pose == ("x",)  # the loop is closed, whatever a simulation does
    crank = robot.bodies["crank"]
    assert crank.mass == 3.0
    assert crank.centre == pytest.approx(
        ((0 + 0) / 3, 0.1 / 3, 1 + (2 * 0.1 + 0.2) / 3)
    )
    # about the common centre: 2 kg at (0, 0, 0.1) and 1 kg at (0, 0.1, 0.2), the latter's own x and y exchanged
    r = np.array([[0, 0, 0.1], [0, 0.1, 0.2]]) - np.array([0, 0.1 / 3, 0.4 / 3])
    own = np.diag([0.02, 0.03, 0.01]) + np.diag([0.002, 0.001, 0.003])
    expected = own + sum(
        m * (each @ each * np.eye(3) - np.outer(each, each))
        for m, each in zip((2, 1), r, strict=True)
    )
    xx, yy, zz, xy, xz, yz = crank.inertia
    np.testing.assert_allclose(
        [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], expected, atol=1e-15
    )


def test_a_link_with_shapes_alone_has_no_mass(imported):
    """MuJoCo would give it that of water."""
    own = re.search(r"(?s)<inertial>.*?</inertial>", ARM)[0]
    shape = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    model, robot, _ = imported(ARM.replace(own, shape), ".urdf")
    assert robot.bodies["upper"].mass == 1.0  # of the plate alone
    model, robot, _ = imported(
        ARM.replace(own, shape).replace('"fixed"', '"continuous"'),
        ".urdf",
        path="other.toml",
    )
    assert robot.bodies["upper"].mass == 0.0
    assert "the source gives no mass of upper" in model.notes


def test_an_arm_in_urdf(imported):
    model, robot, text = imported(ARM, ".urdf", drives=["slide=2e7"], tool="carriage")
    assert list(robot.bodies) == ["upper", "carriage"]
    assert (
        robot.bodies["upper"].mass == 3.0
    )  # with the plate: (0.1, 0, 0) and (0.2, -0.3, 0), turned by 90 degrees
    assert robot.bodies["upper"].centre == pytest.approx(
        (0.3 / 3, (2 * 0.1 + 0.2) / 3, 0.5)
    )
    assert robot.joints["slide"].axis == pytest.approx((0, -1, 0), abs=1e-12)
    assert robot.joints["slide"].drive.range == pytest.approx((-0.1, 0.2))
    assert robot.joints["shoulder"].drive is None
    assert robot.tool.at == pytest.approx((0, 0.1, 0.5), abs=1e-12)
    assert robot.gravity.direction == pytest.approx((0, 0, -1))
    assert "range = [-1, 2]" in text
    assert '"... N*m/rad"' in text
    assert any("meshes" in note for note in model.notes) or "package" not in text


def test_a_mimic_joint_is_told_and_moves_freely(imported):
    mimic = ARM.replace(
        '<limit lower="-0.1"',
        '<mimic joint="shoulder" multiplier="0.5"/><limit lower="-0.1"',
    )
    model, robot, _ = imported(mimic, ".urdf")
    assert any("joints slide and shoulder (mimic)" in note for note in model.notes)
    assert robot.tool.body == "carriage"
    assert len(robot.tool.pose) == at_home.motions(robot, driven=False).shape[1] == 2


@pytest.mark.parametrize(("home", "lead"), [((), 0.1), (("shoulder=0.3",), 0.3)])
def test_a_mimic_joint_follows_and_leaves_its_leader_where_it_is(imported, home, lead):
    """The shoulder is at its lower limit or where it is told; the slide at 0.5 of it + 0.02 m."""
    mimic = ARM.replace('lower="-1" upper="2"', 'lower="0.1" upper="2"').replace(
        '<limit lower="-0.1"',
        '<mimic joint="shoulder" multiplier="0.5" offset="0.02"/><limit lower="-0.1"',
    )
    drives = ["shoulder=1 N*m/rad", "slide=1 N/m"]
    _, robot, _ = imported(mimic, ".urdf", drives=drives, home=home)
    slide = 0.5 * lead + 0.02
    lowest, highest = robot.joints["shoulder"].drive.range
    assert (lowest, highest) == pytest.approx((0.1 - lead, 2.0 - lead))
    assert robot.joints["slide"].drive.range == pytest.approx(
        (-0.1 - slide, 0.2 - slide)
    )


def test_the_home_of_a_mimic_joint_moves_its_leader(imported):
    """The slide at 0.12 m = 0.5 of the shoulder + 0.02 m: the shoulder at 0.2 rad."""
    mimic = ARM.replace(
        '<limit lower="-0.1"',
        '<mimic joint="shoulder" multiplier="0.5" offset="0.02"/><limit lower="-0.1"',
    )
    drives = ["shoulder=1 N*m/rad", "slide=1 N/m"]
    model, robot, _ = imported(mimic, ".urdf", drives=drives, home=("slide=0.12",))
    assert robot.joints["slide"].drive.range == pytest.approx((-0.22, 0.08))
    assert robot.joints["shoulder"].drive.range == pytest.approx((-1.2, 1.8))
    assert not any("instead of" in note for note in model.notes)


def test_a_home_that_couplings_do_not_allow_is_told(imported):
    mimic = ARM.replace(
        '<limit lower="-0.1"',
        '<mimic joint="shoulder" multiplier="0.5"/><limit lower="-0.1"',
    )
    both = ("slide=0.1", "shoulder=0.1")
    model, _, _ = imported(mimic, ".urdf", home=both)
    (note,) = (note for note in model.notes if "instead of" in note)
    assert "slide at 0.06 instead of 0.1" in note
    assert "shoulder at 0.12 instead of 0.1" in note


@pytest.mark.parametrize(
    ("text", "suffix", "note"),
    [
        (
            ARM.replace('lower="-1" upper="2"', 'lower="2" upper="-1"'),
            ".urdf",
            "limits of shoulder are left out: the lower is above the upper",
        ),
        (
            ARM.replace('lower="-1" upper="2"', 'lower="1" upper="2"'),
            ".urdf",
            "home of shoulder is beyond its range",
        ),
        (
            ARM.replace('<origin xyz="0.1 0 0"/><axis', '<origin xyz="100 0 0"/><axis'),
            ".urdf",
            "m from the origin: check that lengths",
        ),
        (
            ARM.replace('rpy="0 0 1.57', 'rpy="0 0 90.0'),
            ".urdf",
            'line 16: origin.rpy = "0 0 90.007963267948966" is beyond 2π rad: is it in degrees?',
        ),
        (
            ARM.replace('lower="-1" upper="2"', 'lower="-90" upper="2"'),
            ".urdf",
            'line 17: limit.lower = "-90" is beyond 2π rad: is it in degrees?',
        ),
        (
            ARM.replace(
                '<limit lower="-0.1"', '<mimic joint="slide"/><limit lower="-0.1"'
            ),
            ".urdf",
            "line 24: joint slide mimics itself, which is left out",
        ),
        (
            ARM.replace(
                'ixx="0.01" iyy="0.02" izz="0.02"', 'ixx="100" iyy="200" izz="200"'
            ),
            ".urdf",
            "the inertia of upper is that of a body far larger than the robot (0.167 m): check that it is in kg·m²",
        ),
        (
            FOUR_BAR.replace('"crank"', '"crank" gravcomp="1"'),
            ".xml",
            "gravity compensation (gravcomp) of crank is left out: the whole weight acts here",
        ),
        (
            FOUR_BAR.replace('-4"/>', '-4"><flag gravity="disable"/></option>'),
            ".xml",
            "the source disables gravity; it acts here",
        ),
        (
            FOUR_BAR.replace('kp="1234"', 'kp="-5"'),
            ".xml",
            "position gains (kp) of motor are below zero and left out",
        ),
    ],
)
def test_doubtful_numbers_are_told(imported, text, suffix, note):
    model, robot, _ = imported(text, suffix)
    assert note in " ".join(model.notes)
    assert len(robot.joints) >= 2


def test_usual_numbers_are_not_doubted(imported):
    endless = ARM.replace('"revolute"', '"continuous"').replace(
        'lower="-1" upper="2" effort="10"', 'effort="inf"'
    )
    model, *_ = imported(
        endless.replace('rpy="0 0 1.57', 'rpy="6.2832 0 1.57'), ".urdf"
    )
    assert not any(
        "2π" in note or "inertia" in note or "gravity" in note for note in model.notes
    )


def test_gains_and_masses_that_are_not_taken_are_told(imported):
    fixed = (
        '<mass value="7"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    )
    model, _, text = imported(
        ARM.replace(
            '<link name="base_link"/>',
            f'<link name="base_link"><inertial>{fixed}</inertial></link>',
        ),
        ".urdf",
    )
    assert "bodies fixed to the ground have no mass here: base_link 7 kg" in model.notes
    _, robot, text = imported(
        FOUR_BAR.replace("<joint name", '<joint armature="0.3" name'),
        ".xml",
        path="servo.toml",
    )
    assert '# drive = { stiffness = "1234 N*m/rad"' in text
    assert "armature 0.3" in text
    assert robot.joints["motor"].drive is None


def test_a_name_cannot_write_into_the_robot_file(imported):
    evil = "up&#10;per = 3&#10;[x]&#27;"
    _, robot, text = imported(
        ARM.replace('"upper"', f'"{evil}"').replace('"shoulder"', f'"{evil}"'), ".urdf"
    )
    assert set(robot.bodies) == {"up_per = 3_[x]_", "carriage"}
    assert "\x1b" not in text


def test_another_home(imported):
    _, robot, _ = imported(
        ARM.replace('lower="-1"', 'lower="-2"'),
        ".urdf",
        drives=["slide=2e7"],
        tool="carriage",
        home=["slide=50 mm", "shoulder=-90 deg"],
    )
    assert robot.tool.at == pytest.approx((0.05, 0, 0.5), abs=1e-12)
    assert robot.joints["slide"].drive.range == pytest.approx((-0.15, 0.15))


def test_a_platform_that_hangs_on_closures_and_two_hinges_of_one_body(imported):
    legs = "".join(
        f'<body name="leg{i}" pos="{x} {y} 0"><joint axis="1 0 0"/><joint axis="0 1 0"/>'
        '<geom size=".01 .1" type="capsule"/></body>'
        for i, (x, y) in enumerate(((0, 0), (1, 0), (0, 1)))
    )
    ties = "".join(
        f'<connect body1="leg{i}" body2="top" anchor="0 0 1"/>' for i in range(3)
    )
    text = (
        f'<mujoco><worldbody>{legs}<body name="top" pos="0 0 1"><freejoint/><geom size=".1"/></body></worldbody>'
        f"<equality>{ties}</equality></mujoco>"
    )
    _, robot, _ = imported(text, ".xml", tool="top")
    assert {joint.type for joint in robot.joints.values()} == {"universal", "spherical"}
    assert set(robot.bodies) == {"leg0", "leg1", "leg2", "top"}
    assert robot.tool.pose[:2] == ("x", "y")
    assert at_home.motions(robot, driven=False).shape[1] == len(robot.tool.pose) == 3


PAN_TILT = """<mujoco><worldbody><body name="head">
  <joint name="pan" axis="0 0 1"/><joint name="tilt" axis="0 1 0"/><geom size=".1" pos=".1 0 .2"/>
</body></worldbody></mujoco>"""


def test_hinges_of_one_body_that_cross_are_merged_and_told(imported):
    model, robot, _ = imported(PAN_TILT, ".xml")
    assert {name: joint.type for name, joint in robot.joints.items()} == {
        "pan": "universal"
    }
    assert (
        "pan and tilt of head are one universal joint here, pan; name one with --drive to have two"
        in model.notes
    )


@pytest.mark.parametrize(
    ("drives", "ranged"),
    [(["pan=1e4", "tilt=1e4"], ""), (["t*=1e4"], ""), ([], "pan"), ([], "tilt")],
)
def test_hinges_that_a_drive_or_range_names_stay_two(imported, drives, ranged):
    text = PAN_TILT.replace(f'"{ranged}"', f'"{ranged}" range="-30 50"')
    model, robot, text = imported(text, ".xml", drives=drives)
    assert [joint.type for joint in robot.joints.values()] == ["revolute", "revolute"]
    assert robot.joints["pan"].between[1] == robot.joints["tilt"].between[0]
    assert (robot.joints["tilt"].drive is not None) == bool(drives)
    assert ("range = [-0.523598775598299, 0.872664625997165]" in text) == bool(ranged)
    assert not any("universal" in note for note in model.notes)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (
            FOUR_BAR.replace('mass="2"', 'mass="-2"'),
            {},
            'model.xml:8: expected no mass below zero, got -2 kg of body "crank"',
        ),
        (
            "\n<mujoco>",
            {},
            "model.xml:2: expected a model in URDF or MJCF, or an assembly in a .step file, got: ",
        ),
        (
            "",
            {},
            "model.xml: expected a model in URDF or MJCF, or an assembly in a .step file, got: ",
        ),
        (
            FOUR_BAR,
            {"drives": ["moter=1"]},
            r'--drive moter=1: expected a joint .*did you mean "motor"',
        ),
        (FOUR_BAR, {"drives": ["motor"]}, "--drive motor: expected JOINT=STIFFNESS"),
        (
            FOUR_BAR,
            {"drives": ["motor=3 N/um"]},
            "--drive motor=3 N/um: expected a torsional stiffness",
        ),
        (
            FOUR_BAR,
            {"tool": "hand"},
            r'--tool hand: expected a body or site of .*tcp.*, got "hand"',
        ),
        (FOUR_BAR, {"tool": "frame"}, "expected a tool that moves, got frame"),
        (FOUR_BAR, {"home": ["motor"]}, "--home motor: expected JOINT=POSITION"),
        (FOUR_BAR, {"home": ["moter=1"]}, "--home moter: expected a joint"),
        (
            FOUR_BAR,
            {"home": ["motor=0.1", "motor=0.2"]},
            "--home motor=0.2: expected each joint once, got motor twice",
        ),
        (
            FOUR_BAR,
            {"home": ["motor=30 mm"]},
            "--home motor: expected an angle such as .*, which is a length",
        ),
        (
            FOUR_BAR.replace(
                "</mujoco>",
                '<keyframe><key name="home" qpos="nan 0 0"/></keyframe></mujoco>',
            ),
            {},
            "model.xml: expected .* whose home is finite numbers",
        ),
        (
            FOUR_BAR.replace(
                "</equality>", '<connect body1="rocker" anchor="0 0 0.2"/></equality>'
            ),
            {},
            "expected a tool that moves, got one that joints and loops hold",
        ),
        (
            FOUR_BAR,
            {"home": ["motor=70 deg"]},
            "--home motor: expected a position within its range, -0.5236 to 0.8727",
        ),
        (
            FOUR_BAR,
            {"drives": ["m*=1", "motor=2"]},
            "--drive motor=2: expected one stiffness of each joint, got two",
        ),
        (
            FOUR_BAR.replace('pos="0.4 0 0">', 'pos="2 0 0">')
            .replace(
                '<connect name="pin" body1="coupler" body2="rocker" anchor="0.4 0.05 0"/>',
                '<connect name="pin" site1="tcp" site2="far"/>',
            )
            .replace(
                '<joint name="pivot"/>',
                '<joint name="pivot"/><site name="far" pos="3 0 0"/>',
            ),
            {},
            "expected loops that close, got a gap of",
        ),
        (
            FOUR_BAR.replace('mass="2"', 'mass="1e308"'),
            {},
            r"model\.xml: expected the model of a robot, got one with bodies\.crank\.mass: expected",
        ),
        (
            FOUR_BAR.replace('anchor="0.4 0.05 0"', 'anchor="0.4 nan 0"'),
            {},
            "model.xml: expected .* finite",
        ),
        (
            FOUR_BAR.replace(
                "<worldbody>",
                '<worldbody><replicate count="999999999"><geom size="1"/></replicate>',
            ),
            {},
            r"model.xml:6: replicate.count: expected less than 10,000 copies",
        ),
        (
            FOUR_BAR.replace('pos="0 0 1"', 'pos="1e308 0 1"'),
            {},
            r"model.xml: expected .* places within 1e\+06 m",
        ),
    ],
)
def test_refusals(imported, tmp_path, text, options, message):
    with pytest.raises(InputError, match=message) as refused:
        imported(text, ".xml", **options)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "robot.toml").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '<origin xyz="0.1 0 0"/><axis',
            '<origin xyzx="0.1 0 0"/><axis',
            r'23: origin: expected a known .*mean "xyz"',
        ),
        ('rpy="0 0 1.57', 'ryp="0 0 1.57', "16: origin: expected a known key"),
        (
            '<axis xyz="1 0 0"/>',
            '<axisx xyz="1 0 0"/>',
            r'23: axisx: expected an element of URDF, got "axisx"',
        ),
        (
            '<joint name="weld"',
            '<xacro:arm prefix="l"/><joint name="weld"',
            "19: xacro:arm: expected a URDF without",
        ),
        (
            'iyz="0"/></inertial>\n  </link>\n  <joint',
            'iyz="inf"/></inertial>\n  </link>\n  <joint',
            r'13: inertia\.iyz: expected finite numbers, got "inf"',
        ),
        (
            'lower="-1"',
            'lower="-inf"',
            r'17: limit\.lower: expected finite numbers, got "-inf"',
        ),
        (
            'upper="0.2"',
            'upper="nan"',
            r'24: limit\.upper: expected finite numbers, got "nan"',
        ),
    ],
)
def test_words_of_urdf_that_a_parser_passes_over_are_refused(
    imported, old, new, message
):
    assert old in ARM
    for suffix in (".urdf", ".URDF", ".xml"):
        with pytest.raises(InputError, match=rf"model\{suffix}:{message}"):
            imported(ARM.replace(old, new), suffix)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'name="slide"',
            'name="shoulder"',
            '22: joint.name: expected a name of its own, got another "shoulder"',
        ),
        (
            'joint name="slide"',
            "joint",
            '22: joint.name: expected a name of its own, got ""',
        ),
        (
            'link name="plate"',
            'link name="upper"',
            '8: link.name: expected a name of its own, got another "upper"',
        ),
    ],
)
def test_repeated_and_missing_names_are_refused_with_their_line(
    imported, old, new, message
):
    with pytest.raises(InputError, match=rf"model\.urdf:{message}"):
        imported(ARM.replace(old, new), ".urdf")


def test_tendons_their_actuators_and_friction_are_said_to_be_left_out(imported):
    loose = """<mujoco><worldbody><body name="a"><joint name="j1" axis="0 1 0" frictionloss="0.4"/>
      <geom size=".1" mass="1"/></body></worldbody>
      <tendon><fixed name="belt"><joint joint="j1" coef="1"/></fixed></tendon>
      <actuator><position name="pull" tendon="belt"/><motor name="motor" joint="j1"/></actuator></mujoco>"""
    model, _, text = imported(loose, ".xml")
    assert "tendons are left out: belt" in model.notes
    assert "actuators of no joint are left out: pull" in model.notes
    assert "# the source has friction 0.4 here (SI), not taken" in text


def test_a_file_that_is_there_is_kept(imported, tmp_path):
    (tmp_path / "robot.toml").write_text("mine")
    with pytest.raises(
        InputError, match="not there yet, got one that is; --force writes over it"
    ):
        imported(ARM, ".urdf")
    assert (tmp_path / "robot.toml").read_text() == "mine"


def test_an_import_is_repeated_with_force(imported, tmp_path, monkeypatch):
    (tmp_path / "robot.toml").write_text("mine")
    monkeypatch.setattr("stiffscope.imports.import_model.is_forced", lambda: True)
    assert imported(ARM, ".urdf")[1].name in ARM


def test_a_model_without_a_body_is_refused_in_one_line(tmp_path):
    (tmp_path / "none.urdf").write_text('<robot name="none"/>')
    assert (
        _guarded(
            [
                "import",
                str(tmp_path / "none.urdf"),
                "--out",
                str(tmp_path / "new.toml"),
                "--quiet",
            ]
        )
        == 2
    )
    assert not (tmp_path / "new.toml").exists()


def test_names_in_another_encoding_are_refused_with_their_line(tmp_path):
    (tmp_path / "arm.urdf").write_bytes(
        ARM.replace("carriage", "gr\xf6\xdfe").encode("latin-1")
    )
    with pytest.raises(
        InputError,
        match=r"arm.urdf:12: expected a model in URDF or MJCF in UTF-8, got byte 0xf6",
    ):
        import_model(tmp_path / "arm.urdf", tmp_path / "robot.toml")


@pytest.mark.filterwarnings("error::UserWarning")
@pytest.mark.parametrize(
    ("place", "number"),
    [
        *product(["MASS", "CENTRE", "AXIS", "ORIGIN"], ["nan", "inf", "1e300"]),
        ("MASS", "-2"),
    ],
)
def test_numbers_that_are_none_are_refused_in_one_line(
    tmp_path, monkeypatch, capfd, place, number
):
    monkeypatch.chdir(tmp_path)
    values = {"MASS": "2", "CENTRE": "0", "AXIS": "0", "ORIGIN": "0", place: number}
    (tmp_path / "arm.urdf").write_text(
        f'''<robot name="arm"><link name="stand"/><link name="arm"><inertial><mass value="{values["MASS"]}"/>
        <origin xyz="{values["CENTRE"]} 0 0"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="s" type="revolute">
        <parent link="stand"/><child link="arm"/>
        <axis xyz="{values["AXIS"]} 0 1"/><origin xyz="{values["ORIGIN"]} 0 0"/>
        <limit lower="-1" upper="1" effort="0" velocity="0"/></joint></robot>'''
    )
    assert _guarded(["import", "arm.urdf", "--out", "new.toml"]) == 2
    said = capfd.readouterr().err.splitlines()
    assert len(said) == 1
    assert re.match(
        r"stiffscope: arm\.urdf(:[1-5]: (mass|axis|origin)\.\w+)?: expected ", said[0]
    )
    assert [file.name for file in tmp_path.iterdir()] == ["arm.urdf"]


@pytest.mark.parametrize(
    "mesh",
    ["", '<mesh name="hull" file="none.stl"/>'],
    ids=["no mesh", "a missing mesh"],
)
def test_a_negative_inertia_is_refused_beside_missing_meshes(tmp_path, mesh):
    shape = '<geom type="mesh" mesh="hull"/>' if mesh else ""
    (tmp_path / "arm.xml").write_text(
        f'<mujoco><asset>{mesh}</asset><worldbody><body name="arm"><joint name="j" axis="0 1 0"/>'
        f'<inertial pos="0 0 1" mass="2" diaginertia="-0.01 0.02 0.02"/>{shape}</body></worldbody></mujoco>'
    )
    with pytest.raises(InputError, match="inertia below zero"):
        compile_at_home(tmp_path / "arm.xml", {})


def _hinged(inertia, root="", more="", rpy="0 0 0"):
    """A body of 0.12 kg on a hinge about x, its inertia as given; a root with one of its own."""
    root = f"<link name='root'>{root}</link>" if root else "<link name='root'/>"
    return f"""<robot name="hinged">{more}{root}<link name="arm"><inertial>
      <origin xyz="0.2 0 0" rpy="{rpy}"/><mass value="0.12"/><inertia {inertia}/></inertial></link>
      <joint name="hinge" type="revolute"><parent link="root"/><child link="arm"/>
      <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def _six(xx, yy, zz, xy=0.0, xz=0.0, yz=0.0):
    return f'ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="{xy}" ixz="{xz}" iyz="{yz}"'


_BALANCE = '<mujoco><compiler balanceinertia="true"/></mujoco>'


@pytest.mark.parametrize("more", ["", _BALANCE], ids=["plain", "balanced"])
def test_an_inertia_rounded_beyond_a_body_is_taken_as_given_and_told(imported, more):
    model, robot, _ = imported(
        _hinged(_six(4.8e-6, 1.6e-4, 1.649e-4), more=more), ".urdf"
    )
    assert robot.bodies["arm"].inertia == pytest.approx(
        (4.8e-6, 1.6e-4, 1.649e-4, 0, 0, 0), rel=1e-9
    )
    told = " ".join(model.notes)
    assert "the inertia of arm (0.061 %) is more than a body can have" in told
    assert ("is not applied" in told) == bool(more)


@pytest.mark.parametrize("turn", [0.3, 1.2])
def test_axes_of_an_impossible_inertia_are_turned(imported, turn):
    """R diag R^T by hand, R about z, whether MuJoCo accepts the inertia or not."""
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    moments = 1e-4, 2e-4, 3.0002e-4
    expected = rotation @ np.diag(moments) @ rotation.T
    _, robot, _ = imported(_hinged(_six(*moments), rpy=f"0 0 {turn}"), ".urdf")
    xx, yy, zz, xy, xz, yz = robot.bodies["arm"].inertia
    np.testing.assert_allclose(
        [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], expected, atol=1e-12
    )


def test_an_inertia_that_nobody_uses_is_no_reason_to_refuse(imported):
    placeholder = '<inertial><mass value="1e-6"/><inertia '
    placeholder += _six(*[1e-6] * 6) + "/></inertial>"
    model, robot, _ = imported(
        _hinged(_six(1e-4, 1e-4, 1e-4), root=placeholder), ".urdf"
    )
    assert robot.bodies["arm"].inertia[:3] == pytest.approx((1e-4, 1e-4, 1e-4))
    assert "the inertia of root is more than a body can have" in model.notes[0]


@pytest.mark.parametrize("moments", [(5, 0.01, 0.01), (-0.1, 0.2, 0.2)])
def test_a_gross_inertia_of_a_moving_body_is_left_out_and_told(imported, moments):
    model, robot, text = imported(_hinged(_six(*moments)), ".urdf")
    assert (robot.bodies["arm"].inertia, robot.bodies["arm"].mass) == (None, 0.12)
    assert "arm (grossly) is more than a body can have" in model.notes[0]
    assert f"inertia [{moments[0]:.4g}, " in text


def test_a_floor_keeps_its_material_without_meshes(imported):
    text = """<mujoco><asset><mesh name="shade" file="shade.stl"/><texture name="t" type="2d" file="t.png"/>
      <material name="grey" texture="t"/></asset><worldbody>
      <geom name="floor" type="plane" size="1 1 1" material="grey"/>
      <body name="arm"><joint name="hinge" axis="0 1 0"/><inertial pos="0.1 0 0" mass="1" diaginertia="1 1 1"/>
      <geom name="hull" type="mesh" mesh="shade"/></body></worldbody>
      <contact><pair geom1="floor" geom2="hull"/></contact></mujoco>"""
    model, robot, _ = imported(text, ".xml")
    assert robot.bodies["arm"].mass == 1.0
    assert any("without its meshes" in note for note in model.notes)


def test_only_what_floats_is_held_not_what_hangs_on_it(imported):
    """k/L^2 and two springs in series: M is at the knee, 0.2 m below the hip."""
    text = """<mujoco model="leg"><worldbody><body name="trunk" pos="0 0 0.5"><freejoint/>
      <inertial pos="0 0 0" mass="5" diaginertia="0.1 0.1 0.1"/>
      <body name="thigh" pos="0.1 0 0"><joint name="hip" axis="0 1 0" range="-1 1"/>
      <inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.01"/>
      <body name="shank" pos="0 0 -0.2"><joint name="knee" axis="0 1 0" range="-2 1"/>
      <inertial pos="0 0 -0.1" mass="0.5" diaginertia="0.01 0.01 0.01"/></body></body></body></worldbody></mujoco>"""
    model, robot, _ = imported(text, ".xml", drives=["*=1000 N*m/rad"])
    assert set(robot.joints) == {"hip", "knee", "trunk.held"}
    assert [note for note in model.notes if "floats" in note] == [
        '"trunk" floats in the source; it is fixed to the ground here'
    ]
    state = analyse(mechanism_of(robot, {}), [robot.poses["home"]])
    soft = state.compliance[0].diagonal()
    assert 1.0 / soft[[0, 4]] == pytest.approx([1000 / 0.2**2, 500.0])


def test_words_of_drivers_in_a_limit_are_left_out_and_told(imported):
    own = 'upper="0.2" command_effort="3" current="2"'
    model, robot, _ = imported(ARM.replace('upper="0.2"', own), ".urdf")
    assert len(robot.joints) == 2
    told = " ".join(model.notes)
    assert "limit.command_effort, which URDF does not know, is left out" in told
    with pytest.raises(InputError, match='did you mean "upper"'):
        imported(ARM.replace('upper="0.2"', 'uper="0.2"'), ".urdf", path="new.toml")


def test_a_broken_mujoco_is_not_a_missing_one(tmp_path, monkeypatch):
    (tmp_path / "arm.urdf").write_text(ARM)
    (tmp_path / "mujoco.py").write_text('raise ImportError("libGL.so.1 is missing")')
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "mujoco")
    with pytest.raises(InputError, match=r"does not load \(libGL.so.1 is missing\)"):
        compile_at_home(tmp_path / "arm.urdf", {})


def test_a_link_without_mass_is_taken_and_the_others_keep_theirs(imported):
    joint = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="0 0 0.3"/>'
    joint += '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    bare = '<robot name="bare"><link name="base"/><link name="upper"/><link name="lower"><inertial><mass value="2"/>'
    bare += '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    bare += f"{joint.format('j1', 'base', 'upper')}{joint.format('j2', 'upper', 'lower')}</robot>"
    model, robot, _ = imported(bare, ".urdf", drives=["j*=9 kN*m/rad"])
    assert (robot.bodies["upper"].mass, robot.bodies["lower"].mass) == (0.0, 2.0)
    assert not any("meshes" in note for note in model.notes)


def _solid_arm(
    folder,
    origin='<origin xyz="0 0 0.12" rpy="0 -1.5707963267948966 0"/>',
    file="upper.step",
    more="",
):
    """An arm with two joints along its x, whose visual is a bar with holes of 8 and 6 mm, in axes of its own."""
    build123d = pytest.importorskip("build123d")
    bar = build123d.Box(300, 40, 20)
    for x, radius in ((-120, 8), (120, 6)):
        bar -= build123d.Pos(x, 0, 0) * build123d.Cylinder(radius, 20)
    (folder / "meshes").mkdir()
    build123d.export_step(bar.solid(), folder / "meshes" / "upper.step")
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    visual = f'<visual>{origin}<geometry><mesh filename="package://arm/meshes/{file}"/></geometry></visual>'
    joints = (
        ("shoulder", "base", "upper", "0 0 0.5", "0.2 0 0.7"),
        ("elbow", "upper", "fore", "0 0 0.24", "0.4 0 0"),
    )
    return (
        f'<robot name="arm"><link name="base"/><link name="upper">{mass}{visual}</link>'
        f'<link name="fore">{mass}</link>{more}'
        + "".join(
            f'<joint name="{name}" type="revolute"><parent link="{one}"/><child link="{two}"/><origin xyz="{xyz}" '
            f'rpy="{rpy}"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
            for name, one, two, xyz, rpy in joints
        )
        + "</robot>"
    )


def test_a_body_bends_as_the_solid_of_its_visual(imported, tmp_path):
    """The axis of each joint is that of its hole, wherever the joints and the visual stand."""
    model, robot, _ = imported(_solid_arm(tmp_path), ".urdf", materials=["up*=steel"])
    body = robot.bodies["upper"]
    frame = np.column_stack((body.x, body.y, np.cross(body.x, body.y)))
    for name, radius in (("shoulder", 0.008), ("elbow", 0.006)):
        joint = robot.joints[name]
        (selector,) = robot.parts["upper"].interfaces[name].faces
        lever = frame @ selector.position + body.at - np.array(joint.at)
        assert np.linalg.norm(np.cross(lever, joint.axis)) == pytest.approx(
            radius, abs=1e-9
        )
        assert f"upper.{name}" in joint.between
    volume = 0.3 * 0.04 * 0.02 - np.pi * (0.008**2 + 0.006**2) * 0.02
    assert (
        f"upper bends, and has its solid's {7850 * volume:.4g} kg, not 1 kg"
        in model.notes
    )


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({}, 'say --material "upper=NAME" to let it bend'),
        ({"file": "lost.step"}, "expected a STEP file"),
        (
            {"origin": '<origin xyz="0 0 0.2"/>'},
            "no face of the solid is at shoulder, elbow",
        ),
        (
            {
                "more": '<link name="rack"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
                'iyz="0"/></inertial></link><joint name="weld" type="fixed"><parent link="upper"/><child link="rack"/>'
                "</joint>"
            },
            "expected one visual and no other link fixed to it, got more",
        ),
    ],
)
def test_a_body_that_stays_rigid_beside_its_solid_says_why(
    imported, tmp_path, options, why
):
    model, robot, _ = imported(
        _solid_arm(tmp_path, **options),
        ".urdf",
        materials=["u*=steel"] if options else [],
    )
    assert not robot.parts
    (note,) = [note for note in model.notes if note.startswith("upper stays rigid")]
    assert why in note


def test_a_material_that_is_none_is_refused_for_a_urdf(imported, tmp_path):
    with pytest.raises(
        InputError, match="--material upper=wood: expected PATTERN=NAME"
    ):
        imported(_solid_arm(tmp_path), ".urdf", materials=["upper=wood"])
    with pytest.raises(
        InputError, match="--material: expected a STEP assembly or a URDF"
    ):
        imported(FOUR_BAR, ".xml", materials=["*=steel"])


FIVE_BAR = """<robot name="five-bar"><link name="base"/>
  {links}
  {joints}
</robot>"""


def _five_bar(tmp_path, kind="6d", frame="left_end"):
    """Two arms of two links in the plane x, z, whose ends coincide only if the elbows are bent."""
    links = ["left_1", "left_2", "left_end", "right_1", "right_2", "right_end"]
    mass = '<inertial><mass value="1"/><inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial>'
    bodies = "".join(
        f'<link name="{n}">{"" if "end" in n else mass}</link>' for n in links
    )
    rows = [
        ("left_1", "revolute", "base", "left_1", "0 0 0"),
        ("left_2", "revolute", "left_1", "left_2", "-0.1 0 0.2"),
        ("left_3", "fixed", "left_2", "left_end", "0.16 0 0.2"),
        ("right_1", "revolute", "base", "right_1", "0.1 0 0"),
        ("right_2", "revolute", "right_1", "right_2", "0.1 0 0.2"),
        ("right_3", "revolute", "right_2", "right_end", "-0.15 0 0.2"),
    ]
    joints = "".join(
        f'<joint name="{n}" type="{t}"><parent link="{p}"/><child link="{c}"/><origin xyz="{o}"/><axis xyz="0 1 0"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        for n, t, p, c, o in rows
    )
    (tmp_path / "loops.yaml").write_text(
        f"closed_loop: [['{frame}', 'right_end']]\ntype: ['{kind}']\nname_mot: ['left_1', 'right_1']\n"
    )
    return FIVE_BAR.format(links=bodies, joints=joints)


def test_a_joint_beyond_its_range_at_zero_stands_at_the_nearest_limit(imported):
    text = """<mujoco><worldbody><body name="arm"><freejoint/><geom size="0.1"/>
    <body name="leg" pos="0 0 -1"><joint name="knee" axis="0 1 0" range="30 90"/>
    <geom size="0.1" pos="1 0 0"/></body></body></worldbody></mujoco>"""
    model, robot, _ = imported(text, ".xml", drives=["knee=1000 N*m/rad"])
    assert any("home of knee is beyond its range" in note for note in model.notes)
    assert robot.joints["knee"].drive.range == pytest.approx((0.0, np.radians(60.0)))
    centre = np.asarray(robot.bodies["leg"].centre) - robot.joints["knee"].at
    assert centre == pytest.approx([np.cos(np.pi / 6), 0.0, -0.5])
    assert configure(mechanism_of(robot, {}), [mechanism_of(robot, {}).tool.home]).valid


@pytest.mark.parametrize(
    ("kind", "frame"), [("6d", "left_end"), ("3D", "left_end"), ("6d", "left_3")]
)
def test_loops_beside_a_urdf_close_it(imported, tmp_path, kind, frame):
    """Two drives, two coordinates; the closed frames coincide, and K is that of J^-T k J^-1 by differences.

    A frame is a link's or a joint's, also a fixed one's.
    """
    text = _five_bar(tmp_path, kind, frame)
    model, robot, _ = imported(
        text,
        ".urdf",
        drives=["left_1=1000 N*m/rad", "right_1=2000 N*m/rad"],
        loops=tmp_path / "loops.yaml",
        tool="left_end",
    )
    (loop,) = [j for name, j in robot.joints.items() if name.startswith("loop")]
    assert loop.type == ("fixed" if kind == "6d" else "spherical")
    assert robot.tool.pose == ("x", "z")
    assert any("1 loop is closed as loops.yaml says" in note for note in model.notes)
    mechanism = mechanism_of(robot, {})
    home = mechanism.tool.home
    step = 1e-5
    poses = home + step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    drives = configure(mechanism, poses).drives
    rates = np.array([drives[0] - drives[1], drives[2] - drives[3]]).T / (2 * step)
    expected = rates.T @ np.diag([1000.0, 2000.0]) @ rates
    found = np.linalg.inv(
        analyse(mechanism, home[None]).compliance[0][np.ix_([0, 2], [0, 2])]
    )
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_loops_far_open_at_the_zero_pose_are_closed(imported, tmp_path):
    """Full steps jump between far branches; the links of 0.3 m reach where both ends can meet."""
    text = _five_bar(tmp_path).replace('"-0.15 0 0.2"', '"0.25 0 -0.15"')
    _, robot, _ = imported(text, ".urdf", loops=tmp_path / "loops.yaml")
    loop = robot.joints["loop1"]
    assert loop.type == "fixed"
    elbow = np.asarray(robot.joints["joints.left_2"].at)
    assert np.linalg.norm(loop.at - elbow) == pytest.approx(np.hypot(0.16, 0.2))
    other = np.asarray(robot.joints["joints.right_2"].at)
    assert np.linalg.norm(loop.at - other) == pytest.approx(np.hypot(0.25, 0.15))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            "closed_loop: [['left_edn', 'right_end']]",
            'got "left_edn"; did you mean "left_end"',
        ),
        ("closed_loop: [['left_end']]", "expected pairs of frames"),
        (
            "closed_loop: [['left_end', 'right_end']]\ntype: ['5d']",
            '"3d" or "6d" for each of 1',
        ),
        ("loops: 3", "closed_loop: expected pairs of frames, got nothing"),
        ("a: [", "expected YAML"),
        (
            "closed_loop: []\njoint_name: ['left_1']\njoint_type: ['HELIX']",
            "expected one of SPHERICAL",
        ),
    ],
)
def test_loops_that_are_none_are_refused(imported, tmp_path, content, message):
    text = _five_bar(tmp_path)
    (tmp_path / "loops.yaml").write_text(content)
    with pytest.raises(InputError, match=message):
        imported(text, ".urdf", loops=tmp_path / "loops.yaml")

"""A tripod under an elastic head of four interfaces, in the robot file's format: three beams on a hub as one matrix."""

import numpy as np

from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import read_robot
from stiffscope.vjm.model.checks import axes_along
from stiffscope.vjm.model.screws import shift
from tests.robots import euler_bernoulli

ANGLES = np.radians([0.0, 120.0, 240.0])
HUB, UP = np.array([0.0, 0.0, 0.5]), np.array([0.0, 0.0, 1.0])
FEET = [0.25 * np.array([np.cos(a), np.sin(a), 0.0]) for a in ANGLES]
ARMS = [0.2 * np.array([np.cos(a), np.sin(a), -0.1]) for a in ANGLES]


def star_stiffness(arms=ARMS):
    """Unsupported stiffness (24, 24) of equal beams from a hub at the origin to the ends of arms."""
    k = np.zeros((24, 24))
    c = euler_bernoulli(float(np.linalg.norm(arms[0])))
    for i, arm in enumerate(arms):
        turn = np.kron(np.eye(2), axes_along(arm, UP, "beam").T)
        relative = turn @ np.hstack([-shift(arm), np.eye(6)])
        at = np.r_[:6, 6 * i + 6 : 6 * i + 12]
        k[np.ix_(at, at)] += relative.T @ np.linalg.solve(c, relative)
    return k


def tripod_text(drive='stiffness = "20 N/um"', turned=(1.0, 0.0, 0.0)):
    """Its robot file: legs that turn at the ground and slide, on balls; the hub is the tool."""
    x = np.array(turned)
    y = np.cross(UP, turned)
    turn = np.array([x, y, UP])  # base to part axes
    places = ", ".join(
        f"{n} = {(turn @ p).tolist()}" for n, p in zip("abc", ARMS, strict=True)
    )
    text = f"""name = "tripod"

[parts.star]
shape = "matrix"
material = "aluminium-7075"
interfaces = {{ hub = [0, 0, 0], {places} }}
stiffness = {star_stiffness([turn @ arm for arm in ARMS]).tolist()}
mass = "2.8 kg"

[bodies.head]
part = "star"
at = {HUB.tolist()}
x = {x.tolist()}
y = {y.tolist()}

[tool]
body = "head.hub"
at = {HUB.tolist()}
pose = ["z", "rx", "ry"]

[gravity]
direction = [0, 0, -1]

[poses]
home = [0.5, 0, 0]
tilted = [0.51, 0.1, -0.05]
low = [0.48, -0.12, 0.2]
"""
    for k, (foot, arm) in enumerate(zip(FEET, ARMS, strict=True)):
        tip = HUB + arm
        middle = 0.5 * (foot + tip)
        side = np.array([-np.sin(ANGLES[k]), np.cos(ANGLES[k]), 0.0])
        text += f"""
[bodies.lower{k}]
[bodies.upper{k}]
mass = "200 g"
centre = {middle.tolist()}
[joints.turn{k}]
between = ["ground", "lower{k}"]
type = "revolute"
at = {foot.tolist()}
axis = {side.tolist()}
compliance = {{ radial = "1 nm/N", axial = "1 nm/N", tilting = "1 urad/(N*m)" }}
[joints.slide{k}]
between = ["lower{k}", "upper{k}"]
type = "prismatic"
at = {middle.tolist()}
axis = {(tip - foot).tolist()}
drive = {{ {drive} }}
[joints.ball{k}]
between = ["upper{k}", "head.{"abc"[k]}"]
type = "spherical"
at = {tip.tolist()}
"""
    return text


def tripod(folder, **options):
    """The elastic robot, its file in a folder."""
    path = folder / "tripod.toml"
    text = tripod_text(**options)
    path.write_text(text)
    robot = read_robot(path, text)
    return NominalRobot(mechanism_of(robot, part_matrices(robot)), robot)

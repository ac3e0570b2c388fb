"""The paper's robot with published matrices, its closed-form kinematics, and random components."""

import tomllib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import PartMatrix, part_matrices
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.model.bodies import Body
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool

DATA = Path(__file__).parents[1] / "data" / "published"
DRIVE = 1.27e7


class Geometry(NamedTuple):
    """Dimensions of Tables 1 to 3, and the range of the carriages, m."""

    L: float = 0.5
    l: float = 0.075
    l1: float = 0.04
    l2: float = 0.015
    h: float = 0.0175
    d: float = 0.07
    a_min: float = 0.20
    a_max: float = 0.55


GEOMETRY = Geometry()


def pose_at(geometry, q, x=0.0, y=0.0):
    """Return the tool point (3,) at the link angle q in rad."""
    return np.array([x, y, geometry.l1 + geometry.l2 + geometry.L * np.sin(q)])


def slides(geometry, poses):
    """Return positions (n, 3) of limbs 1, 2 and stage at tool points (n, 3); NaN if unreachable."""
    x, y, z = np.atleast_2d(poses).T
    sine = (z - geometry.l1 - geometry.l2) / geometry.L
    cosine = np.sqrt(np.where((sine > 0.0) & (sine < 1.0), 1.0 - sine**2, np.nan))
    reach = geometry.L * cosine + geometry.l
    return np.column_stack([reach - x, reach + x, y])


def reachable(geometry, poses):
    """Return whether tool points (n, 3) are within reach (n,)."""
    a = slides(geometry, poses)[:, :2]
    return ((a >= geometry.a_min) & (a <= geometry.a_max)).all(axis=1)


def euler_bernoulli(length=0.5, radius=0.0125, e=211e9, g=81e9):
    """Return the compliance of Eq. (28)."""
    area = np.pi * radius**2
    inertia = np.pi * radius**4 / 4
    c = np.diag(
        [
            length / (e * area),
            *[length**3 / (3 * e * inertia)] * 2,
            length / (2 * g * inertia),
        ]
        + [0.0] * 2
    )
    c[4, 4] = c[5, 5] = length / (e * inertia)
    c[1, 5] = c[5, 1] = length**2 / (2 * e * inertia)
    c[2, 4] = c[4, 2] = -c[1, 5]
    return c


def published_slider():
    content = tomllib.loads((DATA / "slider.toml").read_text())
    return np.array(content["compliance"]) * content["unit"]


def random_compliance(rng, like):
    """Return a full symmetric positive definite matrix scaled like ``like``."""
    a = rng.normal(size=(6, 6))
    scale = np.sqrt(np.diagonal(like))
    return (a @ a.T / 6 + 0.1 * np.eye(6)) * np.outer(scale, scale)


def random_poses(rng, n, geometry=GEOMETRY):
    points = np.column_stack(
        [
            rng.uniform(-0.17, 0.17, 20 * n),
            rng.uniform(-0.3, 0.3, 20 * n),
            rng.uniform(0.21, 0.54, 20 * n),
        ]
    )
    return points[reachable(geometry, points)][:n]


def nominal_robot(*overrides):
    """Return the bundled Biglide with Eqs. (28) and (29) for a diagnosis."""
    robot = load_robot("biglide", overrides)
    return NominalRobot(mechanism_of(robot, part_matrices(robot, "published")), robot)


def published_robot():
    """Return the bundled Biglide with Eqs. (28) and (29) as a mechanism."""
    return nominal_robot().mechanism


def robot_of(link, slider):
    """Return the bundled Biglide with these matrices of link and slider."""
    robot = load_robot("biglide")
    return mechanism_of(
        robot, {"link": PartMatrix(link, mass=1.95), "slider": PartMatrix(slider)}
    )


def cubic_hexapod(size, strut, height):
    """Return six driven struts, ``size`` high, on edges of a cube on its corner; M at ``height``."""
    corners = (
        np.sqrt(3.0)
        * size
        * (
            np.array([[0, 0, 1], [0, 1, 1], [0, 1, 0], [1, 1, 0], [1, 0, 0], [1, 0, 1]])
            - 0.5
        )
    )
    x = np.array([1, -1, 0]) / np.sqrt(2)
    y = np.array([1, 1, -2]) / np.sqrt(6)
    points = corners @ np.stack([x, y, np.cross(x, y)]).T  # the cube's diagonal along z
    bodies = [Body("platform")]
    joints = []
    for k, ends in enumerate([(0, 1), (2, 1), (2, 3), (4, 3), (4, 5), (0, 5)]):
        foot, head = sorted(points[list(ends)], key=lambda p: p[2])
        first, second = np.linalg.svd((head - foot)[None])[2][1:]
        bodies += [Body(f"lower{k}"), Body(f"upper{k}")]
        joints += [
            Joint(f"foot{k}", "ground", f"lower{k}", "universal", foot, first, second),
            Joint(
                f"drive{k}",
                f"lower{k}",
                f"upper{k}",
                "prismatic",
                foot,
                head - foot,
                drive=Drive(strut),
            ),
            Joint(f"head{k}", f"upper{k}", "platform", "spherical", head),
        ]
    tool = Tool(
        "platform", np.array([0.0, 0.0, height]), ("x", "y", "z", "rx", "ry", "rz")
    )
    return Mechanism(tuple(bodies), tuple(joints), tool)

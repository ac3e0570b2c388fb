"""Conversion of a robot file and its parts' matrices to a mechanism of `vjm`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.robot.file.copies import tensor
from stiffscope.robot.file.sections import ElasticBody, RigidBody
from stiffscope.vjm.bodies import Body, Elastic
from stiffscope.vjm.checks import axes_along, spell_name
from stiffscope.vjm.joints import Drive, Joint, Law
from stiffscope.vjm.mechanism import Mechanism, Tool

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.file.sections import BodySection, JointSection, LinearDrive, RotaryDrive
    from stiffscope.robot.part_matrices import PartMatrix


def mechanism_of(robot: RobotFile, matrices: Mapping[str, PartMatrix]) -> Mechanism:
    """Return the mechanism of a robot file, without the effects adopted in the file.

    Parameters
    ----------
    robot
        Robot file.
    matrices
        Matrix and mass of each used part, from `part_matrices`.

    Raises
    ------
    InputError
        If it is not a mechanism; the message names the body or joint as in the file.

    """
    bodies = tuple(_body(robot, name, body, matrices) for name, body in robot.bodies.items())
    joints = tuple(_joint(robot, name, joint) for name, joint in robot.joints.items())
    tool = Tool(robot.tool.body, np.array(robot.tool.at), robot.tool.pose)
    return Mechanism(bodies, joints, tool, gravity_of(robot))


def gravity_of(robot: RobotFile) -> np.ndarray:
    """Return the gravitational acceleration (3,), m/s², base axes; zero without `[gravity]`."""
    if robot.gravity is None:
        return np.zeros(3)
    direction = np.array(robot.gravity.direction)
    return robot.gravity.acceleration * direction / np.linalg.norm(direction)


def _body(robot: RobotFile, name: str, body: BodySection, matrices: Mapping[str, PartMatrix]) -> Body:
    if isinstance(body, RigidBody):
        centre = None if body.centre is None else np.array(body.centre)
        return Body(name, body.mass, centre, None if body.inertia is None else tensor(body.inertia))
    made_of, here = matrices[body.part], spell_name("bodies", name)
    dynamics = made_of.dynamics
    if isinstance(body, ElasticBody):
        places = np.array([body.base, body.tip])
        axes = axes_along(places[1] - places[0], body.y, here)
    else:
        axes = axes_along(body.x, body.y, here)
        places = np.array(body.at) + np.asarray(made_of.places) @ axes.T
    if dynamics is not None and made_of.places is not None:
        ways = (places - places[-1]) @ axes - (made_of.places - made_of.places[-1])
        dynamics = dynamics.move_ends(*ways)
    elastic = Elastic(made_of.compliance, places, axes, made_of.error, dynamics=dynamics, ends=robot.ends(name))
    return Body(name, made_of.mass, elastic=elastic)


def _joint(robot: RobotFile, name: str, joint: JointSection) -> Joint:
    axis, axis2 = getattr(joint, "axis", None), getattr(joint, "axis2", None)
    drive = getattr(joint, "drive", None)
    driven = None if drive is None else _drive(drive)
    return Joint(
        name,
        *joint.between,
        joint.type,
        np.array(joint.at),
        None if axis is None else np.array(axis),
        None if axis2 is None else np.array(axis2),
        driven,
        _bearing(robot, name, joint),
        spring=getattr(joint, "spring", None),
        rest=getattr(joint, "rest", 0.0),
    )


def _drive(drive: LinearDrive | RotaryDrive) -> Drive:
    law = None
    if drive.points is not None or drive.backlash:
        law = Law.from_curve(drive.points or ((1.0, drive.stiffness),), drive.backlash)
    stiffness = drive.stiffness if law is None else float(law.slopes[0])
    return Drive(stiffness, *(drive.range or (-np.inf, np.inf)), law)


def _bearing(robot: RobotFile, name: str, joint: JointSection) -> np.ndarray | None:
    """Return the compliance (6, 6) of a joint's bearing in the joint's axes; None if rigid.

    A copy's bearing is that of its original, rotated with it and expressed in the copy's own axes.
    """
    turn = robot.copied[name].rotation if name in robot.copied else np.eye(3)
    written, here = (_axes(joint, rotation) for rotation in (turn.T, np.eye(3)))
    matrix = joint.yielding(written)
    if not matrix.any():
        return None
    if name not in robot.copied:
        return matrix
    relative = np.kron(np.eye(2), here.T @ turn @ written)
    return relative @ matrix @ relative.T


def _axes(joint: JointSection, rotation: np.ndarray) -> np.ndarray:
    """Return the axes (3, 3) of a joint after rotating its directions."""
    axis, axis2 = getattr(joint, "axis", None), getattr(joint, "axis2", None)
    if axis is None:
        return np.eye(3)
    return axes_along(rotation @ axis, None if axis2 is None else rotation @ axis2)

"""Conversion of a robot file and its parts' matrices to a mechanism of `vjm`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.robot.file.copies import tensor
from stiffscope.robot.file.sections import ElasticBody, RigidBody
from stiffscope.robot.part_matrices import rigid_part
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.bodies import Body, Elastic
from stiffscope.vjm.model.checks import axes_along, spell_name
from stiffscope.vjm.model.joints import Drive, Joint, Law
from stiffscope.vjm.model.mechanism import Mechanism, Tool

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.file.sections import JointSection
    from stiffscope.robot.part_matrices import PartMatrix
    from stiffscope.vjm.kinematics.configurations import Configurations


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
    bodies = tuple(_body(robot, name, matrices) for name in robot.bodies)
    joints = tuple(_joint(robot, name, joint) for name, joint in robot.joints.items())
    tool = Tool(robot.tool.body, np.array(robot.tool.at), robot.tool.pose)
    gravity = np.zeros(3)
    if robot.gravity is not None:
        direction = np.array(robot.gravity.direction)
        gravity = robot.gravity.acceleration * direction / np.linalg.norm(direction)
    return Mechanism(bodies, joints, tool, gravity)


def rigid_mechanism(robot: RobotFile) -> Mechanism:
    """Return the mechanism with rigid parts, for kinematics only; masses are zero if unknown."""
    return mechanism_of(robot, {name: rigid_part(robot, name) for name in robot.parts})


def configured_poses(
    robot: RobotFile, mechanism: Mechanism, poses: ArrayLike
) -> Configurations:
    """Return configurations at poses (n, k); InputError at `[tool] pose` if it cannot be commanded.

    Parameters
    ----------
    robot
        Robot file.
    mechanism
        Bodies, joints, tool and gravity of the robot.
    poses
        Tool poses (n, k), SI.
    """
    try:
        return configure(mechanism, poses)
    except InputError as error:
        where, _, message = str(error).partition("tool.pose: ")
        if where or not message:
            raise
        raise robot.refuse(("tool", "pose"), message) from error


def _body(robot: RobotFile, name: str, matrices: Mapping[str, PartMatrix]) -> Body:
    body = robot.bodies[name]
    if isinstance(body, RigidBody):
        centre = None if body.centre is None else np.array(body.centre)
        return Body(
            name,
            body.mass,
            centre,
            None if body.inertia is None else tensor(body.inertia),
        )
    made_of = matrices[body.part]
    here = spell_name("bodies", name)
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
    soft = made_of.compliance
    error = made_of.error
    ends = robot.ends(name)
    elastic = Elastic(soft, places, axes, error, dynamics=dynamics, ends=ends)
    return Body(name, made_of.mass, elastic=elastic)


def _joint(robot: RobotFile, name: str, joint: JointSection) -> Joint:
    given = getattr(joint, "drive", None)
    driven = None
    law = None
    if given is not None:
        if given.points is not None or given.backlash:
            law = Law.from_curve(
                given.points or ((1.0, given.stiffness),), given.backlash
            )
        stiffness = given.stiffness if law is None else float(law.slopes[0])
        low, high = given.range or (-np.inf, np.inf)
        driven = Drive(stiffness, low, high, law)
    axes = (getattr(joint, key, None) for key in ("axis", "axis2"))
    axis, axis2 = (
        direction if direction is None else np.array(direction) for direction in axes
    )
    flexure = {
        key: getattr(joint, key) for key in ("spring", "rest") if hasattr(joint, key)
    }
    bearing = _bearing(robot, name, joint)
    at = np.array(joint.at)
    return Joint(
        name,
        *joint.between,
        joint.type,
        at,
        axis,
        axis2,
        driven,
        bearing,
        **flexure,
        carried_by=joint.carried_by,
    )


def _bearing(robot: RobotFile, name: str, joint: JointSection) -> np.ndarray | None:
    """Return the compliance (6, 6) of a joint's bearing in the joint's axes; None if rigid.

    A copy's bearing is that of its original, rotated with it and expressed in the copy's own axes.
    """
    written = written_axes(robot, name)
    matrix = joint.yielding(written)
    if not matrix.any():
        return None
    if name not in robot.copied:
        return matrix
    here = _axes(joint, np.eye(3))
    relative = np.kron(np.eye(2), here.T @ robot.copied[name].rotation @ written)
    return relative @ matrix @ relative.T


def written_axes(robot: RobotFile, name: str) -> np.ndarray:
    """Return the axes (3, 3) of a joint as written in the file: those of a copy before its rotation."""
    turn = robot.copied[name].rotation.T if name in robot.copied else np.eye(3)
    return _axes(robot.joints[name], turn)


def _axes(joint: JointSection, rotation: np.ndarray) -> np.ndarray:
    """Return the axes (3, 3) of a joint after rotating its directions."""
    axis = getattr(joint, "axis", None)
    axis2 = getattr(joint, "axis2", None)
    if axis is None:
        return np.eye(3)
    return axes_along(rotation @ axis, None if axis2 is None else rotation @ axis2)

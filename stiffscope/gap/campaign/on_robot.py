"""Check of a campaign against its robot: poses, coordinates, and bodies of sensors and loads."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.quantities import JOINT
from stiffscope.robot.file.description import GROUND
from stiffscope.robot.file.quantities import show_value

if TYPE_CHECKING:
    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.robot.file.description import RobotFile

MOST_POSES = 2_000  # a diagnosis needs 0.02 s and 0.1 MB for each


def match_robot(campaign: Campaign, robot: RobotFile) -> Campaign:
    """Return the campaign checked against the robot, with named poses looked up in its file.

    Raises
    ------
    InputError
        For too many poses, unknown poses, columns that are not the robot's coordinates, and sensors
        and loads that are not on its bodies.

    """
    _check_bodies(campaign, robot)
    if len(campaign.poses) > MOST_POSES:
        where = campaign.where(int(np.argmax(campaign.pose >= MOST_POSES)))
        most = f"expected at most {MOST_POSES:,} different poses"
        got = "got more; leave some out, a few dozen tell as much"
        raise InputError(f"{where}: {campaign.coordinates[0]}: {most}, {got}")
    if not np.isnan(campaign.poses).any():
        return _order_columns(campaign, robot)
    for k, name in enumerate(campaign.pose_names):  # named poses
        if name not in robot.poses:
            where = campaign.where(int(np.argmax(campaign.pose == k)))
            known = f"{robot.name}'s [poses] {', '.join(robot.poses) or '(none)'}"
            raise InputError(f"{where}: pose: expected one of {known}, got {name!r}")
    poses = np.array([robot.poses[name] for name in campaign.pose_names])
    return replace(campaign, poses=poses, coordinates=tuple(robot.tool.pose))


def _order_columns(campaign: Campaign, robot: RobotFile) -> Campaign:
    """Put the coordinates in the robot's order."""
    given, pose = campaign.coordinates, tuple(robot.tool.pose)
    joints = tuple(f"{JOINT}{name}" for name in robot.drives())
    wanted = next((names for names in (pose, joints) if names and set(names) == set(given)), None)
    if wanted is None:
        strange = [name for name in given if name not in {*pose, *joints}]
        valid = joints if given[0].startswith(JOINT) else pose
        lacking = [*strange, *(name for name in valid if name not in given)]
        expected = f"{' '.join(pose)}, or {' '.join(joints)}, got {' '.join(given)}"
        where = f"{campaign.files[0]}:1: {lacking[0]}"
        command = f"the coordinates that command {robot.name}"
        raise InputError(f"{where}: expected {command}: {expected}")
    order = [given.index(name) for name in wanted]
    return replace(campaign, poses=campaign.poses[:, order], coordinates=wanted)


def _check_bodies(campaign: Campaign, robot: RobotFile) -> None:
    """Raise InputError for sensors and loads not on a body, and sensors on the measured body."""
    known = robot.nodes()

    def check(name: str, *key: str, moves: bool) -> None:
        if name not in known or (moves and name == GROUND):
            valid = ", ".join(node for node in known if not (moves and node == GROUND))
            expected = f"expected a body or an end of one ({valid})"
            raise campaign.refuse(key, f"{expected}, got {show_value(name)}")

    for sensor in campaign.sensors:
        section = sensor.target or sensor.name
        check(sensor.body, "sensors", section, "body", moves=False)
        check(sensor.against, "sensors", section, "against", moves=False)
        if sensor.body == sensor.against and (sensor.body != GROUND or sensor.measures != "rotation"):
            key = "sensors", section, "against"
            raise campaign.refuse(key, f"expected another body than {sensor.body}, got the same")
    for load in campaign.loads:
        check(load.body, "loads", load.name, "body", moves=True)

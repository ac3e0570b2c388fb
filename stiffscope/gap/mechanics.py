"""Mechanics of the nominal robot as a diagnosis needs it: the only module of this room that uses `stiffscope.vjm`.

Everything here is of the Biglide: names of drives, closed-form rigid kinematics, bounds of its stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.robot.effects import changed
from stiffscope.vjm.analysis import stiffness
from stiffscope.vjm.biglide import link_angle, reachable
from stiffscope.vjm.bounds import stiffness_bounds
from stiffscope.vjm.maps import reachable_box
from stiffscope.vjm.reduction import assembled
from stiffscope.vjm.response import respond

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from stiffscope.robot.effects import Changes, NominalRobot
    from stiffscope.vjm.biglide import Geometry
    from stiffscope.vjm.response import Response

    Array = NDArray[np.floating[Any]]

DRIVES = {"stage": ("stage.actuator", 1), "limb1": ("limb1.actuator", 0), "limb2": ("limb2.actuator", 0)}
"""Element and axis of each drive."""
_WEIGHT, _PAYLOAD = 6, 7  # load cases behind the six unit wrenches
_GRID = 9  # tool points along each side of the workspace
_SMALL = 1e-3  # share of a geometric error at which it acts linearly


@dataclass(frozen=True)
class RobotAtPoses:
    """The nominal robot at tool points (p, 3) in m."""

    robot: NominalRobot
    poses: Array

    def state(self, changes: Sequence[Changes], payload: Array) -> ElasticState:
        """The robot with changed elements and a payload's wrench (6,) at M. Raises InputError if it cannot close."""
        return ElasticState(self, tuple(changes), payload)

    def drive_centre(self) -> float:
        """Middle of the range of the two sliding drives, m."""
        geometry = self.robot.elastic.geometry
        return 0.5 * (geometry.a_min + geometry.a_max)

    @cached_property
    def weight_stiffness(self) -> Array:
        """Change (p, 6, 6) of the stiffness when the robot's own weight acts."""
        robot, poses = self.robot, self.poses
        loaded = stiffness(robot.elastic, poses, gravity="exact", g=robot.acceleration)
        return loaded - stiffness(robot.elastic, poses)

    def stiffness_bounds(self) -> Array:
        """Diagonals (p, 6) of the stiffness that no machine of these parts can exceed."""
        robot = self.robot.elastic
        return stiffness_bounds(robot, link_angle(robot.geometry, self.poses))

    def workspace(self, y: float) -> Array:
        """Tool points (k, 3) on a grid all over the workspace, at one y."""
        geometry = self.robot.elastic.geometry
        box = reachable_box(geometry)
        x, z = np.meshgrid(np.linspace(box.x_min, box.x_max, _GRID), np.linspace(box.z_min, box.z_max, _GRID))
        points = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
        points = points[reachable(geometry, points)]
        points[:, 1] = y
        return points


@dataclass(frozen=True)
class ElasticState:
    """A robot with changed elements; everything is evaluated where it is asked for."""

    at: RobotAtPoses
    changes: tuple[Changes, ...]
    payload: Array
    """(6,) at M, N and N·m."""

    @cached_property
    def _errors(self) -> Array:
        """Errors (5,) of the rigid mechanism in m: limb 1, limb 2, stage outward, mean links of limb 1, limb 2."""

        def offset(name: str, axis: int) -> float:
            moved = [c[name].offset for c in self.changes if name in c]
            return float(sum(o[axis] for o in moved if o is not None))

        links = [np.mean([offset(f"limb{i}.link{j}", 0) for j in (1, 2, 3)]) for i in (1, 2)]
        return np.array([-offset(*DRIVES["limb1"]), offset(*DRIVES["limb2"]), offset(*DRIVES["stage"]), *links])

    @cached_property
    def displacement(self) -> Array:
        """Translation (p, 3) of the tool by errors of the rigid mechanism, exactly."""
        if not self._errors.any():
            return np.zeros((len(self.at.poses), 3))
        return _displaced(self.at.robot.elastic.geometry, self.at.poses, self._errors)

    @cached_property
    def _response(self) -> Response:
        """Six unit wrenches at M, one m/s² of gravity on the robot's weight, the payload."""
        robot = self.at.robot.elastic
        beyond = replace(robot.geometry, a_min=0.0, a_max=10.0 * robot.geometry.a_max)  # errors may lead out of range
        tree = replace(robot, geometry=beyond).tree(self.at.poses + self.displacement)
        for change in self.changes:
            tree = changed(tree, change)
        loads = np.column_stack([np.eye(6), np.zeros(6), self.payload])
        wrenches = np.broadcast_to(loads, (len(self.at.poses), 6, 8))
        return respond(assembled(tree, loads=True), wrenches, gravity=np.eye(8)[_WEIGHT])

    @cached_property
    def compliance(self) -> Array:
        """Compliance (p, 6, 6) at M."""
        return self._response.twist[..., :6]

    @cached_property
    def weight_twist(self) -> Array:
        """Twist (p, 6) of the tool under the robot's own weight, per m/s² of gravity."""
        return self._response.twist[..., _WEIGHT]

    @cached_property
    def payload_twist(self) -> Array:
        """Twist (p, 6) of the platform under the payload."""
        return self._response.twist[..., _PAYLOAD] - self.tool_compliance @ self.payload

    @cached_property
    def tool_compliance(self) -> Array:
        """Compliance (6, 6) between platform and tool: it yields to the applied wrench alone."""
        added = [c["platform"].compliance for c in self.changes if "platform" in c]
        return sum((c for c in added if c is not None), self.at.robot.compliances["platform"])

    def _wrench(self, name: str) -> Array:
        return np.broadcast_to(self._response.elements[name].wrench, (len(self.at.poses), 6, 8))

    def transmitted(self, name: str) -> Array:
        """Wrench (p, 6, 6) on an element for unit wrenches at M, in its own axes."""
        return self._wrench(name)[..., :6]

    def dead_wrench(self, name: str, gravity: float) -> Array:
        """Wrench (p, 6) on an element under the robot's weight and its payload."""
        wrench = self._wrench(name)
        return gravity * wrench[..., _WEIGHT] + wrench[..., _PAYLOAD]

    def drive_force(self, drive: str) -> Array:
        """Force (p, 6) of a drive for unit wrenches at M; just as well the tool's twist for a shift of the drive."""
        name, axis = DRIVES[drive]
        return self.transmitted(name)[:, axis]

    def dead_drive_force(self, drive: str, gravity: float) -> Array:
        """Force (p,) of a drive under the robot's weight and its payload."""
        name, axis = DRIVES[drive]
        return self.dead_wrench(name, gravity)[:, axis]

    @cached_property
    def offset_twist(self) -> Array:
        """Twist (p, 6) of the unloaded tool by offsets of elements, with its rigid part exact."""
        out = np.zeros((len(self.at.poses), 6))
        if self._errors.any():
            geometry, there = self.at.robot.elastic.geometry, self.at.poses + self.displacement
            ahead, behind = (_displaced(geometry, there, sign * _SMALL * self._errors) for sign in (1.0, -1.0))
            out[:, :3] = self.displacement - (ahead - behind) / (2.0 * _SMALL)
        for changes in self.changes:
            for name, change in changes.items():
                if change.offset is not None:
                    out = out + np.swapaxes(self.transmitted(name), -1, -2) @ change.offset
        return out


def _displaced(geometry: Geometry, poses: Array, errors: Array) -> Array:
    """Translation (p, 3) of M by errors (5,) of drives and of each limb's mean link, by the circles it runs on."""
    sine = (poses[:, 2] - geometry.l1 - geometry.l2) / geometry.L
    reach = geometry.L * np.sqrt(1.0 - sine**2) + geometry.l
    first, second = reach - poses[:, 0] + errors[0], reach + poses[:, 0] + errors[1]
    links = geometry.L + errors[3:]
    between = first + second - 2.0 * geometry.l
    along = (between**2 + links[0] ** 2 - links[1] ** 2) / (2.0 * between)
    if not (np.abs(along) < links[0]).all():
        raise InputError("loop closure: no solution for these geometric errors")
    x = geometry.l - first + along
    z = geometry.l1 + geometry.l2 + np.sqrt(links[0] ** 2 - along**2)
    return np.column_stack([x - poses[:, 0], np.full(len(poses), errors[2]), z - poses[:, 2]])

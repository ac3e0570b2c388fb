"""Mechanics of the nominal robot as a diagnosis needs it: the only module of this room that uses `stiffscope.vjm`.

Everything here is of the Biglide: names of drives, closed-form rigid kinematics, bounds of its stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.robot.effects import changed
from stiffscope.robot.published_model import published_model
from stiffscope.vjm.kinematics import configure
from stiffscope.vjm.mechanism import TOOL
from stiffscope.vjm.statics import respond, stiffness

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from stiffscope.robot.effects import Changes, NominalRobot
    from stiffscope.robot.published_model import Dimensions, PublishedModel
    from stiffscope.vjm.kinematics import Configurations
    from stiffscope.vjm.loading import Response

    Array = NDArray[np.floating[Any]]

DRIVES = {"stage": "stage.actuator", "limb1": "limb1.actuator", "limb2": "limb2.actuator"}
"""Element of each drive; it moves along the x of its own axes."""
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

    @cached_property
    def model(self) -> PublishedModel:
        """The robot wherever its drives stand: errors may lead out of their ranges."""
        return published_model(self.robot.mechanism, self.robot.robot.parameters)

    @cached_property
    def configurations(self) -> Configurations:
        """The robot at its tool points. Raises InputError for one that it cannot reach."""
        return configure(self.model.mechanism, self.poses).required()

    def drive_centre(self) -> float:
        """Middle of the range of the two sliding drives, m."""
        dimensions = self.model.dimensions
        return 0.5 * (dimensions.a_min + dimensions.a_max)

    @cached_property
    def weight_stiffness(self) -> Array:
        """Change (p, 6, 6) of the stiffness when the robot's own weight acts."""
        mechanism, found = self.model.mechanism, self.configurations
        return stiffness(mechanism, found, gravity="exact") - stiffness(mechanism, found)

    def stiffness_bounds(self) -> Array:
        """Diagonals (p, 6) of the stiffness that no machine of these parts can exceed."""
        return self.model.bounds(self.model.dimensions.link_angle(self.poses))

    def workspace(self, y: float) -> Array:
        """Tool points (k, 3) on a grid all over the workspace, at one y."""
        d = self.model.dimensions
        reach = np.arccos((np.clip([d.a_max, d.a_min], d.l, d.l + d.L) - d.l) / d.L)
        half = 0.5 * (d.a_max - d.a_min)
        low, high = (float(z) for z in d.tool_point(reach)[:, 2])
        points = np.array(list(product(np.linspace(-half, half, _GRID), [y], np.linspace(low, high, _GRID))))
        return points[configure(self.robot.mechanism, points).valid]


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

        def along(name: str) -> float:
            offsets = [c[name].offset for c in self.changes if name in c]
            return float(sum(o[0] for o in offsets if o is not None))

        links = [np.mean([along(f"limb{i}.link{j}") for j in (1, 2, 3)]) for i in (1, 2)]
        return np.array([*(along(DRIVES[drive]) for drive in ("limb1", "limb2", "stage")), *links])

    @cached_property
    def displacement(self) -> Array:
        """Translation (p, 3) of the tool by errors of the rigid mechanism, exactly."""
        if not self._errors.any():
            return np.zeros((len(self.at.poses), 3))
        return _displaced(self.at.model.dimensions, self.at.poses, self._errors)

    @cached_property
    def _response(self) -> Response:
        """Six unit wrenches at M, one m/s² of gravity on the robot's weight, the payload."""
        nominal, found = self.at.model.mechanism, self.at.configurations
        if self._errors.any():
            found = configure(nominal, self.at.poses + self.displacement).required()
        mechanism = nominal
        for change in self.changes:
            mechanism = changed(mechanism, change)
        loads = np.column_stack([np.eye(6), np.zeros(6), self.payload])
        per_unit = 1.0 / (self.at.robot.acceleration or np.inf)
        return respond(mechanism, found, loads, gravity=per_unit * np.eye(8)[_WEIGHT])

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
        added = [c[TOOL].compliance for c in self.changes if TOOL in c]
        return sum((c for c in added if c is not None), self.at.robot.compliances[TOOL])

    def _wrench(self, name: str) -> Array:
        return np.broadcast_to(self._response.elements[name].wrench, (len(self.at.poses), 6, 8))

    def transmitted(self, name: str) -> Array:
        """Wrench (p, 6, 6) on an element for unit wrenches at M, in its own axes."""
        return self._wrench(name)[..., :6]

    def dead_wrench(self, name: str, gravity: float) -> Array:
        """Wrench (p, 6) on an element under the robot's weight and its payload, which the tool's does not cross."""
        wrench = self._wrench(name)
        if name == TOOL:
            return np.zeros_like(wrench[..., _WEIGHT])
        return gravity * wrench[..., _WEIGHT] + wrench[..., _PAYLOAD]

    def drive_force(self, drive: str) -> Array:
        """Force (p, 6) of a drive for unit wrenches at M; just as well the tool's twist for a shift of the drive."""
        return self.transmitted(DRIVES[drive])[:, 0]

    def dead_drive_force(self, drive: str, gravity: float) -> Array:
        """Force (p,) of a drive under the robot's weight and its payload."""
        return self.dead_wrench(DRIVES[drive], gravity)[:, 0]

    @cached_property
    def offset_twist(self) -> Array:
        """Twist (p, 6) of the unloaded tool by offsets of elements, with its rigid part exact."""
        out = np.zeros((len(self.at.poses), 6))
        if self._errors.any():
            dimensions, there = self.at.model.dimensions, self.at.poses + self.displacement
            ahead, behind = (_displaced(dimensions, there, sign * _SMALL * self._errors) for sign in (1.0, -1.0))
            out[:, :3] = self.displacement - (ahead - behind) / (2.0 * _SMALL)
        for changes in self.changes:
            for name, change in changes.items():
                if change.offset is not None:
                    out = out + np.swapaxes(self.transmitted(name), -1, -2) @ change.offset
        return out


def _displaced(geometry: Dimensions, poses: Array, errors: Array) -> Array:
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

"""Campaign templates: example sensors and loads of a robot, and a plan of readings to fill in."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.campaign.campaign import LoadPoint, Sensor
from stiffscope.gap.campaign.quantities import WRENCH
from stiffscope.gap.campaign.writing import describe_sensor, write_campaign
from stiffscope.robot.mechanism_of import (
    configured_poses,
    mechanism_of,
    rigid_mechanism,
)
from stiffscope.robot.part_matrices import rigid_part, used_parts
from stiffscope.runtime import output

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.types import Indices
    from stiffscope.vjm.model.screws import Array

POSES = 8
FORCE = 100.0  # N: example
_SPREAD = 0.1  # range about home, relative to the robot's size, without a map


@dataclass(frozen=True)
class Plan:
    """Planned readings: n rows at p poses."""

    poses: Array
    """Poses (p, k)."""
    sensors: tuple[Sensor, ...]
    hooks: tuple[LoadPoint, ...]
    pulls: tuple[tuple[int, Array], ...]
    """Index of the hook, -1 without a load, and the force (3,) there, N."""
    settings: Indices
    """Indices (n, 3) of pose, pull and sensor of each reading."""

    def select(self, rows: Sequence[int]) -> Plan:
        """Return some of the readings, sorted by settings, without anything unused."""
        chosen: list[list[int]] = sorted(self.settings[list(rows)].tolist())
        poses, pulls, sensors = (sorted({row[k] for row in chosen}) for k in range(3))
        hooks = sorted({self.pulls[k][0] for k in pulls} - {-1})
        places = {hook: place for place, hook in enumerate(hooks)} | {-1: -1}
        return Plan(
            self.poses[poses],
            tuple(self.sensors[k] for k in sensors),
            tuple(self.hooks[k] for k in hooks),
            tuple(
                (places[hook], force)
                for hook, force in map(self.pulls.__getitem__, pulls)
            ),
            np.array(
                [
                    [poses.index(p), pulls.index(k), sensors.index(s)]
                    for p, k, s in chosen
                ]
            ),
        )


def write_template(
    robot: RobotFile, name: str, folder: Path, plan: Plan | None = None
) -> tuple[int, int]:
    """Write a campaign folder to be filled in.

    Parameters
    ----------
    robot
        The measured robot.
    name
        Its name in the campaign: that of a bundled robot, or a path relative to the folder.
    folder
        The folder to create.
    plan
        Readings to take; by default every example sensor under every load at some poses.

    Returns
    -------
    tuple of int
        Numbers of poses and of readings in the plan.

    Raises
    ------
    InputError
        The folder exists or cannot be written.
    """
    plan = plan or example_plan(robot)
    with output.staged_folder(folder, new=True) as aside:
        write_plan(robot, name, aside, plan)
    return len(plan.poses), len(plan.settings)


def write_plan(robot: RobotFile, name: str, folder: Path, plan: Plan) -> None:
    """Write the files of a plan into a folder; see `write_template`."""
    header: dict[str, Any] = {
        "robot": name,
        "modelled": ["gravity"] if _weighs(robot) else [],
        "ignore": ["remark"],
        "sensors": {
            s.name: describe_sensor(
                s.measures, s.body, s.at, s.direction, against=s.against, zero=s.zero
            )
            for s in plan.sensors
        },
        "loads": {
            hook.name: {"body": hook.body, "at": list(hook.at)} for hook in plan.hooks
        },
    }
    write_campaign(folder, header, _columns(robot, plan), comment=_advice(robot))


def example_plan(robot: RobotFile) -> Plan:
    """Return all example sensors, with a load along each axis and unloaded, at planned poses."""
    hook = LoadPoint("hook", robot.tool.body, _tuple(robot.tool.at))
    pulls = (*((0, FORCE * axis) for axis in np.eye(3)), (-1, np.zeros(3)))
    return cross_plan(planned_poses(robot), example_sensors(robot), (hook,), pulls)


def cross_plan(
    poses: Array,
    sensors: Sequence[Sensor],
    hooks: Sequence[LoadPoint],
    pulls: Sequence[tuple[int, Array]],
) -> Plan:
    """Return a plan of every sensor under every pull at every pose.

    Parameters
    ----------
    poses
        Commanded poses (p, k), m and rad.
    sensors, hooks
        Sensors, and points where loads act.
    pulls
        Index of a hook (-1: at M) and wrench (6,), N and N·m, of each load.
    """
    settings = np.array(
        [*product(range(len(poses)), range(len(pulls)), range(len(sensors)))]
    )
    return Plan(poses, tuple(sensors), tuple(hooks), tuple(pulls), settings)


def example_sensors(robot: RobotFile) -> tuple[Sensor, ...]:
    """Return a dial gauge along each axis at the tool, and an inclinometer of unknown zero."""
    level = Sensor(
        "level", robot.tool.body, (0.0, 1.0, 0.0), measures="rotation", zero="session"
    )
    return (*place_gauges("gauge", robot.tool.body, robot.tool.at), level)


def place_gauges(name: str, body: str, at: object) -> tuple[Sensor, ...]:
    """Return a dial gauge along each axis at a point (3,) of a body."""
    axes = zip("xyz", np.eye(3), strict=True)
    place = _tuple(at)
    return tuple(
        Sensor(f"{name}_{axis}", body, _tuple(along), place) for axis, along in axes
    )


def planned_poses(robot: RobotFile) -> Array:
    """Return the robot's named poses and other reachable ones throughout its map, (p, k)."""
    from scipy.stats import qmc  # pyright: ignore[reportMissingTypeStubs]

    mechanism = mechanism_of(
        robot, {name: rigid_part(robot, name) for name in used_parts(robot)}
    )
    home = mechanism.tool.home
    ranges = robot.map.ranges() if robot.map is not None else {}
    size = float(
        np.ptp(np.array([joint.at for joint in mechanism.joints]), axis=0).max()
    )
    low = home.copy()
    high = home.copy()
    for k, coordinate in enumerate(mechanism.tool.pose):
        reach = _SPREAD if coordinate.startswith("r") else _SPREAD * size
        low[k], high[k] = ranges.get(coordinate, (home[k] - reach, home[k] + reach))
    shares = np.asarray(qmc.Halton(len(home), scramble=False).random(6 * POSES)[1:])
    others = low + shares * (high - low)
    named = np.array(list(robot.poses.values()))
    others = np.round(others[configured_poses(robot, mechanism, others).valid], 4)
    return np.vstack([named, others])[: max(POSES, len(named))]


def _columns(robot: RobotFile, plan: Plan) -> dict[str, list[str]]:
    """Return the columns of readings.csv as text."""
    last = ("sensor", "kind", "value", "sigma", "session", "remark")
    settings: list[list[int]] = plan.settings.tolist()
    rows: list[list[str]] = []
    for pose, pull, which in settings:
        (hook, force) = plan.pulls[pull]
        sensor = plan.sensors[which]
        load = (
            [plan.hooks[hook].name, *(f"{component:g}" for component in force)]
            if hook >= 0
            else [""] * 4
        )
        kind = "deflection" if hook >= 0 else "deviation"
        sigma = "5e-06" if sensor.rotates else "1e-06"
        place = (f"{value:.10g}" for value in plan.poses[pose])
        rows.append([*place, *load, sensor.name, kind, "", sigma, "first", ""])
    names = (*robot.tool.pose, "load", *WRENCH[:3], *last)
    return dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))


def _advice(robot: RobotFile) -> str:
    return f"""A campaign on {robot.name}. Fill in value in readings.csv, one row per reading; delete rows
without a reading; then: stiffscope campaign check FOLDER, and stiffscope diagnose FOLDER --out OUT.
Instead of a sensor a row may have a quantity at M in a column quantity: dx dy dz drx dry drz, deflections
by the wrench; ex ey ez erx ery erz, deviations of the unloaded tool; kx..., px..., stiffness with other
motions held or free; f1 f2 ..., natural frequencies in Hz.

modelled: effects already in the nominal model. {_tell_weight(robot)}
components = "fea", "beam" or "published": source of the parts' matrices; as in the robot file without it.
units = {{ value = "um", sigma = "um" }}: units by column; SI without it.
Bodies: {", ".join(robot.bodies)}; an elastic one has two ends, NAME.base and NAME.tip. Positions at home, base axes.
zero = "session": one unknown zero offset of the sensor per session."""


def _weighs(robot: RobotFile) -> bool:
    """Return whether a robot file states what weighs, and along which direction."""
    bodies = rigid_mechanism(robot).bodies
    return robot.gravity is not None and any(body.mass for body in bodies)


def _tell_weight(robot: RobotFile) -> str:
    if _weighs(robot):
        return (
            "This robot file has masses and [gravity]:\n"
            "its own weight is modelled, also without this key; [] says on purpose that it is not."
        )
    lacks = "masses" if robot.gravity is not None else "[gravity]"
    return (
        f"This robot file has no {lacks}: no weight\n"
        "acts in the model, and no payload is found from sag; state both where the robot is read at rest."
    )


def _tuple(values: object) -> tuple[float, float, float]:
    x, y, z = (round(float(v), 9) for v in np.array(values))
    return x, y, z

"""A campaign folder to start from: sensors and loads of a robot as examples, and a plan of readings to fill in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.campaign.campaign import LoadPoint, Sensor
from stiffscope.gap.campaign.quantities import WRENCH
from stiffscope.gap.campaign.writing import write_campaign
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.part_matrices import rigid_part, used_parts
from stiffscope.runtime import output
from stiffscope.vjm.kinematics import configure

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.vjm.screws import Array

POSES = 8
FORCE = 100.0  # N: an example
_SPREAD = 0.1  # of the robot's size, about home, where its file has no map


def write_template(robot: RobotFile, name: str, folder: Path) -> tuple[int, int]:
    """Write a campaign folder to be filled in.

    Parameters
    ----------
    robot
        The robot that is measured.
    name
        How the campaign names it: a name that the project knows, or a path seen from the folder.
    folder
        The folder to write, which is not there yet.

    Returns
    -------
    tuple of int
        Numbers of poses and of readings in the plan.

    Raises
    ------
    InputError
        The folder is there, or cannot be written.

    """
    with output.new_folder(folder) as aside:
        sensors, hook = example_sensors(robot), LoadPoint("hook", robot.tool.body, _tuple(robot.tool.at))
        poses = planned_poses(robot)
        columns = _plan(robot, poses, sensors, hook)
        header: dict[str, Any] = {
            "robot": name,
            "modelled": ["gravity"] if robot.gravity else [],
            "components": "fea",
            "ignore": ["remark"],
            "sensors": {sensor.name: _section(sensor) for sensor in sensors},
            "loads": {hook.name: {"body": hook.body, "at": list(hook.at)}},
        }
        write_campaign(aside, header, columns, comment=_advice(robot))
    return len(poses), len(columns["value"])


def example_sensors(robot: RobotFile) -> tuple[Sensor, ...]:
    """A dial gauge along each axis at the tool point, and an inclinometer whose zero is not known."""
    body, at = robot.tool.body, _tuple(robot.tool.at)
    gauges = [
        Sensor(f"gauge_{axis}", body, _tuple(direction), at) for axis, direction in zip("xyz", np.eye(3), strict=True)
    ]
    return (*gauges, Sensor("level", body, (0.0, 1.0, 0.0), measures="rotation", zero="session"))


def planned_poses(robot: RobotFile) -> Array:
    """The robot's named poses, and others all over what its map sweeps, within reach, (p, k)."""
    from scipy.stats import qmc  # pyright: ignore[reportMissingTypeStubs]

    mechanism = mechanism_of(robot, {name: rigid_part(robot, name) for name in used_parts(robot)})
    home = mechanism.tool.home
    ranges = robot.map.ranges() if robot.map is not None else {}
    size = float(np.ptp(np.array([joint.at for joint in mechanism.joints]), axis=0).max())
    low, high = home.copy(), home.copy()
    for k, coordinate in enumerate(mechanism.tool.pose):
        reach = _SPREAD if coordinate.startswith("r") else _SPREAD * size
        low[k], high[k] = ranges.get(coordinate, (home[k] - reach, home[k] + reach))
    others = low + np.asarray(qmc.Halton(len(home), scramble=False).random(6 * POSES)[1:]) * (high - low)
    named = np.array(list(robot.poses.values()) or [home])
    others = np.round(others[configure(mechanism, others).valid], 4)
    return np.vstack([named, others])[: max(POSES, len(named))]


def _plan(robot: RobotFile, poses: Array, sensors: tuple[Sensor, ...], hook: LoadPoint) -> dict[str, list[str]]:
    """Columns of text: every gauge under a load along each axis, then everything unloaded, at every pose."""
    out: dict[str, list[str]] = {
        name: []
        for name in (*robot.tool.pose, "load", *WRENCH[:3], "sensor", "kind", "value", "sigma", "session", "remark")
    }
    for pose in poses:
        for load in (*np.eye(3), np.zeros(3)):
            loaded = bool(load.any())
            for sensor in sensors:
                for name, value in zip(robot.tool.pose, pose, strict=True):
                    out[name].append(f"{value:.10g}")
                out["load"].append(hook.name if loaded else "")
                for name, value in zip(WRENCH[:3], FORCE * load, strict=True):
                    out[name].append(f"{value:g}" if loaded else "")
                out["sensor"].append(sensor.name)
                out["kind"].append("deflection" if loaded else "deviation")
                out["sigma"].append("1e-06" if not sensor.rotates else "5e-06")
                out["session"].append("first")
                out["value"].append("")
                out["remark"].append("")
    return out


def _section(sensor: Sensor) -> dict[str, Any]:
    at = {} if sensor.rotates else {"at": list(sensor.at)}
    rest = {"direction": list(sensor.direction), "against": sensor.against, "zero": sensor.zero}
    return {"measures": sensor.measures, "body": sensor.body, **at, **rest}


def _advice(robot: RobotFile) -> str:
    return f"""A campaign on {robot.name}. Fill in the column value of readings.csv, a reading a row; delete rows
that you do not take; then: stiffscope campaign check FOLDER, and stiffscope diagnose FOLDER --out OUT.
Instead of a sensor a row may have a quantity at M in a column quantity: dx dy dz drx dry drz, deflections
by the wrench; ex ey ez erx ery erz, deviations of the unloaded tool; kx..., px..., stiffness with other
motions held or free; f1 f2 ..., natural frequencies in Hz.

modelled: what the nominal model already carries; components: the parts' matrices, fea, beam or published.
units = {{ value = "um", sigma = "um" }}: units by column; SI without it.
Bodies: {", ".join(robot.bodies)}; an elastic one has two ends, NAME.base and NAME.tip. Positions at home, base axes.
zero = "session": the sensor's zero is one unknown constant a session."""


def _tuple(values: object) -> tuple[float, float, float]:
    x, y, z = (round(float(v), 9) for v in np.array(values))
    return x, y, z

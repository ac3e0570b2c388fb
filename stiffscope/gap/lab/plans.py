"""Measurement plans of a lab: reachable poses, admissible loads, gauges and a hook."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.lab.closure import home_of, locate
from stiffscope.gap.lab.measuring import Plan, Sensor
from stiffscope.gap.lab.response import Spot, respond, tool_spot

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.gap.lab.closure import Located
    from stiffscope.gap.lab.machine import Machine
    from stiffscope.gap.lab.rotations import Array

Style = Literal["tool", "gauges", "sag"]
"""The tool's pose with and without loads; five gauges and a hook; the unloaded tool only."""

FORCE, MOMENT = 500.0, 100.0  # N, N·m: loads of a device, increased for robots stiffer than
_STIFF = (8e-8, 1.3e-6)  # m/N, rad/(N·m)
_DEFLECTION = (4e-4, 8e-4)  # m, rad: largest intended deflections at home
_INSIDE = 0.85  # fraction of a coordinate's range that is used
_TILT = 0.12  # rad: default range of rotations
_SOFT = 30.0  # largest compliance over that at home, to avoid singularities
_GIVEN_UP = 30  # most draws of the wanted number of poses


@dataclass(frozen=True)
class Scale:
    """Translational and rotational compliance of a sound robot at home, m/N and rad/(N·m)."""

    linear: float
    angular: float

    @property
    def force(self) -> float:
        """Force that a lab applies, N."""
        return min(FORCE * max(1.0, _round(_STIFF[0] / self.linear)), _round(_DEFLECTION[0] / self.linear))

    @property
    def moment(self) -> float:
        """Moment that a lab applies, N·m."""
        return min(MOMENT * max(1.0, _round(_STIFF[1] / self.angular)), _round(_DEFLECTION[1] / self.angular))


def _round(value: float) -> float:
    """Round to two digits."""
    digits = int(np.floor(np.log10(value))) - 1
    return float(np.round(value, -digits))


def scale_of(machine: Machine) -> Scale:
    """Return the median compliances of a robot at home."""
    tool = tool_spot(machine)
    c = np.diagonal(respond(machine, home_of(machine)[None], [tool]).find_twists(tool)[0, :, :6])
    return Scale(float(np.median(c[:3])), float(np.median(c[3:])))


def ranges(machine: Machine) -> Array:
    """Return the range (k, 2) of each commanded coordinate, from the file's map or the others."""
    home = home_of(machine)
    known = {} if machine.robot.map is None else machine.robot.map.ranges()
    spans = [high - low for name, (low, high) in known.items() if not name.startswith("r")]
    like = 0.5 * float(np.mean(spans)) if spans else 0.1
    out = np.empty((len(home), 2))
    for k, name in enumerate(machine.pose):
        half = _TILT if name.startswith("r") else like
        low, high = known.get(name, (home[k] - half, home[k] + half))
        middle, reach = 0.5 * (low + high), 0.5 * _INSIDE * (high - low)
        out[k] = middle - reach, middle + reach
    return out


@dataclass(frozen=True)
class Workspace:
    """A sound machine with poses throughout its workspace."""

    machine: Machine
    scale: Scale
    poses: Array
    """Poses (n, k), m and rad."""
    located: Located
    """Configuration of its bodies at the poses."""

    def some(self, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
        """Return the indices (count,) of some random poses."""
        return rng.permutation(len(self.poses))[:count]


def workspace(machine: Machine, count: int, rng: np.random.Generator) -> Workspace:
    """Return reachable poses throughout the workspace of a sound machine, away from singularities.

    Raises InputError if hardly any pose is reachable.
    """
    tool, box = tool_spot(machine), ranges(machine)
    limit = _SOFT * respond(machine, home_of(machine)[None], [tool]).find_twists(tool)[0, :, :6].diagonal()
    limit = limit.reshape(2, 3).max(axis=1).repeat(3)
    found = np.empty((0, len(box)))
    for _ in range(_GIVEN_UP):
        trial = np.round(rng.uniform(box[:, 0], box[:, 1], (count, len(box))), 4)
        located = locate(machine, trial)
        if located.closed.any():
            yields = respond(machine, located.some(located.closed), [tool]).find_twists(tool)[:, :, :6]
            soft = (np.abs(np.einsum("nii->ni", yields)) > limit).any(axis=1)
            found = np.concatenate([found, trial[located.closed][~soft]])[:count]
        if len(found) == count:
            return Workspace(machine, scale_of(machine), found, locate(machine, found))
    raise InputError(
        f"{machine.robot.name}: expected a [map] within reach, got poses of which hardly any can be reached"
    )


def draw_plan(
    where: Workspace,
    rng: np.random.Generator,
    style: Style = "tool",
    *,
    poses: int = 12,
    wrenches: int = 10,
    stiffness: Literal["", "k", "p"] = "",
    sessions: int = 1,
) -> tuple[Plan, Located]:
    """Return a plan with poses throughout a workspace, and the sound machine's configuration there.

    Loads act along each axis, then in random directions, at M, or for gauges at a hook. Without
    loads, three times as many poses are read.

    Parameters
    ----------
    where
        Reachable poses of a sound machine.
    rng
        Random generator of poses and loads.
    style
        Loading and reading: "tool", "gauges", or "sag" without loads.
    poses, wrenches
        Numbers of poses, and of wrenches at each.
    stiffness
        "k" or "p" to read stiffnesses too, from all six unit wrenches or from single pushes.
    sessions
        Number of sessions.

    """
    machine, scale = where.machine, where.scale
    chosen = where.some(poses if style != "sag" else 3 * poses, rng)
    places, located = where.poses[chosen], where.located.some(chosen)
    if style == "sag":
        return Plan(places, (), stiffness=stiffness, sessions=sessions), located
    size = np.array([scale.force] * 3 + [scale.moment] * 3)
    if style == "tool":
        mixed = rng.uniform(-1, 1, (max(wrenches - 6, 0), 6)) * size
        loads = np.round(np.vstack([np.diag(size), mixed])[:wrenches], 3)
        return Plan(places, tuple(("", w) for w in loads), stiffness=stiffness, sessions=sessions), located
    reach = float(
        np.clip(np.sqrt(scale.linear / scale.angular), 0.03, 0.15)
    )  # m: lever at which forces rotate as much as they translate
    hook = Spot(machine.tool, np.round(machine.at + rng.uniform(-1, 1, 3) * reach, 4))
    pulls = np.vstack([np.eye(3), -np.eye(3)[2:], rng.uniform(-1, 1, (max(wrenches - 4, 0), 3))])[:wrenches]
    loads = [("hook", np.round(np.concatenate([scale.force * pull, np.zeros(3)]), 3)) for pull in pulls]
    gauges = _gauges(machine, reach, rng)
    return Plan(places, tuple(loads), {"hook": hook}, gauges, stiffness=stiffness, sessions=sessions), located


def _gauges(machine: Machine, reach: float, rng: np.random.Generator) -> tuple[Sensor, ...]:
    """Return five dial gauges around the tool's body: three vertical and two horizontal."""
    directions = np.eye(3)[[2, 2, 2, 0, 1]]
    feet = np.array([[1.0, 0, 0], [-0.5, 0.9, 0], [-0.5, -0.9, 0], [0, 0.7, 0.4], [0.7, 0, -0.4]])
    points = np.round(machine.at + reach * (feet + rng.uniform(-0.2, 0.2, feet.shape)), 4)
    return tuple(
        Sensor(f"gauge{k + 1}", "displacement", machine.tool, point, direction)
        for k, (point, direction) in enumerate(zip(points, directions, strict=True))
    )

"""Measurement plans of a lab: reachable poses, admissible loads, gauges and a hook."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from stiffscope.errors import InputError
from stiffscope.lab.closure import home_of, locate
from stiffscope.lab.measuring import Plan, Sensor
from stiffscope.lab.response import Spot, respond, tool_spot
from stiffscope.lab.rotations import turn

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from stiffscope.lab.closure import Located
    from stiffscope.lab.machine import Machine
    from stiffscope.lab.rotations import Array

Style = Literal["tool", "gauges", "sag", "tracker", "hammer"]
"""The tool's pose with and without loads; five gauges and a hook; the unloaded tool only; positions
of three targets on the tool, with and without loads, by a tracker that stands anywhere; frequency
responses by hammer."""

FORCE = 500.0
MOMENT = 100.0  # N, N·m: loads of a device, increased for robots stiffer than
_STIFF = (8e-8, 1.3e-6)  # m/N, rad/(N·m)
_RIGID = (
    1e-6  # compliance over that of a stiff robot, below which an axis counts as rigid
)
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
        return _choose_load(FORCE, self.linear, _STIFF[0], _DEFLECTION[0])

    @property
    def moment(self) -> float:
        """Moment that a lab applies, N·m."""
        return _choose_load(MOMENT, self.angular, _STIFF[1], _DEFLECTION[1])


def _choose_load(
    usual: float, compliance: float, stiff: float, deflection: float
) -> float:
    """Return the usual load, larger for stiff robots, and at most that for a deflection."""
    growth, most = (float(f"{size / compliance:.1e}") for size in (stiff, deflection))
    return min(usual * max(1.0, growth), most)


def diagonal_at(machine: Machine, poses: Array | Located) -> Array:
    """Return the diagonal (n, 6) of the compliance at M, at poses (n, k)."""
    tool = tool_spot(machine)
    return np.einsum(
        "nii->ni", respond(machine, poses, [tool]).find_twists(tool)[:, :, :6]
    )


def ranges(machine: Machine) -> Array:
    """Return the range (k, 2) of each commanded coordinate, from the file's map or the others."""
    home = home_of(machine)
    known = {} if machine.robot.map is None else machine.robot.map.ranges()
    spans = [
        high - low for name, (low, high) in known.items() if not name.startswith("r")
    ]
    like = 0.5 * float(np.mean(spans)) if spans else 0.1
    out = np.empty((len(home), 2))
    for k, name in enumerate(machine.pose):
        half = _TILT if name.startswith("r") else like
        low, high = known.get(name, (home[k] - half, home[k] + half))
        middle = 0.5 * (low + high)
        reach = 0.5 * _INSIDE * (high - low)
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


def workspace(
    machine: Machine,
    count: int,
    rng: np.random.Generator,
    known: Callable[[Array], NDArray[np.bool_]] | None = None,
) -> Workspace:
    """Return reachable poses throughout the workspace of a sound machine, away from singularities.

    Parameters
    ----------
    machine, count, rng
        The machine, the number of poses, and the random generator that draws them.
    known
        Returns which poses (n, k) the robot's model reaches too; default: all. The machine steps past
        singular poses between its own steps.

    Raises
    ------
    InputError
        Hardly any pose is reachable.
    """
    box = ranges(machine)
    yields = diagonal_at(machine, home_of(machine)[None])[0].reshape(2, 3)
    limit = _SOFT * yields.max(axis=1).repeat(3)
    own = (row[row > _RIGID * stiff] for row, stiff in zip(yields, _STIFF, strict=True))
    scale = Scale(
        *(
            float(np.median(row if len(row) else stiff))
            for row, stiff in zip(own, _STIFF, strict=True)
        )
    )
    found = np.empty((0, len(box)))
    for _ in range(_GIVEN_UP):
        trial = np.round(rng.uniform(box[:, 0], box[:, 1], (count, len(box))), 4)
        located = locate(machine, trial)
        if located.closed.any():
            there = np.abs(diagonal_at(machine, located.some(located.closed)))
            firm = trial[located.closed][(there <= limit).all(axis=1)]
            found = np.concatenate(
                [found, firm[known(firm)] if known and len(firm) else firm]
            )[:count]
        if len(found) == count:
            return Workspace(machine, scale, found, locate(machine, found))
    message = (
        "expected a [map] within reach, got poses of which hardly any can be reached"
    )
    raise InputError(f"{machine.robot.name}: {message}")


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
    loads, three times as many poses are read; by a tracker twice as many, each with four loads in
    random directions.

    Parameters
    ----------
    where
        Reachable poses of a sound machine.
    rng
        Random generator of poses and loads.
    style
        Loading and reading: "tool", "gauges", "tracker", or "sag" without loads.
    poses, wrenches
        Numbers of poses, and of wrenches at each.
    stiffness
        "k" or "p" to read stiffnesses too, from all six unit wrenches or from single pushes.
    sessions
        Number of sessions.
    """
    machine = where.machine
    scale = where.scale
    times = {"sag": 3, "tracker": 2}.get(style, 1)
    chosen = rng.permutation(len(where.poses))[: times * poses]
    plan = Plan(where.poses[chosen], (), stiffness=stiffness, sessions=sessions)
    located = where.located.some(chosen)
    size = np.array([scale.force] * 3 + [scale.moment] * 3)
    reach = float(np.clip(np.sqrt(scale.linear / scale.angular), 0.03, 0.15))
    if style == "sag":
        return plan, located
    if style == "tool":
        point = ""
        loads = np.diag(size)[:wrenches]
        mixed = rng.uniform(-1, 1, (max(wrenches - 6, 0), 6)) * size
    elif style == "tracker":
        point = ""
        loads = np.zeros((0, 6))
        mixed = rng.uniform(-1, 1, (4, 6)) * size
        targets = _draw_targets(machine, reach, rng)
        frame = turn(rng.uniform(-np.pi, np.pi, 3)), rng.uniform(-3.0, 3.0, 3)
        plan = replace(plan, sensors=targets, frame=frame)
    else:  # with the lever at which forces rotate as much as they translate
        at = np.round(machine.at + rng.uniform(-1, 1, 3) * reach, 4)
        point = "hook"
        loads = scale.force * np.eye(6)[[0, 1, 2, 2]][:wrenches]
        loads[3:] *= -1
        mixed = np.pad(
            scale.force * rng.uniform(-1, 1, (max(wrenches - 4, 0), 3)),
            ((0, 0), (0, 3)),
        )
        gauges = _draw_gauges(machine, reach, rng)
        plan = replace(plan, hooks={point: Spot(machine.tool, at)}, sensors=gauges)
    every = np.round(np.vstack([loads, mixed]), 3)
    return replace(plan, loads=tuple((point, wrench) for wrench in every)), located


def _draw_gauges(
    machine: Machine, reach: float, rng: np.random.Generator
) -> tuple[Sensor, ...]:
    """Return five dial gauges around the tool's body: three vertical and two horizontal."""
    directions = np.eye(3)[[2, 2, 2, 0, 1]]
    feet = np.array(
        [[1.0, 0, 0], [-0.5, 0.9, 0], [-0.5, -0.9, 0], [0, 0.7, 0.4], [0.7, 0, -0.4]]
    )
    points = np.round(
        machine.at + reach * (feet + rng.uniform(-0.2, 0.2, feet.shape)), 4
    )
    return tuple(
        Sensor(f"gauge{k}", "displacement", machine.tool, point, direction)
        for k, (point, direction) in enumerate(zip(points, directions, strict=True), 1)
    )


def _draw_targets(
    machine: Machine, reach: float, rng: np.random.Generator
) -> tuple[Sensor, ...]:
    """Return the channels x, y, z of three targets around M on the tool's body."""
    points = np.round(
        machine.at + reach * (np.eye(3) + rng.uniform(-0.2, 0.2, (3, 3))), 4
    )
    return tuple(
        Sensor(f"smr{k}.{axis}", "displacement", machine.tool, point, direction)
        for k, point in enumerate(points, 1)
        for axis, direction in zip("xyz", np.eye(3), strict=True)
    )

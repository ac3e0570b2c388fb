"""Possible next readings: the lab's loads and instruments at poses throughout the workspace."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.campaign import AT_TOOL
from stiffscope.gap.campaign.kinds import CODE_ALONG
from stiffscope.gap.campaign.quantities import DEFLECTION, DEVIATION, label_pose
from stiffscope.gap.forward.robot_at_poses import configure_robot

if TYPE_CHECKING:
    from stiffscope.gap.campaign.campaign import Campaign, Sensor
    from stiffscope.robot.nominal import NominalRobot
    from stiffscope.runtime.types import Array, Flags, Indices

FORCE = 500.0
MOMENT = 100.0  # N, N·m: default range of loads if the campaign has none
DISPLACEMENT = 1e-6
ROTATION = 5e-6  # m, rad: default noise if the campaign has no displacements
_TRIALS = 128  # candidate poses for the next measurement,
_LINE = 32  # and along each coordinate
_HALVINGS = 6  # bisections between two poses to the workspace boundary
_MARGIN = 0.15  # margin on either side of the range of campaign and map


def plan_trial(
    c: Campaign, nominal: NominalRobot, sigma: Array
) -> tuple[Campaign, Array, Indices]:
    """Plan readings without load and with every load axis at its largest, throughout the workspace.

    Parameters
    ----------
    c
        The campaign.
    nominal
        The campaign's nominal robot.
    sigma
        Noise (n,) of its readings.

    Returns
    -------
    tuple
        Possible next readings (t,), their expected noise (t,) and measurement numbers (t,).
    """
    poses = _trial_poses(c, nominal)
    cases = _trial_loads(c)
    channels = np.unique(c.channel[c.is_motion])
    at_tool = channels >= len(c.sensors)
    if at_tool.any() or not len(channels):
        channels = np.concatenate([channels[~at_tool], len(c.sensors) + np.arange(6)])
    sensor = np.where(channels < len(c.sensors), channels, AT_TOOL)
    axes = np.array([s.axis for s in c.sensors] + list(range(6)))
    per = len(channels)
    rows = len(cases) * len(channels)
    n = len(poses) * rows
    load = np.tile(np.repeat([k for k, _ in cases], per), len(poses))
    wrench = np.tile(np.repeat([w for _, w in cases], per, axis=0), (len(poses), 1))
    still = ~wrench.any(axis=1)
    direction = np.tile(axes[channels], n // per)
    trial = replace(
        c,
        pose_names=tuple(
            label_pose(c.coordinates, pose, c.shown_in) for pose in poses.tolist()
        ),
        poses=poses,
        pose=np.repeat(np.arange(len(poses)), rows),
        wrench=wrench,
        quantity=CODE_ALONG[np.where(still, DEVIATION, DEFLECTION), direction],
        value=np.zeros(n),
        sigma=np.ones(n),
        session=np.zeros(n),
        file=np.full(n, -1),  # before any step of an instrument
        line=np.arange(n),
        sensors=tuple(_as_gauge(s) for s in c.sensors),
        expected=None,
        sensor=np.tile(sensor, n // per),
        load=load,
    )
    noise = _displacement_noise(c, sigma)[np.tile(channels, n // per)]
    return trial, noise, np.arange(n) // per


def _as_gauge(sensor: Sensor) -> Sensor:
    """Return a sensor as calibrated by the campaign: zero known, absolute instrument placed."""
    placed = replace(sensor, zero="none")
    return (
        replace(placed, measures="displacement", at_sigma=0.0)
        if sensor.absolute
        else placed
    )


def _trial_poses(c: Campaign, nominal: NominalRobot) -> Array:
    """Return reachable poses (k, d), evenly over the ranges of the campaign and the robot's map."""
    low = c.poses.min(axis=0)
    high = c.poses.max(axis=0)
    sweep = nominal.robot.map
    for k, name in enumerate(c.coordinates):
        span = getattr(sweep, name, None) if sweep is not None else None
        if span is not None and not isinstance(span, float):
            low[k], high[k] = min(low[k], *span), max(high[k], *span)
    margin = _MARGIN * (high - low)
    low = low - margin
    high = high + margin
    from scipy.stats.qmc import Halton  # type: ignore[reportMissingTypeStubs]

    free = np.flatnonzero(high > low)
    tool = nominal.mechanism.tool
    middle = np.median(c.poses, axis=0)
    points = np.repeat(middle[None], _TRIALS, axis=0)
    shares = Halton(len(free), scramble=False).random(_TRIALS)
    points[:, free] = low[free] + shares * (high - low)[free]
    home = tool.home if c.coordinates == tool.pose else 0.0 * middle
    lines = [
        _trace_coordinate(start, k, low[k], high[k])
        for start in (home, middle)
        for k in free.tolist()
    ]
    reached = np.vstack([*lines, points, c.poses[: _TRIALS // 8]])

    def reaches(poses: Array) -> Flags:
        return configure_robot(nominal.mechanism, c.coordinates, poses).valid

    valid = reaches(reached)
    firsts = (
        i
        for i in range(_LINE * len(lines))
        if (i + 1) % _LINE and valid[i] != valid[i + 1]
    )
    ends = [(i, i + 1) if valid[i] else (i + 1, i) for i in firsts]
    inside, outside = (reached[[end[side] for end in ends]] for side in (0, 1))
    for _ in range(_HALVINGS if ends else 0):
        half = 0.5 * (inside + outside)
        good = reaches(half)[:, None]
        inside = np.where(good, half, inside)
        outside = np.where(good, outside, half)
    trial_poses = np.vstack([inside, reached[valid]])
    while not (
        valid := reaches(trial_poses)
    ).all():  # singular poses may depend on others
        trial_poses = trial_poses[valid]
    return trial_poses


def _trial_loads(c: Campaign) -> list[tuple[int, Array]]:
    """Return loads and wrenches (6,): none, and each loaded axis at its largest."""
    out: list[tuple[int, Array]] = [(AT_TOOL, np.zeros(6))]
    for load in range(AT_TOOL, len(c.loads)):
        wrench = np.nan_to_num(c.wrench[c.is_difference & (c.load == load)])
        largest = np.abs(wrench).max(axis=0) if len(wrench) else np.zeros(6)
        out += [(load, row) for row in np.diag(largest) if row.any()]
    if len(out) == 1:
        out += [(AT_TOOL, row) for row in np.diag([FORCE] * 3 + [MOMENT] * 3)]
    return out


def _displacement_noise(c: Campaign, sigma: Array) -> Array:
    """Return the displacement noise of each channel in the campaign's readings."""
    moving = c.is_motion
    turns = [
        *(sensor.rotates for sensor in c.sensors),
        *(axis > 2 for axis in range(6)),
    ]
    out = np.where(turns, ROTATION, DISPLACEMENT)
    for channel in range(len(out)):
        rows = moving & (c.channel == channel)
        if channel >= len(c.sensors):
            rows = (
                moving
                & (c.sensor < 0)
                & (c.direction // 3 == (channel - len(c.sensors)) // 3)
            )
        if rows.any():
            out[channel] = np.median(sigma[rows])
    return out


def _trace_coordinate(start: Array, axis: int, low: float, high: float) -> Array:
    """Return poses (k, d) from a start, with one coordinate over its whole range."""
    out = np.repeat(start[None], _LINE, axis=0)
    out[:, axis] = np.linspace(low, high, len(out))
    return out

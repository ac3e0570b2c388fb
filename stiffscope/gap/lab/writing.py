"""Writing of readings as a campaign folder."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.campaign.quantities import DEVIATION, WRENCH
from stiffscope.gap.campaign.writing import describe_sensor, number_cells, write_campaign
from stiffscope.gap.lab.measuring import KINDS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.gap.lab.measuring import Readings


def write_readings(
    readings: Readings,
    folder: Path,
    *,
    robot: str,
    pose: Sequence[str],
    modelled: Sequence[str] = ("gravity",),
    components: str = "published",
) -> None:
    """Write a campaign folder.

    Parameters
    ----------
    readings
        The readings with their plan.
    folder
        Created if absent.
    robot, modelled, components
        Header fields: nominal robot, effects included in its model, source of its parts' matrices.
    pose
        Names of the pose columns.

    """
    plan = readings.plan
    header: dict[str, Any] = {"robot": robot, "modelled": list(modelled), "components": components}
    header["sensors"] = {
        s.name: describe_sensor(s.measures, s.node, s.at, s.direction, against=s.against)
        for s in plan.sensors
    }  # fmt: skip
    hooks = plan.hooks.items()
    header["loads"] = {name: {"body": spot.node, "at": spot.at.tolist()} for name, spot in hooks}
    columns = {name: number_cells(plan.poses[readings.pose, k]) for k, name in enumerate(pose)}
    if plan.hooks:
        columns["load"] = [plan.loads[k][0] if k >= 0 else "" for k in readings.load.tolist()]
    wrench = np.full((len(readings.value), 6), np.nan)
    for k, (_, stated) in enumerate(plan.loads):
        wrench[readings.load == k] = stated
    wrench[readings.kind == DEVIATION] = 0.0
    columns |= {name: number_cells(wrench[:, k]) for k, name in enumerate(WRENCH)}
    names = [sensor.name for sensor in readings.channels]
    if plan.sensors:
        columns["sensor"] = [names[k] for k in readings.channel.tolist()]
        columns["kind"] = [KINDS[k] for k in readings.kind.tolist()]
    else:
        letters = ("d", "e", plan.stiffness)  # of deflections, deviations, stiffnesses at M
        codes = zip(readings.kind.tolist(), readings.channel.tolist(), strict=True)
        columns["quantity"] = [letters[kind] + names[channel] for kind, channel in codes]
    columns |= {"value": number_cells(readings.value), "sigma": number_cells(readings.sigma)}
    if plan.sessions > 1:
        columns["session"] = [f"day {k + 1}" for k in readings.session.tolist()]
    write_campaign(folder, header, columns)

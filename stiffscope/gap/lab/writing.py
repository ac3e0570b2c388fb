"""Readings written as a campaign folder: campaign.toml and readings.csv."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.lab.measuring import KINDS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from stiffscope.gap.lab.measuring import Readings, Sensor
    from stiffscope.gap.lab.response import Spot
    from stiffscope.gap.lab.rotations import Array

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
_LETTER = ("d", "e")  # quantities at M of deflections and deviations


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
        With their plan.
    folder
        Made if absent.
    robot, modelled, components
        What the header says: the nominal robot, the effects that its model carries, the source of its parts' matrices.
    pose
        Names of the columns of a pose.

    """
    folder.mkdir(parents=True, exist_ok=True)
    plan = readings.plan
    lines = [f"robot = {_quoted(robot)}", f"modelled = [{', '.join(_quoted(name) for name in modelled)}]"]
    lines += [f"components = {_quoted(components)}", 'readings = "readings.csv"']
    for sensor in plan.sensors:
        lines += ["", f"[sensors.{sensor.name}]", *_sensor(sensor)]
    for name, spot in plan.hooks.items():
        lines += ["", f"[loads.{name}]", *_spot(spot)]
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    columns: dict[str, list[str]] = {name: _cells(plan.poses[readings.pose, k]) for k, name in enumerate(pose)}
    if plan.hooks:
        columns["load"] = [plan.loads[k][0] if k >= 0 else "" for k in readings.load.tolist()]
    wrench = np.full((len(readings.value), 6), np.nan)
    for k, (_, stated) in enumerate(plan.loads):
        wrench[readings.load == k] = stated
    wrench[readings.kind == 1] = 0.0
    columns |= {name: _cells(wrench[:, k]) for k, name in enumerate(WRENCH)}
    names = [sensor.name for sensor in readings.channels]
    if plan.sensors:
        columns["sensor"] = [names[k] for k in readings.channel.tolist()]
        columns["kind"] = [KINDS[k] for k in readings.kind.tolist()]
    else:
        letters = (*_LETTER, plan.stiffness)
        codes = zip(readings.kind.tolist(), readings.channel.tolist(), strict=True)
        columns["quantity"] = [letters[kind] + names[channel] for kind, channel in codes]
    columns |= {"value": _cells(readings.value), "sigma": _cells(readings.sigma)}
    if plan.sessions > 1:
        columns["session"] = [f"day {k + 1}" for k in readings.session.tolist()]
    with (folder / "readings.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def _sensor(sensor: Sensor) -> list[str]:
    place = [] if sensor.measures == "rotation" else [f"at = {_list(sensor.at)}"]
    return [
        f"measures = {_quoted(sensor.measures)}", f"body = {_quoted(sensor.node)}", *place,
        f"direction = {_list(sensor.direction)}", f"against = {_quoted(sensor.against)}",
    ]  # fmt: skip


def _spot(spot: Spot) -> list[str]:
    return [f"body = {_quoted(spot.node)}", f"at = {_list(spot.at)}"]


def _list(values: Iterable[float]) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def _cells(values: Array) -> list[str]:
    return ["" if value != value else repr(value) for value in values.tolist()]  # noqa: PLR0124


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'

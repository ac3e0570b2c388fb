"""A campaign written back in the format that `stiffscope.gap.campaign.readings` loads."""

from __future__ import annotations

import csv
import io
import json
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.quantities import DEVIATION, KINDS, QUANTITIES, WRENCH

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from stiffscope.gap.campaign.campaign import Array, Campaign, LoadPoint, Sensor


def write_campaign(campaign: Campaign, folder: Path, *, comment: str = "") -> None:
    """Write a campaign as `campaign.toml` and `readings.csv` (and `model.csv`) into a folder, created if absent."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f"# {line}" for line in comment.splitlines()]
    if campaign.robot is not None:
        lines.append(f"robot = {_quoted(campaign.robot)}")
    lines.append(f"modelled = [{', '.join(_quoted(name) for name in campaign.modelled)}]")
    lines.append(f"components = {_quoted(campaign.components)}")
    lines.append('readings = "readings.csv"')
    if campaign.predictions:
        lines.append('predictions = "model.csv"')
    lines += section_lines(campaign.sensors, campaign.loads)
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    keys = _key_cells(campaign)
    sessions = len(campaign.session_names) > 1 or campaign.session_names != ("",)
    readings: dict[str, list[str]] = {**keys, "value": _cells(campaign.value), "sigma": _cells(campaign.sigma)}
    if sessions:
        readings["session"] = [campaign.session_names[int(i)] for i in campaign.session.tolist()]
    _write_table(folder / "readings.csv", readings)
    if campaign.predictions:
        models = {name: _cells(values) for name, values in campaign.predictions.items()}
        _write_table(folder / "model.csv", {**keys, **models})


def section_lines(sensors: Iterable[Sensor], loads: Iterable[LoadPoint]) -> Iterator[str]:
    """Lines of a campaign.toml: a section for each sensor and load."""
    for sensor in sensors:
        yield f"\n[sensors.{_key(sensor.name)}]"
        yield f"measures = {_quoted(sensor.measures)}"
        yield f"body = {_quoted(sensor.body)}"
        if not sensor.rotates:
            yield f"at = {[float(v) for v in sensor.at]}"
        yield f"direction = {[float(v) for v in sensor.direction]}"
        yield f"against = {_quoted(sensor.against)}"
        yield f"zero = {_quoted(sensor.zero)}"
    for load in loads:
        yield f"\n[loads.{_key(load.name)}]"
        yield f"body = {_quoted(load.body)}"
        yield f"at = {[float(v) for v in load.at]}"


def _key_cells(campaign: Campaign) -> dict[str, list[str]]:
    out: dict[str, list[str]] = {}
    if np.isnan(campaign.poses).any():
        out["pose"] = [campaign.pose_names[int(i)] for i in campaign.pose.tolist()]
    else:
        out |= {name: _cells(campaign.poses[campaign.pose, k]) for k, name in enumerate(campaign.coordinates)}
    if campaign.loads:
        out["load"] = _names(campaign.loads, campaign.load.tolist())
    if not np.isnan(campaign.wrench).all():
        out |= {name: _cells(campaign.wrench[:, k]) for k, name in enumerate(WRENCH)}
    if not campaign.sensors:
        return {**out, "quantity": [QUANTITIES[code] for code in campaign.quantity.tolist()]}
    at_tool = (campaign.sensor < 0).tolist()
    codes = campaign.quantity.tolist()
    out["sensor"] = _names(campaign.sensors, campaign.sensor.tolist())
    out["quantity"] = [QUANTITIES[code] if here else "" for code, here in zip(codes, at_tool, strict=True)]
    out["kind"] = [
        "" if here else KINDS[DEVIATION if code // 6 == DEVIATION else 0]
        for code, here in zip(codes, at_tool, strict=True)
    ]
    return out


def _names(known: Sequence[Sensor] | Sequence[LoadPoint], codes: list[int]) -> list[str]:
    return ["" if code < 0 else known[code].name for code in codes]


def _cells(values: Array) -> list[str]:
    return ["" if value != value else repr(value) for value in values.tolist()]  # noqa: PLR0124


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _key(text: str) -> str:
    bare = text.replace("-", "").replace("_", "").isalnum() and text.isascii()
    return text if bare else json.dumps(text)


def table_text(columns: Mapping[str, Sequence[str]]) -> str:
    """Columns of text, all of one length, as the content of a CSV file."""
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return out.getvalue()


def _write_table(path: Path, columns: Mapping[str, Sequence[str]]) -> None:
    path.write_bytes(table_text(columns).encode("utf-8"))

"""A campaign written back in the format that `stiffscope.gap.readings` loads."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.quantities import QUANTITIES, WRENCH
from stiffscope.gap.readings import POSITION

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.gap.campaign import Array, Campaign


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
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    keys = _key_cells(campaign)
    sessions = len(campaign.session_names) > 1 or campaign.session_names != ("",)
    readings: dict[str, list[str]] = {**keys, "value": _cells(campaign.value), "sigma": _cells(campaign.sigma)}
    if sessions:
        readings["session"] = [campaign.session_names[int(i)] for i in campaign.session.tolist()]
    _write(folder / "readings.csv", readings)
    if campaign.predictions:
        models = {name: _cells(values) for name, values in campaign.predictions.items()}
        _write(folder / "model.csv", {**keys, **models})


def _key_cells(campaign: Campaign) -> dict[str, list[str]]:
    out: dict[str, list[str]] = {}
    if np.isnan(campaign.poses).any():
        out["pose"] = [campaign.pose_names[int(i)] for i in campaign.pose.tolist()]
    else:
        out |= {name: _cells(campaign.poses[campaign.pose, k]) for k, name in enumerate(POSITION)}
    if not np.isnan(campaign.wrench).all():
        out |= {name: _cells(campaign.wrench[:, k]) for k, name in enumerate(WRENCH)}
    return {**out, "quantity": [QUANTITIES[code] for code in campaign.quantity.tolist()]}


def _cells(values: Array) -> list[str]:
    return ["" if value != value else repr(value) for value in values.tolist()]  # noqa: PLR0124


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _write(path: Path, columns: dict[str, list[str]]) -> None:
    rows = zip(*columns.values(), strict=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)

"""Writing of campaigns: campaign.toml and readings.csv."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import tomlkit

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path


def write_campaign(
    folder: Path,
    header: Mapping[str, Any],
    columns: Mapping[str, Sequence[str]],
    *,
    comment: str = "",
) -> None:
    """Write a campaign as campaign.toml and, if it has readings, readings.csv.

    Parameters
    ----------
    folder
        Created if absent.
    header
        Keys of campaign.toml except `readings`; sections are mappings of mappings.
    columns
        Cells of each column of the readings, all of equal length; none without readings.
    comment
        Text above the header (default: none).
    """
    folder.mkdir(parents=True, exist_ok=True)
    lines = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
    parts: tuple[dict[str, Any], dict[str, Any]] = {}, {}  # plain keys, and sections
    for key, value in header.items():
        if value or not isinstance(value, Mapping):
            parts[isinstance(value, Mapping)][key] = value
    if columns:
        parts[0]["readings"] = "readings.csv"
    text = tomlkit.dumps({**parts[0], **parts[1]})
    (folder / "campaign.toml").write_text(lines + text, encoding="utf-8", newline="")
    if not columns:
        return
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    (folder / "readings.csv").write_text(out.getvalue(), encoding="utf-8", newline="")


def describe_sensor(
    measures: str,
    body: str,
    at: Any,
    direction: Any,
    **more: str,
) -> dict[str, Any]:
    """Return the section of a sensor in campaign.toml; a rotation has no point.

    Parameters
    ----------
    measures, body
        Kind of reading, and the body of the sensor.
    at, direction
        Point (3,), m, and direction (3,).
    more
        Further keys, `against` and `zero`.
    """
    place = {} if measures == "rotation" else {"at": np.asarray(at).tolist()}
    axis = np.asarray(direction).tolist()
    return {"measures": measures, "body": body, **place, "direction": axis, **more}


def number_cells(values: Iterable[float]) -> list[str]:
    """Return the cells of numbers (n,) at full precision; empty for NaN."""
    return ["" if value != value else repr(float(value)) for value in values]  # noqa: PLR0124

"""Writing of campaigns: campaign.toml and readings.csv."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import tomlkit

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path


def write_campaign(
    folder: Path, header: Mapping[str, Any], columns: Mapping[str, Sequence[str]], *, comment: str = ""
) -> None:
    """Write a campaign as campaign.toml and readings.csv.

    Parameters
    ----------
    folder
        Created if absent.
    header
        Keys of campaign.toml except `readings`; sections are mappings of mappings.
    columns
        Cells of each column of the readings, all of equal length.
    comment
        Text above the header (default: none).

    """
    folder.mkdir(parents=True, exist_ok=True)
    lines = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
    plain = {key: value for key, value in header.items() if not isinstance(value, Mapping)}
    sections: dict[str, Any] = {key: value for key, value in header.items() if isinstance(value, Mapping) and value}
    text = tomlkit.dumps({**plain, "readings": "readings.csv", **sections})
    (folder / "campaign.toml").write_text(lines + text, encoding="utf-8", newline="")
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    (folder / "readings.csv").write_text(out.getvalue(), encoding="utf-8", newline="")


def number_cells(values: Iterable[float]) -> list[str]:
    """Return the cells of numbers (n,) at full precision; empty for NaN."""
    return ["" if value != value else repr(float(value)) for value in values]  # noqa: PLR0124

"""Contents of the cache as tables."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from stiffscope.report.terminal import show_line, show_table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from stiffscope.runtime.cache import Entry


def show_totals(root: Path, totals: Mapping[str, tuple[int, int]]) -> None:
    """Show the cache folder, and number and size of its entries by kind."""
    show_line(str(root))
    rows = [
        (kind, f"{count:,}", megabytes(size)) for kind, (count, size) in totals.items()
    ]
    count, size = (sum(column) for column in zip((0, 0), *totals.values(), strict=True))
    rows.append(("all", f"{count:,}", megabytes(size)))
    show_table("Kept results", (("kind",), ("results", "size")), rows)


def show_entries(entries: Sequence[Entry]) -> None:
    """Show each entry: kind, start of its key, size and date."""
    rows = []
    for entry in entries:
        created = datetime.fromtimestamp(entry.made, UTC)
        rows.append(
            (
                entry.kind,
                entry.key[:12],
                megabytes(entry.bytes),
                f"{created:%Y-%m-%d %H:%M}",
            )
        )
    show_table("Kept results", (("kind",), ("key", "size", "made (UTC)")), rows)


def megabytes(size: float) -> str:
    """Return a size in MB: "1.24 MB"."""
    return f"{size / 1e6:.3g} MB"

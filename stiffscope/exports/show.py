"""What an export prints."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stiffscope.report.terminal import show_line
from stiffscope.statics.show.check import show_named

if TYPE_CHECKING:
    from stiffscope.exports.target import Exported


def show_export(title: str, exported: Exported) -> None:
    """Print what was written and what to mind."""
    if exported.rows:
        show_named(title, ("", "value"), exported.rows)
    for remark in exported.remarks:
        show_line(f"Note: {remark}.")

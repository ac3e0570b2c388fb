"""Default progress callback: silent, unless a notebook has set its progress bars."""

from __future__ import annotations

from types import SimpleNamespace


def silence(_stage: str, _fraction: float) -> None:
    """Ignore a stage and its fraction."""


LISTENERS = SimpleNamespace(open_line=lambda _name: silence)
"""Holder of `open_line(name)`, which returns `report(stage, fraction)` for a job."""

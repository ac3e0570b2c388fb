"""Default progress callback: silent, unless a notebook has set its progress bars."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.runtime.types import Progress


def silence(_stage: str, _fraction: float) -> None:
    """Ignore a stage and its fraction."""


class Listeners:
    """Holder of `open_line(name)`, which returns `report(stage, fraction)` for a job."""

    def __init__(self) -> None:
        self.open_line: Callable[[str], Progress] = lambda _name: silence


LISTENERS = Listeners()

"""Who hears of progress where a caller names nobody: nobody, unless a notebook has put its bars here."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    Report = Callable[[str, float], None]


def silence(_stage: str, _fraction: float) -> None:
    """Hear a stage and its fraction, and say nothing."""


class Listeners:
    """The one function, `open_line(name)`, that gives a function `report(stage, fraction)` for a job of that name."""

    def __init__(self) -> None:
        self.open_line: Callable[[str], Report] = lambda _name: silence


LISTENERS = Listeners()

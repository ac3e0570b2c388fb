"""Progress bars on standard error; none without a terminal or with `--quiet`."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from stiffscope.runtime.progress import silence

Report = Callable[[str, float], None]
Reporter = Callable[[str], Report]


@contextlib.contextmanager
def progress(*, quiet: bool) -> Iterator[Reporter]:
    """Yield a function that opens a line: `reporter("slider")` gives `report(stage, fraction)`."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda _name: silence
        return
    name, stage = (
        TextColumn("{task.description:<9}"),
        TextColumn("{task.fields[stage]:<26}"),
    )
    times = (TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    columns = (name, BarColumn(bar_width=28), stage, *times)
    with Progress(*columns, console=console, transient=True) as bars:

        def open_line(name: str) -> Report:
            line = bars.add_task(name, total=1.0, stage="waiting")

            def report(stage: str, fraction: float) -> None:
                bars.update(line, completed=min(max(fraction, 0.0), 1.0), stage=stage)

            return report

        yield open_line

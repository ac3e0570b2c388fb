"""Progress on standard error: bars on a terminal, lines now and then elsewhere, none with `--quiet`."""

from __future__ import annotations

import contextlib
import sys
import time
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
PATIENCE = 10.0  # s until the first line without a terminal
PERIOD = 30.0  # s between further lines


@contextlib.contextmanager
def progress(*, quiet: bool) -> Iterator[Reporter]:
    """Yield a function that opens a line: `reporter("slider")` gives `report(stage, fraction)`."""
    console = Console(stderr=True)
    if quiet:
        yield lambda _name: silence
        return
    if not console.is_terminal:
        yield _write_lines()
        return
    name = TextColumn("{task.description:<9}")
    stage = TextColumn("{task.fields[stage]:<26}")
    times = (TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    columns = (name, BarColumn(bar_width=28), stage, *times)
    with Progress(*columns, console=console, transient=True) as bars:

        def open_line(name: str) -> Report:
            line = bars.add_task(name, total=1.0, stage="waiting")

            def report(stage: str, fraction: float) -> None:
                bars.update(line, completed=min(max(fraction, 0.0), 1.0), stage=stage)

            return report

        yield open_line


def _write_lines() -> Reporter:
    """Return a reporter that writes a line now and then, for logs of batch systems."""
    begun = time.monotonic()
    due = begun + PATIENCE

    def open_line(name: str) -> Report:
        def report(stage: str, fraction: float) -> None:
            nonlocal due
            now = time.monotonic()
            if now < due or fraction >= 1.0:
                return
            due = now + PERIOD
            share = f"{100.0 * min(max(fraction, 0.0), 1.0):.0f} %"
            with contextlib.suppress(OSError, ValueError):  # nobody reads, or closed
                sys.stderr.write(
                    f"{name}: {stage}, {share} after {now - begun:.0f} s\n"
                )
                sys.stderr.flush()

        return report

    return open_line

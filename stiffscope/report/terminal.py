"""Lines and tables on standard output: fitted to the terminal, never truncated, ASCII if needed."""

from __future__ import annotations

import re
import unicodedata
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING

from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence


FOLDED = 16  # minimum width of a prose column, characters
ASCII_BOX = "    \n    \n -- \n    \n    \n    \n    \n    \n"  # rich's SIMPLE_HEAD with a dashed line
SUPERSCRIPTS = re.compile("[⁰¹²³⁴-⁹⁻]+")
ASCII = str.maketrans(
    {
        "µ": "u",
        "±": "+/-",
        "·": "*",
        "×": "x",
        "−": "-",
        "√": "sqrt",
        "≤": "<=",
        "≥": ">=",
        "°": "deg",
        "χ": "chi",
        "σ": "sigma",
        "ω": "w",
    }
)


@dataclass(frozen=True)
class Shown:
    """A shown table, or a line of prose as a title without columns."""

    title: str
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    prose: frozenset[str] = frozenset()
    folded: bool = False
    """Whether a page shows it only on demand."""


_recorder: ContextVar[list[Shown] | None] = ContextVar("recorder", default=None)


@contextmanager
def record_shown() -> Iterator[list[Shown]]:
    """Record tables and lines instead of printing them, to show the same in a page."""
    shown: list[Shown] = []
    token = _recorder.set(shown)
    try:
        yield shown
    finally:
        _recorder.reset(token)


def show_line(text: str, style: str | None = None) -> None:
    """Print a line of prose, wrapped on a terminal, unwrapped in a file."""
    recorder = _recorder.get()
    if recorder is not None:
        recorder.append(Shown(text.strip()))
        return
    out = _console()
    out.print(
        in_encoding(text, out.encoding), style=style, soft_wrap=not out.is_terminal
    )


def show_facts(title: str, facts: Sequence[tuple[str, str]]) -> None:
    """Print names and facts, one per line; in a page as a table."""
    shown = Shown(title, ("", "at a glance"), tuple(facts), frozenset({"at a glance"}))
    _show_block(shown, title, [f"  {name:<18}  {words}" for name, words in facts])


def show_list(title: str, items: Sequence[str]) -> None:
    """Print items, one per line; in a page as a paragraph."""
    _show_block(
        Shown(f"{title}: {'; '.join(items)}"), title, [f"  - {item}" for item in items]
    )


def _show_block(shown: Shown, title: str, lines: Sequence[str]) -> None:
    """Print a title and lines, or record what stands for them in a page."""
    recorder = _recorder.get()
    if recorder is not None:
        recorder.append(shown)
        return
    show_line(title, "bold")
    for line in (*lines, ""):
        show_line(line)


def show_table(
    title: str,
    groups: Sequence[Sequence[str]],
    rows: Sequence[Sequence[str]],
    *,
    prose: Collection[str] = (),
) -> None:
    """Print a table, split into several with repeated first columns if wider than the terminal.

    Parameters
    ----------
    title, rows
        Title above the table, and its rows with a cell per column.
    groups
        Names of the columns in groups that stay together; every table repeats the first group.
    prose
        Text columns: left-aligned, and wrapped instead of widening the table.

    Empty columns are omitted.
    """
    count = sum(map(len, groups))
    shown_columns = [
        k == 0 or not rows or any(row[k] for row in rows) for k in range(count)
    ]
    rows = [
        [cell for cell, keep in zip(row, shown_columns, strict=True) if keep]
        for row in rows
    ]
    flags = iter(shown_columns)
    groups = [[name for name in group if next(flags)] for group in groups]
    columns = tuple(name for group in groups for name in group)
    recorder = _recorder.get()
    if recorder is not None:
        recorder.append(
            Shown(title, columns, tuple(map(tuple, rows)), frozenset(prose))
        )
        return
    out = _console()
    names = [in_encoding(name, out.encoding) for name in columns]
    cells = [[in_encoding(cell, out.encoding) for cell in row] for row in rows]
    folded = {k for k, name in enumerate(columns) if name in prose}
    ends = accumulate(map(len, groups), initial=0)
    first, *others = (list(range(a, b)) for a, b in pairwise(ends) if b > a)
    if not others:  # nothing to repeat
        first, others = [], [first]

    def table(columns: list[int]) -> Table:
        filled = [row for row in cells if any(row[k] for k in columns)]
        return _table(
            names, filled, first + columns, folded, ascii_only=out.options.ascii_only
        )

    show_line(title, "bold")
    shown: list[int] = []
    for group in [*others, []]:
        if shown and (not group or _least_width(out, table(shown + group)) > out.width):
            whole = _console()
            whole.width = max(out.width, _least_width(out, table(shown)))
            whole.print(table(shown))
            whole.print()
            shown = []
        shown += group


def in_encoding(text: str, encoding: str) -> str:
    """Return the text in characters of an encoding: 10⁶ N·m/rad is 10^6 N*m/rad in ASCII."""
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        raised = SUPERSCRIPTS.sub(
            lambda found: "^" + unicodedata.normalize("NFKC", found[0]), text
        )
        return raised.translate(ASCII).encode(encoding, "replace").decode(encoding)
    return text


def _console() -> Console:
    """Return a console without markup, so that brackets in user's names are printed."""
    return Console(highlight=False, markup=False, emoji=False)


def _least_width(out: Console, table: Table) -> int:
    return Measurement.get(out, out.options.update(width=10_000), table).minimum


def _table(
    names: Sequence[str],
    rows: Sequence[Sequence[str]],
    columns: Sequence[int],
    folded: set[int],
    *,
    ascii_only: bool,
) -> Table:
    """Return a table with the first column and prose aligned left, other columns right."""
    lines = box.Box(ASCII_BOX, ascii=True) if ascii_only else box.SIMPLE_HEAD
    table = Table(box=lines, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    for k in columns:
        widest = max(cell_len(row[k]) for row in [names, *rows])
        if k in folded:
            table.add_column(names[k], overflow="fold", min_width=min(FOLDED, widest))
        else:
            side = "left" if k == 0 else "right"
            table.add_column(names[k], justify=side, no_wrap=True, min_width=widest)
    for row in rows:
        table.add_row(*(row[k] for k in columns))
    return table

"""`stiffscope cache`: folder and size of stored results, and how to clear them."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit
from stiffscope.errors import say_count
from stiffscope.files.store_tables import megabytes, show_entries, show_totals
from stiffscope.report.terminal import show_line
from stiffscope.runtime.cache import KINDS, Cache, cache_folder, totals

if TYPE_CHECKING:
    from stiffscope.cli.output import Output

kinds = click.option(
    "--kind",
    "chosen",
    multiple=True,
    type=click.Choice(KINDS),
    help="Only of this kind.",
)


@click.group("cache", invoke_without_command=True)
@takes(options.json)
@click.pass_context
def cache(context: click.Context, *, output: Output) -> None:
    """Show, list or clear the results of earlier runs.

    The environment variable STIFFSCOPE_CACHE sets the folder. Clearing it costs nothing but the
    time to recompute.
    """
    if context.invoked_subcommand is None:
        root = cache_folder()
        sums = totals(Cache(root).entries())
        sizes = {
            kind: {"entries": count, "bytes": size}
            for kind, (count, size) in sums.items()
        }
        emit(
            output,
            {"folder": str(root), "kinds": sizes},
            lambda: show_totals(root, sums),
        )


@cache.command("list")
@takes(kinds, options.json)
def list_entries(chosen: Texts, *, output: Output) -> None:
    """Every result that is kept, the oldest first."""
    entries = sorted(
        Cache(cache_folder()).entries(chosen), key=lambda entry: entry.made
    )
    emit(
        output,
        [dataclasses.asdict(entry) for entry in entries],
        lambda: show_entries(entries),
    )


@cache.command("clear")
@takes(kinds, options.json)
def clear(chosen: Texts, *, output: Output) -> None:
    """Remove what stiffscope keeps there; what it did not write stays."""
    root = cache_folder()
    gone = Cache(root).clear(chosen)
    size = sum(entry.bytes for entry in gone)
    words = f"Removed {say_count(len(gone), 'result')}, {megabytes(size)}, from {root}"
    answer = {"folder": str(root), "entries": len(gone), "bytes": size}
    emit(output, answer, lambda: show_line(words))

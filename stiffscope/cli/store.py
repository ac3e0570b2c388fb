"""`stiffscope cache`: where earlier results are kept, how much they take, and how to be rid of them."""

from __future__ import annotations

import dataclasses

import click

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.runtime import files

kinds = click.option(
    "--kind", "chosen", multiple=True, metavar="KIND", help="Only results of this kind, such as pictures."
)


@click.group("cache", invoke_without_command=True)
@takes(options.target)
@click.pass_context
def cache(context: click.Context, *, target: str | None, quiet: bool) -> None:
    """Results of earlier runs: where they are and how large; list or clear them.

    STIFFSCOPE_CACHE puts the folder elsewhere. Clearing it loses nothing but the time to compute again.
    """
    if context.invoked_subcommand is not None:
        return
    from stiffscope.report.store import show_totals
    from stiffscope.runtime.cache import Cache, cache_folder, totals

    root = cache_folder()
    found = totals(Cache(root).entries())
    if target is not None:
        sizes = {kind: {"entries": count, "bytes": size} for kind, (count, size) in found.items()}
        files.write_json(target, {"folder": str(root), "kinds": sizes})
    if not quiet and target != "-":
        show_totals(root, found)


@cache.command("list")
@takes(kinds, options.target)
def listed(chosen: tuple[str, ...], *, target: str | None, quiet: bool) -> None:
    """Every result that is kept, the oldest first."""
    from stiffscope.report.store import show_entries
    from stiffscope.runtime.cache import Cache, cache_folder

    entries = sorted(Cache(cache_folder()).entries(chosen), key=lambda entry: entry.made)
    if target is not None:
        files.write_json(target, [dataclasses.asdict(entry) for entry in entries])
    if not quiet and target != "-":
        show_entries(entries)


@cache.command("clear")
@takes(kinds, options.target)
def clear(chosen: tuple[str, ...], *, target: str | None, quiet: bool) -> None:
    """Remove what stiffscope keeps there; what it did not write stays."""
    from stiffscope.report.store import megabytes
    from stiffscope.report.terminal import show_line
    from stiffscope.runtime.cache import Cache, cache_folder

    root = cache_folder()
    gone = Cache(root).clear(chosen)
    size = sum(entry.bytes for entry in gone)
    if target is not None:
        files.write_json(target, {"folder": str(root), "entries": len(gone), "bytes": size})
    if not quiet and target != "-":
        show_line(f"Removed {len(gone)} results, {megabytes(size)}, from {root}")

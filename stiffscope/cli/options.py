"""Arguments and options shared by several commands."""

from __future__ import annotations

import functools
import logging
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from stiffscope.cli.output import Output
from stiffscope.robot.file.override import TypedOverride
from stiffscope.runtime.output import check_json, overwrite
from stiffscope.runtime.reading import opened

if TYPE_CHECKING:
    from collections.abc import Callable

Texts = tuple[str, ...]
PATH = click.Path(path_type=Path)
SOURCES = ("fea", "beam", "published")
GRAVITY = ("none", "literal", "exact")


def takes(*options: Callable[..., Any]) -> Callable[..., Any]:
    """Add these options, in the order of the help, and the common options to a command.

    `--json`, `--out` and `--quiet` become one argument, `output`, whose folder is checked first.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(command)
        def work(
            json: str | None = None,
            out: Path | None = None,
            *,
            quiet: bool,
            **given: Any,
        ) -> Any:
            output = Output(json, out, quiet)
            texts = [value for value in given.values() if isinstance(value, str | Path)]
            output.check_folder(
                out,
                *(Path(text) for text in texts if os.path.isfile(text)),  # noqa: PTH113 (a text may be no path at all)
            )
            opened.clear()
            opened.update(os.path.realpath(text) for text in texts)
            output.check_json()
            return command(output=output, **given)

        for option in reversed((*options, force, quiet, debug)):
            work = option(work)
        return work

    return decorate


def _note_debug(
    _context: click.Context, _option: click.Parameter, wanted: bool
) -> None:
    if wanted:
        logging.getLogger().setLevel(logging.DEBUG)
        for chatty in ("matplotlib", "PIL", "pint", "numba"):
            logging.getLogger(chatty).setLevel(logging.WARNING)


def check_file(
    _context: click.Context, _option: click.Parameter, target: str | None
) -> str | None:
    """Raise InputError before any computation if a file cannot be written."""
    if target not in (None, "-"):
        check_json(Path(target))
    return target


def gravity(default: str | None) -> Callable[..., Any]:
    """Return the option `--gravity`; without a default the robot file decides."""
    return click.option(
        "--gravity",
        type=click.Choice(GRAVITY),
        default=default,
        show_default=True
        if default
        else "none, unless the robot file has adopted gravity",
        help="How weight acts on stiffness.",
    )


def folder(name: str, text: str, *, required: bool = False) -> Callable[..., Any]:
    """Return an option for an output folder; ``text``: what it will hold."""
    text = f"Folder to write: {text}"
    return click.option(name, required=required, metavar="DIR", type=PATH, help=text)


def superelement(ends: str) -> Callable[..., Any]:
    """Return the option `--superelement`; ``ends``: on what the stiffness is condensed."""
    text = f"stiffness and mass condensed on the {ends} (npz, .mtx, DMIG), complete or absent."
    return folder("--superelement", text)


def count(
    name: str, default: int, text: str, least: int, most: int | None = None
) -> Callable[..., Any]:
    """Return an option for a whole number between its least and greatest value, if any."""
    return click.option(
        name,
        default=default,
        show_default=True,
        type=click.IntRange(least, most),
        help=text,
    )


robot = click.argument("name", metavar="ROBOT")
overrides = click.option(
    "--set",
    "overrides",
    multiple=True,
    callback=lambda _context, _option, texts: tuple(map(TypedOverride, texts)),
    metavar="NAME.KEY=VALUE",
    help="Override a value of a part, parameter, body or joint of the robot file, such as "
    "slider.thickness=25mm. May be repeated.",
)
tolerance = click.option(
    "--tolerance",
    metavar="SHARE",
    help="Error bar of the parts' matrices, such as 0.1% or 1e-3.",
)
components = click.option(
    "--components",
    type=click.Choice(SOURCES),
    help="Source of the parts' matrices, instead of that in the robot file.",
)
quiet = click.option("--quiet", is_flag=True, help="No progress bars and no tables.")
debug = click.option(
    "--debug",
    is_flag=True,
    expose_value=False,
    callback=_note_debug,
    help="Show where an unexpected error came from.",
)
OUT = "Folder to write: complete or absent."
force = click.option(
    "--force",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=lambda _context, _option, wanted: overwrite(wanted),
    help="Overwrite JSON and output folders that stiffscope did not write; other files stay.",
)
out = folder("--out", "complete or absent.", required=True)
json = click.option(
    "--json",
    metavar="FILE",
    callback=check_file,
    help='Write JSON ("-": standard output, nothing else there).',
)
scheduler = click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Dask scheduler, such as tcp://host:8786, not this machine.",
)
poses = click.option(
    "--at",
    "poses",
    multiple=True,
    metavar="X,Y,Z",
    help='Tool pose: the coordinates of [tool] pose, SI or with units ("0,0,350 mm"), or the name '
    "of a pose in the robot file. May be repeated.",
)
joints = click.option(
    "--joints",
    "joints",
    multiple=True,
    metavar="DRIVE=POSITION,…",
    help="Displacements of drives from home instead of a tool pose "
    '("leg1.motor=10 deg,leg2.motor=5 deg"); other drives stay at home. May be repeated.',
)
part, required_part = (
    click.option(
        "--part", required=required, metavar="PART", help="A part of the robot file."
    )
    for required in (False, True)
)

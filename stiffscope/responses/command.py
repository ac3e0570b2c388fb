"""The command `responses`."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import click

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit
from stiffscope.errors import InputError
from stiffscope.experiments.manifest import manifest_of
from stiffscope.responses.files import is_universal, read_responses
from stiffscope.responses.model import DERIVATIVES
from stiffscope.responses.show import (
    responses_json,
    show_responses,
    write_figure,
    write_page,
)
from stiffscope.responses.tables import Channel, read_direction
from stiffscope.responses.units import read_unit

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.cli.output import Output
    from stiffscope.responses.model import ResponseFile


@click.command()
@takes(
    click.argument("file", metavar="FILE", type=options.PATH),
    options.json,
    click.option(
        "--channel",
        "channels",
        multiple=True,
        metavar="NAME=MOTION/FORCE",
        help='Of a table, what a column holds: "H21=7:-x/1:+z". May be repeated.',
    ),
    click.option(
        "--quantity",
        type=click.Choice(list(DERIVATIVES)),
        help="Of a table, what its values are.",
    ),
    click.option(
        "--unit", metavar="UNIT", help='Of a table: "um/N", "m/s^2/N"; by default SI.'
    ),
)
@options.folder("--out", "report and figure, complete or absent.")
def responses(
    file: Path,
    *,
    channels: Texts,
    quantity: Any,
    unit: str | None,
    output: Output,
) -> None:
    """Show measured frequency responses: resonances, static stiffness, doubts.

    FILE is a universal file (.uff, .unv) or a table (.csv, .txt, .xlsx, .mat, .npz), as hammer,
    shaker and vibrometer tests leave them.
    """
    manifest = manifest_of(None, file)
    read = _read(file, channels, quantity, unit)
    emit(
        output,
        responses_json(read),
        partial(show_responses, read),
        manifest=manifest,
        fill=partial(write_figure, read),
        page=partial(write_page, read),
        kept="responses.json",
    )


def _read(file: Path, channels: Texts, quantity: Any, unit: str | None) -> ResponseFile:
    if is_universal(file):
        given = {"--channel": channels, "--quantity": quantity, "--unit": unit}
        for option, value in given.items():
            if value:
                raise InputError(
                    f"{option}: expected a table, got the universal file {file.name}"
                )
        return read_responses(file, {})
    if quantity is None:
        expected = f"expected {', '.join(DERIVATIVES)} of a table"
        raise InputError(f"--quantity: {expected}, got none")
    factor = 1.0 if unit is None else read_unit(unit, quantity)
    return read_responses(file, _read_channels(channels), quantity, factor)


def _read_channels(texts: Texts) -> dict[str, Channel]:
    channels = dict[str, Channel]()
    for text in texts:
        name, _, ends = text.partition("=")
        motion, _, force = ends.partition("/")
        try:
            channels[name.strip()] = Channel(
                read_direction(force), read_direction(motion)
            )
        except ValueError as error:
            raise InputError(f'--channel "{text}": {error}') from error
    return channels

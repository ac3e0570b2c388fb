"""`stiffscope live`: a local page with sliders and live results."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.live.server import open_robot, serve

if TYPE_CHECKING:
    from stiffscope.cli.output import Output


@click.command()
@takes(
    options.robot,
    options.components,
    options.overrides,
    click.option(
        "--campaign",
        metavar="DIR",
        type=click.Path(path_type=Path, exists=True, file_okay=False),
        help="Compare its readings with the robot, and follow its tables as they are saved.",
    ),
    click.option(
        "--job",
        metavar="JOB",
        type=click.Path(path_type=Path, exists=True, dir_okay=False),
        help="Show the stable depth of its milling cut, as `stiffscope lobes`.",
    ),
    click.option(
        "--port",
        default=0,
        type=click.IntRange(0, 65535),
        help="Port; default: a free one.",
    ),
    click.option("--no-browser", is_flag=True, help="Print the address only."),
)
def live(
    name: str,
    *,
    components: Any,
    overrides: Texts,
    campaign: Path | None,
    job: Path | None,
    port: int,
    no_browser: bool,
    output: Output,
) -> None:
    """Open a page with the turning robot and a slider for every value, pose and load.

    Stiffness, sag, natural frequencies, maps and, with --job, the stable depth of cut follow the
    sliders. The page is served on this machine only, at an address with a token; Ctrl-C ends it.
    """

    def announce(address: str) -> None:
        click.echo(f"{address}  (Ctrl-C ends)", err=not output.loud)
        if not no_browser:
            webbrowser.open(address)

    serve(open_robot(name, overrides, components, campaign, job), port, announce)

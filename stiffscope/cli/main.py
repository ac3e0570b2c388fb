"""The command line: parse, call, show. What a command does stands in the module that it imports when it runs."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from stiffscope import __version__
from stiffscope.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

PARTS = ("link", "slider")
SOURCES = ("fea", "beam", "published")
GRAVITY = ("none", "literal", "exact")


class Stopped(BaseException):
    """The process was asked to end."""


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run a command: exit code 0 done, 2 bad input (one line on standard error), 1 anything else."""
    sys.exit(_guarded(sys.argv[1:] if arguments is None else arguments))


def _guarded(arguments: list[str]) -> int:
    _listen()
    try:
        cli.main(arguments, prog_name="stiffscope", standalone_mode=False)
        sys.stdout.flush()
    except InputError as error:
        _say(str(error))
        return 2
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "stiffscope"
        _say(f"{error.format_message()} (see {command} --help)")
        return 2
    except (KeyboardInterrupt, click.Abort, Stopped):
        _say("stopped; nothing half-written is left")
        return 1
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # whoever read the output has gone
        return 1
    except Exception as error:
        if "--debug" in arguments:
            raise
        _say(f"unexpected {type(error).__name__}: {error} (repeat with --debug for the whole story)")
        return 1
    return 0


def _listen() -> None:
    """End cleanly when asked to, and show each warning once, on a line."""
    for name in ("SIGTERM", "SIGHUP"):
        with contextlib.suppress(AttributeError, ValueError):  # not on every system, not outside the main thread
            signal.signal(getattr(signal, name), _stop)
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("stiffscope: %(message)s"))
    handler.addFilter(_Once())
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    logging.captureWarnings(capture=False)


class _Once(logging.Filter):
    def __init__(self) -> None:
        super().__init__()
        self.seen: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        """Let a message through the first time."""
        message = record.getMessage()
        new = message not in self.seen
        self.seen.add(message)
        return new


def _stop(_signal: int, _frame: Any) -> NoReturn:
    raise Stopped


def _say(text: str) -> None:
    click.echo(f"stiffscope: {' '.join(text.split())}", err=True)


def _takes(*options: Callable[..., Any]) -> Callable[..., Any]:
    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed((*options, _quiet, _debug)):
            command = option(command)
        return command

    return decorate


def _note_debug(_context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if wanted:
        logging.getLogger().setLevel(logging.DEBUG)
        for chatty in ("matplotlib", "PIL", "pint", "numba"):
            logging.getLogger(chatty).setLevel(logging.WARNING)


def _check_file(_context: click.Context, _option: click.Parameter, target: str | None) -> str | None:
    from stiffscope.files import check_file

    if target not in (None, "-"):
        check_file(Path(target))
    return target


_robot = click.argument("robot", metavar="ROBOT.toml")
_set = click.option(
    "--set", "overrides", multiple=True, metavar="PART.PARAMETER=VALUE",
    help="Change a value of the robot file, such as slider.thickness=25mm. May be repeated.",
)  # fmt: skip
_tolerance = click.option(
    "--tolerance", metavar="SHARE", help="Error bar wanted of every entry of the parts' matrices, such as 0.1% or 1e-3."
)
_components = click.option(
    "--components",
    type=click.Choice(SOURCES),
    help="Source of the parts' matrices, instead of what the robot file says.",
)
_quiet = click.option("--quiet", is_flag=True, help="No progress bars and no tables.")
_debug = click.option(
    "--debug", is_flag=True, expose_value=False, callback=_note_debug, help="Show where an unexpected error came from."
)
_out = click.option(
    "--out", required=True, metavar="DIR", type=click.Path(path_type=Path), help="Folder to write: complete or absent."
)
_json = click.option(
    "--json", "target", metavar="FILE", callback=_check_file,
    help='Write JSON ("-": standard output, nothing else there).',
)  # fmt: skip
_part = click.option("--part", type=click.Choice(PARTS), help="The link or the slider.")
_at = click.option(
    "--at",
    "poses",
    multiple=True,
    metavar="X,Y,Z",
    help="Tool point in m, or a pose named in the robot file. May be repeated.",
)


def _gravity(default: str | None) -> Callable[..., Any]:
    return click.option(
        "--gravity",
        type=click.Choice(GRAVITY),
        default=default,
        show_default=default or "none, unless the robot file has adopted gravity",
        help="How weight acts on stiffness.",
    )


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="stiffscope", message="%(prog)s %(version)s")
def cli() -> None:
    """Stiffness of a parallel robot: virtual experiments on its parts, the whole robot, the gap to the real machine.

    ROBOT.toml is a robot file, or the name of a robot that comes along: biglide.
    """


@cli.command()
@_takes(_robot, _out, _components, _tolerance, _set)
def run(**options: Any) -> None:
    """The whole chain: parts, robot, tables, pictures.

    Builds the parts in CAD, meshes them, runs their virtual experiments, assembles the robot, and writes
    pictures, fields, matrices and a manifest to DIR. What was computed before is reused.
    """
    from stiffscope.cli.run import run_robot

    run_robot(options.pop("robot"), options.pop("out"), **options)


@cli.command()
@_takes(_robot, _part, _tolerance, _set, _json)
@click.option(
    "--superelement",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Folder to write: the stiffness condensed on the part's interfaces (npz, Matrix Market), complete or absent.",
)
@click.option(
    "--step", metavar="FILE", help="Take this solid as the part: clamped at its least x, loaded at its greatest."
)
def compliance(part: str | None, **options: Any) -> None:
    """A part's 6x6 compliance with error bars."""
    from stiffscope.cli.commands import part_compliance

    if part is None:
        raise click.UsageError("--part is missing: link or slider", click.get_current_context())
    part_compliance(options.pop("robot"), part, **options)


@cli.command()
@_takes(_robot, _at, _components, _gravity(None), _set, _json)
def stiffness(**options: Any) -> None:
    """The robot's 6x6 stiffness at tool points, and its sag.

    Without --at, at the poses of the robot file.
    """
    from stiffscope.cli.commands import robot_stiffness

    robot_stiffness(options.pop("robot"), options.pop("poses"), **options)


@cli.command()
@_takes(_robot, _at, _components, _set, _json)
@click.option(
    "--wrench", required=True, metavar="FX,FY,FZ,MX,MY,MZ", help="Wrench on the platform at M, axes {O}, in N and N·m."
)
def deflection(**options: Any) -> None:
    """How far the tool yields under a wrench, and which part yields how much of it."""
    from stiffscope.cli.commands import robot_deflection

    robot_deflection(options.pop("robot"), options.pop("poses"), options.pop("wrench"), **options)


@cli.command()
@_takes(_robot, _part, _set)
def compare(part: str | None, **options: Any) -> None:
    """FEA beside beam theory beside published, entry by entry."""
    from stiffscope.cli.commands import compare_parts

    compare_parts(options.pop("robot"), (part,) if part else PARTS, **options)


@cli.command()
@_takes(_robot, _out, _tolerance, _set)
@click.option("--part", type=click.Choice(PARTS), default="slider", show_default=True, help="The link or the slider.")
def interfaces(**options: Any) -> None:
    """How much a part's compliance depends on how it is held and loaded.

    Tests the part loaded as a rigid face, by an even traction and on three joint pads, and held by its face, in its
    bolt holes and on an elastic foundation. Prints what each choice changes; writes CSV, JSON and a figure to DIR.
    """
    from stiffscope.cli.interfaces import compare_interfaces

    compare_interfaces(options.pop("robot"), options.pop("part"), options.pop("out"), **options)


@cli.command("map")
@_takes(_robot, _out, _components, _gravity("exact"), _set)
@click.option(
    "--points", default=200, show_default=True, type=click.IntRange(2, 3000), help="Tool points along x and z."
)
def map_(**options: Any) -> None:
    """Stiffness over the workspace: figures and numbers."""
    from stiffscope.cli.commands import robot_map

    robot_map(options.pop("robot"), options.pop("out"), **options)


@cli.command()
@_takes(click.argument("campaign", metavar="CAMPAIGN"), _out, _json)
@click.option(
    "--adopt",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Write a robot file that carries the effects that were found.",
)
def diagnose(**options: Any) -> None:
    """Where model and machine differ, and which effect causes it.

    CAMPAIGN is a folder with a campaign.toml and its readings, or the name of a campaign that comes along: published.
    """
    from stiffscope.cli.diagnose import diagnose_campaign

    diagnose_campaign(options.pop("campaign"), options.pop("out"), **options)


@cli.command()
@_takes(_out, _json)
@click.option("--campaigns", default=100, show_default=True, type=click.IntRange(1, 100000), help="How many to draw.")
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="What decides which are drawn.")
def blind(**options: Any) -> None:
    """The check of the diagnosis on campaigns whose effects are withheld.

    Draws campaigns, seals what is in them, diagnoses them, and scores the answers.
    """
    from stiffscope.cli.blind import blind as check

    check(options.pop("out"), **options)


@cli.command()
@_takes(_json)
def audit(**options: Any) -> None:
    """The paper's numbers recomputed, each with a verdict."""
    from stiffscope.cli.audit import audit as examine

    examine(**options)


@cli.command()
@_takes(click.argument("file", metavar="FILE.step"), _json)
def faces(**options: Any) -> None:
    """The faces of a STEP file, to choose from."""
    from stiffscope.cli.commands import list_faces

    list_faces(**options)

"""The command line: parse, call, show. What a command does stands in the module that it imports when it runs."""

from __future__ import annotations

import contextlib
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from stiffscope import InputError, __version__

if TYPE_CHECKING:
    from collections.abc import Callable

PARTS = ("link", "slider")
SOURCES = ("fea", "beam", "published")


class Stopped(BaseException):
    """The process was asked to end."""


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run a command: exit code 0 done, 2 bad input (one line on standard error), 1 anything else."""
    arguments = sys.argv[1:] if arguments is None else arguments
    sys.exit(_guarded(arguments))


def _guarded(arguments: list[str]) -> int:
    for name in ("SIGTERM", "SIGHUP"):
        with contextlib.suppress(AttributeError, ValueError):  # not on every system, not outside the main thread
            signal.signal(getattr(signal, name), _stop)
    try:
        cli.main(arguments, prog_name="stiffscope", standalone_mode=False)
    except InputError as error:
        _say(str(error))
        return 2
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "stiffscope"
        _say(f"{command}: {error.format_message()} (see {command} --help)")
        return 2
    except (KeyboardInterrupt, click.Abort, Stopped):
        _say("stopped; nothing half-written is left")
        return 1
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    except Exception as error:
        if "--debug" in arguments:
            raise
        _say(
            f"unexpected {type(error).__name__}: {error}".splitlines()[0] + " (repeat with --debug for the whole story)"
        )
        return 1
    return 0


def _stop(_signal: int, _frame: Any) -> NoReturn:
    raise Stopped


def _say(line: str) -> None:
    click.echo(f"stiffscope: {' '.join(line.splitlines())}", err=True)


def _options(*options: Callable[..., Any]) -> Callable[..., Any]:
    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


_robot = click.argument("robot", metavar="ROBOT.toml")
_set = click.option(
    "--set", "overrides", multiple=True, metavar="PART.PARAMETER=VALUE",
    help='Change a value of the robot file, such as slider.thickness=25mm. May be repeated.',
)  # fmt: skip
_components = click.option(
    "--components",
    type=click.Choice(SOURCES),
    help="Where the parts' matrices come from, instead of what the robot file says.",
)
_quiet = click.option("--quiet", is_flag=True, help="No progress bars and no tables.")
_debug = click.option("--debug", is_flag=True, help="Show where an unexpected error came from.")
_out = click.option(
    "--out", required=True, metavar="DIR", type=click.Path(path_type=Path), help="Folder to write; complete or absent."
)
_json = click.option(
    "--json", "json_target", metavar="FILE", help='Write JSON ("-": standard output, and nothing else there).'
)
_part = click.option("--part", type=click.Choice(PARTS), help="The link or the slider.")
_at = click.option(
    "--at", "poses", multiple=True, metavar="X,Y,Z", help="Tool point in m, or the name of a pose of the robot file."
)


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="stiffscope")
def cli() -> None:
    """Stiffness of a parallel robot: virtual experiments on its parts, the whole robot, and the gap to the real machine.

    ROBOT.toml is a robot file, or the name of a robot that comes along: biglide.
    """


@cli.command()
@_options(_robot, _out, _components, _set, _quiet, _debug)
def run(robot: str, out: Path, components: str | None, overrides: tuple[str, ...], quiet: bool, debug: bool) -> None:
    """From the parts to the robot: build, mesh, load, assemble; tables, pictures and data in DIR."""
    from app.pipeline import run_robot

    run_robot(robot, out, overrides=overrides, components=components, quiet=quiet)


@cli.command()
@_options(_robot, _part, _set, _json, _quiet, _debug)
@click.option(
    "--step", metavar="FILE", help="Take this solid as the part: clamped at its least x, loaded at its greatest."
)
def compliance(
    robot: str,
    part: str | None,
    overrides: tuple[str, ...],
    json_target: str | None,
    quiet: bool,
    debug: bool,
    step: str | None,
) -> None:
    """Virtual experiment on one part: its 6x6 compliance with an error bar."""
    from app.parts import show_compliance

    if part is None:
        raise click.UsageError("give --part link or --part slider", click.get_current_context())
    show_compliance(robot, part, overrides=overrides, step=step, json_target=json_target, quiet=quiet)

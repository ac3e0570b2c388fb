"""The command line: the group of commands, exit codes, and one line for whatever goes wrong."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import sys
from typing import Any, NoReturn

import click
from click.exceptions import NoArgsIsHelpError

from stiffscope.cli import campaigns, check, design, library, parts, robots, vibration
from stiffscope.errors import InputError


class Stopped(BaseException):
    """The process was asked to end."""


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="stiffscope", prog_name="stiffscope", message="%(prog)s %(version)s")
def cli() -> None:
    """Stiffness of a robot: virtual experiments on its parts, the whole robot, the gap to the real machine.

    ROBOT is a robot file, or the name of a robot that comes along (biglide, delta; stiffscope robots lists them).
    """


for command in (
    *(robots.run, robots.stiffness, robots.deflection, robots.map_, vibration.modes, vibration.frf),
    *(parts.compliance, parts.compare, parts.interfaces, parts.faces),
    *(design.sensitivity, check.check, library.robots, library.new, library.import_),
    *(campaigns.diagnose, campaigns.blind, campaigns.audit),
):
    cli.add_command(command)


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run a command.

    Parameters
    ----------
    arguments
        Words after the program's name; by default those of this process.

    Raises
    ------
    SystemExit
        0 done, 2 bad input (one line on standard error), 1 anything else.

    """
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
        _show_usage(error)
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
        _say(f"unexpected {type(error).__name__}: {error} (use --debug for the traceback)")
        return 1
    return 0


def _show_usage(error: click.UsageError) -> None:
    if isinstance(error, NoArgsIsHelpError):
        error.show()
    else:
        command = error.ctx.command_path if error.ctx else "stiffscope"
        _say(f"{error.format_message()} (see {command} --help)")


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

"""The command line: the group of commands, exit codes and one-line error messages."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import re
import signal
import sys
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import click
from click.exceptions import NoArgsIsHelpError
from click.shell_completion import CompletionItem

from stiffscope.errors import (
    InputError,
    StiffscopeError,
    lacks_memory,
    require,
    suggest,
)
from stiffscope.registry import SUBJECTS, commands
from stiffscope.runtime.collection import no_collection
from stiffscope.runtime.output import FULL
from stiffscope.runtime.reading import describe_cause, show_path
from stiffscope.runtime.signals import STOPS

_FOR_DEVELOPERS = {
    "py.warnings",
    "asyncio",
}  # shown only with --debug, e.g. a stopped event loop
STOPPED = "stopped; nothing half-written is left"
_stopped: list[int] = []  # signals that asked this process to end


class Stopped(BaseException):
    """The process was asked to end; the message, if any, replaces the default one."""


class LazyGroup(click.Group):
    """A command group that imports a command only to run it; its help imports none."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 (click's own signature)
        """Return the sorted names of all commands."""
        return sorted(commands())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import a command."""
        known = commands().get(cmd_name)
        if known is None:
            return None
        with no_collection():
            module = import_module(known.module)
        for defined in vars(module).values():
            if isinstance(defined, click.Command) and defined.name == cmd_name:
                return defined
        raise StiffscopeError(f"{known.module}: defines no command {cmd_name}")

    def shell_complete(
        self, ctx: click.Context, incomplete: str
    ) -> list[CompletionItem]:
        """Complete the names of commands without importing them, and options."""
        words = [
            CompletionItem(name, help=known.help)
            for name, known in sorted(commands().items())
            if name.startswith(incomplete)
        ]
        options = click.Command.shell_complete(self, ctx, incomplete)
        return [*words, *options]

    def format_commands(
        self,
        ctx: click.Context,  # noqa: ARG002
        formatter: click.HelpFormatter,
    ) -> None:
        """List the commands by subject."""
        for subject in SUBJECTS:
            rows = [
                (c.name, c.help) for c in commands().values() if c.subject == subject
            ]
            with formatter.section(subject):
                formatter.write_dl(rows)


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(
    package_name="stiffscope", prog_name="stiffscope", message="%(prog)s %(version)s"
)
def cli() -> None:
    """Stiffness of a robot: virtual experiments on parts, the whole robot, the gap to the machine.

    ROBOT is a robot file, or a bundled robot (biglide, delta; stiffscope robots lists them).
    """


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run a command.

    Parameters
    ----------
    arguments
        Command-line arguments; by default those of this process.

    Raises
    ------
    SystemExit
        Exit code: 0 success, 2 bad input (one line on standard error), 1 any other error.
    """
    sys.exit(_guarded(sys.argv[1:] if arguments is None else arguments))


def _guarded(arguments: list[str]) -> int:  # noqa: PLR0911 (one return per way to end)
    _listen()
    try:
        _check_surroundings()
        cli.main(arguments, prog_name="stiffscope", standalone_mode=False)
        sys.stdout.flush()
    except InputError as error:
        _say(*error.lines)
        return 2
    except click.UsageError as error:
        _show_usage(error)
        return 2
    except (KeyboardInterrupt, click.Abort, Stopped) as error:
        _say(str(error) or STOPPED)
        return 1
    except BrokenPipeError:
        _drop_output()  # the reader has closed the pipe
        return 1
    except OSError as error:
        if "--debug" in arguments:
            raise
        _drop_output()
        _say(_describe_error(error))
        return 1 if error.errno in FULL or _stopped or lacks_memory(error) else 2
    except UnicodeEncodeError as error:
        text = show_path(str(error.object)[:60])
        _say(f"{text}: expected text in UTF-8, got bytes that are none")
        return 2
    except Exception as error:
        if "--debug" in arguments:
            raise
        _say(_describe_error(error))
        return 1
    return 0


def _describe_error(error: Exception) -> str:
    if _stopped:  # a library may turn a stop into an error of its own, e.g. ImportError
        return STOPPED
    if lacks_memory(error):
        return "not enough memory; use a machine with more or, where a part is meshed, a larger mesh.size"
    if isinstance(error, StiffscopeError):
        return str(error)
    if isinstance(error, OSError):
        file = (
            str(error.filename) if isinstance(error.filename, str | os.PathLike) else ""
        )
        place = (
            show_path(file)
            if file
            else "standard output, or the disk of temporary files"
        )
        return f"{place}: cannot be used ({describe_cause(error, file or '-')})"
    return f"unexpected {type(error).__name__}: {error} (use --debug for the traceback)"


def _check_surroundings() -> None:
    """Raise InputError for a closed output or a missing working folder."""
    valid = "a file, a pipe or a terminal"
    require(sys.stdout is not None, "standard output", valid, "a closed one")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    try:
        Path.cwd()
    except OSError as error:
        raise InputError(
            "the working folder is no longer there; change to another one"
        ) from error


def _drop_output() -> None:
    """Redirect standard output to the null device, so that Python's exit writes nothing."""
    with contextlib.suppress(OSError, AttributeError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _show_usage(error: click.UsageError) -> None:
    if isinstance(error, NoArgsIsHelpError):
        error.show()
    else:
        command = error.ctx.command_path if error.ctx else "stiffscope"
        text = error.format_message()
        unknown = re.match(r"No such command '(.*)'\.", text)
        group = error.ctx.command if error.ctx else None
        if unknown and error.ctx and isinstance(group, click.Group):
            text = text.removesuffix(".") + suggest(
                unknown[1], group.list_commands(error.ctx)
            )
        _say(f"{text} (see {command} --help)")


def _listen() -> None:
    """Handle stop signals, and show each warning once, in one line."""
    _stopped.clear()
    for name in STOPS:
        with contextlib.suppress(
            AttributeError, ValueError
        ):  # not on every system or thread
            signal.signal(getattr(signal, name), _stop)
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("stiffscope: %(message)s"))
    handler.addFilter(_Once())
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    logging.captureWarnings(
        capture=True
    )  # Python's own warnings are shown with --debug


class _Once(logging.Filter):
    def __init__(self) -> None:
        super().__init__()
        self.seen: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a message is new."""
        if record.name in _FOR_DEVELOPERS and logging.getLogger().level > logging.DEBUG:
            return False
        message = record.getMessage()
        new = message not in self.seen
        self.seen.add(message)
        return new


def _stop(number: int, _frame: Any) -> NoReturn:
    _stopped.append(number)
    for name in STOPS:  # ignore further signals during cleanup
        with contextlib.suppress(AttributeError):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    raise KeyboardInterrupt if number == signal.SIGINT else Stopped


def _say(*texts: str) -> None:
    for text in texts:
        plain = " ".join(show_path(word) for word in text.split())
        with contextlib.suppress(OSError):
            click.echo(f"stiffscope: {plain}", err=True)

"""A target of `stiffscope export`: one object that carries all its facts."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from stiffscope.cli.poses import Asked
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.robot.file.description import RobotFile

TARGETS = "stiffscope.exports.targets"


@dataclass(frozen=True)
class Order:
    """What is to be exported.

    Attributes
    ----------
    assembled
        Robot with its parts' matrices; ``assembled.mechanism`` has the effects adopted in the file.
    asked
        Names and configurations of the poses; at least one.
    highest
        Frequency (Hz) above which a simulator need not follow vibrations; None if not given.
    """

    assembled: Assembled
    asked: Asked
    highest: float | None = None


@dataclass(frozen=True)
class Exported:
    """A robot in the form of another program.

    Attributes
    ----------
    write
        Writes the files into a folder.
    answer
        Content of `--json`, beside the robot, the target and the poses.
    rows
        Table of the terminal: name and value.
    remarks
        Sentences on what the other program cannot express, or what to mind.
    """

    write: Callable[[Path], object]
    answer: dict[str, Any] = field(default_factory=dict)
    rows: tuple[tuple[str, str], ...] = ()
    remarks: tuple[str, ...] = ()


def accept(_robot: RobotFile) -> None:
    """Refuse no robot."""


@dataclass(frozen=True)
class Target:
    """A form in which a robot can be exported.

    Attributes
    ----------
    name
        As `--to` has it; the name of its module.
    help
        One sentence for `--help`.
    files
        Names of the files it writes, ``{robot}`` for the robot's name, each with its meaning.
    export
        Returns the robot in this form; raises InputError, in one line that says what to do, for a
        robot that the other program cannot hold.
    check
        Raises InputError before any virtual experiment for a robot that cannot be exported.
    """

    name: str
    help: str
    files: dict[str, str]
    export: Callable[[Order], Exported]
    check: Callable[[RobotFile], None] = accept


@cache
def target_names() -> tuple[str, ...]:
    """Return the names of all targets without importing them."""
    package = import_module(TARGETS)
    return tuple(sorted(module.name for module in iter_modules(package.__path__)))


def load_target(name: str) -> Target:
    """Return a target by its name."""
    return import_module(f"{TARGETS}.{name}").TARGET

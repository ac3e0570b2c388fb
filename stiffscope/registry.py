"""What each slice of the package registers, so that the core need not know the slices.

A slice is a subpackage with a module `slice` that defines ``SLICE``. That module imports nothing but
this one, so that `stiffscope --help` stays fast: everything else is named as ``"module:name"`` and
imported on first use.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

SUBJECTS = (
    "A robot",
    "A part",
    "A design",
    "A machine at work",
    "A machine",
    "Files",
)
"""Headings of `stiffscope --help`, in order."""


@dataclass(frozen=True)
class Command:
    """A command: its name, the module that defines it, its heading and its first sentence."""

    name: str
    module: str
    subject: str
    help: str


@dataclass(frozen=True)
class Slice:
    """What one slice adds to the package.

    Attributes
    ----------
    commands
        Its commands.
    rank
        Where its commands stand among those of the same heading; small numbers first.
    changes
        ``"module:function"`` by section of the robot file: a function that takes the mechanism and
        the robot file, and returns the mechanism changed as the section says.
    doubts
        ``"module:function"`` that returns doubts on a robot file, for `check`; none if empty.
    pictures
        ``"module:function"`` that returns further pictures of a run, given the assembled robot and
        the folder of the run; none if empty.
    keys
        ``"module:name"`` by kind of file: the sections of that file as pairs of title and schema.
    sections
        Further top-level sections of a kind of file: kind, name, and ``"module:schema"``.
    """

    commands: tuple[Command, ...] = ()
    rank: int = 50
    changes: tuple[tuple[str, str], ...] = ()
    doubts: str = ""
    pictures: str = ""
    keys: tuple[tuple[str, str], ...] = ()
    sections: tuple[tuple[str, str, str], ...] = ()


@cache
def slices() -> dict[str, Slice]:
    """Return what the slices register, by name of the slice."""
    by_name = {}
    for package in iter_modules([str(Path(__file__).parent)]):
        name = f"stiffscope.{package.name}.slice"
        if package.ispkg and find_spec(name) is not None:
            by_name[package.name] = import_module(name).SLICE
    return by_name


@cache
def commands() -> dict[str, Command]:
    """Return all commands by name, in the order of the help."""
    ordered = sorted(slices().values(), key=lambda each: each.rank)
    listed = [command for provider in ordered for command in provider.commands]
    listed.sort(key=lambda command: SUBJECTS.index(command.subject))
    return {command.name: command for command in listed}


def registered(kind: str) -> Iterator[Any]:
    """Import and yield what every slice registers of a kind: `doubts` or `pictures`."""
    for provider in slices().values():
        reference = getattr(provider, kind)
        if reference:
            yield load(reference)


def sections_of(kind: str) -> dict[str, Any]:
    """Return the schemas of the sections that slices add to a kind of file, by name."""
    return {
        name: load(reference)
        for provider in slices().values()
        for of, name, reference in provider.sections
        if of == kind
    }


def load(reference: str) -> Any:
    """Import ``"module:name"``."""
    module, _, name = reference.partition(":")
    return getattr(import_module(module), name)

"""First pass over a robot file: its text to data, and the lines of its keys, which errors name."""

from __future__ import annotations

import re
import tomllib
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError
from stiffscope.robot.file.positions import Key, line_of, positions

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

MOST_VALUES, MOST_LEVELS = 50_000, 30  # of a file written by hand
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_WORD = r"(?:(?<![\w-])[\w-]++|\"[^\"\n]*+\"|'[^'\n]*+')"
_DOTTED = re.compile(rf"(?:{_WORD}[ \t]*+\.[ \t]*+){{300}}")  # parsing takes the square of the depth


class FieldError(ValueError):
    """What is wrong with the value of a key; `Source.refuse` adds file and line."""

    def __init__(self, key: Key, message: str) -> None:
        super().__init__(message)
        self.key = key


@contextmanager
def blame(*key: str | int) -> Iterator[None]:
    """Raise FieldError of a key for a ValueError of what is done to its value."""
    try:
        yield
    except FieldError:
        raise
    except ValueError as error:
        raise FieldError(key, str(error)) from error


@dataclass
class Source:
    """A file's path and text, what `--set` changed of it by key, and where copies come from."""

    path: Path
    text: str
    overrides: tuple[str, ...] = ()
    changed: dict[Key, str] = field(default_factory=dict)
    origins: dict[str, str] = field(default_factory=dict)

    @cached_property
    def lines(self) -> dict[Key, int]:
        """Line of every key of the file."""
        return positions(self.text)

    def line(self, key: Key) -> int:
        """Line of a key; that of its original for a copied body or joint."""
        if len(key) > 1 and key[:2] not in self.lines and key[1] in self.origins:
            key = (key[0], self.origins[str(key[1])], *key[2:])
        return line_of(self.lines, key)

    def refuse(self, key: Key, message: str) -> InputError:
        """Error for a key: names the `--set` that brought it, else file and line."""
        key = as_written(key)
        by = next((self.changed[key[:n]] for n in range(len(key), 0, -1) if key[:n] in self.changed), None)
        for table in (key, key[:-1]):  # one that is not in the file, but for what was set in it
            if by is None and len(table) > 1 and table not in self.lines:
                by = next((text for each, text in self.changed.items() if each[: len(table)] == table), None)
        return InputError(f"{by or f'{self.path}:{self.line(key)}'}: {field_name(key)}: {message}")


def as_written(key: Key) -> Key:
    """The key of a joint that has a body's name, and so is "joints.NAME" itself."""
    if len(key) > 1 and key[0] == "joints" and str(key[1]).startswith("joints."):
        return ("joints", str(key[1]).removeprefix("joints."), *key[2:])
    return key


def field_name(key: Key) -> str:
    """A key as the file spells it: `joints."leg1.motor".axis[2]`."""
    parts = (
        f"[{part}]" if isinstance(part, int) else f".{part}" if _BARE.fullmatch(part) else f'."{part}"' for part in key
    )
    return "".join(parts).removeprefix(".")


def parse_text(path: Path, text: str, what: str = "a robot file") -> dict[str, Any]:
    """Content of a TOML text of bounded size and depth.

    Parameters
    ----------
    path
        What errors call the file.
    text
        Its content.
    what
        What it should be, for the message.

    Returns
    -------
    dict
        As `tomllib` gives it.

    Raises
    ------
    InputError
        With line and column, or line and field.

    """
    deep = _DOTTED.search(text)
    if deep:
        line = text.count("\n", 0, deep.start()) + 1
        raise InputError(f"{path}:{line}: expected keys of at most {MOST_LEVELS} names with dots, got a longer one")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        line, message = _explain(error, text, shown=path.suffix == ".toml")
        raise InputError(f"{path}:{line}: {message}") from error
    except RecursionError as error:
        line = _first_line(text, rf"[\[{{](?:\s*[\[{{]){{{MOST_LEVELS}}}")
        raise InputError(f"{path}:{line}: expected {what}, got tables or lists nested too deeply") from error
    except ValueError as error:  # Python's limit of digits
        line = _first_line(text, r"[0-9_]{4300}")
        raise InputError(f"{path}:{line}: expected numbers of at most 19 digits, got a longer one") from error
    try:
        _check_size(data)
    except FieldError as error:
        name = field_name(error.key)
        name = name if len(name) <= 120 else f"{name[:117]}..."
        raise InputError(f"{path}:{line_of(positions(text), error.key)}: {name}: {error}") from error
    return data


def _explain(error: tomllib.TOMLDecodeError, text: str, *, shown: bool) -> tuple[int, str]:
    """Line of what is no TOML, and the message; a file that was hardly meant to be any is not ``shown``."""
    reason, _, place = str(error).partition(" (at ")
    found = re.search(r"line (\d+), column (\d+)", place)
    lines = text.split("\n")
    line = min(int(found[1]), len(lines)) if found else len(lines)
    line_shown = f'"{lines[line - 1].strip()[:60]}" (column' if shown else "another text (column"
    where = f"{line_shown} {found[2]})" if found else "the end of the file"
    return line, f"expected valid TOML, got {where}: {reason[:1].lower()}{reason[1:]}"


def _first_line(text: str, pattern: str) -> int:
    """Line of what a pattern finds first."""
    found = re.search(pattern, text)
    return text.count("\n", 0, found.start()) + 1 if found else 1


def _check_size(data: dict[str, Any]) -> None:
    """Raise FieldError for what is too deep, too much or too long to be looked at further."""
    left: list[tuple[Key, Any]] = [((), data)]
    count = 0
    while left:
        key, value = left.pop()
        count += 1
        if count > MOST_VALUES:
            raise FieldError(key[:1], f"expected at most {MOST_VALUES} values in a file, got more")
        if len(key) > MOST_LEVELS:
            raise FieldError(key, f"expected at most {MOST_LEVELS} levels of tables and lists, got more")
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise FieldError(key, "expected a number of at most 19 digits, got a longer one")
        if isinstance(value, dict | list):
            items = value.items() if isinstance(value, dict) else enumerate(value)
            left += [((*key, name), each) for name, each in items]

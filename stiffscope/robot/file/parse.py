"""First pass over a robot file: parse its text, and find the lines of its keys for messages."""

from __future__ import annotations

import re
import tomllib
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

from stiffscope.errors import FieldError, InputError
from stiffscope.robot.file.positions import line_of, positions

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from stiffscope.errors import Key

MOST_VALUES = 50_000
MOST_LEVELS = 30  # ample for a file written by hand
_NAME = re.compile(r'([A-Za-z0-9_-]+)|"([^"]*)"')
_PLACE = re.compile(r'(?:(?:[A-Za-z0-9_-]+|"[^"]*")(?:\.|(?=: )))+')
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_WORD = r"(?:(?<![\w-])[\w-]+|\"[^\"\n]*\"|'[^'\n]*')"
_DOTTED = re.compile(
    rf"(?:{_WORD}[ \t]*\.[ \t]*){{300}}"
)  # parsing time is quadratic in depth


@contextmanager
def naming_key(*key: str | int, inner: bool = False) -> Iterator[None]:
    """Convert a ValueError in the block to a FieldError of a key, or of an inner key that it names."""
    try:
        yield
    except FieldError:
        raise
    except ValueError as error:
        within, message = split_place(str(error)) if inner else ((), str(error))
        raise FieldError((*key, *within[1:]), message) from error


def split_place(message: str) -> tuple[Key, str]:
    """Return the keys before a message such as 'joints."leg1.arm".at: expected …', and the rest."""
    place = _PLACE.match(message)
    if place is None:
        return (), message
    keys = tuple(bare or quoted for bare, quoted in _NAME.findall(place[0]))
    return keys, message[place.end() + 2 :]


@dataclass
class Source:
    """Path and text of a file, `--set` changes by key, and originals of copies."""

    path: Path
    text: str
    overrides: tuple[str, ...] = ()
    changed: dict[Key, str] = field(default_factory=dict)
    origins: dict[str, str] = field(default_factory=dict)

    @cached_property
    def lines(self) -> dict[Key, int]:
        """Line of each key in the file."""
        return positions(self.text)

    def line(self, key: Key) -> int:
        """Return the line of a key; for a copied body or joint that of its original."""
        if len(key) > 1 and key[:2] not in self.lines and key[1] in self.origins:
            key = (key[0], self.origins[str(key[1])], *key[2:])
        return line_of(self.lines, key)

    def refuse(self, key: Key, message: str) -> InputError:
        """Return an error for a key: with its `--set` override, else with file, line, overrides."""
        key = as_written(key)
        above = [key[:n] for n in range(len(key), 0, -1)]
        by = next((self.changed[each] for each in above if each in self.changed), None)
        for table in above[:2]:  # a table that exists only because of an override
            if by is None and len(table) > 1 and table not in self.lines:
                inside = (
                    change for change in self.changed if change[: len(table)] == table
                )
                by = self.changed.get(next(inside, ()))
        where = by or f"{self.path}:{self.line(key)}"
        others = ", ".join(self.overrides[:3])
        message += f" (with --set {others})" if others and not by else ""
        return InputError(f"{where}: {field_name(key)}: {message}")

    def require(self, valid: object, key: Key, expected: str, got: object) -> None:
        """Raise the error of a key unless what it needs is valid."""
        if not valid:
            raise self.refuse(key, f"expected {expected}, got {got}")

    @contextmanager
    def refusing(self) -> Iterator[None]:
        """Convert a FieldError in the block to `refuse`'s error."""
        try:
            yield
        except FieldError as error:
            raise self.refuse(error.key, str(error)) from error


class Text(str):
    """A text of a file with its location there."""

    where: str

    def __new__(cls, text: str, where: str) -> Self:
        """Create a text at "FILE:LINE: FIELD"."""
        placed = super().__new__(cls, text)
        placed.where = where
        return placed


def place_of(option: str, text: str) -> str:
    """Return the location of a setting: option and text, or file, line and field."""
    return text.where if isinstance(text, Text) else f"{option} {text}"


def as_written(key: Key) -> Key:
    """Return a key as written: a joint named like a body is called "joints.NAME" internally."""
    if len(key) > 1 and key[0] == "joints" and str(key[1]).startswith("joints."):
        return ("joints", str(key[1]).removeprefix("joints."), *key[2:])
    return key


def field_name(key: Key) -> str:
    """Format a key as in the file: `joints."leg1.motor".axis[2]`."""
    names = [
        part if isinstance(part, int) or _BARE.fullmatch(part) else f'"{part}"'
        for part in key
    ]
    parts = (f"[{name}]" if isinstance(name, int) else f".{name}" for name in names)
    return "".join(parts).removeprefix(".")


def parse_text(path: Path, text: str, what: str = "a robot file") -> dict[str, Any]:
    """Parse a TOML text of bounded size and depth.

    Parameters
    ----------
    path
        File named in messages.
    text
        Content of the file.
    what
        Expected kind of file, for messages.

    Returns
    -------
    dict
        Data from `tomllib`.

    Raises
    ------
    InputError
        If the text is invalid; the message names line and column, or line and field.
    """
    deep = _DOTTED.search(text)
    if deep:
        line = text.count("\n", 0, deep.start()) + 1
        most = f"at most {MOST_LEVELS} names with dots"
        raise InputError(f"{path}:{line}: expected keys of {most}, got a longer one")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        line, message = _explain(error, text, shown=path.suffix == ".toml")
        raise InputError(f"{path}:{line}: {message}") from error
    except RecursionError as error:
        line = _first_line(text, rf"[\[{{](?:\s*[\[{{]){{{MOST_LEVELS}}}")
        got = "tables or lists nested too deeply"
        raise InputError(f"{path}:{line}: expected {what}, got {got}") from error
    except ValueError as error:  # Python's limit on digits
        place = f"{path}:{_first_line(text, r'[0-9_]{4300}')}"
        raise InputError(
            f"{place}: expected numbers of at most 19 digits, got a longer one"
        ) from error
    try:
        _check_size(data)
    except FieldError as error:
        name = field_name(error.key)
        name = name if len(name) <= 120 else f"{name[:117]}..."
        line = line_of(positions(text), error.key)
        raise InputError(f"{path}:{line}: {name}: {error}") from error
    return data


def _explain(
    error: tomllib.TOMLDecodeError, text: str, *, shown: bool
) -> tuple[int, str]:
    """Return line and message of a TOML error; quote the line only if ``shown``."""
    reason, _, place = str(error).partition(" (at ")
    match = re.search(r"line (\d+), column (\d+)", place)
    lines = text.split("\n")
    line = min(int(match[1]), len(lines)) if match else len(lines)
    line_shown = (
        f'"{lines[line - 1].strip()[:60]}" (column' if shown else "another text (column"
    )
    where = f"{line_shown} {match[2]})" if match else "the end of the file"
    return line, f"expected valid TOML, got {where}: {reason[:1].lower()}{reason[1:]}"


def _first_line(text: str, pattern: str) -> int:
    """Return the line of a pattern's first match."""
    match = re.search(pattern, text)
    return text.count("\n", 0, match.start()) + 1 if match else 1


def _check_size(data: dict[str, Any]) -> None:
    """Raise FieldError if data is nested too deeply, too large, or has too long integers."""
    left: list[tuple[Key, Any]] = [((), data)]
    count = 0
    while left:
        key, value = left.pop()
        count += 1
        if count > MOST_VALUES:
            most = f"at most {MOST_VALUES} values in a file"
            raise FieldError(key[:1], f"expected {most}, got more")
        if len(key) > MOST_LEVELS:
            most = f"at most {MOST_LEVELS} levels of tables and lists"
            raise FieldError(key, f"expected {most}, got more")
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise FieldError(
                key, "expected a number of at most 19 digits, got a longer one"
            )
        if isinstance(value, dict | list):
            items = value.items() if isinstance(value, dict) else enumerate(value)
            left += [((*key, name), each) for name, each in items]

"""Where a robot's values come from: the text of its file, and what `--set` changed; errors name the place."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError
from stiffscope.robot.file.positions import Key, line_of, positions
from stiffscope.runtime import reading

if TYPE_CHECKING:
    from pathlib import Path

MOST_VALUES, MOST_LEVELS = 50_000, 30  # of a file written by hand
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_WORD = r"(?:(?<![\w-])[\w-]++|\"[^\"\n]*+\"|'[^'\n]*+')"
_DOTTED = re.compile(rf"(?:{_WORD}[ \t]*+\.[ \t]*+){{300}}")  # the parser's time grows with the square of the depth


def field_name(key: Key) -> str:
    """A key as the file spells it: `joints."leg1.motor".axis[2]`."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if _BARE.fullmatch(part) else f'."{part}"'
    return text.removeprefix(".")


def read_text(path: Path) -> str:
    """Text of a robot file. Raises InputError for what is none."""
    return reading.read_text(path, "a robot file in TOML")


def parse_text(path: Path, text: str, what: str = "a robot file") -> dict[str, Any]:
    """Content of a TOML text of bounded size and depth. Raises InputError with line and column, or line and field."""
    deep = _DOTTED.search(text)
    if deep:
        line = text.count("\n", 0, deep.start()) + 1
        raise InputError(f"{path}:{line}: expected keys of at most {MOST_LEVELS} names with dots, got a longer one")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        place = re.search(r"\(at line (\d+), column (\d+)\)", str(error))
        reason = str(error).split(" (at ")[0]
        if place is None:
            line, where = text.count("\n") + 1, "the end of the file"
        else:
            lines = text.split("\n")
            line = min(int(place[1]), len(lines))
            where = f'"{lines[line - 1].strip()[:60]}" (column {place[2]})'
        reason = reason[:1].lower() + reason[1:]
        raise InputError(f"{path}:{line}: expected valid TOML, got {where}: {reason}") from error
    except RecursionError as error:
        line = _first(text, rf"[\[{{](?:\s*[\[{{]){{{MOST_LEVELS}}}")
        raise InputError(f"{path}:{line}: expected {what}, got tables or lists nested too deeply") from error
    except ValueError as error:  # Python's limit of digits
        line = _first(text, r"[0-9_]{4300}")
        raise InputError(f"{path}:{line}: expected numbers of at most 19 digits, got a longer one") from error
    refusal = _beyond(data)
    if refusal is not None:
        key, message = refusal
        raise InputError(f"{path}:{line_of(positions(text), key)}: {_cut(field_name(key))}: {message}")
    return data


def _first(text: str, pattern: str) -> int:
    """Line of what a pattern finds first."""
    found = re.search(pattern, text)
    return text.count("\n", 0, found.start()) + 1 if found else 1


def _beyond(data: dict[str, Any]) -> tuple[Key, str] | None:
    """Key of what is too deep, too much or too long to be looked at further, and why; None where nothing is."""
    left: list[tuple[Key, Any]] = [((), data)]
    count = 0
    while left:
        key, value = left.pop()
        count += 1
        if count > MOST_VALUES:
            return key[:1], f"expected at most {MOST_VALUES} values in a file, got more"
        if len(key) > MOST_LEVELS:
            return key, f"expected at most {MOST_LEVELS} levels of tables and lists, got more"
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            return key, "expected a number of at most 19 digits, got a longer one"
        if isinstance(value, dict):
            left += [((*key, name), each) for name, each in value.items()]
        elif isinstance(value, list):
            left += [((*key, number), each) for number, each in enumerate(value)]
    return None


def _cut(text: str) -> str:
    return text if len(text) <= 120 else f"{text[:117]}..."


@dataclass
class Source:
    """A robot file's path and text, what `--set` changed of it and the keys of that, and where copies come from."""

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
        for length in range(len(key), 0, -1):
            if key[:length] in self.changed:
                return InputError(f"{self.changed[key[:length]]}: {field_name(key)}: {message}")
        if key[:-1] not in self.lines:
            for changed, origin in self.changed.items():
                if len(key) > 1 and changed[: len(key) - 1] == key[:-1]:
                    return InputError(f"{origin}: {field_name(key)}: {message}")
        return InputError(f"{self.path}:{self.line(key)}: {field_name(key)}: {message}")

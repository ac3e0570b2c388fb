"""Where each key of a TOML text stands, in one pass over its tokens; neither tomllib nor tomlkit keeps line numbers."""

from __future__ import annotations

import re
import tomllib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

Key = tuple[str | int, ...]
"""Path to a value: table and key names, and positions in lists from 0."""

_TOKEN = re.compile(
    r"""[^\S\n]* ("{3}(?:[^\\]|\\.)*?"{3,5} | '{3}.*?'{3,5} | "(?:[^"\\]|\\.)*" | '[^']*'  # strings
        | \#[^\n]* | [][{}=,.\n] | [^][{}=,.\n"'\#\s]+)""",
    re.DOTALL | re.VERBOSE,
)
_ENDS = {",", "]", "}", "\n"}


def key_lines(text: str) -> dict[Key, int]:
    """Line, from 1, on which each table, key and list item of a valid TOML text begins."""
    return _Walk(text).lines


def line_of(lines: Mapping[Key, int], key: Key) -> int:
    """Line of a key's value among those of `key_lines`; of the nearest table that is there, for a key that is not."""
    while key and key not in lines:
        key = key[:-1]
    return lines.get(key, 1)


class _Walk:
    """One pass over a text that tomllib has accepted; `here` is the position among the words."""

    def __init__(self, text: str) -> None:
        self.words: list[tuple[str, int]] = []
        line = 1
        for word in _TOKEN.findall(text):
            if word[0] != "#":
                self.words.append((word, line))
            if "\n" in word:
                line += word.count("\n")
        self.words.append(("\n", line))
        self.here = 0
        self.lines: dict[Key, int] = {}
        self.last: dict[Key, int] = {}  # position of the latest table of each array of tables
        table: Key = ()
        while self.here < len(self.words):
            if self._next() == "\n":
                self.here += 1
            elif self._next() == "[":
                table = self._header()
            else:
                self._pair(table)

    def _next(self) -> str:
        return self.words[self.here][0]

    def _header(self) -> Key:
        """[table] or [[array of tables]]; a key that passes such an array means the latest of its tables."""
        self.here += 1
        many = self._next() == "["
        self.here += many
        key = self._key()
        table: Key = ()
        for part in key[:-1]:
            table = (*table, part)
            if table in self.last:
                table = (*table, self.last[table])
        table = (*table, key[-1])
        self._note(table)
        if many:
            self.last[table] = self.last.get(table, -1) + 1
            table = (*table, self.last[table])
            self._note(table)
        self.here += 1 + many
        return table

    def _pair(self, table: Key) -> None:
        key = self._key()
        self.here += 1  # =
        self._value((*table, *key))

    def _key(self) -> Key:
        parts: list[str] = []
        while True:
            word = self._next()
            parts.append(next(iter(tomllib.loads(f"{word} = 0"))) if word[0] in "\"'" else word)
            self.here += 1
            if self._next() != ".":
                return tuple(parts)
            self.here += 1

    def _value(self, path: Key) -> None:
        self._note(path)
        opened = self._next()
        if opened not in "[{":
            while self._next() not in _ENDS:
                self.here += 1
            return
        self.here += 1
        count = 0
        while self._next() not in "]}":
            if self._next() in _ENDS:
                self.here += 1
            elif opened == "{":
                self._pair(path)
            else:
                self._value((*path, count))
                count += 1
        self.here += 1

    def _note(self, path: Key) -> None:
        """Note the present line for a path, and for what leads to it, unless they have one."""
        while path and path not in self.lines:
            self.lines[path] = self.words[self.here][1]
            path = path[:-1]

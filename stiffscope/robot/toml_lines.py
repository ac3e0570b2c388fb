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
    """One pass over a text that tomllib has accepted; each method takes a position among the words, and returns one."""

    def __init__(self, text: str) -> None:
        self.words: list[str] = []
        self.at: list[int] = []
        line = 1
        for word in _TOKEN.findall(text):
            if word[0] != "#":
                self.words.append(word)
                self.at.append(line)
            if "\n" in word:
                line += word.count("\n")
        self.lines: dict[Key, int] = {}
        self.last: dict[Key, int] = {}  # position of the latest table of each array of tables
        self._statements()

    def _statements(self) -> None:
        table: Key = ()
        position = 0
        while position < len(self.words):
            if self.words[position] == "\n":
                position += 1
            elif self.words[position] == "[":
                table, position = self._header(position)
            else:
                key, position = self._key(position)
                position = self._value(position + 1, (*table, *key))

    def _header(self, position: int) -> tuple[Key, int]:
        line, brackets = self.at[position], 1 + (self.words[position + 1] == "[")
        key, position = self._key(position + brackets)
        table = (*self._resolved(key[:-1]), key[-1])
        self._note(table, line)
        if brackets == 2:
            self.last[table] = self.last.get(table, -1) + 1
            table = (*table, self.last[table])
            self._note(table, line)
        return table, position + brackets

    def _key(self, position: int) -> tuple[Key, int]:
        parts = [_name(self.words[position])]
        while self.words[position + 1] == ".":
            position += 2
            parts.append(_name(self.words[position]))
        return tuple(parts), position + 1

    def _value(self, position: int, path: Key) -> int:
        self._note(path, self.at[position])
        if self.words[position] == "[":
            return self._items(position + 1, path)
        if self.words[position] == "{":
            return self._pairs(position + 1, path)
        while position < len(self.words) and self.words[position] not in _ENDS:
            position += 1
        return position

    def _items(self, position: int, path: Key) -> int:
        count = 0
        while self.words[position] != "]":
            if self.words[position] in _ENDS:
                position += 1
            else:
                position = self._value(position, (*path, count))
                count += 1
        return position + 1

    def _pairs(self, position: int, path: Key) -> int:
        while self.words[position] != "}":
            if self.words[position] in _ENDS:
                position += 1
            else:
                key, position = self._key(position)
                position = self._value(position + 1, (*path, *key))
        return position + 1

    def _note(self, path: Key, line: int) -> None:
        for length in range(len(path), 0, -1):
            if path[:length] in self.lines:
                break
            self.lines[path[:length]] = line

    def _resolved(self, key: Key) -> Key:
        """A header's key with the position of the latest table wherever it passes an array of tables."""
        found: Key = ()
        for part in key:
            found = (*found, part)
            if found in self.last:
                found = (*found, self.last[found])
        return found


def _name(word: str) -> str:
    return next(iter(tomllib.loads(f"{word} = 0"))) if word[0] in "\"'" else word

"""Lines of the keys of a TOML file, found in one pass over its text; the parser of the standard library keeps none."""

from __future__ import annotations

import re
from typing import Any

Key = tuple[str | int, ...]

_STRING = r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\])*"|\'[^\']*\''
_TOKEN = re.compile(
    rf"[ \t\r]+|\#[^\n]*|(?P<string>{_STRING})|(?P<bare>[^\s\"'\#=,.\[\]{{}}]+)|(?P<mark>.|\n)", re.DOTALL
)
_ESCAPE = re.compile(r'\\(u[0-9a-fA-F]{4}|U[0-9a-fA-F]{8}|[btnfre"\\])')
_ESCAPED = {"b": "\b", "t": "\t", "n": "\n", "f": "\f", "r": "\r", "e": "\x1b", '"': '"', "\\": "\\"}


def positions(text: str) -> dict[Key, int]:
    """Line of every table, key and list item of a valid TOML text, counted from 1."""
    return _Scanner(text).run()


class _Scanner:
    """A walk over tokens; the text has been accepted by a parser, so it is not checked here."""

    def __init__(self, text: str) -> None:
        self.lines: dict[Key, int] = {}
        self.tables: dict[Key, int] = {}  # lists of tables: how many there are so far
        self.tokens: list[tuple[str, str, int]] = []  # kind, text, line
        line = 1
        for match in _TOKEN.finditer(text):
            if match.lastgroup is not None:
                self.tokens.append((match.lastgroup, match.group(), line))
            line += match.group().count("\n")
        self.tokens.append(("end", "", line))
        self.at = 0

    def run(self) -> dict[Key, int]:
        table: Key = ()
        while self.kind != "end":
            if self.mark == "\n":
                self.at += 1
            elif self.mark == "[":
                table = self.header()
            else:
                self.pair(table)
        return self.lines

    @property
    def kind(self) -> str:
        return self.tokens[self.at][0]

    @property
    def mark(self) -> str:
        """The mark that stands here, or nothing."""
        kind, text, _ = self.tokens[self.at]
        return text if kind == "mark" else ""

    @property
    def line(self) -> int:
        return self.tokens[self.at][2]

    def note(self, key: Key, line: int) -> None:
        """Keep the line of a key, and of the tables that it opens on its way."""
        for length in range(len(key), 0, -1):
            if self.lines.setdefault(key[:length], line) != line:
                return

    def header(self) -> Key:
        line, many = self.line, self.tokens[self.at + 1][1] == "["
        self.at += 2 if many else 1
        names = self.key()
        self.at += 2 if many else 1
        key: Key = ()
        for name in names[:-1]:
            key = self.inside((*key, name))
        key = (*key, names[-1])
        if many:
            self.note(key, line)
            self.tables[key] = self.tables.get(key, 0) + 1
        key = self.inside(key)
        self.lines[key] = line  # over what an earlier sub-table has opened
        self.note(key, line)
        return key

    def inside(self, key: Key) -> Key:
        """A list of tables stands for its last one."""
        return (*key, self.tables[key] - 1) if key in self.tables else key

    def key(self) -> list[str]:
        """A dotted key; stands behind it afterwards."""
        names = [self.name()]
        while self.mark == ".":
            self.at += 1
            names.append(self.name())
        return names

    def name(self) -> str:
        kind, text, _ = self.tokens[self.at]
        self.at += 1
        if kind == "string":
            return _ESCAPE.sub(_unescaped, text[1:-1]) if text[0] == '"' else text[1:-1]
        return text

    def pair(self, table: Key) -> None:
        """`key = value`, and all that is in the value."""
        line = self.line
        key = (*table, *self.key())
        self.note(key, line)
        self.at += 1  # =
        self.value(key)

    def value(self, key: Key) -> None:
        if self.mark == "[":
            self.items(key)
        elif self.mark == "{":
            self.pairs(key)
        else:
            while self.kind != "end" and self.mark not in {"\n", ",", "]", "}"}:
                self.at += 1

    def items(self, key: Key) -> None:
        self.at += 1
        number = 0
        while self.mark != "]":
            if self.mark in {"\n", ","}:
                self.at += 1
            else:
                self.note((*key, number), self.line)
                self.value((*key, number))
                number += 1
        self.at += 1

    def pairs(self, key: Key) -> None:
        self.at += 1
        while self.mark != "}":
            if self.mark in {"\n", ","}:
                self.at += 1
            else:
                self.pair(key)
        self.at += 1


def _unescaped(match: re.Match[str]) -> Any:
    code = match[1]
    return _ESCAPED[code] if code in _ESCAPED else chr(int(code[1:], 16))


def line_of(lines: dict[Key, int], key: Key) -> int:
    """Line of a key, or of the nearest table around it that the file has."""
    while key:
        if key in lines:
            return lines[key]
        key = key[:-1]
    return 1

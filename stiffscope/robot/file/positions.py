"""Line numbers of the keys of a TOML file, which Python's TOML parsers do not provide."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.errors import Key

_STRING = r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\])*"|\'[^\']*\''
_TOKEN = re.compile(
    rf"[ \t\r]+|\#[^\n]*|(?P<string>{_STRING})|(?P<bare>[^\s\"'\#=,.\[\]{{}}]+)|(?P<mark>.|\n)",
    re.DOTALL,
)
_ESCAPE = re.compile(r'\\(u[0-9a-fA-F]{4}|U[0-9a-fA-F]{8}|[btnfre"\\])')
_ESCAPED = dict(zip('btnfre"\\', '\b\t\n\f\r\x1b"\\', strict=True))


def positions(text: str) -> dict[Key, int]:
    """Return the line of each table, key and list item in a valid TOML text, counted from 1."""
    scanner = _Scanner(text)
    table = ()
    while scanner.kind != "end":
        if scanner.mark == "\n":
            scanner.step()
        elif scanner.mark == "[":
            table = scanner.read_header()
        else:
            scanner.read_pair(table)
    return scanner.lines


def line_of(lines: dict[Key, int], key: Key) -> int:
    """Return the line of a key, or of its nearest enclosing table in the file."""
    return next((lines[key[:n]] for n in range(len(key), 0, -1) if key[:n] in lines), 1)


def _tokens(text: str) -> Iterator[tuple[str, str, int]]:
    """Yield kind, text and line of each token except spaces and comments."""
    line = 1
    for match in _TOKEN.finditer(text):
        if match.lastgroup is not None:
            yield match.lastgroup, match.group(), line
        line += match.group().count("\n")
    yield "end", "", line


class _Scanner:
    """Scanner of the tokens of a valid TOML text, which is not checked again."""

    def __init__(self, text: str) -> None:
        self.lines: dict[Key, int] = {}
        self.tables: dict[Key, int] = {}  # lists of tables: number found so far
        self.tokens = _tokens(text)
        self.step()

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            self.kind, self.text, self.line = next(self.tokens)
            self.mark = self.text if self.kind == "mark" else ""

    def note(self, key: Key, line: int) -> None:
        """Record the line of a key, and of the tables that it opens implicitly."""
        for length in range(len(key), 0, -1):
            if self.lines.setdefault(key[:length], line) != line:
                return

    def read_header(self) -> Key:
        line = self.line
        self.step()
        many = self.mark == "["
        self.step(many)
        *names, last = self.read_key()
        self.step(1 + many)
        key: Key = ()
        for name in names:
            key = self.inside((*key, name))
        key = (*key, last)
        if many:
            self.note(key, line)
            self.tables[key] = self.tables.get(key, 0) + 1
        key = self.inside(key)
        self.lines[key] = (
            line  # replaces the line of an earlier sub-table that opened it
        )
        self.note(key, line)
        return key

    def inside(self, key: Key) -> Key:
        """Return the key of the last table if a key is a list of tables; otherwise the key."""
        return (*key, self.tables[key] - 1) if key in self.tables else key

    def read_key(self) -> list[str]:
        """Read a dotted key, and advance past it."""
        names = [self.read_name()]
        while self.mark == ".":
            self.step()
            names.append(self.read_name())
        return names

    def read_name(self) -> str:
        name = self.text[1:-1] if self.kind == "string" else self.text
        name = _ESCAPE.sub(_unescape, name) if self.text[:1] == '"' else name
        self.step()
        return name

    def read_pair(self, table: Key) -> None:
        """Read `key = value`, including all keys inside the value."""
        line = self.line
        key = (*table, *self.read_key())
        self.note(key, line)
        self.step()  # =
        self.read_value(key)

    def read_value(self, key: Key) -> None:
        end = {"[": "]", "{": "}"}.get(self.mark)
        if end is None:
            while self.kind != "end" and self.mark not in {"\n", ",", "]", "}"}:
                self.step()
            return
        self.step()
        number = 0
        while self.mark != end:
            if self.mark in {"\n", ","}:
                self.step()
            elif end == "}":
                self.read_pair(key)
            else:
                self.note((*key, number), self.line)
                self.read_value((*key, number))
                number += 1
        self.step()


def _unescape(match: re.Match[str]) -> str:
    code = match[1]
    return _ESCAPED[code] if code in _ESCAPED else chr(int(code[1:], 16))

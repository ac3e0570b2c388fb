"""Universal files as datasets: ASCII records, and binary values of dataset 58b.

The delimiter of datasets is a line of ``-1``, which may also occur within binary values: these are
skipped by their stated length.

References
----------
University of Cincinnati SDRL, Universal File Formats for Modal Analysis Testing, datasets 58, 58b.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from stiffscope.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_DELIMITER = re.compile(rb"^ {4}-1[ \t]*$")
_BINARY = re.compile(rb"^ *(\d+)b(.*)$", re.IGNORECASE)
ASCII_LINES = 11  # of the header of 58b


@dataclass(frozen=True)
class Block:
    """One dataset.

    Attributes
    ----------
    number
        Its type: 58, 15, …
    name, line
        File, and line of the dataset's first record.
    records
        ASCII lines after the one with the type; of 58b, those of its header.
    binary
        Bytes of the values of 58b; None of an ASCII dataset.
    little_endian
        Byte order of these.
    """

    number: int
    name: str
    line: int
    records: Sequence[str]
    binary: bytes | None = None
    little_endian: bool = True

    def fail(self, record: int, expected: str) -> InputError:
        """Return the error for a record, counted from 0."""
        known = 0 <= record < len(self.records)
        got = (
            repr(self.records[record].strip()[:60])
            if known
            else "the end of the dataset"
        )
        where = f"{self.name}:{self.line + record}: dataset {self.number}"
        return InputError(f"{where}: expected {expected}, got {got}")

    def text(self, record: int) -> str:
        """Return a record. Raise InputError if the dataset ends before it."""
        if record >= len(self.records):
            raise self.fail(record, f"at least {record + 1} records")
        return self.records[record]


def split_blocks(name: str, content: bytes) -> Iterator[Block]:
    """Yield the datasets of a universal file.

    Parameters
    ----------
    name
        File, for messages.
    content
        Its bytes.

    Raises
    ------
    InputError
        The file has no dataset, one without a type, or one that is cut off.
    """
    at = 0
    line = 1
    seen = False
    while True:
        text, at, line = _next_line(content, at, line)
        if text is None:
            break
        if not _DELIMITER.match(text):
            continue  # between datasets: blank lines and notes of some programs
        seen = True
        text, at, line = _next_line(content, at, line)
        if text is None:
            break
        binary = _BINARY.match(text)
        if binary:
            block, at, line = _read_binary(name, content, at, line, binary)
            yield block
            continue
        block, at, line = _read_ascii(name, content, at, line, text)
        yield block
    if not seen:
        raise InputError(f"{name}: expected datasets between lines of -1, got none")


def _read_ascii(
    name: str, content: bytes, at: int, line: int, header: bytes
) -> tuple[Block, int, int]:
    """Return an ASCII dataset, and where the file goes on."""
    first = line
    try:
        number = int(header)
    except ValueError as error:
        got = repr(header.decode("latin-1").strip()[:60])
        expected = "the number of a dataset"
        raise InputError(
            f"{name}:{line - 1}: expected {expected}, got {got}"
        ) from error
    records = list[str]()
    while True:
        text, at, line = _next_line(content, at, line)
        if text is None:
            expected = "a line of -1 at its end"
            where = f"{name}:{first}: dataset {number}"
            raise InputError(f"{where}: expected {expected}, got the end of the file")
        if _DELIMITER.match(text):
            return Block(number, name, first, records), at, line
        records.append(text.decode("latin-1"))


def _next_line(content: bytes, at: int, line: int) -> tuple[bytes | None, int, int]:
    """Return the line that starts at a byte, the start of the next one, and its number.

    Lines end with LF, CR LF or CR.
    """
    if at >= len(content):
        return None, at, line
    end = content.find(b"\n", at)
    end = len(content) if end < 0 else end
    earlier = content.find(b"\r", at, end)  # not through the rest of the file
    end = end if earlier < 0 else earlier
    width = 2 if content[end : end + 2] == b"\r\n" else 1
    return content[at:end], end + width, line + 1


def _read_binary(
    name: str, content: bytes, at: int, line: int, header: re.Match[bytes]
) -> tuple[Block, int, int]:
    """Return a dataset 58b, and where the file goes on."""
    number = int(header[1])
    first = line
    fields = header[2].split()
    where = f"{name}:{first - 1}: dataset {number}b"
    if len(fields) < 4:
        expected = "byte order, number format, numbers of lines and of bytes"
        raise InputError(f"{where}: expected {expected}, got {len(fields)} fields")
    try:
        order, form, count, size = (int(word) for word in fields[:4])
    except ValueError as error:
        raise InputError(f"{where}: expected whole numbers, got {error}") from error
    if order not in {1, 2} or form != 2:
        expected = "byte order 1 or 2 and number format 2 (IEEE 754)"
        raise InputError(f"{where}: expected {expected}, got {order} and {form}")
    records = []
    for _ in range(count or ASCII_LINES):
        text, at, line = _next_line(content, at, line)
        if text is None:
            raise InputError(
                f"{where}: expected {count} lines, got the end of the file"
            )
        records.append(text.decode("latin-1"))
    end = _find_end(content, at, [size, *_value_sizes(records)])
    if end is None:
        expected = f"{size} bytes and a line of -1 after them"
        got = f"{len(content) - at} bytes to the end of the file"
        raise InputError(f"{where}: expected {expected}, got {got}")
    stop, after = end
    block = Block(
        number=number,
        name=name,
        line=first,
        records=records,
        binary=content[at:stop],
        little_endian=order == 1,
    )
    return block, after, line + 2


def _value_sizes(records: Sequence[str]) -> list[int]:
    """Return the sizes, bytes, that the header's own form of the values allows."""
    try:
        data_type, count, spacing = (int(word) for word in records[6].split()[:3])
    except (IndexError, ValueError):
        return []
    stated = 4 if data_type in {2, 5} else 8
    ordinates = 2 if data_type > 4 else 1
    sizes = list[int]()
    for precision in dict.fromkeys((stated, 8)):
        width = precision * ordinates
        if spacing == 1:
            sizes.append(count * width)
        else:
            sizes += [count * (width + 4), count * (width + precision)]
    return sizes


def _find_end(content: bytes, at: int, sizes: Sequence[int]) -> tuple[int, int] | None:
    """Return where the binary values end and where the file goes on after the delimiter.

    A size is believed if a delimiter follows it. Otherwise the values were changed by a transfer
    as text (CR added to each LF): the next delimiter that is followed by another one, or by the
    end of the file, ends them.
    """
    pattern = re.compile(rb"[\r\n]* {4}-1[ \t]*(?:\r\n|\n|\r|$)")
    for size in sizes:
        end = pattern.match(content, at + size)
        if end:
            return at + size, end.end()
    for end in pattern.finditer(content, at):
        rest = content[end.end() : end.end() + 200].lstrip()
        if not rest or rest.startswith(b"-1"):
            return end.start(), end.end()
    return None

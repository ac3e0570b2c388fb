"""Tables (.csv, .tsv, .xlsx) as columns of text or numbers; errors name file, line and column."""

from __future__ import annotations

import csv
import io
import logging
import math
import re
import zipfile
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice, pairwise, repeat
from typing import TYPE_CHECKING, Any

import numpy as np
import openpyxl

from stiffscope.errors import InputError, require, suggest
from stiffscope.runtime.reading import open_file, read_text

if TYPE_CHECKING:
    from collections.abc import (
        Callable,
        Collection,
        Iterable,
        Iterator,
        Mapping,
        Sequence,
    )
    from pathlib import Path
    from typing import BinaryIO

    from stiffscope.runtime.types import Array, Flags, Indices


log = logging.getLogger(__name__)
MOST_ROWS = 200_000  # of one table
MOST_COLUMNS = 1_000
MOST_CELLS = 20_000_000  # of a sheet, including empty ones; takes two seconds
_LAST_ROW = 1 << 20  # of a sheet
_MOST_LINES = 1 << 20  # of a text, including blank ones
_LONGEST = 1 << 16  # characters searched for the separator, and of an XML tag
_MOST_TAGS = 1 << 19  # of a row of a sheet, and beside its rows; takes seconds
MOST_BYTES = 1 << 26  # of an unpacked table: 200,000 rows of 20 numbers


_MOST_TOLD = 20  # faults of a table in one run


class Faults:
    """Faults of a table that are told together, in the order of its lines.

    Of a cell the first one counts. What follows from several cells is not looked for in rows with a wrong cell.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self._messages: list[tuple[int, str]] = []
        self._cells: dict[str, Flags] = {}
        self.missing: frozenset[str] = frozenset()
        """Columns that the table lacks; nothing is looked for that follows from them."""

    def add(self, line: int, *messages: str) -> None:
        """Add messages at a line."""
        self._messages += [(line, message) for message in messages]

    def unseen(self, wrong: Flags, column: str, *, alone: bool) -> Flags:
        """Return flags (n,) of rows that have a fault for the first time, and remember them.

        ``alone``: whether the fault follows from this cell alone.
        """
        if self.missing and (column in self.missing or not alone):
            return np.zeros(len(wrong), dtype=bool)
        columns = [column] if alone else list(self._cells)
        out = np.array(wrong, dtype=bool)
        for name in columns:
            if name in self._cells:
                out &= ~self._cells[name]
        self._cells[column] = self._cells.get(column, False) | out
        return out

    def raise_any(self) -> None:
        """Raise InputError with all faults, if there are any."""
        if not self._messages:
            return
        told = [
            message for _, message in sorted(self._messages, key=lambda one: one[0])
        ]
        rest = len(told) - _MOST_TOLD
        if rest > 0:
            told[_MOST_TOLD:] = [f"... and {rest} more of these"]
        raise InputError(told[0], told[1:])


@dataclass(frozen=True)
class Table:
    """Columns of text, or all of finite numbers (n,), of equal length."""

    name: str
    columns: Mapping[str, Sequence[str] | Array]
    lines: Sequence[int]
    """Line number of each row in the file."""
    decimal_comma: bool = False
    """Whether numbers may have a decimal comma."""
    headings: Mapping[str, str] = field(default_factory=dict)
    """The file's own headings of columns, where they are others."""
    faults: Faults | None = None
    """Where faults are gathered; None: the first one is raised."""

    @contextmanager
    def tell_together(self) -> Iterator[None]:
        """Raise InputError at the end, with all faults of the table that was read so."""
        faults = self.faults or Faults()
        try:
            yield
        except InputError as error:
            faults.add(self.lines[-1], *error.lines)
        faults.raise_any()

    def fail(self, row: int, column: str, expected: str) -> InputError:
        """Return the error for a cell."""
        cell = self.columns[column][row] if column in self.columns else ""
        text = cell if isinstance(cell, str) else f"{cell:g}"
        shown = "an empty cell" if not text.strip() else repr(text[:40])
        where = f"{self.name}:{self.lines[row]}: {self.headings.get(column, column)}"
        return InputError(f"{where}: expected {expected}, got {shown}")

    def note(self, error: InputError) -> None:
        """Gather an error about the whole table, or raise it."""
        if self.faults is None:
            raise error
        self.faults.add(0, *error.lines)

    @property
    def empty_column(self) -> tuple[str, ...]:
        """Return the cells of a column that the table does not have."""
        return tuple(repeat("", len(self.lines)))

    def column(self, name: str) -> tuple[str, ...]:
        """Return the cells of a column; empty cells if the column is missing."""
        cells = self.columns.get(name)
        return self.empty_column if cells is None else tuple(map(str, cells))

    def refuse_where(
        self, wrong: Flags, column: str, expected: str, *, alone: bool = False
    ) -> None:
        """Raise the error for the first wrong row of flags (n,), if any, or gather it.

        ``alone``: whether the fault follows from this column's cells alone.
        """
        if self.faults is not None:
            wrong = self.faults.unseen(wrong, column, alone=alone)
        if not wrong.any():
            return
        first = int(np.argmax(wrong))
        error = self.fail(first, column, expected)
        if self.faults is None:
            raise error
        rows = np.flatnonzero(wrong)
        more = ""
        if len(rows) > 1:
            last = self.lines[int(rows[-1])]
            more = f"; alike on {len(rows) - 1:,} more, to line {last}"
        self.faults.add(self.lines[first], f"{error}{more}")

    def codes(self, column: str, known: Sequence[str], expected: str) -> Indices:
        """Return indices (n,) of cells in known names; -1 if empty. Raise InputError if unknown."""
        code = {"": -1, **{name: k for k, name in enumerate(known)}}
        out = np.array(
            [code.get(cell, -2) for cell in self.column(column)], dtype=np.int64
        )
        self.refuse_where(out == -2, column, expected, alone=True)
        return np.maximum(out, -1)


def read_table(
    path: Path,
    check: Callable[[str, list[str]], None],
    ignore: Collection[str] = (),
    most: int | None = None,
    *,
    headings: Mapping[str, str] | None = None,
    together: bool = False,
) -> Table:
    """Return a table's columns without surrounding blanks; blank lines are skipped.

    The header, or Excel's line "sep=;" above it, determines the separator of text files: comma, semicolon
    or tab. With the latter two, numbers may have a decimal comma. Of an .xlsx file the first visible
    sheet is read. Empty columns to the right of the table are skipped.

    Parameters
    ----------
    path
        A .csv, .tsv or .xlsx file.
    check
        Called with the file's name and its header, without ignored columns, before reading rows.
    ignore
        Columns to skip.
    most
        Most rows; by default the limit for readings.
    headings
        The file's own headings, by the name of the column that they stand for.
    together
        Whether faults of columns and cells are gathered for `Table.tell_together`.

    Raises
    ------
    InputError
        The file cannot be read, is not UTF-8, has no valid header, or has a row with another number
        of cells.
    """
    told = most is not None
    most = most or MOST_ROWS
    read = _sheet if path.suffix.lower() == ".xlsx" else _lines
    rows, lines, decimal_comma, sheets = read(path, most)
    name = f"{path.name} (sheet {sheets[0]})" if sheets[1:] else path.name
    require(rows, name, "a header line of column names", "an empty file")
    _drop_empty_columns(rows)
    header = _header(name, rows[0], lines[0])
    renamed = {
        column: heading
        for column, heading in (headings or {}).items()
        if heading in header
    }
    header = _rename(name, header, renamed, lines[0])
    faults = Faults() if together else None
    try:
        check(name, [column for column in header if column not in ignore])
    except ColumnsError as error:
        if faults is None:
            raise
        faults.add(lines[0], *error.lines)
        faults.missing = error.missing
    if len(rows) > most + 1:
        what = f"{name}:{lines[most + 1]}: expected at most {most:,} rows, got more"
        raise InputError(what if told else f"{what}; average repeated readings")
    _check_lengths(name, header, rows, lines)
    below = f"{name}:{lines[0] + 1}"
    require(len(rows) > 1, below, "at least one row under the header")
    if sheets[1:]:
        log.warning(
            "%s: sheet %s is read, not %s", path.name, sheets[0], ", ".join(sheets[1:])
        )
    cells = zip(header, zip(*rows[1:], strict=True), strict=True)
    columns = {
        each: tuple(map(str.strip, column))
        for each, column in cells
        if each not in ignore
    }
    return Table(name, columns, tuple(lines[1:]), decimal_comma, renamed, faults)


def _rename(
    name: str, header: list[str], renamed: Mapping[str, str], line: int
) -> list[str]:
    """Return the header with names of columns in place of a file's own headings."""
    column_of = {heading: column for column, heading in renamed.items()}
    for column, heading in renamed.items():
        require(
            not (column in header and column not in column_of),
            f"{name}:{line}: {column}",
            "it once",
            f"{heading!a} for it, too",
        )
    return [column_of.get(cell, cell) for cell in header]


def _drop_empty_columns(rows: list[list[str]]) -> None:
    """Drop cells to the right of the last name in the header, of rows as wide as the header that have none filled."""
    width = len(rows[0])
    names = max((k for k, cell in enumerate(rows[0], 1) if cell.strip()), default=0)
    for row in rows:  # others have a separator too many: a decimal comma
        if len(row) == width and not "".join(row[names:]).strip():
            del row[names:]


def _lines(path: Path, most: int) -> tuple[list[list[str]], list[int], bool, list[str]]:
    """Return up to ``most + 1`` data rows, line numbers, whether decimal commas are allowed, no sheets."""
    what = (
        "a table in CSV"
        if path.suffix.lower() in {".csv", ".tsv"}
        else "a table (.csv, .tsv, .xlsx)"
    )
    text = read_text(path, what, MOST_BYTES * max(1, most // MOST_ROWS))
    if match := re.match(
        r'"?sep=([,;\t])"?(?=\r?\n)', text, re.IGNORECASE
    ):  # Excel's own first line
        text = text[match.end() :]  # its line end stays, so that lines are counted
    start = text.lstrip()[:_LONGEST].partition("\n")[0]
    mark = (
        match[1] if match else "\t" if "\t" in start else ";" if ";" in start else ","
    )
    stream = io.StringIO(text, newline="")
    blank = mark != "\t"
    reader = csv.reader(stream, delimiter=mark, strict=True, skipinitialspace=blank)
    rows: list[list[str]] = []
    lines: list[int] = []
    before = 0
    try:
        for row in reader:
            if "".join(row).strip():  # skip rows of separators only
                rows.append(row)
                lines.append(before + 1)
                if len(rows) > most + 1 or len(row) > MOST_COLUMNS:
                    break
            before = reader.line_num
            if before > _MOST_LINES:
                most_lines = f"expected at most {_MOST_LINES:,} lines"
                raise InputError(f"{path.name}:{before}: {most_lines}, got more")
    except csv.Error as error:
        got = "a quote that nothing closes" if "end of data" in str(error) else error
        raise InputError(
            f"{path.name}:{before + 1}: expected a CSV row, got {got}"
        ) from None
    return rows, lines, mark != ",", []


def _sheet(path: Path, most: int) -> tuple[list[list[str]], list[int], bool, list[str]]:
    """Return the rows of the first visible sheet of an .xlsx file, their numbers, and all visible titles."""
    try:
        with open_file(path, "an .xlsx workbook") as stream:
            _check_unpacked(path, stream)
            book = openpyxl.load_workbook(stream, read_only=True, data_only=True)
            shown = _visible(path, book)
            sheet = shown[0]
            sheet.reset_dimensions()  # the stated size is unreliable
            rows, lines = _filled_rows(path, sheet.iter_rows(values_only=True), most)
            gaps = any("" in row or len(row) < len(rows[0]) for row in rows)
            if gaps and lines[-1] <= most:
                _check_formulas(path, stream, sheet)
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 (any error of the zip and XML parsers)
        got = " ".join(str(error).split())
        raise InputError(f"{path}: expected an .xlsx workbook, got {got}") from None
    width = len(rows[0]) if rows else 0
    return (
        [row + [""] * (width - len(row)) for row in rows],
        lines,
        True,
        [ascii(each.title) for each in shown],
    )


def _visible(path: Path, book: openpyxl.Workbook) -> list[Any]:
    """Return the sheets that are not hidden; raise InputError if there is none."""
    shown = [
        worksheet for worksheet in book.worksheets if worksheet.sheet_state == "visible"
    ]
    require(shown, path, "an .xlsx workbook with a sheet not hidden")
    return shown


def _filled_rows(
    path: Path, rows: Iterable[Sequence[object]], most: int
) -> tuple[list[list[str]], list[int]]:
    """Return nonempty rows up to their last value, with row numbers, in bounded time and memory."""
    filled: list[list[str]] = []
    lines: list[int] = []
    cells = 0
    for line, row in enumerate(rows, 1):
        cells += 1 + len(row)
        if cells > MOST_CELLS or line > _LAST_ROW:
            message = f"expected at most {_LAST_ROW:,} rows and {MOST_CELLS:,} cells, got more"
            raise InputError(f"{path.name}:{line}: {message}")
        last = next(
            (k for k in range(len(row), 0, -1) if row[k - 1] not in {None, ""}), 0
        )
        if last:
            filled.append([_cell(value) for value in row[:last]])
            lines.append(line)
            if len(filled) > most + 1 or last > MOST_COLUMNS:
                break
    return filled, lines


def _check_formulas(path: Path, stream: BinaryIO, known: Any) -> None:
    """Raise InputError for formulas without stored values, never computed by a spreadsheet."""
    written = openpyxl.load_workbook(stream, read_only=True)[known.title]
    written.reset_dimensions()
    for cells, values in zip(
        written.iter_rows(), known.iter_rows(values_only=True), strict=False
    ):
        for cell, value in zip(cells, values, strict=False):
            if value is None and cell.data_type == "f":
                where = f"{path.name}:{cell.row}: column {cell.column}"
                got = "got none; open the workbook in a spreadsheet and save it"
                raise InputError(f"{where}: expected a formula with its value, {got}")


def _check_unpacked(path: Path, stream: BinaryIO) -> None:
    """Raise InputError for a workbook that is too large when unpacked, or has a row or tag that is."""
    with zipfile.ZipFile(stream) as book:
        size = sum(member.file_size for member in book.infolist())
    most = f"an .xlsx workbook of at most {MOST_BYTES >> 20} MiB unpacked"
    require(size <= MOST_BYTES, path, most, size >> 20)
    most = f"an .xlsx workbook with at most {_MOST_TAGS:,} tags in and beside rows, of at most {_LONGEST:,} characters"
    with zipfile.ZipFile(stream) as book:
        for name in book.namelist():
            if not name.endswith((".xml", ".rels")):
                continue
            text = book.read(name)
            matches = islice(re.finditer(rb"<(?:\w+:)?row\b", text), _LAST_ROW)
            rows = [0, *(match.start() for match in matches), len(text)]
            count = max(text.count(b"<", *ends) for ends in pairwise(rows))
            is_long = re.search(rb"<[^<>]{%d}" % _LONGEST, text)
            fits = count <= _MOST_TAGS and not is_long
            require(fits, path, most, f"more in {name!a}")
    stream.seek(0)


def _cell(value: object) -> str:
    """Return a workbook's cell as text; the number 1.125 as 1.1250, unlike a text with a separator of thousands."""
    text = "" if value is None else str(value).strip()
    return (
        f"{text}0"
        if isinstance(value, float) and _DOUBTFUL["."].fullmatch(text)
        else text
    )


_THOUSANDS = r"[+-]?[1-9]\d{0,2}\%s\d{3}"
_DOUBTFUL = {mark: re.compile(f"^{_THOUSANDS % mark}$", re.MULTILINE) for mark in ",."}
_DECIMAL_COMMA = re.compile(r"^([+-]?\d*),(\d+([eE][+-]?\d+)?)\Z")


def _header(name: str, row: list[str], line: int) -> list[str]:
    header = [cell.strip() for cell in row]
    require(
        len(header) <= MOST_COLUMNS,
        f"{name}:{line}: column {MOST_COLUMNS + 1}",
        f"at most {MOST_COLUMNS:,} columns",
        "more",
    )
    for position, cell in enumerate(header):
        require(cell, f"{name}:{line}: column {position + 1}", "a name in the header")
        require(
            cell not in header[:position],
            f"{name}:{line}: {cell}",
            "each name once",
            "it twice",
        )
    return header


def _check_lengths(
    name: str, header: list[str], rows: list[list[str]], lines: list[int]
) -> None:
    count = len(header)
    for row, line in zip(rows, lines, strict=True):
        if len(row) != count:
            if len(row) < count:
                at = header[len(row)]
                got = f"{len(row)}: the row ends early"
            else:
                at = f"column {count + 1}"
                got = f"{len(row)}"
                filled = [k for k in range(count, len(row)) if row[k].strip()]
                if filled:
                    at = f"column {filled[0] + 1}"
                    got = f'"{row[filled[0]].strip()}" to the right of them'
            raise InputError(f"{name}:{line}: {at}: expected {count} cells, got {got}")


class ColumnsError(InputError):
    """Columns that a table lacks, and columns that are not expected in it."""

    def __init__(self, messages: Sequence[str], missing: Iterable[str]) -> None:
        """Keep the names of the columns that are lacking."""
        super().__init__(messages[0], messages[1:])
        self.missing = frozenset(missing)


def check_columns(
    name: str, header: list[str], required: Collection[str], valid: Collection[str]
) -> None:
    """Raise ColumnsError for each missing column, and each that is not in `valid`."""
    unknown = [column for column in header if column not in valid]
    missing = [column for column in required if column not in header]
    messages: list[str] = []
    for column in missing:
        near = [
            heading
            for heading in header
            if heading.casefold() == column
            or (heading in unknown and suggest(heading, [column]))
        ]
        got = f'"{near[0]}"' if near else "none"
        messages.append(f"{name}:1: {column}: expected this column, got {got}")
        unknown = [heading for heading in unknown if heading not in near[:1]]
    listed = ", ".join(valid)
    messages += [
        f"{name}:1: {column}: expected one of {listed}{suggest(column, valid)}"
        for column in unknown
    ]
    if messages:
        raise ColumnsError(messages, missing)


def check_marks(table: Table, columns: Iterable[str]) -> None:
    """Raise InputError for a number such as "1.000" in columns of a text where another has a comma, "4,2".

    Numbers of a workbook need no mark, so there "1,000" is refused where no other is surely decimal.
    """
    if not table.decimal_comma:
        return
    texts = {
        name: "\n".join(table.columns[name])
        for name in columns
        if name in table.columns
    }

    def find(pattern: str, text: str) -> re.Match[str] | None:
        return re.search(f"^{pattern}$", text, re.MULTILINE)

    whole = "\n".join(texts.values())
    if ".xlsx" in table.name.lower():
        sure = find(rf"(?!{_THOUSANDS % ','}$)[+-]?\d*,\d+", whole)
        expected = (
            {".": f"one decimal mark, as in {sure[0]},"} if sure else {",": "a number"}
        )
    else:
        marks = (
            (mark, find(rf"[+-]?\d*\{other}\d+", whole)) for mark, other in (".,", ",.")
        )
        expected = {
            mark: f"one decimal mark, as in {sure[0]}," for mark, sure in marks if sure
        }
    for mark, what in expected.items():
        for name, text in texts.items():
            doubtful = _DOUBTFUL[mark].search(text)
            if doubtful:
                row = text.count("\n", 0, doubtful.start())
                raise table.fail(row, name, f"{what} and no separator of thousands")


def numbers(
    table: Table, column: str, *, empty: bool = False, expected: str = "a finite number"
) -> Array:
    """Return a column as floats (n,); `empty` allows NaN for empty cells. Raise InputError.

    Parameters
    ----------
    table, column
        Table of text, and name of the column.
    empty
        Whether empty cells are NaN instead of refused.
    expected
        Words for the message.
    """
    cells = table.columns.get(column, table.empty_column)
    if isinstance(cells, np.ndarray):
        return cells
    texts = (
        (_DECIMAL_COMMA.sub(r"\1.\2", cell) for cell in cells)
        if table.decimal_comma
        else cells
    )
    values = np.array([_number(text) for text in texts], dtype=np.float64)
    bad = ~np.isfinite(values)
    table.refuse_where(
        bad & [bool(cell) for cell in cells] if empty else bad,
        column,
        expected,
        alone=True,
    )
    values[bad] = np.nan
    return values


def _number(cell: str) -> float:
    """Return a cell's number; NaN if it is not a number."""
    try:
        return float(cell) if cell.isascii() and "_" not in cell else math.nan
    except ValueError:
        return math.nan

"""Universal files (UFF, .unv): datasets 58, 58b, 15, 2411, 82, 164 and 55.

References
----------
University of Cincinnati SDRL, Universal File Formats for Modal Analysis Testing.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from stiffscope.errors import InputError, require
from stiffscope.responses.blocks import Block, split_blocks
from stiffscope.responses.model import (
    Direction,
    Quantity,
    Response,
    ResponseFile,
    Shape,
    find_impossible,
    integrate_motion,
)
from stiffscope.responses.units import UnitSystem, ordinate_factor
from stiffscope.runtime.reading import read_bytes
from stiffscope.runtime.table import MOST_ROWS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from stiffscope.runtime.types import Array

FREQUENCY_RESPONSE = 4
COHERENCE = 6
QUANTITIES: dict[int, Quantity] = {8: "receptance", 11: "mobility", 12: "accelerance"}
FREQUENCY = 18
_EXPONENT = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d)|(?<=\d)(?=[+-]\d{3}$)")
_RECORD = 6  # most numbers of a record of values
_KNOWN = {15, 55, 58, 82, 151, 164, 2411}
_NORMAL, _COMPLEX_FIRST, _COMPLEX_SECOND = 2, 3, 7  # analyses of dataset 55


@dataclass(frozen=True)
class _Function:
    """A function of dataset 58, in units of the file."""

    kind: int
    force: Direction | None
    motion: Direction | None
    x: Array
    values: NDArray[np.complex128]
    quantity: Quantity | None
    labels: tuple[str, str]
    block: Block


def read_uff(path: Path) -> ResponseFile:
    """Read a universal file of frequency responses, nodes and mode shapes.

    Responses are converted to receptances in SI units: by their own unit labels, else by dataset
    164, else they are taken as SI with a remark. A coherence belongs to the response of the same
    directions.

    Parameters
    ----------
    path
        A .uff or .unv file.

    Raises
    ------
    InputError
        The file cannot be read; the message names file, line and dataset.
    """
    blocks = list(split_blocks(path.name, read_bytes(path, "a universal file")))
    remarks = list[str]()
    systems = [_read_units(block) for block in blocks if block.number == 164]
    units = systems[-1] if systems else None
    if len({(system.length, system.force) for system in systems}) > 1:
        raise InputError(
            f"{path.name}: expected one system of units, got {len(systems)}"
        )
    points = dict[str, "Array"]()
    lines = list[tuple[str, ...]]()
    shapes = list[Shape]()
    functions = list[_Function]()
    for block in blocks:
        if block.number in {15, 2411}:
            points |= _read_nodes(block, units, remarks)
        elif block.number == 82:
            lines += _read_lines(block)
        elif block.number == 55:
            shape = _read_shape(block)
            if shape is not None:
                shapes.append(shape)
        elif block.number == 58:
            functions.append(_read_function(block))
    left_out = sorted({block.number for block in blocks} - _KNOWN)
    if left_out:
        remarks.append(
            f"{path.name}: datasets {', '.join(map(str, left_out))} are not read"
        )
    responses = _pair_coherences(functions, units, remarks)
    return ResponseFile(
        path,
        responses=tuple(responses),
        shapes=tuple(shapes),
        points=points,
        lines=tuple(lines),
        remarks=tuple(dict.fromkeys(remarks)),
    )


def _read_units(block: Block) -> UnitSystem:
    """Return the units of dataset 164; a value in SI is a value of the file over its factor."""
    numbers = _columns(block, [1], width=25)
    if len(numbers) < 2 or not (numbers[:2] > 0.0).all():
        raise block.fail(1, "factors of length and force, above zero")
    return UnitSystem(length=1.0 / float(numbers[0]), force=1.0 / float(numbers[1]))


def _read_nodes(
    block: Block, units: UnitSystem | None, remarks: list[str]
) -> dict[str, Array]:
    """Return the places (3,) of nodes, m."""
    step = 1 if block.number == 15 else 2
    scale = 1.0 if units is None else units.length
    found = dict[str, "Array"]()
    turned = False
    for record in range(0, len(block.records), step):
        if not block.text(record).strip():
            continue
        ints = _whole(block, record, 4, width=10)
        if block.number == 15:
            place = _columns(block, [record], width=13, start=40)
        else:
            place = _columns(block, [record + 1], width=25)
        if len(place) != 3 or not np.isfinite(place).all():
            raise block.fail(record + step - 1, "three coordinates")
        found[str(ints[0])] = scale * place
        turned = turned or any(ints[1:3])
    if turned:
        remarks.append(
            f"{block.name}:{block.line}: nodes in local coordinate systems are taken as in global ones"
        )
    return found


def _read_lines(block: Block) -> list[tuple[str, ...]]:
    """Return the traces of dataset 82; node 0 lifts the pen."""
    words = " ".join(block.records[2:]).split()
    traces = list[tuple[str, ...]]()
    trace = list[str]()
    for word in [*words, "0"]:
        if word != "0":
            trace.append(word)
            continue
        if len(trace) > 1:
            traces.append(tuple(trace))
        trace = []
    return traces


def _read_function(block: Block) -> _Function:
    """Return the function of a dataset 58."""
    names = block.text(5)
    head = _whole(block, 5, 1, width=5)
    motion = _direction(block, names[41:51], names[51:55])
    force = _direction(block, names[66:76], names[76:80])
    form = _whole(block, 6, 3, width=10)
    start, increment = _columns(block, [6], width=13, start=30)[:2]
    data_type, count, spacing = form
    if data_type not in {2, 4, 5, 6} or count < 1 or spacing not in {0, 1}:
        raise block.fail(
            6, "a type 2, 4, 5 or 6, a number of values and a spacing 0 or 1"
        )
    require(
        count <= MOST_ROWS,
        f"{block.name}:{block.line + 6}: dataset {block.number}",
        f"at most {MOST_ROWS:,} values",
        f"{count:,}",
    )
    abscissa = _whole(block, 7, 1, width=10)[0]
    numerator, label = _characteristics(block, 8)
    _, under = _characteristics(block, 9)
    if head[0] in {FREQUENCY_RESPONSE, COHERENCE} and abscissa not in {
        0,
        1,
        FREQUENCY,
    }:
        raise block.fail(7, f"frequencies ({FREQUENCY}) as abscissa")
    values = (
        _ascii_values(block, data_type, spacing)
        if block.binary is None
        else _binary_values(block, data_type, spacing, count)
    )
    width = (2 if data_type > 4 else 1) + (1 if spacing == 0 else 0)
    if len(values) < width * count:
        got = f"{len(values) // width}, as the dataset is cut off"
        where = f"{block.name}:{block.line + 11}: dataset {block.number}"
        raise InputError(f"{where}: expected {count} values, got {got}")
    # some programs fill the last record with zeros
    require(
        len(values) - width * count < _RECORD,
        f"{block.name}:{block.line + 6}: dataset {block.number}",
        f"as many values as follow, {len(values) // width}",
        count,
    )
    table = values[: width * count].reshape(count, width)
    x = table[:, 0] if spacing == 0 else start + increment * np.arange(count)
    ordinates = table[:, 1:] if spacing == 0 else table
    complex_values = ordinates[:, 0].astype(complex)
    if data_type > 4:
        complex_values = ordinates[:, 0] + 1j * ordinates[:, 1]
    for numbers in (x, complex_values):
        row = find_impossible(numbers)
        require(
            row is None,
            f"{block.name}:{block.line + 11}: dataset {block.number}",
            "finite values from 1e-30 to 1e30, and of binary ones the byte order that is stated",
            None if row is None else f"{numbers[row]:.6g} at value {row + 1}",
        )
    return _Function(
        kind=head[0],
        force=force,
        motion=motion,
        x=x,
        values=complex_values,
        quantity=QUANTITIES.get(numerator),
        labels=(label, under),
        block=block,
    )


def _direction(block: Block, node: str, way: str) -> Direction | None:
    """Return a node and its direction; None if it is a scalar."""
    try:
        axis = int(way or "0")
        point = int(node or "0")
    except ValueError as error:
        raise block.fail(5, "numbers of nodes and directions") from error
    if axis == 0:
        return None
    if abs(axis) > 6:
        raise block.fail(5, "directions from -6 to 6")
    return Direction(str(point), abs(axis) - 1, 1 if axis > 0 else -1)


def _characteristics(block: Block, record: int) -> tuple[int, str]:
    """Return a specific data type, and the label of its unit."""
    kind = _whole(block, record, 1, width=10)[0]
    label = block.text(record)[47:67].strip()
    return kind, "" if label.upper() == "NONE" else label


def _ascii_values(block: Block, data_type: int, spacing: Literal[0, 1] | int) -> Array:
    """Return the numbers of an ASCII dataset in order, by the columns of its format."""
    rows = list(range(11, len(block.records)))
    if data_type in {2, 5}:
        return _columns(block, rows, width=13)
    if spacing == 1:
        return _columns(block, rows, width=20)
    widths = [13, 20, 13, 20] if data_type == 4 else [13, 20, 20]
    _refuse_cut(block, rows, np.cumsum(widths).tolist())
    words = list[str]()
    for record in rows:
        text = block.records[record]
        at = 0
        for width in widths:
            word = text[at : at + width].strip()
            at += width
            if word:
                words.append(word)
    return _numbers(block, rows, words)


def _binary_values(block: Block, data_type: int, spacing: int, count: int) -> Array:
    """Return the numbers of dataset 58b in order.

    By the standard, abscissas of uneven spacing are single precision; some programs write them in
    the precision of the values, and some write doubles whatever they state. The number of bytes
    tells which.
    """
    data = block.binary or b""
    order = "<" if block.little_endian else ">"
    precision = "f4" if data_type in {2, 5} else "f8"
    forms = [[precision], ["f8"]]
    if data_type > 4:  # complex: real and imaginary part
        forms = [[precision, precision], ["f8", "f8"]]
    if spacing == 0:
        forms = [["f4", *forms[0]], [precision, *forms[0]], ["f8", *forms[1]]]
    for form in forms:
        layout = np.dtype([(str(k), order + kind) for k, kind in enumerate(form)])
        wanted = layout.itemsize * count
        for candidate in (data, data.replace(b"\r\n", b"\n")):
            if len(candidate) == wanted:
                table = np.frombuffer(candidate, layout)
                columns = [table[name].astype(float) for name in layout.names or ()]
                return np.column_stack(columns).ravel()
    where = f"{block.name}:{block.line + 11}: dataset {block.number}b"
    expected = f"{count} values of type {data_type}"
    raise InputError(f"{where}: expected {expected}, got {len(data)} bytes")


def _read_shape(block: Block) -> Shape | None:
    """Return the mode shape of a dataset 55; None of another analysis."""
    form = _whole(block, 5, 6, width=10)
    analysis, data_type, count = form[1], form[4], form[5]
    if analysis not in {_NORMAL, _COMPLEX_FIRST, _COMPLEX_SECOND}:
        return None
    if data_type not in {2, 5} or count not in {3, 6}:
        raise block.fail(5, "real or complex data (2 or 5) of 3 or 6 values a node")
    width = count * (2 if data_type == 5 else 1)
    records = -(-width // 6)
    header = _columns(block, [7], width=13)
    if len(header) < 4:
        raise block.fail(7, "a frequency or an eigenvalue with modal constants")
    frequency = float(header[0])
    damping = float(header[2]) or float("nan")
    if analysis != _NORMAL:
        # the eigenvalue is -ζ ω ± i ω √(1 - ζ²)
        eigenvalue = complex(header[0], header[1])
        frequency = abs(eigenvalue) / (2.0 * np.pi)
        damping = -eigenvalue.real / abs(eigenvalue) if eigenvalue else float("nan")
    shape = dict[str, "NDArray[np.complex128]"]()
    for record in range(8, len(block.records), 1 + records):
        if not block.text(record).strip():
            continue
        node = _whole(block, record, 1, width=10)[0]
        rows = list(range(record + 1, record + 1 + records))
        values = _columns(block, rows, width=13)
        if len(values) != width:
            raise block.fail(record, f"{width} values")
        shape[str(node)] = (
            values.astype(complex)
            if data_type == 2
            else values[0::2] + 1j * values[1::2]
        )
    return Shape(frequency, damping, shape, f"{block.name}:{block.line}")


def _pair_coherences(
    functions: Sequence[_Function], units: UnitSystem | None, remarks: list[str]
) -> list[Response]:
    """Return the responses in SI, each with the coherence of the same directions."""
    coherences = {
        (function.force, function.motion): function
        for function in functions
        if function.kind == COHERENCE
    }
    out = list[Response]()
    for function in functions:
        if function.kind != FREQUENCY_RESPONSE:
            continue
        block = function.block
        where = f"{block.name}:{block.line}"
        if function.force is None or function.motion is None:
            raise block.fail(5, "a response and a reference with nodes and directions")
        if function.quantity is None:
            raise block.fail(8, "displacement (8), velocity (11) or acceleration (12)")
        factor, remark = ordinate_factor(
            quantity=function.quantity,
            labels=function.labels,
            turns=(function.motion.axis > 2, function.force.axis > 2),
            system=units,
            where=where,
        )
        if remark:
            remarks.append(remark)
        used = function.x > 0.0
        frequency = function.x[used]
        if (np.diff(frequency) <= 0.0).any() or not len(frequency):
            raise block.fail(6, "ascending frequencies")
        response = Response(
            force=function.force,
            motion=function.motion,
            frequency=frequency,
            receptance=integrate_motion(
                factor * function.values[used], frequency, function.quantity
            ),
            coherence=None,
            quantity=function.quantity,
            source=where,
        )
        beside = coherences.get((function.force, function.motion))
        if beside is not None:
            coherence = np.interp(frequency, beside.x, beside.values.real)
            response = replace(response, coherence=coherence.clip(0.0, 1.0))
        out.append(response)
    return out


def _whole(block: Block, record: int, count: int, *, width: int) -> list[int]:
    """Return the first whole numbers of a record, in columns or, failing that, between blanks."""
    text = block.text(record)
    columns = [text[k * width : (k + 1) * width] for k in range(count)]
    for words in (columns, text.split()[:count]):
        try:
            numbers = [int(word or "0") for word in words]
        except ValueError:
            continue
        if len(numbers) == count:
            return numbers
    raise block.fail(record, f"{count} whole numbers")


def _refuse_cut(
    block: Block, records: Sequence[int], edges: Sequence[int], start: int = 0
) -> None:
    """Raise InputError for a record that is cut off inside a column.

    What is left of a number is another number. Numbers end at the right edges (k,) of their
    columns: a record whose last one does not is cut, unless others are not aligned either.
    """
    stops = set(edges)
    inside = [
        record
        for record in records
        for end in [len(block.text(record).rstrip())]
        if start < end < max(stops, default=0) and end not in stops
    ]
    if not inside:
        return
    aligned = [
        bool(text[edge - 1].strip())
        for record in {records[0], inside[0]}
        for text in [block.text(record).rstrip()]
        for edge in edges
        if edge < len(text)
    ]
    if aligned and all(aligned):
        raise block.fail(inside[0], "numbers up to the ends of their columns")


def _columns(
    block: Block, records: Sequence[int], *, width: int, start: int = 0
) -> Array:
    """Return the numbers of records in columns of a width."""
    longest = max((len(block.text(record)) for record in records), default=0)
    edges = list(range(start + width, longest + width, width))
    _refuse_cut(block, records, edges, start)
    words = list[str]()
    for record in records:
        text = block.text(record)
        for at in range(start, len(text), width):
            word = text[at : at + width].strip()
            if word:
                words.append(word)
    return _numbers(block, records, words)


def _numbers(block: Block, records: Sequence[int], words: Sequence[str]) -> Array:
    """Return numbers as Fortran writes them: 1.5E+03, 1.5D+03 or 1.5-103."""
    try:
        return np.array(words, dtype=np.str_).astype(float)
    except ValueError:
        pass
    out = list[float]()
    for word in words:
        try:
            out.append(float(_EXPONENT.sub("e", word)))
        except ValueError as error:
            fault = next((k for k in records if word in block.records[k]), records[0])
            raise block.fail(fault, "numbers in columns") from error
    return np.array(out)

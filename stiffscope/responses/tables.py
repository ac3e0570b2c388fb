"""Tables of frequency responses: text of three columns, CSV, spreadsheet, .mat and .npz."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError, require
from stiffscope.responses.model import (
    AXES,
    Direction,
    Quantity,
    Response,
    ResponseFile,
    find_impossible,
    integrate_motion,
)
from stiffscope.runtime import table as tables
from stiffscope.runtime.reading import open_file, read_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from stiffscope.runtime.types import Array

FREQUENCY = "frequency"
_PARTS = ("re", "im", "abs", "deg", "coh")
_DIRECTION = re.compile(r"(.+):([+-]?)(r?[xyz])")


@dataclass(frozen=True)
class Channel:
    """Force and motion of a column, or of a pair of columns, of a table."""

    force: Direction
    motion: Direction


def read_direction(text: str) -> Direction:
    """Return a direction written as ``POINT:AXIS``, e.g. ``7:-x``. Raise ValueError otherwise."""
    match = _DIRECTION.fullmatch(text.strip())
    if match is None:
        raise ValueError(
            f'expected a point and a direction such as "7:-x", got "{text}"'
        )
    return Direction(match[1], AXES.index(match[3]), -1 if match[2] == "-" else 1)


def read_response_table(
    path: Path,
    channels: Mapping[str, Channel],
    quantity: Quantity,
    factor: float = 1.0,
) -> ResponseFile:
    """Read a table of responses.

    Parameters
    ----------
    path
        .csv, .tsv, .xlsx, .mat or .npz with columns (arrays) ``frequency`` and, of a channel H,
        ``H.re`` and ``H.im``, or ``H.abs`` and ``H.deg``, or a complex array ``H``; ``H.coh`` is its
        coherence. A .txt file has three columns, frequency, real and imaginary part, of one channel.
    channels
        Force and motion by channel.
    quantity
        What the values are.
    factor
        SI value of the values' unit.

    Raises
    ------
    InputError
        The file cannot be read, or a channel lacks columns.
    """
    if not channels:
        raise InputError(
            f"{path.name}: channels: expected force and motion of each, got none"
        )
    read = _READERS.get(path.suffix.lower())
    if read is None:
        known = ", ".join(_READERS)
        raise InputError(
            f"{path.name}: expected a file of {known}, got {path.suffix or 'none'}"
        )
    columns = read(path, list(channels))
    if FREQUENCY not in columns:
        raise InputError(
            f"{path.name}: expected a column {FREQUENCY}, got {_list(columns)}"
        )
    frequency = _real(path, FREQUENCY, columns[FREQUENCY])
    used = frequency > 0.0
    if not used.any() or (np.diff(frequency[used]) <= 0.0).any():
        raise InputError(
            f"{path.name}: {FREQUENCY}: expected ascending numbers above 0 Hz"
        )
    responses = [
        Response(
            force=channel.force,
            motion=channel.motion,
            frequency=frequency[used],
            receptance=integrate_motion(
                factor * _complex(path, name, columns, len(frequency))[used],
                frequency[used],
                quantity,
            ),
            coherence=_coherence(path, name, columns, used),
            quantity=quantity,
            source=f"{path.name}: {name}",
        )
        for name, channel in channels.items()
    ]
    return ResponseFile(path, tuple(responses))


def _complex(
    path: Path, name: str, columns: Mapping[str, Array], count: int
) -> NDArray[np.complex128]:
    """Return the complex values (n,) of a channel."""
    parts = {part: columns.get(f"{name}.{part}") for part in _PARTS}
    if name in columns:
        values = np.asarray(columns[name], dtype=complex).ravel()
    elif parts["re"] is not None and parts["im"] is not None:
        real = _real(path, f"{name}.re", parts["re"])
        values = real + 1j * _real(path, f"{name}.im", parts["im"])
    elif parts["abs"] is not None and parts["deg"] is not None:
        angle = np.radians(_real(path, f"{name}.deg", parts["deg"]))
        values = _real(path, f"{name}.abs", parts["abs"]) * np.exp(1j * angle)
    else:
        expected = f"columns {name}.re and {name}.im, or {name}.abs and {name}.deg"
        raise InputError(f"{path.name}: expected {expected}, got {_list(columns)}")
    if len(values) != count:
        raise InputError(
            f"{path.name}: {name}: expected {count} values, got {len(values)}"
        )
    _require_measured(path, name, values)
    return np.asarray(values, dtype=np.complex128)


def _coherence(
    path: Path, name: str, columns: Mapping[str, Array], used: NDArray[np.bool_]
) -> Array | None:
    column = f"{name}.coh"
    if column not in columns:
        return None
    values = _real(path, column, columns[column])
    if len(values) != len(used) or not ((values >= 0.0) & (values <= 1.0)).all():
        raise InputError(
            f"{path.name}: {column}: expected {len(used)} values from 0 to 1"
        )
    return values[used]


def _real(path: Path, name: str, values: Any) -> Array:
    try:
        numbers = np.asarray(values, dtype=float).ravel()
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{path.name}: {name}: expected real numbers, got others"
        ) from error
    _require_measured(path, name, numbers)
    return numbers


def _require_measured(path: Path, name: str, values: NDArray[Any]) -> None:
    row = find_impossible(values)
    require(
        row is None,
        f"{path.name}: {name}",
        "finite values from 1e-30 to 1e30",
        None if row is None else f"{values[row]:.6g} in row {row + 1}",
    )


def _list(columns: Mapping[str, Any]) -> str:
    return ", ".join(list(columns)[:12]) or "none"


def _read_sheet(path: Path, names: Sequence[str]) -> dict[str, Any]:  # noqa: ARG001
    read = tables.read_table(path, lambda *_: None)
    return {name: tables.numbers(read, name) for name in read.columns}


def _read_three_columns(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Return frequency, real and imaginary part; lines that start with # or % are comments."""
    if len(names) != 1:
        raise InputError(
            f"{path.name}: expected one channel of a .txt file, got {len(names)}"
        )
    rows = list[list[float]]()
    text = read_text(path, "a table of three columns", tables.MOST_BYTES)
    for number, line in enumerate(text.splitlines(), 1):
        words = line.replace(";", " ").replace("\t", " ").split()
        if not words or words[0][0] in "#%":
            continue
        try:
            row = [float(word.replace(",", ".")) for word in words]
        except ValueError:
            if not rows:
                continue  # a heading
            row = []
        if len(row) != 3:
            expected = "frequency, real and imaginary part"
            raise InputError(
                f"{path.name}:{number}: expected {expected}, got {line.strip()[:60]!r}"
            )
        rows.append(row)
    if not rows:
        raise InputError(f"{path.name}: expected rows of three numbers, got none")
    values = np.array(rows)
    (name,) = names
    return {
        FREQUENCY: values[:, 0],
        f"{name}.re": values[:, 1],
        f"{name}.im": values[:, 2],
    }


def _read_mat(path: Path, names: Sequence[str]) -> dict[str, Any]:  # noqa: ARG001
    from scipy.io import loadmat

    with open_file(path, "a MATLAB file") as stream:
        try:
            held = loadmat(stream)
        except (ValueError, TypeError, NotImplementedError, OSError) as error:
            raise InputError(
                f"{path.name}: expected a MATLAB file up to version 7, got {error}"
            ) from error
    return {name: values for name, values in held.items() if not name.startswith("__")}


def _read_npz(path: Path, names: Sequence[str]) -> dict[str, Any]:  # noqa: ARG001
    with open_file(path, "a NumPy archive") as stream:
        try:
            with np.load(stream, allow_pickle=False) as held:
                return {name: held[name] for name in held.files}
        except (ValueError, OSError, EOFError, KeyError) as error:
            raise InputError(
                f"{path.name}: expected a NumPy archive, got {error}"
            ) from error


_READERS = {
    ".csv": _read_sheet,
    ".tsv": _read_sheet,
    ".xlsx": _read_sheet,
    ".txt": _read_three_columns,
    ".mat": _read_mat,
    ".npz": _read_npz,
}

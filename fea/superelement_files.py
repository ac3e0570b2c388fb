"""Superelements from files: npz, Matrix Market and Nastran, also from other programs."""

from __future__ import annotations

import re
import zipfile
from dataclasses import dataclass
from itertools import repeat
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib import format as npy
from scipy.io import mminfo, mmread

from stiffscope.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from stiffscope.fea.mesh import Floats

SUFFIXES = (".npz", ".mtx", ".bdf", ".dat", ".pch")
MOST_ROWS = 3000  # limit of matrix rows: 500 interfaces
_NODE = re.compile(
    r"^\W*(\d+) (\S.*?) (\S+) (\S+) (\S+)\s*$"
)  # comment: number, name, x y z in m


@dataclass(frozen=True, eq=False)
class Read:
    """Contents of a file: stiffness, mass or None, and interface places (3,), m, by name."""

    stiffness: Floats
    mass: Floats | None
    interfaces: dict[str, tuple[float, ...]]


def read_superelement(path: Path) -> Read:
    """Read a superelement; ``NAME.stiffness.mtx`` is read with ``NAME.mass.mtx`` if that exists.

    Raises
    ------
    InputError
        If the format is unknown or the stiffness is missing; the message starts with "expected".
    """
    if not path.is_file():
        raise InputError(f"expected a file of a superelement, got none at {path}")
    try:
        if path.suffix == ".npz":
            return _read_npz(path)
        if path.suffix == ".mtx":
            return _read_matrix_market(path)
        if path.suffix in SUFFIXES:
            return _read_dmig(path)
    except (
        OSError,
        EOFError,
        zipfile.BadZipFile,
        KeyError,
        IndexError,
        TypeError,
        ValueError,
    ) as error:
        if isinstance(error, InputError):
            raise
        got = f"a file that cannot be read as one ({error})"
        raise InputError(f"expected a superelement, got {got}") from error
    raise InputError(
        f"expected a file of a superelement ({', '.join(SUFFIXES)}), got {path.name}"
    )


def _check_matrix(shape: tuple[int, ...], kind: str) -> None:
    """Raise InputError for an invalid superelement matrix, before it is loaded."""
    if len(shape) != 2 or shape[0] != shape[1] or not 0 < shape[0] <= MOST_ROWS:
        valid = f"a square matrix of at most {MOST_ROWS} rows"
        raise InputError(f"expected {valid}, got {' x '.join(map(str, shape))}")
    if kind not in {"real", "integer"}:
        raise InputError(f"expected a matrix of real numbers, got {kind} ones")


def _read_npz(path: Path) -> Read:
    with zipfile.ZipFile(path) as archive:  # the headers, before anything is loaded
        for name in {"stiffness.npy", "mass.npy"}.intersection(archive.namelist()):
            with archive.open(name) as stream:
                first = npy.read_magic(stream)[0] == 1
                read = npy.read_array_header_1_0 if first else npy.read_array_header_2_0
                shape, _, kind = read(stream)
            _check_matrix(shape, "real" if kind.kind in "fiu" else kind.name)
    with np.load(path, allow_pickle=False) as held:
        stiffness = np.asarray(held["stiffness"], dtype=float)
        mass = np.asarray(held["mass"], dtype=float) if "mass" in held else None
        squares = (
            np.ravel(held["mode_squares"]) if "mode_squares" in held else np.zeros(0)
        )
        if not np.array_equal(
            squares, stiffness.diagonal()[len(stiffness) - len(squares) :]
        ):
            valid = "mode_squares to be the last of the stiffness's diagonal"
            raise InputError(f"expected {valid}, got others")
        names = _named_places(str(held["help"])) if "help" in held else {}
        places = held["nodes"].tolist() if "nodes" in held else []
    if names and places and len(names) != len(places):
        raise InputError(
            f"expected {len(names)} nodes, as its help names, got {len(places)}"
        )
    exact = {name: tuple(place) for name, place in zip(names, places, strict=False)}
    numbered = {f"node{k}": tuple(place) for k, place in enumerate(places)}
    return Read(stiffness, mass, exact or numbered)


def _read_matrix_market(path: Path) -> Read:
    beside = path.with_name(path.name.replace("stiffness", "mass"))
    mass = _dense(beside) if beside != path and beside.is_file() else None
    return Read(
        _dense(path), mass, _named_places(path.read_text(errors="replace"), "%")
    )


def _dense(path: Path) -> Floats:
    rows, columns, _, _, kind, _ = mminfo(path)
    _check_matrix((rows, columns), kind)
    matrix: Any = mmread(path)
    return np.asarray(
        matrix.toarray() if hasattr(matrix, "toarray") else matrix, dtype=np.float64
    )


def _read_dmig(path: Path) -> Read:
    """Read real DMIG entries, small, large or free fields; grid points by number, then scalars."""
    text = path.read_text(errors="replace")
    grids: dict[int, tuple[float, ...]] = {}
    entries: dict[str, dict[tuple[tuple[int, int], tuple[int, int]], float]] = {}
    for card in _cards(text):
        if card[0] == "GRID":
            grids[int(card[1])] = tuple(_number(each) for each in card[3:6])
        elif card[0] == "DMIG" and card[2] != "0":
            column = int(card[2]), int(card[3] or 0)
            block = entries.setdefault(card[1], {})
            rest = card[5:]
            for k in range(0, len(rest) - 2, 4):
                if rest[k]:
                    block[(int(rest[k]), int(rest[k + 1] or 0)), column] = _number(
                        rest[k + 2]
                    )
    points = sorted(
        {point for block in entries.values() for pair in block for point in pair}
    )
    order = [(grid, component) for grid in sorted(grids) for component in range(1, 7)]
    order += [point for point in points if point[0] not in grids]
    place, named = {point: k for k, point in enumerate(order)}, _named_places(text, "$")

    def matrix(first: str) -> Floats | None:
        name = next(
            (entry for entry in entries if entry.upper().startswith(first)), None
        )
        if name is None:
            return None
        out = np.zeros((len(order), len(order)))
        for (row, column), value in entries[name].items():
            out[place[row], place[column]] = out[place[column], place[row]] = value
        return out

    stiffness = matrix("K")
    if stiffness is None:
        raise InputError("expected a DMIG matrix whose name begins with K, got none")
    exact = {
        name: grids[grid] for name, grid in zip(named, sorted(grids), strict=False)
    }
    numbered = {f"grid{grid}": grids[grid] for grid in sorted(grids)}
    return Read(stiffness, matrix("M"), exact or numbered)


def _cards(text: str) -> Iterator[list[str]]:
    """Yield cards with continuations: name, then fields; DMIG has four per row, from index 5."""
    card: list[str] = []
    for line in text.splitlines():
        if not line.strip() or line.startswith("$"):
            continue
        wide = "*" in line[:8]
        if "," in line:
            first, *fields = (word.strip() for word in line.split(","))
        else:
            first = line[:8].strip()
            size = 16 if wide else 8
            fields = [line[k : k + size].strip() for k in range(8, 72, size)]
        first = first.rstrip("*")
        count = 4 if wide else 8
        fields = [*fields, *repeat("", count)][:count]
        if first:
            if card:
                yield card
            card = [first.upper(), *fields]
        else:
            card += fields
    if card:
        yield card


def _number(text: str) -> float:
    """Parse a Nastran number, whose exponent may lack its letter."""
    plain = text.strip().replace("D", "E").replace("d", "e")
    return float(re.sub(r"(?<=[\d.])([+-]\d+)$", r"e\1", plain)) if plain else 0.0


def _named_places(text: str, mark: str = "") -> dict[str, tuple[float, ...]]:
    """Return names and places from the lines, beginning with a mark, after "Nodes, x y z in m:"."""
    named_places: dict[str, tuple[float, ...]] = {}
    comment = "\n".join(line for line in text.splitlines() if line.startswith(mark))
    for line in comment.partition("Nodes, x y z in m:")[2].splitlines():
        node = _NODE.match(line)
        if node is not None:
            named_places[node[2]] = tuple(float(group) for group in node.groups()[2:])
    return named_places

"""Campaign folders read: tables as arrays, checked cell by cell."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign import Campaign
from stiffscope.gap.campaign_header import load_header
from stiffscope.gap.quantities import DEFLECTION, DEVIATION, QUANTITIES, STIFFNESS, WRENCH
from stiffscope.gap.table import Table, check_columns, numbers, read_table

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Codes = NDArray[np.int64]

log = logging.getLogger(__name__)

POSITION = ("x", "y", "z")


def load_campaign(folder: Path) -> Campaign:
    """Return the campaign in a folder.

    Raises InputError that names the file, the line, the column and what was expected.
    """
    header = load_header(folder)
    bare = header.predictions is not None
    parts = [_load_readings(folder / name, bare=bare) for name in header.readings]
    if len({part.labelled for part in parts}) > 1:
        raise InputError("campaign.toml: readings: expected all files with x y z, or all with pose")
    names, pose, poses = _number_poses(parts)
    labels = [label for part in parts for label in part.sessions]
    sessions = {label: i for i, label in enumerate(dict.fromkeys(labels))}
    predictions: dict[str, Array] = {}
    if header.predictions is not None:
        predictions = _load_predictions(folder / header.predictions, parts)
    return Campaign(
        robot=header.robot,
        modelled=header.modelled,
        components=header.components,
        pose_names=names,
        poses=np.array(poses),
        pose=np.array(pose),
        wrench=np.concatenate([part.wrench for part in parts]),
        quantity=np.concatenate([part.quantity for part in parts]),
        value=np.concatenate([part.value for part in parts]),
        sigma=np.concatenate([part.sigma for part in parts]),
        session_names=tuple(sessions),
        session=np.array([sessions[label] for label in labels]),
        files=header.readings,
        file=np.repeat(np.arange(len(parts)), [len(part.value) for part in parts]),
        line=np.array([line for part in parts for line in part.table.lines]),
        predictions=predictions,
    )


@dataclass(frozen=True)
class _Rows:
    """The key columns and values of one file."""

    table: Table
    labelled: bool
    place: tuple[tuple[Any, ...], ...]
    wrench: Array
    quantity: Codes
    sessions: tuple[str, ...]
    value: Array
    sigma: Array


_CODE = {name: code for code, name in enumerate(QUANTITIES)}


def _quantity(table: Table) -> Codes:
    cells = table.columns["quantity"]
    try:
        return np.array([_CODE[cell] for cell in cells], dtype=np.int64)
    except KeyError:
        row = next(i for i, cell in enumerate(cells) if cell not in _CODE)
        raise table.fail(row, "quantity", f"one of {' '.join(QUANTITIES)}") from None


def _place(table: Table, *, labelled: bool) -> tuple[tuple[Any, ...], ...]:
    if labelled:
        cells = table.columns["pose"]
        if "" in cells:
            raise table.fail(cells.index(""), "pose", "the label of a pose")
        return tuple((cell,) for cell in cells)
    columns = [np.round(numbers(table, name, expected="a finite number of metres"), 12) for name in POSITION]
    return tuple(zip(*(column.tolist() for column in columns), strict=True))


def _wrench(table: Table, quantity: Codes) -> Array:
    """Return the wrenches (n, 6): given for deflections, empty for stiffness, zero or empty for deviations."""
    kind = quantity // 6
    out = np.full((len(quantity), 6), np.nan)
    if not any(name in table.columns for name in WRENCH):
        if (kind == DEFLECTION).any():
            row = int(np.argmax(kind == DEFLECTION))
            raise table.fail(row, "fx", "a wrench for a deflection (columns fx fy fz mx my mz)")
    else:
        for k, name in enumerate(WRENCH):
            column = numbers(table, name, empty=True, expected="a finite number or, for stiffness, an empty cell")
            given = ~np.isnan(column)
            wrong = (kind == DEFLECTION) & ~given
            if wrong.any():
                raise table.fail(int(np.argmax(wrong)), name, "a finite number: a deflection needs its wrench")
            wrong = (kind == STIFFNESS) & given
            if wrong.any():
                raise table.fail(int(np.argmax(wrong)), name, "an empty cell: a stiffness reading has no wrench")
            wrong = (kind == DEVIATION) & given & (column != 0)
            if wrong.any():
                raise table.fail(int(np.argmax(wrong)), name, "0: a deviation is read on the unloaded platform")
            out[:, k] = column
    out[kind == DEVIATION] = 0.0
    return out


def _keys_of(header: Collection[str], *, bare: bool) -> tuple[str, ...]:
    """Return the key columns: x y z or, with predictions, the label that stands for them, wrench and quantity."""
    place = ("pose",) if bare and "pose" in header else POSITION
    return (*place, *WRENCH, "quantity")


def _check(name: str, header: list[str], *, bare: bool, others: Collection[str]) -> None:
    keys = _keys_of(header, bare=bare)
    loaded = any(column in header for column in WRENCH)
    required = [key for key in keys if loaded or key not in WRENCH]
    valid = [*keys, *others] if "sigma" in others else header
    check_columns(name, header, [*required, *(c for c in others if c != "session")], [*valid, "session"])


def _load_readings(path: Path, *, bare: bool) -> _Rows:
    table = read_table(path, partial(_check, bare=bare, others=("value", "sigma", "session")))
    labelled = "pose" in table.columns
    quantity = _quantity(table)
    value = numbers(table, "value", expected="a finite reading in SI")
    soft = (quantity // 6 == STIFFNESS) & (value <= 0)
    if soft.any():
        raise table.fail(int(np.argmax(soft)), "value", "a positive stiffness")
    sigma = numbers(table, "sigma", empty=True, expected="a positive number, or an empty cell if unknown")
    wrong = sigma <= 0
    if wrong.any():
        raise table.fail(int(np.argmax(wrong)), "sigma", "a positive number, or an empty cell if unknown")
    sessions = table.columns.get("session", ("",) * len(value))
    place, wrench = _place(table, labelled=labelled), _wrench(table, quantity)
    return _Rows(table, labelled, place, wrench, quantity, sessions, value, sigma)


def _number_poses(parts: list[_Rows]) -> tuple[tuple[str, ...], list[int], list[list[float]]]:
    places = [place for part in parts for place in part.place]
    index = {place: i for i, place in enumerate(dict.fromkeys(places))}
    pose = [index[place] for place in places]
    if parts[0].labelled:
        return tuple(str(place[0]) for place in index), pose, [[np.nan] * 3 for _ in index]
    names = tuple(f"({x:g}, {y:g}, {z:g})" for x, y, z in index)
    return names, pose, [list(place) for place in index]


def _keys(rows: _Rows, *, sessions: bool) -> list[tuple[Any, ...]]:
    wrench = [tuple(w) for w in np.nan_to_num(np.round(rows.wrench, 9)).tolist()]
    labels = rows.sessions if sessions else ("",) * len(wrench)
    return list(zip(rows.place, wrench, rows.quantity.tolist(), labels, strict=True))


def _load_predictions(path: Path, parts: list[_Rows]) -> dict[str, Array]:
    table = read_table(path, partial(_check, bare=True, others=("value",)))
    labelled = "pose" in table.columns
    if labelled != parts[0].labelled:
        wanted = "pose" if parts[0].labelled else "x y z"
        raise InputError(f"{table.name}:1: expected the readings' own key columns ({wanted})")
    if "sigma" in table.columns:
        raise InputError(f"{table.name}:1: sigma: expected predictions, which have no sigma")
    keys = _keys_of(table.columns, bare=True)
    models = [name for name in table.columns if name not in {*keys, "session", *POSITION}]
    quantity = _quantity(table)
    values = {name: numbers(table, name, expected="a finite predicted value in SI") for name in models}
    stacked = np.stack([values[name] for name in models], axis=1)
    sessions = table.columns.get("session", ("",) * len(quantity))
    place, wrench = _place(table, labelled=labelled), _wrench(table, quantity)
    rows = _Rows(table, labelled, place, wrench, quantity, sessions, stacked, stacked[:, 0])
    by_session = "session" in table.columns
    found: dict[tuple[Any, ...], int] = {}
    for row, key in enumerate(_keys(rows, sessions=by_session)):
        first = found.setdefault(key, row)
        if np.any(stacked[first] != stacked[row]):
            raise table.fail(row, "value", f"the prediction already given on line {table.lines[first]}")
    picked: list[int] = []
    for part in parts:
        for row, key in enumerate(_keys(part, sessions=by_session)):
            if key not in found:
                message = f"a reading that {table.name} predicts"
                raise part.table.fail(row, "pose" if labelled else "x", message)
            picked.append(found[key])
    idle = len(found) - len(set(picked))
    if idle:
        log.warning("%s: %d predictions have no reading", table.name, idle)
    return {name: stacked[picked, k] for k, name in enumerate(models)}

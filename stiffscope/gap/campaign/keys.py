"""Key columns of a table: the commanded pose, applied load and measured quantity of each row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.campaign.quantities import (
    AXES,
    DEFLECTION,
    DEVIATION,
    FIRST_POSITION,
    FREQUENCIES,
    FREQUENCY,
    JOINT,
    KINDS,
    POSITION,
    QUANTITIES,
    STIFFNESS,
    WRENCH,
    kind_of,
)
from stiffscope.gap.campaign.units import component, coordinate
from stiffscope.runtime.table import check_columns

if TYPE_CHECKING:
    from collections.abc import Collection

    from stiffscope.gap.campaign.campaign_header import Header
    from stiffscope.runtime.table import Table
    from stiffscope.runtime.types import Array, Indices

OPTIONAL = ("session", "sensor", "quantity", "load", "kind")
LABEL = ("pose",)
"""Coordinates of named poses."""
_SHOWN_QUANTITIES = " ".join((*QUANTITIES[: QUANTITIES.index("f1")], "f1", "...", FREQUENCIES[-1]))


@dataclass(frozen=True)
class Keys:
    """Commanded poses, applied loads and measured quantities of n rows, SI."""

    table: Table
    coordinates: tuple[str, ...]
    """Columns of the pose; `LABEL` if poses are named."""
    place: tuple[tuple[Any, ...], ...]
    """Pose of each row: coordinates or name."""
    wrench: Array
    """Wrenches (n, 6); NaN for stiffnesses and frequencies."""
    quantity: Indices
    sensor: Indices
    load: Indices
    sessions: tuple[str, ...]

    def identities(self, *, sessions: bool) -> list[tuple[Any, ...]]:
        """Return keys that identify the rows, with or without their sessions."""
        wrench = [tuple(w) for w in np.nan_to_num(np.round(self.wrench, 9)).tolist()]
        labels = self.sessions if sessions else ("",) * len(wrench)
        codes = (self.quantity.tolist(), self.sensor.tolist(), self.load.tolist())
        return list(zip(self.place, wrench, *codes, labels, strict=True))


def coordinates_of(columns: Collection[str], *, bare: bool) -> tuple[str, ...]:
    """Return a table's pose columns, by default those of a position; ``bare``: or names."""
    places = [name for name in columns if name in AXES or name.startswith(JOINT)]
    if "pose" in columns and (bare or not places):
        return LABEL
    return tuple(sorted(places, key=lambda n: AXES.index(n) if n in AXES else len(AXES))) or AXES[:3]


def check_readings_columns(name: str, columns: list[str], *, bare: bool) -> None:
    """Raise InputError for missing or unknown columns of a table of readings."""
    place = coordinates_of(columns, bare=bare)
    measured = () if "sensor" in columns else ("quantity",)
    valid = (*place, *WRENCH, *OPTIONAL, "value", "sigma")
    check_columns(name, columns, [*place, *measured, "value", "sigma"], dict.fromkeys(valid))


def check_predictions_columns(name: str, columns: list[str]) -> None:
    """Raise InputError for missing columns of predictions; further ones are rival models."""
    measured = () if "sensor" in columns else ("quantity",)
    check_columns(name, columns, [*coordinates_of(columns, bare=True), *measured, "value"], columns)


def read_keys(table: Table, header: Header, *, bare: bool) -> Keys:
    """Return the key columns of a table.

    Parameters
    ----------
    table, header
        The table, and the campaign's header with its sensors, loads and units.
    bare
        Whether there is no robot, so that poses may be names besides coordinates.

    Returns
    -------
    Keys
        n rows, SI.

    """
    coordinates = coordinates_of(table.columns, bare=bare)
    applied = _read_applied(table, header)
    quantity, sensor = _read_measured(table, header, applied)
    names = [load.name for load in header.loads]
    expected = f"one of campaign.toml's [loads] {' '.join(names) or '(none)'}, or an empty cell for M"
    load = table.codes("load", names, expected)
    wrench = _check_wrench(table, applied, quantity, sensor, load)
    if coordinates == LABEL:
        cells = table.columns["pose"]
        if "" in cells:
            raise table.fail(cells.index(""), "pose", "the label of a pose")
        place: tuple[tuple[Any, ...], ...] = tuple((cell,) for cell in cells)
    else:
        place = tuple(zip(*(coordinate(table, header, name).tolist() for name in coordinates), strict=True))
    return Keys(table, coordinates, place, wrench, quantity, sensor, load, table.column("session"))


def _read_applied(table: Table, header: Header) -> Array:
    """Return wrenches (n, 6) from the cells; zero for missing columns, NaN for empty cells."""
    given = [name in table.columns for name in WRENCH]
    columns = [
        component(table, header, name) if name in table.columns else np.zeros(len(table.lines)) for name in WRENCH
    ]
    out = np.column_stack(columns)
    out[np.isnan(out[:, given]).all(axis=1)] = np.nan  # also if there are no columns
    return out


def _read_measured(table: Table, header: Header, applied: Array) -> tuple[Indices, Indices]:
    """Return quantity and sensor (n,) of each row; ``applied`` (n, 6): wrench, NaN if empty."""
    names = [sensor.name for sensor in header.sensors]
    shown = f"one of {_SHOWN_QUANTITIES}"
    listed = f"one of campaign.toml's [sensors] {' '.join(names) or '(none)'}"
    quantity = table.codes("quantity", QUANTITIES, shown)
    sensor = table.codes("sensor", names, listed)
    at_tool, by_sensor = quantity >= 0, sensor >= 0
    both = "an empty cell beside a quantity: one of the two a row"
    table.refuse_where(at_tool & by_sensor, "sensor", both)
    column = "quantity" if "quantity" in table.columns else "sensor"
    table.refuse_where(~at_tool & ~by_sensor, column, listed if names else shown)
    absolute = np.array([s.absolute for s in header.sensors] or [False])[np.maximum(sensor, 0)] & by_sensor
    kind = table.codes("kind", KINDS[:2], "deflection or deviation")
    wrong = (kind >= 0) & at_tool & (kind != quantity // 6)
    table.refuse_where(wrong, "kind", "an empty cell beside a quantity, which says its kind")
    message = "an empty cell beside a position or a distance, which is what it is"
    table.refuse_where((kind >= 0) & absolute, "kind", message)
    loaded = (np.nan_to_num(applied) != 0.0).any(axis=1)
    kind = np.where(kind >= 0, kind, np.where(loaded, DEFLECTION, DEVIATION))
    axis = np.array([s.axis for s in header.sensors] or [0])[np.maximum(sensor, 0)]
    seen = np.where(absolute, FIRST_POSITION + axis, 6 * kind + axis)
    return np.where(by_sensor, seen, quantity), sensor


def _check_wrench(table: Table, applied: Array, quantity: Indices, sensor: Indices, load: Indices) -> Array:
    """Return wrenches (n, 6): NaN for stiffnesses and frequencies, zero if nothing is applied."""
    kind = kind_of(quantity)
    nothing = (np.nan_to_num(applied) == 0.0).all(axis=1)
    at_tool = (kind == DEFLECTION) & (sensor < 0)
    if not any(name in table.columns for name in WRENCH):
        table.refuse_where(at_tool, "fx", "a wrench for a deflection (columns fx fy fz mx my mz)")
    stiff = (kind >= STIFFNESS) & (kind <= FREQUENCY)
    for k, name in enumerate(WRENCH):
        if name in table.columns:
            empty = np.isnan(applied[:, k])
            message = "a finite number: a deflection needs its wrench"
            table.refuse_where(at_tool & nothing & empty, name, message)
            if (stiff & ~empty).any():
                which = KINDS[int(kind[int(np.argmax(stiff & ~empty))])].replace("push", "stiffness")
                table.refuse_where(stiff & ~empty, name, f"an empty cell: a {which} reading has no wrench")
            moved = (kind == DEVIATION) & ~empty & (applied[:, k] != 0)
            table.refuse_where(moved, name, "0: a deviation is read on the unloaded platform")
    loaded = (kind == DEFLECTION) | (kind == POSITION) | ((kind == DEVIATION) & nothing)
    table.refuse_where((load >= 0) & ~loaded, "load", "an empty cell: only a deflection has a load")
    out = np.nan_to_num(applied)
    out[stiff] = np.nan
    return out

"""Columns of a campaign's table: poses, loads and quantities of rows; numbers in SI with limits."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import repeat
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign import quantities as of
from stiffscope.gap.campaign.kinds import (
    CODE_ALONG,
    DIRECTION_OF,
    KIND_OF,
    KINDS,
    NAMED,
    by_code,
    number_of,
)
from stiffscope.gap.campaign.quantities import (
    AXES,
    DEFLECTION,
    DEVIATION,
    POSITION,
    WRENCH,
    kind_of,
    names_of,
)
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.quantities import Dimension, show_value, to_si, weight_of
from stiffscope.runtime.table import check_columns, numbers

if TYPE_CHECKING:
    from collections.abc import Collection

    from stiffscope.gap.campaign.campaign_header import Header
    from stiffscope.gap.campaign.kinds.kind import Kind
    from stiffscope.runtime.table import Table
    from stiffscope.runtime.types import Array, Indices

OPTIONAL = ("session", "sensor", "quantity", "load", "kind")
LABEL = ("pose",)
"""Coordinates of named poses."""
_MOST_SHOWN = 6  # quantities of a kind in a message; of more, the first and the last


def _show_quantities(kind: Kind) -> tuple[str, ...]:
    names = names_of(kind)
    return names if len(names) <= _MOST_SHOWN else (names[0], "...", names[-1])


_SHOWN_QUANTITIES = " ".join(name for kind in KINDS for name in _show_quantities(kind))
_BY_COLUMN = [kind for kind in KINDS if kind.by_column]
_IS_APPLIED = by_code(lambda kind: kind.wrench == "applied")
_IS_ZERO = by_code(lambda kind: kind.wrench == "zero")
_HAS_NONE = by_code(lambda kind: kind.wrench == "none")
_IS_DIFFERENCE = by_code(lambda kind: kind.is_difference)
_PLACE = Dimension("a length", "m", "mm", most=q.LENGTH.most)
_TURN = Dimension("an angle", "rad", "deg", most=1e4)
_WRENCH = (
    Dimension("a force", "N", "N", most=q.FORCE.most),
    Dimension("a moment", "N*m", "N*mm", most=q.MOMENT.most),
)


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
        labels = self.sessions if sessions else repeat("", len(wrench))
        codes = (self.quantity.tolist(), self.sensor.tolist(), self.load.tolist())
        return list(zip(self.place, wrench, *codes, labels, strict=True))


def coordinates_of(columns: Collection[str], *, bare: bool) -> tuple[str, ...]:
    """Return a table's pose columns, by default those of a position; ``bare``: or names."""
    places = [name for name in columns if name in AXES or name.startswith(of.JOINT)]
    if "pose" in columns and (bare or not places):
        return LABEL
    places.sort(key=(*AXES, *places).index)
    return tuple(places) or AXES[:3]


def check_readings_columns(name: str, columns: list[str], *, bare: bool) -> None:
    """Raise InputError for missing or unknown columns of a table of readings."""
    place = coordinates_of(columns, bare=bare)
    measured = () if "sensor" in columns else ("quantity",)
    valid = (*place, *WRENCH, *OPTIONAL, "value", "sigma")
    check_columns(name, columns, [*place, *measured, "value"], dict.fromkeys(valid))


def check_predictions_columns(name: str, columns: list[str]) -> None:
    """Raise InputError for missing columns of predictions; further ones are rival models."""
    measured = () if "sensor" in columns else ("quantity",)
    check_columns(
        name,
        columns,
        [*coordinates_of(columns, bare=True), *measured, "value"],
        columns,
    )


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
    listed = f"one of campaign.toml's [loads] {' '.join(names) or '(none)'}"
    load = table.codes("load", names, f"{listed}, or an empty cell for M")
    wrench = _check_wrench(table, applied, quantity, sensor, load)
    if coordinates == LABEL:
        cells = table.column("pose")
        if "" in cells:
            unnamed = np.array([cell == "" for cell in cells])
            table.refuse_where(unnamed, "pose", "the label of a pose", alone=True)
        place: tuple[tuple[Any, ...], ...] = tuple((cell,) for cell in cells)
    else:
        values = (coordinate(table, header, name).tolist() for name in coordinates)
        place = tuple(zip(*values, strict=True))
    for name in ("session", *LABEL):
        strange = np.array([not cell.isprintable() for cell in table.column(name)])
        # a terminal would obey others
        table.refuse_where(strange, name, "a label of printable characters", alone=True)
    return Keys(
        table=table,
        coordinates=coordinates,
        place=place,
        wrench=wrench,
        quantity=quantity,
        sensor=sensor,
        load=load,
        sessions=table.column("session"),
    )


def _read_applied(table: Table, header: Header) -> Array:
    """Return wrenches (n, 6) from the cells; zero for missing columns, NaN for empty cells."""
    given = [name in table.columns for name in WRENCH]
    out = np.zeros((len(table.lines), 6))
    for k in np.flatnonzero(given):
        out[:, k] = component(table, header, WRENCH[k])
    out[np.isnan(out[:, given]).all(axis=1)] = np.nan  # also if there are no columns
    return out


def _read_measured(
    table: Table, header: Header, applied: Array
) -> tuple[Indices, Indices]:
    """Return quantity and sensor (n,) of each row; ``applied`` (n, 6): wrench, NaN if empty."""
    names = [sensor.name for sensor in header.sensors]
    shown = f"one of {_SHOWN_QUANTITIES}"
    listed = f"one of campaign.toml's [sensors] {' '.join(names) or '(none)'}"
    quantity = table.codes("quantity", of.QUANTITIES, shown)
    sensor = table.codes("sensor", names, listed)
    at_tool = quantity >= 0
    by_sensor = sensor >= 0
    both = "an empty cell beside a quantity: one of the two a row"
    table.refuse_where(at_tool & by_sensor, "sensor", both)
    column = "quantity" if "quantity" in table.columns else "sensor"
    either = f"{shown}, or a sensor, {listed}" if column == "quantity" else listed
    table.refuse_where(~at_tool & ~by_sensor, column, either if names else shown)
    every = np.maximum(sensor, 0)
    absolute = (
        np.array([s.absolute for s in header.sensors] or [False])[every] & by_sensor
    )
    kinds = [each.name for each in _BY_COLUMN]
    kind = table.codes("kind", kinds, " or ".join(kinds))
    quantity = np.where(at_tool, NAMED[quantity], quantity)
    stated = np.array([number_of(each) for each in _BY_COLUMN])[kind]
    wrong = (kind >= 0) & at_tool & (stated != KIND_OF[quantity])
    table.refuse_where(
        wrong, "kind", "an empty cell beside a quantity, which says its kind"
    )
    message = "an empty cell beside a position or a distance, which is what it is"
    table.refuse_where((kind >= 0) & absolute, "kind", message)
    loaded = (np.nan_to_num(applied) != 0.0).any(axis=1)
    usual = np.where(loaded, DEFLECTION, DEVIATION)
    kind = np.where(kind >= 0, stated, usual)
    kind = np.where(absolute, POSITION, kind)
    axis = np.array([s.axis for s in header.sensors] or [0])[every]
    return np.where(by_sensor, CODE_ALONG[kind, axis], quantity), sensor


def _check_wrench(
    table: Table, applied: Array, quantity: Indices, sensor: Indices, load: Indices
) -> Array:
    """Return wrenches (n, 6): NaN for stiffnesses and frequencies, zero if nothing is applied."""
    kind = kind_of(quantity)
    nothing = (np.nan_to_num(applied) == 0.0).all(axis=1)
    at_tool = _IS_DIFFERENCE[quantity] & (sensor < 0)
    if not any(name in table.columns for name in WRENCH):
        table.refuse_where(
            at_tool, "fx", "a wrench for a deflection (columns fx fy fz mx my mz)"
        )
    stiff = _HAS_NONE[quantity]
    for k, name in enumerate(WRENCH):
        if name in table.columns:
            empty = np.isnan(applied[:, k])
            message = "a finite number: a deflection needs its wrench"
            table.refuse_where(at_tool & nothing & empty, name, message)
            row = int(np.argmax(stiff & ~empty))  # the first wrong one, if any
            which = KINDS[int(kind[row])].called
            message = f"an empty cell: a {which} reading has no wrench"
            table.refuse_where(stiff & ~empty, name, message)
            moved = _IS_ZERO[quantity] & ~empty & (applied[:, k] != 0)
            table.refuse_where(
                moved, name, "0: a deviation is read on the unloaded platform"
            )
    loaded = _IS_APPLIED[quantity] | (_IS_ZERO[quantity] & nothing)
    table.refuse_where(
        (load >= 0) & ~loaded, "load", "an empty cell: only a deflection has a load"
    )
    out = np.nan_to_num(applied)
    out[stiff] = np.nan
    return out


def check_units(header: Header, table: Table) -> None:
    """Raise InputError for units of unknown or missing columns."""
    known = {*AXES, *WRENCH, "value", "sigma"}
    for column in header.units:
        if column not in known and not (
            column.startswith(of.JOINT) and column[len(of.JOINT) :]
        ):
            valid = ", ".join((*AXES, *WRENCH, "value", "sigma", "q:JOINT"))
            table.note(
                header.source.refuse(
                    ("units", column), f"expected a column among {valid}"
                )
            )
        if column.startswith(of.JOINT) and column not in table.columns:
            expected = f"expected a column of {table.name}, which has none such"
            table.note(header.source.refuse(("units", column), expected))
        if column not in table.columns and column == "sigma":
            message = f"{table.name}:1: sigma: expected this column, got none"
            table.note(InputError(message))


def coordinate(table: Table, header: Header, name: str) -> Array:
    """Return a commanded coordinate (n,) in SI."""
    dimensions = (
        (_PLACE,) if name in AXES[:3] else (_TURN,) if name in AXES else (_PLACE, _TURN)
    )
    unit = " or ".join(
        {"m": "metres", "rad": "radians"}[dimension.unit] for dimension in dimensions
    )
    values = numbers(table, name, expected=f"a finite number of {unit}")
    values = values * _factor(table, header, name, *dimensions)
    _check_most(table, name, values, dimensions[0])
    with np.errstate(over="ignore"):  # what is too large is noted above
        return np.round(values, 12)


def component(table: Table, header: Header, name: str) -> Array:
    """Return a component of the wrench (n,) in SI; NaN for empty cells."""
    dimension = _WRENCH[WRENCH.index(name) // 3]
    values = numbers(
        table, name, empty=True, expected="a finite number or an empty cell"
    )
    values = values * _factor(table, header, name, dimension)
    _check_most(table, name, values, dimension)
    return values


def _factor(table: Table, header: Header, column: str, *dimensions: Dimension) -> float:
    """Return the SI value of a column's unit. Raises InputError if it fits no dimension."""
    unit = header.units.get(column)
    if unit is None:
        return 1.0
    for dimension in dimensions:
        try:
            return to_si(f"1 {unit}", dimension)
        except ValueError:
            continue
    expected = " or ".join(f'{d.noun} such as "{d.example}"' for d in dimensions)
    message = f"expected a unit of {expected}, got {show_value(unit)}"
    message += weight_of(unit, dimensions[0])
    table.note(header.source.refuse(("units", column), message))
    return 1.0


def readings_in_si(
    table: Table,
    header: Header,
    column: str,
    values: Array,
    quantity: Indices,
    *,
    unit_of: str = "",
) -> Array:
    """Convert readings to SI.

    Parameters
    ----------
    table, header
        Table and header of the campaign.
    column
        Column of the values.
    values
        Values (n,) as written; NaN is kept.
    quantity
        Quantity codes (n,) of the rows.
    unit_of
        Column whose unit applies; by default their own.

    Raises
    ------
    InputError
        The unit does not fit a row's quantity, or a value is implausibly large or fine.
    """
    unit_of = unit_of or column
    unit = header.units.get(unit_of)
    out = np.array(values)
    kinds = kind_of(quantity)
    turns = DIRECTION_OF[quantity] // 3
    for kind, turn in {(int(k), int(t)) for k, t in zip(kinds, turns, strict=True)}:
        rows = (kinds == kind) & (turns == turn)
        dimension = KINDS[kind].dimensions[turn]
        try:
            with np.errstate(over="ignore"):  # overflow is refused below
                out[rows] *= to_si(f"1 {unit}", dimension) if unit else 1.0
        except ValueError:
            if not _check_unit(table, header, str(unit), unit_of):
                return out
            row = int(np.argmax(rows))
            measured = "quantity" if table.column("quantity")[row] else "sensor"
            stated = f"measured in {unit}, as campaign.toml says of {unit_of}"
            message = f"a reading that is {stated}, not {dimension.noun}"
            table.refuse_where(np.arange(len(rows)) == row, measured, message)
            continue
        _check_most(table, column, np.where(rows, out, 0.0), dimension)
        fine = rows & (out < dimension.least) & (out > 0.0)
        if column == "sigma":
            message = f"an uncertainty of at least {dimension.least:g} {dimension.unit}"
            table.refuse_where(fine, column, message)
    return out


def _check_most(table: Table, column: str, values: Array, dimension: Dimension) -> None:
    """Raise InputError for values (n,), SI, beyond those of any robot."""
    limit = f"{dimension.noun} of at most {dimension.most:g} {dimension.unit}"
    unit = f'units = {{ {column} = "{dimension.example}" }}'
    message = f"{limit} (another unit than SI is named in campaign.toml: {unit})"
    table.refuse_where(np.abs(values) > dimension.most, column, message)


def _check_unit(table: Table, header: Header, unit: str, column: str) -> bool:
    """Return whether it is a unit of readings, after a note if it is not."""
    for dimension in (
        *(quantity for kind in KINDS for quantity in kind.dimensions),
        q.NUMBER,
    ):
        try:
            to_si(f"1 {unit}", dimension)
        except ValueError:
            continue
        return True
    message = f'expected a unit such as "um", "urad" or "N/um", got {show_value(unit)}'
    table.note(header.source.refuse(("units", column), message))
    return False

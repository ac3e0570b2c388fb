"""Conversion of a table's numbers to SI, with limits of plausible values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.quantities import (
    AXES,
    DEFLECTION,
    DEVIATION,
    FREQUENCY,
    JOINT,
    POSITION,
    PUSH,
    STIFFNESS,
    WRENCH,
    kind_of,
)
from stiffscope.robot.file.quantities import FORCE, LENGTH, MOMENT, NUMBER, Dimension, show_value, to_si
from stiffscope.runtime.table import numbers

if TYPE_CHECKING:
    from stiffscope.gap.campaign.campaign_header import Header
    from stiffscope.runtime.table import Table
    from stiffscope.runtime.types import Array, Indices

# `least` is the smallest standard uncertainty of any instrument.
MOVED = Dimension("a displacement", "m", "um", 1e-14, 10.0)
_TURNED = Dimension("a rotation", "rad", "urad", 1e-14, 10)
_STIFF = (
    Dimension("a stiffness", "N/m", "N/um", 1e-6, 1e18),
    Dimension("a rotational stiffness", "N*m/rad", "N*m/mrad", 1e-6, 1e18),
)
_OFTEN = Dimension("a frequency", "Hz", "Hz", 1e-9, 1e12)
_THERE = Dimension("a position", "m", "mm", 1e-14, LENGTH.most)
_MEASURED = {  # by kind: translation, rotation
    DEFLECTION: (MOVED, _TURNED),
    DEVIATION: (MOVED, _TURNED),
    STIFFNESS: _STIFF,
    PUSH: _STIFF,
    FREQUENCY: (_OFTEN, _OFTEN),
    POSITION: (_THERE, _THERE),
}
_PLACE, _TURN = Dimension("a length", "m", "mm", most=LENGTH.most), Dimension("an angle", "rad", "deg", most=1e4)
_WRENCH = Dimension("a force", "N", "N", most=FORCE.most), Dimension("a moment", "N*m", "N*mm", most=MOMENT.most)


def check_units(header: Header, table: Table) -> None:
    """Raise InputError for units of unknown or missing columns."""
    known = {*AXES, *WRENCH, "value", "sigma"}
    for column in header.units:
        if column not in known and not column.startswith(JOINT):
            valid = ", ".join((*AXES, *WRENCH, "value", "sigma", "q:JOINT"))
            raise header.source.refuse(("units", column), f"expected a column among {valid}")
        if column not in table.columns and column in {"value", "sigma"}:
            raise InputError(f"{table.name}:1: {column}: expected this column, got none")


def coordinate(table: Table, header: Header, name: str) -> Array:
    """Return a commanded coordinate (n,) in SI."""
    dimensions = (_PLACE,) if name in AXES[:3] else (_TURN,) if name in AXES else (_PLACE, _TURN)
    unit = " or ".join({"m": "metres", "rad": "radians"}[each.unit] for each in dimensions)
    values = numbers(table, name, expected=f"a finite number of {unit}") * _factor(header, name, *dimensions)
    _check_most(table, name, values, dimensions[0])
    return np.round(values, 12)


def component(table: Table, header: Header, name: str) -> Array:
    """Return a component of the wrench (n,) in SI; NaN for empty cells."""
    dimension = _WRENCH[WRENCH.index(name) // 3]
    values = numbers(table, name, empty=True, expected="a finite number or an empty cell")
    values = values * _factor(header, name, dimension)
    _check_most(table, name, values, dimension)
    return values


def _factor(header: Header, column: str, *dimensions: Dimension) -> float:
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
    raise header.source.refuse(("units", column), f"expected a unit of {expected}, got {show_value(unit)}")


def readings_in_si(
    table: Table, header: Header, column: str, values: Array, quantity: Indices, *, unit_of: str = ""
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
    kinds, turns = kind_of(quantity), quantity % 6 // 3
    for kind, turn in {(int(k), int(t)) for k, t in zip(kinds, turns, strict=True)}:
        mine = (kinds == kind) & (turns == turn)
        dimension = _MEASURED[kind][turn]
        try:
            with np.errstate(over="ignore"):  # overflow is refused below
                out[mine] *= to_si(f"1 {unit}", dimension) if unit else 1.0
        except ValueError:
            _check_unit(header, str(unit), unit_of)
            row = int(np.argmax(mine))
            measured = "quantity" if table.column("quantity")[row] else "sensor"
            message = f"a reading that is measured in {unit}, as campaign.toml says of {unit_of}, not {dimension.noun}"
            raise table.fail(row, measured, message) from None
        _check_most(table, column, np.where(mine, out, 0.0), dimension)
        fine = mine & (out < dimension.least) & (out > 0.0)
        if column == "sigma":
            message = f"an uncertainty of at least {dimension.least:g} {dimension.unit}"
            table.refuse_where(fine, column, message)
    return out


def _check_most(table: Table, column: str, values: Array, dimension: Dimension) -> None:
    """Raise InputError for values (n,), SI, beyond those of any robot."""
    limit = f"{dimension.noun} of at most {dimension.most:g} {dimension.unit}"
    unit = f' (another unit than SI is named in campaign.toml: units = {{ {column} = "{dimension.example}" }})'
    table.refuse_where(np.abs(values) > dimension.most, column, limit + unit)


def _check_unit(header: Header, unit: str, column: str) -> None:
    for dimension in (*(each for pair in _MEASURED.values() for each in pair), NUMBER):
        try:
            to_si(f"1 {unit}", dimension)
        except ValueError:
            continue
        return
    raise header.source.refuse(
        ("units", column), f'expected a unit such as "um", "urad" or "N/um", got {show_value(unit)}'
    )

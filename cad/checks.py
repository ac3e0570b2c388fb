"""Checks of geometric parameters. Every error names the field as the robot file spells it, and what would be valid."""

import math
from numbers import Integral, Real

import numpy as np

from stiffscope.errors import InputError

# m: a length outside this range is most likely in the wrong unit, and the mesher's tolerances fail
SMALLEST, LARGEST = 1e-5, 20.0

GAP = 5e-4  # m: least wall thickness between features; thinner walls take the mesher minutes

FINEST = 1e-4  # m: least fillet radius; smaller ones are below the tolerances of kernel and mesher

FARTHEST = 1e3  # m: a point farther away is most likely in the wrong unit, and costs the kernel its precision

POINT = f"a point of three numbers in m, within {FARTHEST:g} m"


def mm(length: float) -> str:
    """Format a length in m as text in mm."""
    return f"{length * 1e3:.6g} mm"


def require(valid: bool, field: str, expected: str, got: object) -> None:
    """Raise InputError ``FIELD: expected …, got …`` unless `valid`.

    Parameters
    ----------
    valid
        Whether the value is.
    field
        Field that a message names.
    expected
        What a message says was expected.
    got
        What a message says there was.

    """
    if not valid:
        raise InputError(f"{field}: expected {expected}, got {got}")


def require_between(field: str, least: float, value: float, most: float, note: str = "") -> None:
    """Raise InputError unless a length (m) is within two others; ``note`` follows these in the message."""
    require(least <= value <= most, field, f"{mm(least)} to {mm(most)}{note}", mm(value))


def require_below(field: str, value: float, limit: float, note: str = "") -> None:
    """Raise InputError unless a length (m) is below a limit; ``note`` follows that in the message."""
    require(value < limit, field, f"less than {mm(limit)}{note}", mm(value))


def number(field: str, value: object) -> float:
    """Return `value` as a finite float. Raises InputError."""
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
        raise InputError(f"{field}: expected a finite number, got {value!r}")
    return float(value)


def length(field: str, value: object) -> float:
    """Return `value` as a length in m within `SMALLEST` and `LARGEST`. Raises InputError."""
    metres = number(field, value)
    require(SMALLEST <= metres <= LARGEST, field, f"a length from {mm(SMALLEST)} to {mm(LARGEST)}", mm(metres))
    return metres


def optional_length(field: str, value: object) -> float:
    """Return `value` as a length in m, or 0, which leaves the feature out. Raises InputError."""
    return 0.0 if number(field, value) == 0 else length(field, value)


def count(field: str, value: object, largest: int = 100) -> int:
    """Return `value` as a whole number from 0 to `largest`. Raises InputError.

    Parameters
    ----------
    field
        Field that a message names.
    value
        Value to check.
    largest
        Largest valid number.

    """
    if isinstance(value, bool) or not isinstance(value, Integral) or not 0 <= int(value) <= largest:
        raise InputError(f"{field}: expected a whole number from 0 to {largest}, got {value!r}")
    return int(value)


def choice(field: str, value: object, valid: tuple[str, ...]) -> None:
    """Raise InputError unless `value` is one of `valid`.

    Parameters
    ----------
    field
        Field that a message names.
    value
        Value to check.
    valid
        Valid words.

    """
    require(value in valid, field, "one of " + ", ".join(map(repr, valid)), repr(value))


def is_point(value: object) -> bool:
    """Whether `value` is a point as `POINT` describes it."""
    return _size(value) <= FARTHEST


def direction(field: str, value: object) -> None:
    """Raise InputError unless `value` is a vector of three numbers with a usable length."""
    require(1e-9 <= _size(value) <= 1e9, field, "a direction (three numbers of length 1e-9 to 1e9)", repr(value))


def _size(value: object) -> float:
    """Euclidean norm of a vector of three numbers, without overflow; NaN for anything else."""
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return math.nan
    return math.hypot(*numbers) if numbers.shape == (3,) else math.nan

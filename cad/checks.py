"""Checks of geometric parameters. Errors name the field as in the robot file, and valid values."""

import math
from numbers import Integral, Real

import numpy as np

from stiffscope.errors import InputError

# m: a length outside this range probably has the wrong unit, and the mesher's tolerances fail
SMALLEST = 1e-5
LARGEST = 20.0
GAP = 5e-4  # m: smallest wall between features; thinner walls take minutes to mesh
FINEST = 1e-4  # m: smallest fillet radius; smaller ones are below kernel and mesher tolerances
FARTHEST = 1e3  # m: a farther point probably has the wrong unit, and costs precision
POINT = f"a point of three numbers in m, within {FARTHEST:g} m"


def mm(length: float) -> str:
    """Format a length in m as text in mm."""
    return f"{length * 1e3:.6g} mm"


def require(valid: bool, field: str, expected: str, got: object) -> None:
    """Raise InputError ``FIELD: expected …, got …`` unless `valid`."""
    if not valid:
        raise InputError(f"{field}: expected {expected}, got {got}")


def require_between(
    field: str, least: float, value: float, most: float, note: str = ""
) -> None:
    """Raise InputError unless a length (m) is within limits; ``note`` is appended to these."""
    require(
        least <= value <= most, field, f"{mm(least)} to {mm(most)}{note}", mm(value)
    )


def number(field: str, value: object) -> float:
    """Return `value` as a finite float. Raises InputError if it is not one."""
    if (
        isinstance(value, bool)
        or not isinstance(value, Real)
        or not math.isfinite(value)
    ):
        raise InputError(f"{field}: expected a finite number, got {value!r}")
    return float(value)


def length(field: str, value: object) -> float:
    """Return `value` as a length in m within `SMALLEST` and `LARGEST`. Raises InputError."""
    metres = number(field, value)
    valid = f"a length from {mm(SMALLEST)} to {mm(LARGEST)}"
    require(SMALLEST <= metres <= LARGEST, field, valid, mm(metres))
    return metres


def optional_length(field: str, value: object) -> float:
    """Return `value` as a length in m, or 0, which omits the feature. Raises InputError."""
    return 0.0 if number(field, value) == 0 else length(field, value)


def count(field: str, value: object, largest: int = 100) -> int:
    """Return `value` as a whole number from 0 to `largest`; else raise InputError on the field."""
    if (
        isinstance(value, bool)
        or not isinstance(value, Integral)
        or not 0 <= int(value) <= largest
    ):
        raise InputError(
            f"{field}: expected a whole number from 0 to {largest}, got {value!r}"
        )
    return int(value)


def choice(field: str, value: object, valid: tuple[str, ...]) -> None:
    """Raise InputError on the field unless `value` is one of `valid`."""
    require(value in valid, field, "one of " + ", ".join(map(repr, valid)), repr(value))


def is_point(value: object) -> bool:
    """Return whether `value` is a point as described by `POINT`."""
    return _size(value) <= FARTHEST


def direction(field: str, value: object) -> None:
    """Raise InputError unless `value` is a vector of three numbers of usable length."""
    valid = "a direction (three numbers of length 1e-9 to 1e9)"
    require(1e-9 <= _size(value) <= 1e9, field, valid, repr(value))


def _size(value: object) -> float:
    """Return the Euclidean norm of three numbers, without overflow; NaN for anything else."""
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return math.nan
    return math.hypot(*numbers) if numbers.shape == (3,) else math.nan

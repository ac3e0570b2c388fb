"""Checks of geometric parameters: what fails is named as in the robot file, with what would be valid."""

import math
from numbers import Integral, Real

import numpy as np

from stiffscope.errors import InputError

SMALLEST, LARGEST = 1e-5, 20.0  # m: beyond this a length is a unit mistaken, and the mesher's tolerances fail

GAP = 5e-4  # m: the least wall left between features; what is thinner costs the mesher minutes

FINEST = 1e-4  # m: the least radius of a fillet; the kernel's tolerance and the mesher's envelope swallow smaller ones

FARTHEST = 1e3  # m: a point beyond it is a unit mistaken, and the kernel has too few digits for the solid

POINT = f"a point of three numbers in m, within {FARTHEST:g} m"


def mm(length: float) -> str:
    """A length in m, written in mm."""
    return f"{length * 1e3:.6g} mm"


def require(valid: bool, field: str, expected: str, got: object) -> None:
    """Raise InputError, naming the field, unless `valid`."""
    if not valid:
        raise InputError(f"{field}: expected {expected}, got {got}")


def number(field: str, value: object) -> float:
    """`value` as a finite float."""
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
        raise InputError(f"{field}: expected a finite number, got {value!r}")
    return float(value)


def length(field: str, value: object) -> float:
    """`value` as a length in m that a part can have."""
    metres = number(field, value)
    require(SMALLEST <= metres <= LARGEST, field, f"a length from {mm(SMALLEST)} to {mm(LARGEST)}", mm(metres))
    return metres


def optional_length(field: str, value: object) -> float:
    """`value` as a length in m, or 0: the feature is absent."""
    return 0.0 if number(field, value) == 0 else length(field, value)


def count(field: str, value: object, largest: int = 100) -> int:
    """`value` as a whole number from 0 to `largest`."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not 0 <= int(value) <= largest:
        raise InputError(f"{field}: expected a whole number from 0 to {largest}, got {value!r}")
    return int(value)


def choice(field: str, value: object, valid: tuple[str, ...]) -> None:
    """Check that `value` is one of `valid`."""
    require(value in valid, field, "one of " + ", ".join(map(repr, valid)), repr(value))


def is_point(value: object) -> bool:
    """Whether `value` is what `POINT` says."""
    return _size(value) <= FARTHEST


def direction(field: str, value: object) -> None:
    """Check that `value` is three numbers that tell a direction."""
    require(1e-9 <= _size(value) <= 1e9, field, "a direction (three numbers of length 1e-9 to 1e9)", repr(value))


def _size(value: object) -> float:
    """Length of a vector of three numbers, without overflow; not a number for anything else."""
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return math.nan
    return math.hypot(*numbers) if numbers.shape == (3,) else math.nan

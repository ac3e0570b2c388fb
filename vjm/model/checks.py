"""Input checks of the mechanics: names, shapes, finiteness, symmetry, definiteness."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, require

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from stiffscope.vjm.model.screws import Array

GROUND = "ground"
BASE = "<base>"
TOOL = "<tool>"
_SYMMETRY = 1e-6  # relative; published matrices are rounded
_INDEFINITE = -1e-9
PARALLEL = 1e-6
"""Sine of the angle below which two directions are parallel."""
_EQUAL = 1e-9  # of a unit vector's components


def check_compliance(
    matrix: ArrayLike, name: str, *, semidefinite: bool = False, ends: int = 1
) -> Array:
    """Check a compliance (6, 6), or (6m, 6m) of m ``ends``; return it exactly symmetric.

    Raises InputError if it has another shape, is not symmetric or is indefinite.

    Parameters
    ----------
    matrix
        Compliance (6m, 6m), SI.
    name
        Name for messages.
    semidefinite
        Whether zero compliance in some direction is allowed.
    ends
        Number m of ends.
    """
    c = np.asarray(matrix, dtype=float)
    size = 6 * ends
    require(
        c.shape == (size, size),
        name,
        f"a {size}x{size} compliance matrix",
        f"shape {c.shape}",
    )
    if not np.isfinite(c).all():
        raise InputError(f"{name}: every entry must be a finite number")
    if (np.diagonal(c) < 0.0).any():
        least = np.diagonal(c).min()
        raise InputError(
            f"{name}: diagonal entries must not be negative, got {least:.6g}"
        )
    root = np.sqrt(np.diagonal(c))  # products of tiny entries would be lost
    scale = np.outer(root, root)
    worst = np.unravel_index(np.argmax(np.abs(c - c.T) - _SYMMETRY * scale), c.shape)
    if abs(c[worst] - c[worst[::-1]]) > _SYMMETRY * scale[worst]:
        i, j = (int(k) + 1 for k in worst)
        there = c[worst]
        across = c[worst[::-1]]
        raise InputError(
            f"{name}: not symmetric, C{i}{j} = {there:.6g} but C{j}{i} = {across:.6g}"
        )
    c = 0.5 * (c + c.T)
    by_kind = np.diagonal(c).reshape(ends, 2, 3).max(axis=(0, 2))
    largest = np.sqrt(np.tile(np.repeat(by_kind, 3), ends))
    if ((scale == 0.0) & (np.abs(c) > _SYMMETRY * np.outer(largest, largest))).any():
        fault = "an entry couples with a direction that does not yield"
        raise InputError(f"{name}: not positive definite ({fault})")
    unit = np.where(scale > 0.0, c, 0.0) / np.where(scale > 0.0, scale, 1.0)
    smallest = float(np.linalg.eigvalsh(unit)[0])
    if smallest < _INDEFINITE or (not semidefinite and smallest <= 0.0):
        fault = f"smallest eigenvalue of the scaled matrix {smallest:.3g}"
        raise InputError(f"{name}: not positive definite ({fault})")
    return c


def spell_name(table: str, name: str) -> str:
    """Spell a body or joint as a robot file does, e.g. ``joints."leg1.motor"``."""
    return (
        f"{table}.{name}"
        if re.fullmatch(r"[A-Za-z0-9_-]+", name)
        else f'{table}."{name}"'
    )


def list_names(names: Sequence[str]) -> str:
    """Join names for a sentence."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def check_name(table: str, name: str) -> str:
    """Refuse an empty or reserved name of a body or joint; return its spelling in a robot file."""
    here = spell_name(table, name)
    require(
        name and name not in {GROUND, BASE, TOOL},
        here,
        "a name of its own",
        f"{name!r}",
    )
    return here


def check_array(
    value: ArrayLike, shape: tuple[int, ...], here: str, what: str
) -> Array:
    """Check that a value is an array of finite numbers of a given shape.

    Parameters
    ----------
    value
        Value to check.
    shape
        Expected shape.
    here
        Field for messages.
    what
        Expected quantity, for messages.
    """
    array = np.asarray(value, dtype=float)
    if array.shape != shape or not np.isfinite(array).all():
        got = (
            f"shape {array.shape}"
            if array.shape != shape
            else "some that are not finite"
        )
        got = array.tolist() if array.size <= 6 else got
        raise InputError(
            f"{here}: expected {what} of finite numbers, shape {shape}, got {got}"
        )
    return array


def check_vector(value: ArrayLike, here: str, what: str) -> Array:
    """Check that a value is a vector of three finite numbers.

    Parameters
    ----------
    value
        Value to check.
    here
        Field for messages.
    what
        Expected quantity, for messages.
    """
    return check_array(value, (3,), here, what)


def check_direction(value: ArrayLike, here: str) -> Array:
    """Return the unit vector (3,) along a direction."""
    vector = check_vector(value, here, "a direction")
    length = float(np.linalg.norm(vector))
    if not length > 0.0:
        raise InputError(f"{here}: expected a direction, got {vector.tolist()}")
    return vector / length


def axes_along(
    x: ArrayLike,
    y: ArrayLike | None = None,
    name: str = "axes",
    keys: tuple[str, str] = ("x", "y"),
) -> Array:
    """Return axes (3, 3) as columns: x along ``x`` (3,), y nearest to ``y`` (3,), z = x × y.

    ``name`` and ``keys`` are for messages.

    Parameters
    ----------
    x
        Direction (3,) of the first axis.
    y
        Direction (3,) near the second axis; by default the base axis after the one nearest to `x`.
    name
        Name for messages.
    keys
        Fields of x and y, for messages.
    """
    along = check_direction(x, f"{name}.{keys[0]}")
    near = np.abs(along)
    following = np.eye(3)[(int(np.argmax(near > near.max() - _EQUAL)) + 1) % 3]
    side = following if y is None else check_direction(y, f"{name}.{keys[1]}")
    normal = np.cross(along, side)
    if np.linalg.norm(normal) < PARALLEL:
        expected = f"a direction other than {keys[0]}"
        raise InputError(f"{name}.{keys[1]}: expected {expected}, got {side.tolist()}")
    normal = normal / np.linalg.norm(normal)
    return np.column_stack([along, np.cross(normal, along), normal])


def assign(owner: object, key: str, value: object) -> None:
    """Set a field of a frozen dataclass during its initialization.

    Parameters
    ----------
    owner
        Instance under initialization.
    key
        Name of the field.
    value
        Value to set.
    """
    object.__setattr__(owner, key, value)

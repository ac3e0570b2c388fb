"""Checks of what is handed to the mechanics: shape, finiteness, symmetry, definiteness."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from stiffscope.vjm.screws import Array

_SYMMETRY = 1e-6  # relative; published matrices are rounded
_INDEFINITE = -1e-9


def checked_compliance(matrix: ArrayLike, name: str, *, semidefinite: bool = False) -> Array:
    """A compliance (6, 6), made exactly symmetric. Raises InputError on another shape, asymmetry or indefiniteness."""
    c = np.asarray(matrix, dtype=float)
    if c.shape != (6, 6):
        msg = f"{name}: expected a 6x6 compliance matrix, got shape {c.shape}"
        raise InputError(msg)
    if not np.isfinite(c).all():
        msg = f"{name}: every entry must be a finite number"
        raise InputError(msg)
    if (np.diagonal(c) < 0.0).any():
        msg = f"{name}: diagonal entries must not be negative, got {np.diagonal(c).min():.6g}"
        raise InputError(msg)
    scale = np.sqrt(np.outer(np.diagonal(c), np.diagonal(c)))
    worst = np.unravel_index(np.argmax(np.abs(c - c.T) - _SYMMETRY * scale), (6, 6))
    if abs(c[worst] - c[worst[::-1]]) > _SYMMETRY * scale[worst]:
        i, j = int(worst[0]) + 1, int(worst[1]) + 1
        msg = f"{name}: not symmetric, C{i}{j} = {c[worst]:.6g} but C{j}{i} = {c[worst[::-1]]:.6g}"
        raise InputError(msg)
    c = 0.5 * (c + c.T)
    largest = np.repeat([np.diagonal(c)[:3].max(), np.diagonal(c)[3:].max()], 3)
    if ((scale == 0.0) & (np.abs(c) > _SYMMETRY * np.sqrt(np.outer(largest, largest)))).any():
        raise InputError(f"{name}: not positive definite (an entry couples with a direction that does not yield)")
    unit = np.where(scale > 0.0, c, 0.0) / np.where(scale > 0.0, scale, 1.0)
    smallest = float(np.linalg.eigvalsh(unit)[0])
    if smallest < _INDEFINITE or (not semidefinite and smallest <= 0.0):
        msg = f"{name}: not positive definite (smallest eigenvalue of the scaled matrix {smallest:.3g})"
        raise InputError(msg)
    return c

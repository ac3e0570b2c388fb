"""Numbers as people read them: with the digits that their error bounds leave, and zeros as zeros."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

TWIST = ("vx", "vy", "vz", "ωx", "ωy", "ωz")
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
NEGLIGIBLE = 1e-6
ZERO = "·"
ZERO_NOTE = f"{ZERO}  zero within its error bound, or below 10⁻⁶ of √(M_ii M_jj)"


def resolved(matrix: Any, error: Any = 0.0) -> NDArray[np.bool_]:
    """Return which entries (6n, 6n) of a matrix are more than mesh noise: beyond their bounds and 10⁻⁶ √(M_ii M_jj)."""
    values = np.abs(np.asarray(matrix, dtype=float))
    scale = np.sqrt(np.diagonal(values))
    return (values > np.asarray(error)) & (values > NEGLIGIBLE * np.outer(scale, scale))


def percent(value: float, digits: int = 3) -> str:
    """Return a percentage: "1.25 %"."""
    return f"{value:.{digits}g} %" if math.isfinite(value) else "unknown"


def relative(error: float, value: float) -> str:
    """Return a bound as a percentage of its value, with two digits."""
    return percent(100 * abs(error / value), 2) if value else "-"


def ratio(value: float, other: float) -> str:
    """Return how many times one value is another."""
    return f"{value / other:.4g}" if other else "-"


def with_bound(value: float, bound: float) -> str:
    """Return a value with the digits that its bound leaves, and the bound: "4.815e-09 ± 2e-12"."""
    digits = min(9, max(1, len(f"{abs(value) / max(bound, 1e-12 * abs(value)):.0f}")))
    return f"{value:.{digits}e} ± {bound:.0e}"


def point(position: Any, digits: int = 4) -> str:
    """Return a position (3,) in m as text in mm: "0, 0, 347.5"."""
    return ", ".join(f"{1e3 * c:z.{digits}g}" for c in position)


def pose_values(pose: Any, digits: int = 4) -> str:
    """Return a pose's values, SI, without rounding errors: "0, 0, 0.3475"."""
    return ", ".join(f"{round(float(c), 9):z.{digits}g}" for c in pose)


def coordinates(pose: Sequence[str]) -> str:
    """Return the heading of a column of tool poses, which are shown in SI: "x, y, z (m)"."""
    turns = sum(name.startswith("r") for name in pose)
    unit = "m" if not turns else "rad" if turns == len(pose) else "m, rad"
    return f"{', '.join(pose)} ({unit})"

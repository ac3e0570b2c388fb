"""Formatting of numbers: significant digits according to error bounds, and clean zeros."""

from __future__ import annotations

import base64
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.robot.file.quantities import shown_unit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

TWIST = ("vx", "vy", "vz", "ωx", "ωy", "ωz")
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
NEGLIGIBLE = 1e-6
ZERO = "·"
ZERO_NOTE = f"{ZERO}  zero within its error bound, or below 10⁻⁶ of √(M_ii M_jj)"


def find_resolved(matrix: Any, error: Any = 0.0) -> NDArray[np.bool_]:
    """Return a mask (6n, 6n) of entries above noise: their bounds and 10⁻⁶ √(M_ii M_jj)."""
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
    """Return the ratio of two values as text."""
    return f"{value / other:.4g}" if other else "-"


def with_bound(value: float, bound: float) -> str:
    """Return a value, rounded according to its bound, and the bound: "4.815e-09 ± 2e-12"."""
    digits = min(9, max(1, len(f"{abs(value) / max(bound, 1e-12 * abs(value)):.0f}")))
    return f"{value:.{digits}e} ± {bound:.0e}"


def point(position: Any, digits: int = 4) -> str:
    """Return a position (3,) in m as text in mm: "0, 0, 347.5"."""
    return ", ".join(f"{1e3 * c:z.{digits}g}" for c in position)


def vector(values: Any, digits: int = 4) -> str:
    """Return numbers without rounding errors: "0, 0, 9.81"."""
    return ", ".join(f"{round(float(c), 9):z.{digits}g}" for c in values)


def pose_values(pose: Any, names: Sequence[str], digits: int = 5) -> str:
    """Return a pose in mm and deg, drives (`q:JOINT`) in m or rad, rounded: "0, 0, 347.5"."""
    return vector(
        [shown_unit(name)[0] * c for name, c in zip(names, pose, strict=True)], digits
    )


def coordinates(names: Sequence[str]) -> str:
    """Return the heading of a column of tool poses: "x, y, z (mm)"."""
    units = {shown_unit(name)[1] for name in names}
    drives = units & {"m or rad"}
    return f"{', '.join(names)} ({', '.join(sorted(drives or units, reverse=True))})"


def name_pose(pose: Any, names: Sequence[str]) -> str:
    """Return a pose with its coordinates: "x, y, z (mm) = 0, 0, 347.5"."""
    return f"{coordinates(names)} = {pose_values(pose, names)}"


def power(number: float, decimals: int = 1) -> str:
    """Return 2.3e6 as 2.3·10⁶ in matplotlib's notation; numbers up to three digits unchanged."""
    mantissa, exponent = f"{number:.{decimals}e}".split("e")
    tens = int(exponent)
    return f"{number:.3g}" if abs(tens) < 3 else rf"${mantissa}\cdot10^{{{tens}}}$"


SHOWN_IN: dict[
    str, tuple[tuple[float, str], ...]
] = {  # factor to SI and unit, coarsest first
    "m": ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm")),
    "rad": ((1e-3, "mrad"), (1e-6, "µrad")),
    "N/m": ((1e6, "N/µm"),),
    "N·m/rad": ((1e3, "kN·m/rad"),),
}


def choose_unit(unit: str, values: Any) -> tuple[float, str]:
    """Return factor and name of the most readable unit for values in SI, e.g. m, mm or µm."""
    greatest = np.max(np.abs(values), initial=0.0)
    choices = SHOWN_IN.get(unit, ((1.0, unit),))
    return next(
        (choice for choice in choices if greatest >= 2.0 * choice[0]), choices[-1]
    )


def base64_of(values: Any, kind: str = "<f4") -> str:
    """Return an array's numbers in base64, by default as float32."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()

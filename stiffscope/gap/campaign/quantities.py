"""Measured quantities of campaigns, and their codes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.robot.file.quantities import shown_unit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.runtime.types import Indices


AXES = ("x", "y", "z", "rx", "ry", "rz")
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
DEFLECTIONS = tuple(f"d{axis}" for axis in AXES)
DEVIATIONS = tuple(f"e{axis}" for axis in AXES)
STIFFNESSES = tuple(f"k{axis}" for axis in AXES)
PUSHES = tuple(f"p{axis}" for axis in AXES)
MOST_MODES = 30
FREQUENCIES = tuple(f"f{k + 1}" for k in range(MOST_MODES))
QUANTITIES = DEFLECTIONS + DEVIATIONS + STIFFNESSES + PUSHES + FREQUENCIES
"""A quantity's code is its index here, from which follow `kind_of` and the direction, code % 6."""
DEFLECTION, DEVIATION, STIFFNESS, PUSH, FREQUENCY, POSITION = range(6)
KINDS = ("deflection", "deviation", "stiffness", "push", "frequency", "position")
JOINT = "q:"
"""Prefix of coordinates that are displacements of driven joints from home."""
FIRST_FREQUENCY = QUANTITIES.index("f1")
FIRST_POSITION = len(QUANTITIES)
"""Code of a position along x in an instrument's frame, or a distance; only sensors have it."""


def kind_of(quantity: Indices) -> Indices:
    """Return the indices (n,) into `KINDS` for quantity codes (n,)."""
    return np.where(
        quantity >= FIRST_POSITION, POSITION, np.minimum(quantity // 6, FREQUENCY)
    )


def label_pose(coordinates: Sequence[str], pose: Sequence[float]) -> str:
    """Return a pose as a label: "(100, 300, -1164 mm)", rotations in deg, drives in m and rad."""
    shown: dict[str, list[str]] = {}
    for name, value in zip(coordinates, pose, strict=True):
        factor, unit = shown_unit(name)
        end = "" if name.startswith(JOINT) else f" {unit}"
        shown.setdefault(end, []).append(f"{factor * value + 0.0:g}")
    return f"({', '.join(', '.join(values) + unit for unit, values in shown.items())})"

"""Quantities that a campaign reads, and their codes."""

from __future__ import annotations

AXES = ("x", "y", "z", "rx", "ry", "rz")
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
DEFLECTIONS = tuple(f"d{axis}" for axis in AXES)
DEVIATIONS = tuple(f"e{axis}" for axis in AXES)
STIFFNESSES = tuple(f"k{axis}" for axis in AXES)
QUANTITIES = DEFLECTIONS + DEVIATIONS + STIFFNESSES
"""A quantity's code is its position here: code // 6 is its kind, code % 6 its direction."""
DEFLECTION, DEVIATION, STIFFNESS = 0, 1, 2

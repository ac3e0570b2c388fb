"""Quantities that a campaign reads, and their codes."""

from __future__ import annotations

AXES = ("x", "y", "z", "rx", "ry", "rz")
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
DEFLECTIONS = tuple(f"d{axis}" for axis in AXES)
DEVIATIONS = tuple(f"e{axis}" for axis in AXES)
STIFFNESSES = tuple(f"k{axis}" for axis in AXES)
PUSHES = tuple(f"p{axis}" for axis in AXES)
MOST_MODES = 30
FREQUENCIES = tuple(f"f{k + 1}" for k in range(MOST_MODES))
QUANTITIES = DEFLECTIONS + DEVIATIONS + STIFFNESSES + PUSHES + FREQUENCIES
"""A quantity's code is its position here: code // 6 is its kind (frequencies: 4 and above), code % 6 its direction."""
DEFLECTION, DEVIATION, STIFFNESS, PUSH, FREQUENCY = range(5)
JOINT = "q:"
"""What the name of a coordinate begins with that is a driven joint's displacement from home."""
KINDS = ("deflection", "deviation", "stiffness", "push", "frequency")
FIRST_FREQUENCY = QUANTITIES.index("f1")

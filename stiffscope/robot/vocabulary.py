"""Vocabulary of effects that robot files, campaigns, the virtual lab and diagnoses share.

Where an effect can act is said by the robot's own file: its elements, groups and parts (`stiffscope.robot.effects`).
"""

from __future__ import annotations

COMPLIANCE_ENTRIES = tuple(f"c{i}{j}" for i in range(1, 7) for j in range(i, 7))


def _same(names: tuple[str, ...], unit: str) -> tuple[tuple[str, str], ...]:
    return tuple((name, unit) for name in names)


_FACTOR = (("factor", "1"),)
_ROTATIONS = ("rx", "ry", "rz")
COUPLED = ("rxry", "rxrz", "ryrz")
"""Rotations of a support that a moment about another axis causes."""
_SUPPORT = (*_same(("x", "y", "z"), "m/N"), *_same((*_ROTATIONS, *COUPLED), "rad/(N·m)"))

FORMER_WORDS = {"slider-compliance": "part-compliance"}
"""Words of the first campaign format, and those that mean the same now."""

EFFECTS: dict[str, tuple[tuple[str, str], ...]] = {
    "gravity": (),
    "payload": (("mass", "kg"), ("x", "m"), ("y", "m"), ("z", "m")),
    "actuator-stiffness": _FACTOR,
    "joint-compliance": (("radial", "m/N"), ("axial", "m/N"), ("tilting", "rad/(N·m)")),
    "link-stiffness": _FACTOR,
    "rigid-ends": (("length", "m"),),
    "slider-compliance": (*_FACTOR, *_same(COMPLIANCE_ENTRIES, "SI")),
    "guide-compliance": (("lateral", "m/N"), ("vertical", "m/N"), ("angular", "rad/(N·m)")),
    "base-compliance": _SUPPORT,
    "platform-compliance": _SUPPORT,
    "backlash": (("half_width", "m"),),
    "encoder-offset": (("offset", "m"),),
    "link-length": (("error", "m"),),
    "thermal": (("temperature", "K"),),
    "instrument-misalignment": _same(_ROTATIONS, "rad"),
    "displacement-scale": _FACTOR,
    "force-scale": _FACTOR,
    "part-compliance": (*_FACTOR, *_same(COMPLIANCE_ENTRIES, "SI")),
    "part-dimension": (("value", "SI"),),
}
"""Parameters of every effect as pairs (name, SI unit)."""

"""Vocabulary of effects that robot files, campaigns, the virtual lab and diagnoses share.

Where an effect can act is said by the robot's own file: its elements, groups and parts (`stiffscope.robot.effects`).
`VOCABULARY` are the words of the first campaign format, with the places that the Biglide's file has as groups;
`EFFECTS` are all words with their parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

LINKS = tuple(f"limb{i}.link{j}" for i in (1, 2) for j in (1, 2, 3))
COMPLIANCE_ENTRIES = tuple(f"c{i}{j}" for i in range(1, 7) for j in range(i, 7))


@dataclass(frozen=True)
class Term:
    """One word of the vocabulary: where an effect can act and what it is described by."""

    places: tuple[str, ...]
    parameters: tuple[tuple[str, str], ...]
    """Pairs (name, SI unit)."""


def _same(names: tuple[str, ...], unit: str) -> tuple[tuple[str, str], ...]:
    return tuple((name, unit) for name in names)


_FACTOR = (("factor", "1"),)
_ROTATIONS = ("rx", "ry", "rz")
_DIAGONAL = (*_same(("x", "y", "z"), "m/N"), *_same(_ROTATIONS, "rad/(N·m)"))
_DRIVES = ("stage", "limb1", "limb2")

VOCABULARY: dict[str, Term] = {
    "gravity": Term(("robot",), ()),
    "payload": Term(("platform",), (("mass", "kg"), ("x", "m"), ("y", "m"), ("z", "m"))),
    "actuator-stiffness": Term((*_DRIVES, "limbs"), _FACTOR),
    "joint-compliance": Term(("joints",), (("radial", "m/N"), ("axial", "m/N"), ("tilting", "rad/(N·m)"))),
    "link-stiffness": Term(("links", *LINKS), _FACTOR),
    "rigid-ends": Term(("links",), (("length", "m"),)),
    "slider-compliance": Term(("sliders",), (*_FACTOR, *_same(COMPLIANCE_ENTRIES, "SI"))),
    "guide-compliance": Term(("carriages",), (("lateral", "m/N"), ("vertical", "m/N"), ("angular", "rad/(N·m)"))),
    "base-compliance": Term(("base",), _DIAGONAL),
    "platform-compliance": Term(("platform",), _DIAGONAL),
    "backlash": Term(_DRIVES, (("half_width", "m"),)),
    "encoder-offset": Term(("limb1", "limb2", "stage"), (("offset", "m"),)),
    "link-length": Term(("links", *LINKS), (("error", "m"),)),
    "thermal": Term(("links",), (("temperature", "K"),)),
    "instrument-misalignment": Term(("instrument",), _same(_ROTATIONS, "rad")),
    "displacement-scale": Term(("instrument",), _FACTOR),
    "force-scale": Term(("instrument",), _FACTOR),
}

EFFECTS: dict[str, tuple[tuple[str, str], ...]] = {
    **{name: term.parameters for name, term in VOCABULARY.items()},
    "part-compliance": (*_FACTOR, *_same(COMPLIANCE_ENTRIES, "SI")),
    "part-dimension": (("value", "SI"),),
}
"""Parameters of every effect as pairs (name, SI unit)."""

"""Mean forces of milling and drilling, by Kienzle's law of the specific cutting force.

``kc = kc1 (h / 1 mm)^-mc`` (O. Kienzle, VDI-Z. 94 (1952) 299). Mean forces of a milling cutter follow from tangential
and radial forces on its teeth, averaged over the engagement (Y. Altintas, Manufacturing Automation, 2nd ed., Cambridge
2012, eq. 2.76-2.78); the mean chip and the power as tool makers' handbooks have them.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np


@dataclass(frozen=True)
class CuttingForces:
    """Mean forces on the tool in N: along the feed, across it (to the left, seen from the spindle), along its axis.

    ``torque`` about the tool's axis in N·m, ``power`` in W, ``speed`` of the spindle in rev/s, ``teeth`` that pass in
    a second, ``chip`` its mean thickness in m.
    """

    feed: float
    across: float
    axial: float
    torque: float
    power: float
    speed: float
    tooth_passing: float
    chip: float


@cache
def cutting_materials() -> dict[str, tuple[float, float]]:
    """Specific cutting force kc1 in Pa and exponent mc, by material."""
    text = resources.files("stiffscope.data").joinpath("cutting.toml").read_text(encoding="utf-8")
    return {name: (1e6 * each["kc1"], each["mc"]) for name, each in tomllib.loads(text).items()}


def specific_force(kc1: float, mc: float, chip: float) -> float:
    """Specific cutting force in Pa at a chip's thickness in m."""
    return kc1 * (1e3 * chip) ** -mc


def mill(
    kc1: float, mc: float, *, diameter: float, teeth: int, speed: float, feed: float, depth: float, width: float,
    climb: bool = True, lead: float = 0.5 * np.pi, radial: float = 0.3, axial: float = 0.0,
) -> CuttingForces:  # fmt: skip
    """Mean forces of a milling cutter that turns clockwise, seen from its spindle.

    Parameters
    ----------
    kc1, mc
        Of Kienzle's law, Pa.
    diameter, teeth, speed
        Of the cutter: m, number, and rev/s.
    feed
        m/s; more makes thicker chips.
    depth, width
        Axial and radial engagement, m; a width of the diameter is a slot.
    climb
        Down milling; else up milling. A slot is neither.
    lead
        Entering angle, rad; 90° of an end mill.
    radial, axial
        Radial and axial over tangential force.

    Returns
    -------
    CuttingForces
        Averaged over a turn.

    """
    per_tooth = feed / (speed * teeth)
    swept = np.arccos(1.0 - 2.0 * width / diameter)
    chip = per_tooth * np.sin(lead) * (2.0 * width / diameter) / swept
    kt = specific_force(kc1, mc, chip)
    first, last = (np.pi - swept, np.pi) if climb else (0.0, swept)
    cosine = np.cos(2.0 * last) - np.cos(2.0 * first)
    sine = 2.0 * (last - first) - (np.sin(2.0 * last) - np.sin(2.0 * first))
    each = teeth * depth * per_tooth * kt / (8.0 * np.pi)
    power = depth * width * feed * kt
    return CuttingForces(
        feed=float(each * (cosine - radial * sine)),
        across=float(each * (sine + radial * cosine)),
        axial=float(-axial * 4.0 * each * (np.cos(last) - np.cos(first))),
        torque=float(power / (2.0 * np.pi * speed)),
        power=float(power), speed=speed, tooth_passing=speed * teeth, chip=float(chip),
    )  # fmt: skip


def drill(
    kc1: float, mc: float, *, diameter: float, speed: float, feed: float, point: float = np.deg2rad(118.0)
) -> CuttingForces:
    """Thrust and torque of a twist drill of two lips.

    Parameters
    ----------
    kc1, mc
        Of Kienzle's law, Pa.
    diameter, speed, feed
        m, rev/s and m/s.
    point
        Angle of its point, rad.

    Returns
    -------
    CuttingForces
        Its thrust pushes the tool back.

    """
    per_turn = feed / speed
    chip = 0.5 * per_turn * np.sin(0.5 * point)
    kc = specific_force(kc1, mc, chip)
    power = 0.25 * np.pi * diameter**2 * feed * kc * 0.5  # the mean of the lips' speed is half of the rim's
    thrust = 0.25 * kc * diameter * per_turn * np.sin(0.5 * point)
    return CuttingForces(
        0.0, 0.0, float(thrust), float(power / (2.0 * np.pi * speed)), float(power), speed, 2.0 * speed, float(chip)
    )

"""Mean forces in milling, turning and drilling from Kienzle's law of the specific cutting force.

``kc = kc1 (h / 1 mm)^-mc`` (O. Kienzle, VDI-Z. 94 (1952) 299). Mean milling forces are tangential
and radial tooth forces averaged over the engagement (Y. Altintas, Manufacturing Automation, 2nd
ed., Cambridge 2012, eq. 2.76-2.78); mean chip and power follow tool makers' handbooks.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np


@dataclass(frozen=True)
class CuttingForces:
    """Mean forces on the tool, N: along the feed, to its left seen from the spindle, and axial.

    ``torque`` about the tool's axis, N·m; ``power``, W; ``speed`` of the spindle, rev/s;
    ``tooth_passing`` frequency, Hz; ``chip``, its mean thickness, m.
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
    """Return the specific cutting force kc1, Pa, and the exponent mc by material."""
    text = (
        resources.files("stiffscope.data")
        .joinpath("cutting.toml")
        .read_text(encoding="utf-8")
    )
    return {
        name: (1e6 * each["kc1"], each["mc"])
        for name, each in tomllib.loads(text).items()
    }


def specific_force(kc1: float, mc: float, chip: float) -> float:
    """Return the specific cutting force, Pa, at a chip thickness in m.

    Parameters
    ----------
    kc1
        Specific cutting force at a chip thickness of 1 mm, Pa.
    mc
        Exponent of its decrease.
    chip
        Chip thickness, m.
    """
    return kc1 * (1e3 * chip) ** -mc


def mill(
    kc1: float,
    mc: float,
    *,
    diameter: float,
    teeth: int,
    speed: float,
    feed: float,
    depth: float,
    width: float,
    climb: bool = True,
    lead: float = 0.5 * np.pi,
    radial: float = 0.3,
    axial: float = 0.0,
) -> CuttingForces:
    """Return the mean forces of a milling cutter that rotates clockwise seen from the spindle.

    Parameters
    ----------
    kc1, mc
        Constants of Kienzle's law; kc1 in Pa.
    diameter, teeth, speed
        Diameter (m), number of teeth and speed (rev/s) of the cutter.
    feed
        Feed, m/s; a larger feed gives thicker chips.
    depth, width
        Axial and radial engagement, m; a slot has a width equal to the diameter.
    climb
        Whether to climb mill (down milling); irrelevant for a slot.
    lead
        Entering angle, rad; 90° for an end mill.
    radial, axial
        Radial and axial force over tangential force.

    Returns
    -------
    CuttingForces
        Forces averaged over one turn.
    """
    per_tooth = feed / (speed * teeth)
    swept = 2.0 * np.arcsin(
        np.sqrt(width / diameter)
    )  # also where the engagement is tiny
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
        power=float(power),
        speed=speed,
        tooth_passing=speed * teeth,
        chip=float(chip),
    )


def turn(
    kc1: float,
    mc: float,
    *,
    diameter: float,
    speed: float,
    feed: float,
    depth: float,
    lead: float = 0.5 * np.pi,
    radial: float = 0.3,
    side: float = 1.0,
) -> CuttingForces:
    """Return the forces on a turning or boring tool; axial is along its holder.

    Parameters
    ----------
    kc1, mc
        Constants of Kienzle's law; kc1 in Pa.
    diameter, speed
        Diameter of the workpiece or bore, m, and its speed, rev/s.
    feed
        Feed, m/s; a larger feed gives thicker chips.
    depth
        Depth of cut, m.
    lead
        Entering angle, rad; 90° for an edge square to the feed.
    radial
        Thrust, square to the edge, over tangential force.
    side
        1 if the workpiece passes the tool to the left of the feed, seen from the holder, else -1.
    """
    per_turn = feed / speed
    chip = per_turn * np.sin(lead)
    force = specific_force(kc1, mc, chip) * depth * per_turn
    power = force * np.pi * diameter * speed
    return CuttingForces(
        feed=float(-radial * force * np.sin(lead)),
        across=float(side * force),
        axial=float(radial * force * np.cos(lead)),
        torque=0.0,
        power=float(power),
        speed=speed,
        tooth_passing=speed,
        chip=float(chip),
    )


def drill(
    kc1: float,
    mc: float,
    *,
    diameter: float,
    speed: float,
    feed: float,
    point: float = np.deg2rad(118.0),
) -> CuttingForces:
    """Return thrust and torque of a twist drill with two lips.

    Parameters
    ----------
    kc1, mc
        Constants of Kienzle's law; kc1 in Pa.
    diameter, speed, feed
        Diameter (m), speed (rev/s) and feed (m/s).
    point
        Point angle, rad.

    Returns
    -------
    CuttingForces
        Forces; the thrust pushes the tool back.
    """
    per_turn = feed / speed
    chip = 0.5 * per_turn * np.sin(0.5 * point)
    kc = specific_force(kc1, mc, chip)
    power = (
        0.25 * np.pi * diameter**2 * feed * kc * 0.5
    )  # mean lip speed: half the rim speed
    thrust = 0.25 * kc * diameter * per_turn * np.sin(0.5 * point)
    torque = power / (2.0 * np.pi * speed)
    return CuttingForces(
        feed=0.0,
        across=0.0,
        axial=float(thrust),
        torque=float(torque),
        power=float(power),
        speed=speed,
        tooth_passing=2.0 * speed,
        chip=float(chip),
    )

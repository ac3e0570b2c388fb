"""The true machine of the virtual lab: a Biglide, and whatever is wrong with it."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.gap.lab.structure import Array

MIRROR = np.diag([-1.0, -1.0, 1.0, -1.0, -1.0, 1.0])  # slider of limb 2 from that of limb 1


def _zeros(*shape: int) -> Array:
    return np.zeros(shape)


@dataclass(frozen=True)
class Dimensions:
    """The published dimensions, m, in the names of docs/theory.md 3.4."""

    L: float
    l: float
    l1: float
    l2: float
    h: float
    d: float


@dataclass(frozen=True)
class Drive:
    """A lead-screw drive; the last three are what an ideal one lacks."""

    stiffness: float
    """N/m."""
    offset: float = 0.0
    """Zero of the encoder, m, positive outward (stage: along y)."""
    backlash: float = 0.0
    """Half-width of the dead zone, m."""
    hardening: float = 0.0
    """Cubic stiffness, N/m³: F = k e + k₃ e³."""
    friction: float = 0.0
    """Force that the guide's friction keeps from the screw, N."""


@dataclass(frozen=True)
class Instrument:
    """What stands between the machine and a number in a file."""

    rotation: Array = field(default_factory=lambda: _zeros(3))
    scale: float = 1.0
    force: float = 1.0
    """True wrench / stated wrench."""
    crosstalk: Array = field(default_factory=lambda: _zeros(6, 6))
    """Share of the column's axis that leaks into the row's reading."""
    application: Array = field(default_factory=lambda: _zeros(3))
    """Where the wrench acts relative to M, m."""
    drift: Array = field(default_factory=lambda: _zeros(6))
    """What the sensor has wandered by the end of the campaign, m and rad."""
    gain_drift: float = 0.0
    """Relative change of its gain from the beginning to the end."""
    quantum: Array = field(default_factory=lambda: _zeros(6))
    """Least step of the converter, m and rad."""
    bad_session: float = 0.0
    """Relative gain error of the last session."""


@dataclass(frozen=True)
class Machine:
    """A Biglide as it really is, SI, axes of {O}. Limb and link are the leading axes of its arrays."""

    dimensions: Dimensions
    drives: tuple[Drive, Drive, Drive]
    """limb1, limb2, stage."""
    links: Array
    """(2, 3, 6, 6) compliance at B_ij, link axes."""
    sliders: Array
    """(2, 6, 6) compliance at A_i, axes {O}."""
    link_mass: float
    platform_mass: float
    expansion: float
    acceleration: float
    gravity: bool = True
    bearings: Array = field(default_factory=lambda: _zeros(2, 3, 2, 6))
    """Diagonal compliances at A_ij, B_ij in link axes; the fifth is the revolute itself."""
    guides: Array = field(default_factory=lambda: _zeros(2, 6))
    base: Array = field(default_factory=lambda: _zeros(6))
    stage_guide: Array = field(default_factory=lambda: _zeros(6))
    """Diagonal compliance of the stage's own guide, at the stage, not at {O}."""
    platform: Array = field(default_factory=lambda: _zeros(6))
    payload_mass: float = 0.0
    payload_centre: Array = field(default_factory=lambda: _zeros(3))
    length_error: Array = field(default_factory=lambda: _zeros(2, 3))
    bow: Array = field(default_factory=lambda: _zeros(2, 3))
    """Thermal curvature of a link, 1/m: its free end rises by κL²/2 and turns by κL."""
    cable: Array = field(default_factory=lambda: _zeros(6))
    """Diagonal stiffness of a cable chain between frame and platform, slack at the middle pose."""
    rail_pitch: float = 0.0
    """Relative pitch error of the x screws."""
    width_error: float = 0.0
    """Error of l, m."""
    instrument: Instrument = field(default_factory=Instrument)


def beam(length: float, section: Array) -> Array:
    """Return the compliance (6, 6) at the free end of a uniform cantilever in link axes.

    section: (6,) per metre, 1/EA, 1/κGA (y), 1/κGA (z), 1/GI_p, 1/EI_y, 1/EI_z; zero shear gives docs/theory.md (7.1).
    """
    n, vy, vz, t, by, bz = section * length
    out = np.diag([n, vy + bz * length**2 / 3, vz + by * length**2 / 3, t, by, bz])
    out[1, 5] = out[5, 1] = bz * length / 2
    out[2, 4] = out[4, 2] = -by * length / 2
    return out


def section_of(compliance: Array, length: float) -> Array:
    """Return the uniform section whose cantilever comes nearest to a compliance (6, 6); see `beam`."""
    n, y, z, t, by, bz = np.diag(compliance) / length
    return np.array([n, y - bz * length**2 / 3, z - by * length**2 / 3, t, by, bz])


def _symmetric(entries: list[list[float]]) -> Array:
    out = np.zeros((6, 6))
    for i, j, value in entries:
        out[int(i) - 1, int(j) - 1] = out[int(j) - 1, int(i) - 1] = value
    return out


def default_file() -> Path:
    """Return the file of the machine's numbers."""
    from stiffscope.data import FOLDER

    return FOLDER / "campaigns" / "lab" / "machine.toml"


def biglide(components: str = "published", *, link: Array | None = None, slider: Array | None = None) -> Machine:
    """Return the sound machine.

    components: "published" (Eqs. 28 and 29) or "fea"; link and slider (6, 6) replace what it names.
    """
    if components not in {"published", "fea"}:
        raise InputError(f"components: expected published or fea, got {components!r}")
    data: dict[str, Any] = tomllib.loads(default_file().read_text(encoding="utf-8"))
    dimensions = Dimensions(**data["geometry"])
    bar, matrices = data["link"], data["compliance"]
    if link is None:
        e, g, r = bar["youngs_modulus"], bar["shear_modulus"], bar["radius"]
        area, inertia = np.pi * r**2, np.pi * r**4 / 4
        rates = [1 / (e * area), 0, 0, 1 / (2 * g * inertia), 1 / (e * inertia), 1 / (e * inertia)]
        euler = beam(dimensions.L, np.array(rates))
        link = euler if components == "published" else _symmetric(matrices["link_fea"])
    if slider is None:
        slider = _symmetric(matrices[f"slider_{components}"])
    drive = Drive(stiffness=data["drives"]["stiffness"])
    return Machine(
        dimensions=dimensions,
        drives=(drive, drive, drive),
        links=np.broadcast_to(link, (2, 3, 6, 6)).copy(),
        sliders=np.stack([slider, MIRROR @ slider @ MIRROR]),
        link_mass=data["masses"]["link"],
        platform_mass=data["masses"]["platform"],
        expansion=bar["expansion"],
        acceleration=data["gravity"]["acceleration"],
    )

"""Stiffness of bearings, guides and screws from their data; x is the axis or sliding direction.

Every function returns a ``MachineElement``: its stiffness (6, 6) at its load, zero along free
directions. Races, carriages and rails are rigid, and nothing rotates: the compliance of rings and
housings, and gyroscopic and centrifugal effects of fast spindles, are neglected.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from stiffscope.errors import require
from stiffscope.vjm.elements.rolling import (
    LINE,
    POINT,
    Contacts,
    hertz_constant,
    in_series,
    line_constant,
    settle,
)
from stiffscope.vjm.model.screws import shift

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.vjm.model.screws import Array

STEEL = 206e9, 0.3  # Young's modulus (Pa) and Poisson's ratio of bearing steel
CERAMIC = 310e9, 0.27  # of silicon nitride balls
Arrangement = Literal["single", "back-to-back", "face-to-face", "tandem"]
_WAYS = {"back-to-back": (1.0, -1.0), "face-to-face": (-1.0, 1.0), "tandem": (1.0, 1.0)}
_SLICES = 31  # along a roller
_MOST_PRESSED = 5e-3  # approach over circle radius; several times what indents steel
_ROUNDED = 1e-13  # of sqrt(K_ii K_jj)
_POINTS = "Hertz point contacts (Harris and Kotzalas 2006, ch. 6)"
_HERTZ = f"{_POINTS}, equilibrium of de Mul, Vree and Maas (1989)"
_LINES = "Palmgren line contacts (Harris and Kotzalas 2006, eq. 7.8)"
_FEW_LOADED = "some elements carry nothing: the stiffness changes with direction and size of loads"


@dataclass(frozen=True, eq=False)
class MachineElement:
    """State of a machine element at its load.

    ``stiffness`` (6, 6) in N/m, N, N·m/rad at its middle, zero along the ``free`` directions;
    ``source``; ``twist`` (6,) of the moved side, m, rad; ``loads`` (k,) on the rolling elements, N,
    and contact ``angles`` (k,) from the radial plane, rad; ``notes``: limits of the result.
    """

    stiffness: Array
    free: tuple[int, ...]
    source: str
    twist: Array = field(default_factory=lambda: np.zeros(6))
    loads: Array = field(default_factory=lambda: np.zeros(0))
    angles: Array = field(default_factory=lambda: np.zeros(0))
    notes: tuple[str, ...] = ()

    @property
    def compliance(self) -> Array:
        """Compliance (6, 6): the inverse over held directions; zero along free ones."""
        held = [i for i in range(6) if i not in self.free]
        out = np.zeros((6, 6))
        inner = self.stiffness[np.ix_(held, held)]
        scale = np.sqrt(np.diagonal(inner).clip(min=0.0))
        size = np.outer(scale, scale)
        names = ", ".join(("ux", "uy", "uz", "rx", "ry", "rz")[i] for i in held)
        require(
            (scale > 0.0).all() and np.linalg.cond(inner / size) <= 1e12,
            "load",
            f"one under which elements hold {names}",
            "one left free",
        )
        out[np.ix_(held, held)] = np.linalg.inv(inner / size) / size
        return out


def reduced_modulus(
    element: tuple[float, float] = STEEL, race: tuple[float, float] = STEEL
) -> float:
    """Return E' (Pa) of two materials, each a Young's modulus (Pa) and a Poisson's ratio."""
    return 1.0 / sum((1.0 - nu**2) / e for e, nu in (element, race))


def ball_contacts(
    count: int,
    diameter: float,
    pitch: float,
    angle: float,
    osculation: tuple[float, float],
    modulus: float,
    clearance: float = 0.0,
) -> Contacts:
    """Return the ball contacts of a bearing whose inner ring moves; moving it along +x loads them.

    Parameters
    ----------
    count, diameter, pitch
        Number of balls, their diameter and that of their circle, m.
    angle
        Contact angle from the radial plane with balls just touching both races, rad.
    osculation
        Groove radius over ball diameter, inner and outer ring; nearer to 0.5 is stiffer.
    modulus
        Reduced modulus, Pa.
    clearance
        Diametral clearance of a radial bearing with contact angle 0, m; negative for interference.
    """
    inner, outer = osculation
    what = "a contact angle from 0 to below 90 degrees"
    require(0.0 <= angle < 0.5 * np.pi, "angle", what, f"{np.degrees(angle):.4g}")
    got = f"{1e6 * clearance:g} um"
    require(not (angle and clearance), "clearance", "none beside a contact angle", got)
    reach = (inner + outer - 1.0) * diameter
    bend = diameter * np.cos(angle) / pitch
    require(
        0.0 < bend < 1.0 and pitch * np.sin(np.pi / count) >= diameter,
        "pitch",
        f"a circle that {count} balls of {1e3 * diameter:g} mm fit on",
        f"{1e3 * pitch:g} mm",
    )
    most = f"less than {2e3 * reach:.4g} mm"
    require(clearance < 2.0 * reach, "clearance", most, f"{1e3 * clearance:g} mm")
    ball = 2.0 / diameter
    constants = [
        hertz_constant(
            np.array([ball * (1.0 + curve), ball - 1.0 / (f * diameter)]), modulus
        )
        for f, curve in ((inner, bend / (1.0 - bend)), (outer, -bend / (1.0 + bend)))
    ]
    radial, around = _circle(count)
    pressing = np.cos(angle) * radial + np.sin(angle) * np.eye(3)[0]
    between = reach * pressing - 0.5 * clearance * radial
    at = (0.5 * pitch + (inner - 0.5) * diameter * np.cos(angle)) * radial
    constant = np.full(count, in_series(*constants))
    return Contacts(
        at=at,
        between=between,
        reach=np.full(count, reach),
        constant=constant,
        exponent=POINT,
        slide=around,
        turning=True,
    )


def ball_bearing(
    contacts: Contacts,
    load: Array,
    arrangement: Arrangement = "single",
    spacing: float = 0.0,
) -> MachineElement:
    """Compute a ball bearing, or a pair of equally preloaded ones.

    Parameters
    ----------
    contacts
        From `ball_contacts`.
    load
        (3,) force on the inner ring, N: preload along x; for a pair, the preload of each bearing.
    arrangement
        Of a pair: back to back (pressure lines diverge, stiffest in tilting), face to face, tandem.
    spacing
        Distance between a pair's middle planes, m.
    """
    length = float(np.linalg.norm(contacts.at[0]))
    wrench = np.concatenate([np.asarray(load, dtype=float), np.zeros(3)])
    if arrangement == "single":
        return _element(contacts, wrench, length, (3,), _HERTZ)
    require(
        not wrench[1:].any(),
        "load",
        "a preload along the axis of a pair",
        "a radial force",
    )
    one = _element(contacts, wrench, length, (3,), _HERTZ)
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
    total = np.zeros((6, 6))
    for side, way in zip((-0.5, 0.5), _WAYS[arrangement], strict=True):
        row_stiffness = one.stiffness if way > 0.0 else mirror @ one.stiffness @ mirror
        carry = shift([side * spacing, 0.0, 0.0])
        total += carry.T @ row_stiffness @ carry
    return replace(one, stiffness=total, source=f"{_HERTZ}; two, {arrangement}")


def roller_bearing(
    count: int, length: float, pitch: float, clearance: float, load: Array
) -> MachineElement:
    """Compute a cylindrical roller bearing, free along its axis.

    Parameters
    ----------
    count, length, pitch
        Number of rollers, effective roller length and diameter of their circle, m.
    clearance
        Diametral, m; negative for an interference, which preloads.
    load
        (3,) radial force on the inner ring, N.
    """
    radial, around = _circle(count)
    where = length * ((np.arange(_SLICES) + 0.5) / _SLICES - 0.5)
    at = (0.5 * pitch * radial[:, None] + where[:, None] * np.eye(3)[0]).reshape(-1, 3)
    between, slide = (np.repeat(way, _SLICES, axis=0) for way in (radial, around))
    reach = np.full(len(at), 1.0 + 0.5 * clearance)
    constant = np.full(len(at), line_constant(length) / _SLICES)
    contacts = Contacts(
        at=at,
        between=between,
        reach=reach,
        constant=constant,
        exponent=LINE,
        slide=slide,
        turning=False,
    )
    wrench = np.concatenate([load, np.zeros(3)])
    bearing = _element(
        contacts, wrench, 0.5 * pitch, (0, 3), f"{_LINES}, rollers in slices"
    )
    shared = bearing.loads.reshape(count, _SLICES).sum(axis=1)
    return replace(bearing, loads=shared, angles=bearing.angles[::_SLICES])


def crossed_roller(
    count: int, length: float, pitch: float, clearance: float, load: Array
) -> MachineElement:
    """Compute a crossed-roller bearing: rollers at 45 degrees, alternating in direction.

    Parameters
    ----------
    count, length, pitch, clearance, load
        As for `roller_bearing`; the clearance is the radial one over a diameter.
    """
    radial, around = _circle(count)
    way = np.where(np.arange(count) % 2, -1.0, 1.0)[:, None] * np.eye(3)[0]
    between = (radial + way) / np.sqrt(2.0)
    reach = np.full(count, 1.0 + 0.5 * clearance / np.sqrt(2.0))
    constant = np.full(count, line_constant(length))
    contacts = Contacts(
        at=0.5 * pitch * radial,
        between=between,
        reach=reach,
        constant=constant,
        exponent=LINE,
        slide=around,
        turning=False,
    )
    return _element(
        contacts, np.concatenate([load, np.zeros(3)]), 0.5 * pitch, (3,), _LINES
    )


def carriage_contacts(
    count: int,
    diameter: float,
    osculation: float,
    angle: float,
    width: float,
    height: float,
    length: float,
    preload: float,
    modulus: float,
    *,
    face_to_face: bool = False,
) -> Contacts:
    """Return the loaded ball contacts of a four-row carriage on a straight rail.

    Parameters
    ----------
    count, diameter, osculation
        Number of loaded balls per row, their diameter (m), groove radius over ball diameter.
    angle
        Contact angle from the horizontal, rad.
    width, height, length
        Row distances (m) across and in height, and from the first to the last ball along the rail.
    preload
        Force (N) that presses the upper rows against the lower ones.
    modulus
        Reduced modulus, Pa.
    face_to_face
        True if the contact lines of a side meet inside; the guide is then far softer in roll.
    """
    ball = 2.0 / diameter
    one = hertz_constant(
        np.array([ball, ball - 1.0 / (osculation * diameter)]), modulus
    )
    c = in_series(one, one)
    pressed = (preload / (2.0 * count * np.sin(angle)) / c) ** (1.0 / POINT)
    along = np.linspace(-0.5, 0.5, count) * length if count > 1 else np.zeros(1)
    turn = -1.0 if face_to_face else 1.0
    sides = [[x, s, t] for s in (-1, 1) for t in (-1, 1) for x in along]
    place = np.array([1.0, 0.5 * width, 0.5 * height])
    at = np.array(sides) * place
    press = np.array([0.0, -np.cos(angle), turn * np.sin(angle)])
    normal = np.sign(at) * press
    k = len(at)
    slide = np.broadcast_to(np.eye(3)[0], at.shape)
    reach = np.full(k, 1.0 - pressed)
    constant = np.full(k, c)
    return Contacts(
        at=at,
        between=normal,
        reach=reach,
        constant=constant,
        exponent=POINT,
        slide=slide,
        turning=False,
    )


def guide_of_balls(
    contacts: Contacts, rails: tuple[int, float], carriages: tuple[int, float]
) -> MachineElement:
    """Compute a guide of equal carriages; number and spacing (m) of rails and of carriages.

    Parameters
    ----------
    contacts
        Ball contacts of a carriage, from `carriage_contacts`.
    rails, carriages
        Number and spacing, m, of rails and of carriages on a rail.
    """
    length = float(np.linalg.norm(contacts.at, axis=1).max())
    one = _element(
        contacts, np.zeros(6), length, (0,), f"{_POINTS}; rigid rail and carriage"
    )
    return replace(one, stiffness=_on_rails(one.stiffness, rails, carriages))


def guide_of_sheet(
    diagonal: Sequence[float],
    rails: tuple[int, float],
    carriages: tuple[int, float],
    source: str,
) -> MachineElement:
    """Compute a guide from carriage stiffnesses (6,): 0 along x, then y, z, and about x, y, z.

    Parameters
    ----------
    diagonal
        Stiffnesses (6,) of a carriage: 0 along x, along y, z in N/m, about x, y, z in N·m/rad.
    rails, carriages
        Number and spacing, m, of rails and of carriages on a rail.
    source
        Where the stiffnesses are from.
    """
    return MachineElement(_on_rails(np.diag(diagonal), rails, carriages), (0,), source)


def of_sheet(
    radial: float, axial: float, tilting: float, source: str
) -> MachineElement:
    """Create a rotary bearing from stiffnesses, N/m, N/m, N·m/rad; 0 is free, as is its axis.

    Parameters
    ----------
    radial, axial, tilting
        Stiffnesses, N/m, N/m, N·m/rad; 0 is free.
    source
        Where they are from.
    """
    diagonal = np.array([axial, radial, radial, 0.0, tilting, tilting])
    free = tuple(int(i) for i in np.flatnonzero(diagonal == 0.0))
    return MachineElement(np.diag(diagonal), free, source)


def at_load(stiffness: float, known: float, load: float, exponent: float) -> float:
    """Scale a stiffness to another load: k (F / F₀)^(1 - 1/e).

    Parameters
    ----------
    stiffness
        Stiffness k at the known load.
    known, load
        Known load F₀ and the other load F, N.
    exponent
        Exponent e of the load-deflection law: 3/2 for balls (Hertz), 10/9 for rollers (Palmgren).

    Returns
    -------
    Stiffness at the other load, in the unit of k.
    """
    return stiffness * (load / known) ** (1.0 - 1.0 / exponent)


def ball_screw(
    diameter: float,
    length: float,
    nut: float,
    support: float,
    *,
    both_ends: bool = False,
    lead: float = 0.0,
    material: tuple[float, float] = STEEL,
) -> MachineElement:
    """Compute a ball screw along x, free in all other directions: shaft, nut and support in series.

    Parameters
    ----------
    diameter, length
        Root diameter of the shaft, and its length from support to nut, m; with ``both_ends`` the
        length between the supports, with the nut in the middle.
    nut, support
        Axial stiffness of the nut and of one support bearing, N/m; infinite ones are rigid.
    both_ends
        True if both supports hold the shaft axially.
    lead
        m per turn; adds the shaft's torsion between support and nut, drive held. 0 neglects it.
    material
        Young's modulus (Pa) and Poisson's ratio of the shaft.
    """
    e, poisson = material
    area = np.pi * diameter**2 / 4.0
    polar = np.pi * diameter**4 / 32.0
    ends, reach = (2.0, length / 2.0) if both_ends else (1.0, length)
    chain = (reach / (e * area) + 1.0 / support) / ends + 1.0 / nut
    if lead:
        chain += (
            (lead / (2.0 * np.pi)) ** 2 * reach / (e / (2.0 * (1.0 + poisson)) * polar)
        )
    k = np.zeros((6, 6))
    k[0, 0] = 1.0 / chain
    source = "springs in series: E A / L of the shaft, nut, support"
    if lead:
        source += ", twist of the shaft"
    return MachineElement(k, (1, 2, 3, 4, 5), source)


def _on_rails(
    one: Array, rails: tuple[int, float], carriages: tuple[int, float]
) -> Array:
    """Add the carriages' stiffnesses at their middle; rails spread along y, carriages along x."""
    out = np.zeros((6, 6))
    for y in (np.arange(rails[0]) - (rails[0] - 1) / 2.0) * rails[1]:
        for x in (np.arange(carriages[0]) - (carriages[0] - 1) / 2.0) * carriages[1]:
            carry = shift([x, y, 0.0])
            out += carry.T @ one @ carry
    return out


def _circle(count: int) -> tuple[Array, Array]:
    """Return radial and circumferential directions (k, 3) of elements around x, the first on y."""
    turn = 2.0 * np.pi * np.arange(count) / count
    none = np.zeros(count)
    radial = (none, np.cos(turn), np.sin(turn))
    around = (none, -np.sin(turn), np.cos(turn))
    return np.stack(radial, axis=1), np.stack(around, axis=1)


def _element(
    contacts: Contacts, wrench: Array, length: float, free: tuple[int, ...], source: str
) -> MachineElement:
    twist = settle(contacts, wrench, length)
    along, pressed, loads, _ = contacts.state(twist)
    require(
        pressed.any(),
        "load",
        "a preload, a load or an interference",
        "no loaded element",
    )
    most = pressed.max()
    require(
        most <= _MOST_PRESSED * length,
        "load",
        "elastic contacts",
        f"elements pressed together by {1e3 * most:.3g} mm",
    )
    stiffness = contacts.stiffness(twist)
    stiffness[list(free)] = 0.0
    stiffness[:, list(free)] = 0.0
    size = np.sqrt(np.diagonal(stiffness))
    stiffness[np.abs(stiffness) < _ROUNDED * np.outer(size, size)] = 0.0
    notes = () if (pressed > 0.0).all() else (_FEW_LOADED,)
    return MachineElement(
        stiffness=stiffness,
        free=free,
        source=source,
        twist=twist,
        loads=loads,
        angles=np.arcsin(along[:, 0]),
        notes=notes,
    )

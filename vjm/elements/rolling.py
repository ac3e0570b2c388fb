"""Rolling elements between rigid races: Hertz and Palmgren contacts, equilibrium, stiffness.

An element depends on the vector v between the races' groove centres: its approach is δ = |v| - A,
with A at first contact, and its load Q = c δ^e along v; for a roller v keeps its direction. The
energy Σ c δ^(e+1)/(e+1) is convex in one race's displacement; equilibrium is its minimum.

References
----------
T. A. Harris, M. N. Kotzalas, Rolling Bearing Analysis, 5th ed., CRC Press 2006, ch. 6 and 7.
J. M. de Mul, J. M. Vree, D. A. Maas, "Equilibrium and associated load distribution in ball and roller bearings loaded
in five degrees of freedom while neglecting friction", J. Tribology 111 (1989) 142.
"""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false
# (scipy declares few types)

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ellipe, ellipk

from stiffscope.errors import require
from stiffscope.vjm.model.screws import shift

if TYPE_CHECKING:
    from stiffscope.vjm.model.screws import Array

POINT = 1.5
LINE = 10.0 / 9.0  # exponents of load over approach
_PALMGREN = (
    3.84e-5  # mm: δ = 3.84e-5 Q^0.9 / l^0.8 (N, mm) between a steel roller and one race
)
_STEPS = 200
_SETTLED = 1e-11
_ACCEPTED = 1e-6  # allowed residual, of the load
_TOUCHING = (
    1e-9  # least approach of a loaded element, of the greatest: less is rounding
)


def hertz_constant(curvatures: Array, modulus: float) -> float:
    """Return load over approach^1.5 (N/m^1.5) of a point contact.

    Parameters
    ----------
    curvatures
        (2,) sums of both bodies' curvatures (1/m) in the principal planes; less is longer contact.
    modulus
        Reduced modulus E' (Pa), ``1/E' = (1 - ν₁²)/E₁ + (1 - ν₂²)/E₂``.

    Returns
    -------
    float
        After K. L. Johnson, Contact Mechanics, CUP 1985, eq. 4.26, with computed ellipse axes.
    """
    small, large = np.sort(np.asarray(curvatures, dtype=float))
    require(
        0.0 < small < np.inf,
        "contact",
        "races that leave room for the elements",
        f"a curvature of {small:g} 1/m",
    )
    low = 1e-14
    high = 1.0  # k² = (b/a)² of the ellipse
    k2 = 1.0
    for _ in range(120):
        k2 = (low * high) ** 0.5
        m = 1.0 - k2
        e = ellipe(m)
        k = ellipk(m)
        ratio = (e / k2 - k) / (k - e) if m > 1e-12 else 1.0
        low, high = (k2, high) if ratio > large / small else (low, k2)
    m = 1.0 - k2
    total = 0.5 * (small + large)
    e = ellipe(m)
    k = ellipk(m)
    a3 = 3.0 * e / (2.0 * np.pi * modulus * k2 * total)  # a³ / Q: half of the long axis
    approach = 3.0 * k / (2.0 * np.pi * modulus) / np.cbrt(a3)  # δ / Q^(2/3)
    return float(approach**-1.5)


def line_constant(length: float) -> float:
    """Return load over approach^(10/9) (N/m^(10/9)) of a steel roller (length m) between two races.

    A. Palmgren, Grundlagen der Wälzlagertechnik, 3rd ed. 1964; Harris, eq. 7.8: approaches add.
    """
    return (1e3 * length) ** (8.0 / 9.0) * (1e3 / (2.0 * _PALMGREN)) ** LINE


def in_series(*constants: float, exponent: float = POINT) -> float:
    """Return the constant of contacts in series: one load, approaches add."""
    return float(np.sum(np.array(constants) ** (-1.0 / exponent)) ** -exponent)


@dataclass(frozen=True, eq=False)
class Contacts:
    """k rolling elements: points ``at`` (k, 3) of the moved race; ``between`` (k, 3): unloaded v.

    ``reach`` (k,): A, m; ``constant`` (k,): c; ``exponent``: e; ``slide`` (k, 3): unit direction in
    which the moved race slides freely; ``turning``: v rotates with the motion (balls, not rollers).
    """

    at: Array
    between: Array
    reach: Array
    constant: Array
    exponent: float
    slide: Array
    turning: bool

    @cached_property
    def moves(self) -> Array:
        """Element displacements (k, 3, 6) per twist of the moved race at the origin."""
        whole = shift(self.at)[:, :3]
        return whole - self.slide[:, :, None] * (self.slide[:, None] @ whole)

    def state(self, twist: Array) -> tuple[Array, Array, Array, Array]:
        """Return directions (k, 3), approaches, loads and lengths |v| (k,) at a twist (6,)."""
        moved = self.moves @ twist
        v = self.between + moved if self.turning else self.between
        size = np.linalg.norm(v, axis=1)
        along = v / size[:, None]
        pressed = size - self.reach
        if not self.turning:
            pressed = pressed + np.einsum("ki,ki->k", along, moved)
        least = max(
            _TOUCHING * pressed.max(initial=0.0), 4e-16 * size.max(initial=0.0)
        )  # what rounding leaves
        pressed = np.where(pressed > least, pressed, 0.0)
        return along, pressed, self.constant * pressed**self.exponent, size

    def energy(self, twist: Array) -> float:
        """Return the strain energy, J."""
        _, pressed, load, _ = self.state(twist)
        return float((load * pressed).sum() / (self.exponent + 1.0))

    def wrench(self, twist: Array) -> Array:
        """Return the wrench (6,) that moves the race by a twist."""
        along, _, load, _ = self.state(twist)
        return np.einsum("kij,ki,k->j", self.moves, along, load)

    def stiffness(self, twist: Array) -> Array:
        """Return the tangent stiffness (6, 6) at a twist."""
        along, pressed, load, size = self.state(twist)
        slope = self.exponent * self.constant * pressed ** (self.exponent - 1.0)
        contact_stiffness = slope[:, None, None] * along[:, :, None] * along[:, None]
        if self.turning:
            across = np.eye(3) - along[:, :, None] * along[:, None]
            contact_stiffness = (
                contact_stiffness + (load / size)[:, None, None] * across
            )
        total = np.einsum("kia,kij,kjb->ab", self.moves, contact_stiffness, self.moves)
        return 0.5 * (total + total.T)


def settle(contacts: Contacts, wrench: Array, length: float) -> Array:
    """Return the twist (6,) of the moved race in equilibrium with a wrench (6,).

    Parameters
    ----------
    contacts
        Rolling elements.
    wrench
        N, N·m at the origin.
    length
        m, scales rotations to translations.

    Raises
    ------
    InputError
        If the race is not held against the wrench.
    """
    unit = np.repeat([1.0, 1.0 / length], 3)
    load: Array = np.asarray(wrench, dtype=float) * unit
    most = float(np.linalg.norm(load))
    typical = float((most / contacts.constant.max()) ** (1.0 / contacts.exponent))
    size = max(most, float(contacts.state(np.zeros(6))[2].max()))
    if not size:
        return np.zeros(6)  # nothing is pressed
    x: Array = load / (most or 1.0) * typical

    def potential(at: Array) -> float:
        return contacts.energy(at * unit) - float(load @ at)

    for _ in range(_STEPS):
        left: Array = load - contacts.wrench(x * unit) * unit
        if np.abs(left).max() <= _SETTLED * size:
            break
        k = contacts.stiffness(x * unit) * np.outer(unit, unit)
        soft = 1e-9 * max(float(np.trace(k)) / 6.0, most / max(typical, 1e-12) * 1e-6)
        step: Array = np.linalg.solve(k + soft * np.eye(6), left)
        reach = 20.0 * max(typical, 1e-7) + 0.2 * float(np.linalg.norm(x))
        step = step * min(1.0, reach / max(float(np.linalg.norm(step)), 1e-300))
        now = potential(x)
        slope = 1e-4 * float(left @ step)
        share = 1.0
        most_now = now + 1e-14 * abs(now)
        while share > 1e-9 and potential(x + share * step) > most_now - share * slope:
            share *= 0.5
        x = x + share * step
    require(
        np.abs(load - contacts.wrench(x * unit) * unit).max() <= _ACCEPTED * size,
        "load",
        "one that the elements can carry, found no equilibrium",
    )
    return x * unit

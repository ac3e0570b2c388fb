"""Beam theory for comparison: compliance at the end of a clamped straight beam.

Axes: x along the beam from the clamped end to the loaded one, where the reference point is; y and z are principal.
Twist (v, ω) for a wrench (f, m), SI.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, tanh
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Section:
    """A cross-section.

    Attributes
    ----------
    area : m².
    bending_y, bending_z : second moments of area about y and z, m⁴.
    torsion : torsion constant J, m⁴; the torque is G J times the twist a metre.
    shear_y, shear_z : shear coefficients κ for forces along y and z.
    """

    area: float
    bending_y: float
    bending_z: float
    torsion: float
    shear_y: float
    shear_z: float


def circle(radius: float, bore: float = 0.0, poisson: float = 0.3) -> Section:
    """Return a circle or tube of outer and inner radius (m); shear after Cowper (1966).

    Raises
    ------
    InputError : radii that are not 0 <= bore < radius.
    """
    if not 0 <= bore < radius < np.inf:
        raise InputError(f"section: expected 0 <= bore < radius, got bore {bore} m and radius {radius} m")
    ratio = (bore / radius) ** 2
    second = pi * (radius**4 - bore**4) / 4
    shear = 6 * (1 + poisson) * (1 + ratio) ** 2
    shear /= (7 + 6 * poisson) * (1 + ratio) ** 2 + (20 + 12 * poisson) * ratio
    return Section(pi * (radius**2 - bore**2), second, second, 2 * second, shear, shear)


def rectangle(width: float, height: float, poisson: float = 0.3) -> Section:
    """Return a rectangle, width along y and height along z (m): Saint-Venant's torsion, Cowper's shear.

    Raises
    ------
    InputError : sides that are not positive.
    """
    if not (0 < width < np.inf and 0 < height < np.inf):
        raise InputError(f"section: expected positive sides, got width {width} m and height {height} m")
    shear = 10 * (1 + poisson) / (12 + 11 * poisson)
    return Section(
        area=width * height,
        bending_y=width * height**3 / 12,
        bending_z=height * width**3 / 12,
        torsion=saint_venant_torsion(width, height),
        shear_y=shear,
        shear_z=shear,
    )


def saint_venant_torsion(width: float, height: float) -> float:
    """Return the torsion constant (m⁴) of a rectangle (Timoshenko and Goodier, Theory of Elasticity, art. 109)."""
    a, b = max(width, height), min(width, height)
    series = sum(tanh(n * pi * a / (2 * b)) / n**5 for n in range(1, 60, 2))
    return a * b**3 / 3 * (1 - 192 * b / (pi**5 * a) * series)


def polar(section: Section) -> Section:
    """Return the section with the torsion constant I_y + I_z, as the published slider was computed (theory, 7.4)."""
    return replace(section, torsion=section.bending_y + section.bending_z)


def euler_bernoulli(
    length: float, section: Section, youngs_modulus: float, shear_modulus: float
) -> NDArray[np.float64]:
    """Return the (6, 6) compliance of docs/theory.md (7.1): bending, stretch and torsion without shear.

    Raises
    ------
    InputError : a length or modulus that is not positive.
    """
    for name, value in (("length", length), ("Young's modulus", youngs_modulus), ("shear modulus", shear_modulus)):
        if not 0 < value < np.inf:
            raise InputError(f"beam: expected a positive {name}, got {value}")
    about_y, about_z = youngs_modulus * section.bending_y, youngs_modulus * section.bending_z
    compliance = np.zeros((6, 6))
    compliance[0, 0] = length / (youngs_modulus * section.area)
    compliance[1, 1] = length**3 / (3 * about_z)
    compliance[2, 2] = length**3 / (3 * about_y)
    compliance[3, 3] = length / (shear_modulus * section.torsion)
    compliance[4, 4] = length / about_y
    compliance[5, 5] = length / about_z
    compliance[1, 5] = compliance[5, 1] = length**2 / (2 * about_z)
    compliance[2, 4] = compliance[4, 2] = -(length**2) / (2 * about_y)
    return compliance


def timoshenko(length: float, section: Section, youngs_modulus: float, shear_modulus: float) -> NDArray[np.float64]:
    """Return the (6, 6) compliance of docs/theory.md (7.1) with the shear deflection L / (κ G A) added to C22 and C33.

    Raises
    ------
    InputError : a length or modulus that is not positive.
    """
    compliance = euler_bernoulli(length, section, youngs_modulus, shear_modulus)
    compliance[1, 1] += length / (section.shear_y * shear_modulus * section.area)
    compliance[2, 2] += length / (section.shear_z * shear_modulus * section.area)
    return compliance

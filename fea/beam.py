"""Beam theory for comparison: compliance at the end of a straight clamped beam.

Axes: x from the clamped to the loaded end, which is the reference point; y and z are principal.
Twist (v, ω) for a wrench (f, m), SI.
"""

from __future__ import annotations

from dataclasses import replace
from math import tanh
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.cad.cross_sections import Section


def polar(section: Section) -> Section:
    """Return the section with torsion constant I_y + I_z of the published slider (theory, 7.4)."""
    return replace(section, torsion=section.bending_y + section.bending_z)


def euler_bernoulli(
    length: float, section: Section, youngs_modulus: float, shear_modulus: float
) -> NDArray[np.float64]:
    """Return the (6, 6) compliance of docs/theory.md (7.1): bending, axial and torsion, no shear.

    Parameters
    ----------
    length
        Length, m.
    section
        Cross-section: area, second moments, torsion, shear.
    youngs_modulus
        Young's modulus E, Pa.
    shear_modulus
        Shear modulus G, Pa.

    Raises
    ------
    InputError : if the length or a modulus is not positive.
    """
    values = length, youngs_modulus, shear_modulus
    for name, value in zip(
        ("length", "Young's modulus", "shear modulus"), values, strict=True
    ):
        if not 0 < value < np.inf:
            raise InputError(f"beam: expected a positive {name}, got {value}")
    second = section.bending_y, section.bending_z
    rates = np.array([section.area, np.inf, np.inf, np.inf, *second]) * youngs_modulus
    turned = np.array(
        [0.0, 0.0, section.shear_centre, -1.0, 0.0, 0.0]
    )  # about the shear centre
    twist = length / (shear_modulus * section.torsion)
    return cantilever(length, 1.0 / rates) + twist * np.outer(turned, turned)


def cantilever(length: float, rates: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return the (6, 6) tip compliance of a uniform cantilever from compliances per metre (6,)."""
    compliance = np.diag(np.asarray(rates * length, dtype=np.float64))
    compliance[1, 1] += rates[5] * length**3 / 3.0
    compliance[2, 2] += rates[4] * length**3 / 3.0
    compliance[1, 5] = compliance[5, 1] = rates[5] * length**2 / 2.0
    compliance[2, 4] = compliance[4, 2] = -rates[4] * length**2 / 2.0
    return compliance


def timoshenko(
    length: float, section: Section, youngs_modulus: float, shear_modulus: float
) -> NDArray[np.float64]:
    """Return the (6, 6) compliance of docs/theory.md (7.1) with shear, L / (κ G A), in C22 and C33.

    Parameters
    ----------
    length
        Length, m.
    section
        Cross-section: area, second moments, torsion, shear.
    youngs_modulus
        Young's modulus E, Pa.
    shear_modulus
        Shear modulus G, Pa.

    Raises
    ------
    InputError : if the length or a modulus is not positive.
    """
    compliance = euler_bernoulli(length, section, youngs_modulus, shear_modulus)
    compliance[1, 1] += length / (section.shear_y * shear_modulus * section.area)
    compliance[2, 2] += length / (section.shear_z * shear_modulus * section.area)
    return compliance


def restrained_torsion(
    length: float, section: Section, youngs_modulus: float, shear_modulus: float
) -> float:
    """Return the twist per torque (rad/(N m)) of a beam with warping restrained at both ends.

    Vlasov: L / GJ (1 - tanh(λ) / λ) with λ = L / 2 √(GJ / E C_w). Saint-Venant: L / GJ.

    Parameters
    ----------
    length
        Length, m.
    section
        Cross-section: area, second moments, torsion, shear.
    youngs_modulus
        Young's modulus E, Pa.
    shear_modulus
        Shear modulus G, Pa.
    """
    plain = length / (shear_modulus * section.torsion)
    if not section.warping:
        return plain
    ratio = shear_modulus * section.torsion / (youngs_modulus * section.warping)
    reach = length / 2 * ratio**0.5
    return plain * (1 - tanh(reach) / reach)

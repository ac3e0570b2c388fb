"""Estimates of how soft an imported part is: a bar of its extent, thickness and volume, in bending.

From the covariance of the solid's volume: a bar of length L has L²/12 along itself, and its section
a radius of gyration i about its soft axis; its tip yields L³ / (3 E A i²) per force. Sheet metal
is softer than its extents: of its wall, t = 2 V / A thick, a flat bar yields 4 L⁴ / (E V t²).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.cad.assembly import Instance
    from stiffscope.cad.materials import AnyMaterial

SLENDER = 8.0  # length over thickness, of a bar of the same extents


@dataclass(frozen=True)
class Estimate:
    """Estimates of a part's bending.

    Attributes
    ----------
    compliance : of the part as a cantilever, m/N.
    slenderness : length over thickness, of a bar of its extents.
    wall : compliance, m/N, if its wall bends alone, as sheet metal does; that of a square bar is
        equal to ``compliance``.
    """

    compliance: float
    slenderness: float
    wall: float

    @property
    def is_slender(self) -> bool:
        """Whether it is long beside its thickness, as rods, leaves and plates are."""
        return self.slenderness > SLENDER


def estimate_part(solid: Instance, material: AnyMaterial) -> Estimate:
    """Return the estimate of a part of a material."""
    product = solid.product
    inertia = product.inertia
    covariance = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    squares = np.linalg.eigvalsh(covariance) / product.volume
    thin, _, long = np.maximum(squares, 1e-300).tolist()
    length = np.sqrt(12.0 * long)
    area = product.volume / length
    stiffness = 3.0 * material.youngs_modulus * area * thin / length**3
    sheet = 2.0 * product.volume / sum(face.area for face in product.faces)
    wall = length**4 / (material.youngs_modulus * product.volume * sheet**2)
    compliance = float(1.0 / stiffness)
    return Estimate(compliance, float(np.sqrt(long / thin)), max(compliance, wall))

"""Estimates of how soft an imported part is: a bar of its extent, thickness and volume, in bending.

From the covariance of the solid's volume: a bar of length L has L²/12 along itself, and its section
a radius of gyration i about its soft axis; its tip yields L³ / (3 E A i²) per force.
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
    """Bending compliance of a part as a cantilever, m/N, and its length over its thickness."""

    compliance: float
    slenderness: float

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
    stiffness = 3.0 * _youngs_modulus(material) * area * thin / length**3
    return Estimate(float(1.0 / stiffness), float(np.sqrt(long / thin)))


def _youngs_modulus(material: AnyMaterial) -> float:
    own = getattr(material, "youngs_modulus", None)
    return float(own) if own is not None else float(min(material.youngs_moduli))

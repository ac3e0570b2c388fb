"""Estimates of how soft an imported part is: a bar of its extent, thickness and volume, in bending.

From the covariance of the solid's volume: a bar of length L has L²/12 along itself, and its section
a radius of gyration i about its soft axis; its tip yields L³ / (3 E A i²) per force. Sheet metal
is softer than its extents: of its wall, t = 2 V / A thick, a flat bar yields 4 L⁴ / (E V t²).
A bent sheet, drawn along its width w, is a strip of developed length D: its end yields about
4 r² D / (E I), with I = w t³ / 12 and r the radius of gyration of its profile; 4 r² = D² / 3 if flat.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope import cad
from stiffscope.cad.faces import DISTANCE

if TYPE_CHECKING:
    from stiffscope.cad.assembly import Instance, Product
    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.runtime.types import Array

SLENDER = 8.0  # length over thickness, of a bar of the same extents
PARALLEL = 1e-3  # rad, of directions along and across an extrusion
PIERCED = 0.1  # of a sheet's area: holes and what else is neither along nor across it


@dataclass(frozen=True)
class Estimate:
    """Estimates of a part's bending.

    Attributes
    ----------
    compliance : of the part as a cantilever, m/N: as a bar, or as a strip if it is a bent sheet.
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
    covariance = (0.5 * np.trace(inertia) * np.eye(3) - inertia) / product.volume
    squares = np.linalg.eigvalsh(covariance)
    thin, _, long = np.maximum(squares, 1e-300).tolist()
    length = np.sqrt(12.0 * long)
    area = product.volume / length
    stiffness = 3.0 * material.youngs_modulus * area * thin / length**3
    sheet = 2.0 * product.volume / sum(face.area for face in product.faces)
    wall = length**4 / (material.youngs_modulus * product.volume * sheet**2)
    strip = _bend_strip(product, covariance) / material.youngs_modulus
    compliance = max(float(1.0 / stiffness), strip)
    return Estimate(compliance, float(np.sqrt(long / thin)), max(compliance, wall))


def _bend_strip(product: Product, covariance: Array) -> float:
    """Return E times the compliance (1/m) of a solid as a bent strip, drawn along its width; or 0.

    Parameters
    ----------
    covariance : (3, 3) of its volume about the centre, over the volume, m².
    """
    largest = 0.0
    shapes = cad.kernel.faces(product.solid)
    planes = [face for face in product.faces if face.kind == "plane"]
    tried = list[np.ndarray]()
    for axis in (plane.axis for plane in planes):
        if any(abs(axis @ other) > 1.0 - PARALLEL**2 for other in tried):
            continue
        tried.append(axis)
        ends = [f for f in planes if abs(f.axis @ axis) > 1.0 - PARALLEL**2]
        flat = sum(f.area for f in planes if abs(f.axis @ axis) < PARALLEL)
        round_area = sum(
            f.area
            for f in product.faces
            if f.kind == "cylinder" and abs(f.axis @ axis) > 1.0 - PARALLEL**2
        )
        sides = flat + round_area
        capped = sum(f.area for f in ends)
        heights = np.array([axis @ f.centroid for f in ends])
        inner = np.minimum(heights - heights.min(), heights.max() - heights)
        if inner.max() > DISTANCE:
            continue  # steps and grooves are no ends of a prism
        rest = sum(f.area for f in product.faces) - sides - capped
        if rest > PIERCED * sides:
            continue
        if any(cad.kernel.count_borders(shapes[f.index]) > 1 for f in ends):
            continue  # a ring or tube is much stiffer than an open strip
        width = 2.0 * product.volume / capped
        own = axis @ covariance @ axis
        across = np.eye(3) - np.outer(axis, axis)
        if own > np.linalg.eigvalsh(across @ covariance @ across)[-1]:
            continue  # a bar of thin walls, which bends along its axis
        # the profile's area and perimeter are D t and 2 (D + t)
        section = capped / 2.0
        half = (sides + rest) / width / 4.0
        root = np.sqrt(max(half**2 - section, 0.0))
        length = half + root
        thickness = section / length
        radius_squared = np.trace(covariance) - own - thickness**2 / 12.0
        bent = 48.0 * radius_squared * length / (width * thickness**3)
        largest = max(largest, float(bent))
    return largest

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
    from stiffscope.cad.faces import FaceGeometry
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
    axes: list[Array] = []
    for face in product.faces:
        flat = face.kind == "plane"
        if flat and not any(_is_parallel(face.axis, known) for known in axes):
            axes.append(face.axis)
    return max((_bend_along(product, covariance, axis) for axis in axes), default=0.0)


def _bend_along(product: Product, covariance: Array, axis: Array) -> float:
    """Return what `_bend_strip` does for a strip of this axis of width; 0 if it is none."""
    ends = [
        face
        for face in product.faces
        if face.kind == "plane" and _is_parallel(face.axis, axis)
    ]
    sides = sum(face.area for face in product.faces if _is_side(face, axis))
    capped = sum(face.area for face in ends)
    rest = sum(face.area for face in product.faces) - sides - capped
    heights = np.array([axis @ face.centroid for face in ends])
    inner = np.minimum(heights - heights.min(), heights.max() - heights)
    is_prism = inner.max() <= DISTANCE and rest <= PIERCED * sides
    own = axis @ covariance @ axis
    across = np.eye(3) - np.outer(axis, axis)
    # a bar of thin walls bends along its axis
    is_bar = own > np.linalg.eigvalsh(across @ covariance @ across)[-1]
    if not is_prism or is_bar:
        return 0.0
    shapes = cad.kernel.faces(product.solid)
    if any(cad.kernel.count_borders(shapes[face.index]) > 1 for face in ends):
        return 0.0  # a ring or tube is much stiffer than an open strip
    width = 2.0 * product.volume / capped
    # the profile's area and perimeter are D t and 2 (D + t)
    section = capped / 2.0
    half = (sides + rest) / width / 4.0
    root = np.sqrt(max(half**2 - section, 0.0))
    length = half + root
    thickness = section / length
    radius_squared = np.trace(covariance) - own - thickness**2 / 12.0
    return float(48.0 * radius_squared * length / (width * thickness**3))


def _is_parallel(first: Array, second: Array) -> bool:
    return abs(float(first @ second)) > 1.0 - PARALLEL**2


def _is_side(face: FaceGeometry, axis: Array) -> bool:
    """Return whether a face is drawn along an axis: a plane or cylinder of that direction."""
    if face.kind == "cylinder":
        return _is_parallel(face.axis, axis)
    return face.kind == "plane" and abs(float(face.axis @ axis)) < PARALLEL

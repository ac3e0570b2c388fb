"""Engagement of a cutter: where its teeth cut, and how chip thickness and force are directed.

Axes of the path: x along the feed, y to its left seen from the spindle, z along the spindle. A tooth
at angle φ, from y towards x, cuts at x = R sin φ, y = R cos φ. A displacement d of the tool makes
its chip thicker by n·d, and a chip thicker by h loads the tool with b·c(φ)·h; b: depth of cut.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.runtime.types import Array

_POINTS = 48  # of a quadrature over the engagement, exact to rounding
_RIPPLE = (
    0.1  # harmonic over mean, above which the zero-order solution is off by percents
)


@dataclass(frozen=True)
class Engagement:
    """Teeth in the workpiece.

    Attributes
    ----------
    teeth
        Number of teeth, evenly spaced.
    start, end
        Angles at which a tooth enters and leaves, rad.
    stiffness
        Change of the tangential force per change of the chip's area, Pa.
    radial, axial
        Radial and axial over tangential force.
    lead
        Entering angle of the edge, rad; 90° for an end mill.
    fixed
        Directions n and c / ``stiffness`` of a tool that does not rotate, instead of those of a
        tooth at its angle.
    """

    teeth: int
    start: float
    end: float
    stiffness: float
    radial: float = 0.0
    axial: float = 0.0
    lead: float = 0.5 * np.pi
    fixed: tuple[tuple[float, ...], tuple[float, ...]] | None = None

    @property
    def planar(self) -> bool:
        """Whether axial displacements leave the chip as it is."""
        if self.fixed is not None:
            return self.fixed[0][2] == 0.0
        return abs(np.cos(self.lead)) < 1e-9

    @property
    def immersed(self) -> float:
        """Mean number of teeth in the workpiece."""
        return self.teeth * (self.end - self.start) / (2.0 * np.pi)

    def normal(self, angle: Array) -> Array:
        """Return n (…, 3) at angles (…), rad."""
        if self.fixed is not None:
            return np.broadcast_to(self.fixed[0], (*np.shape(angle), 3)).astype(float)
        sine = np.sin(self.lead)
        axial = 0.0 if self.planar else -np.cos(self.lead)
        return np.stack(
            [
                np.sin(angle) * sine,
                np.cos(angle) * sine,
                np.full(np.shape(angle), axial),
            ],
            axis=-1,
        )

    def force(self, angle: Array) -> Array:
        """Return c (…, 3) at angles (…), N/m²: force per depth of cut and chip thickness."""
        if self.fixed is not None:
            shape = (*np.shape(angle), 3)
            return self.stiffness * np.broadcast_to(self.fixed[1], shape).astype(float)
        sine = np.sin(angle)
        cosine = np.cos(angle)
        directions = np.stack(
            [
                -cosine - self.radial * sine,
                sine - self.radial * cosine,
                np.full(np.shape(angle), self.axial),
            ],
            axis=-1,
        )
        # the edge in the workpiece is longer than the depth of cut by 1 / sin(lead)
        return self.stiffness / np.sin(self.lead) * directions

    @cached_property
    def mean(self) -> Array:
        """Mean of Σ c nᵀ over the teeth (3, 3), N/m² (Altintas and Budak, eq. 9 to 12)."""
        return self.harmonic(0).real

    def harmonic(self, order: int) -> Array:
        """Return a Fourier coefficient (3, 3) of Σ c nᵀ over the tooth period."""
        nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
        half = 0.5 * (self.end - self.start)
        angle = self.start + half * (nodes + 1.0)
        turned = np.exp(-1j * order * self.teeth * angle) * weights * half
        share = self.teeth / (2.0 * np.pi)
        return share * np.einsum(
            "a,ai,aj->ij", turned, self.force(angle), self.normal(angle)
        )

    @cached_property
    def ripple(self) -> float:
        """First harmonic of Σ c nᵀ over its mean: zero for constant coefficients."""
        if self.fixed is not None:
            return 0.0
        return float(np.linalg.norm(self.harmonic(1)) / np.linalg.norm(self.mean))

    @property
    def interrupted(self) -> bool:
        """Whether the mean alone does not describe the cut, so that all harmonics are needed."""
        return self.ripple > _RIPPLE


def milling(
    *,
    teeth: int,
    width: float,
    diameter: float,
    stiffness: float,
    radial: float = 0.3,
    axial: float = 0.0,
    lead: float = 0.5 * np.pi,
    climb: bool = True,
) -> Engagement:
    """Return the engagement of a milling cutter that rotates clockwise seen from the spindle.

    Parameters
    ----------
    teeth
        Number of teeth.
    width, diameter
        Radial depth of cut and diameter of the cutter, m.
    stiffness
        Change of the tangential force per change of the chip's area, Pa.
    radial, axial
        Radial and axial over tangential force.
    lead
        Entering angle of the edge, rad.
    climb
        Climb (down) milling: teeth leave along the feed's normal. Irrelevant for a slot.

    References
    ----------
    Y. Altintas, E. Budak, Analytical prediction of stability lobes in milling, CIRP Annals 44,
    1995, 357-362.
    """
    swept = 2.0 * np.arcsin(np.sqrt(min(width / diameter, 1.0)))
    start, end = (np.pi - swept, np.pi) if climb else (0.0, swept)
    return Engagement(
        teeth=teeth,
        start=float(start),
        end=float(end),
        stiffness=stiffness,
        radial=radial,
        axial=axial,
        lead=lead,
    )


def one_direction(
    stiffness: float, normal: tuple[float, ...], force: tuple[float, ...]
) -> Engagement:
    """Return the engagement of one edge that stays in the workpiece: turning and boring.

    Parameters
    ----------
    stiffness
        Change of the force per change of the chip's area, Pa.
    normal
        Direction in which a displacement of the tool makes the chip thicker.
    force
        Force on the tool over ``stiffness`` and the chip's area; against ``normal`` for a force
        that pushes the tool back.
    """
    return Engagement(
        teeth=1,
        start=0.0,
        end=2.0 * np.pi,
        stiffness=stiffness,
        fixed=(tuple(normal), tuple(force)),
    )


def turning(*, stiffness: float, radial: float, lead: float, side: float) -> Engagement:
    """Return the engagement of a turning or boring tool: one edge, in one direction.

    Feed is x of the path's axes, and z points from the workpiece to the tool's holder. The edge is
    at the entering angle κ: a displacement along ``n = (sin κ, 0, -cos κ)`` makes the chip thicker.
    The tangential force is along y, and the thrust against n.

    Parameters
    ----------
    stiffness
        Change of the tangential force per change of the chip's area, Pa.
    radial
        Thrust over tangential force.
    lead
        Entering angle κ of the edge, rad; 90° if it is square to the feed.
    side
        1 if the workpiece passes the tool to the left of the feed, seen from the holder, else -1.

    References
    ----------
    J. Tlusty, M. Polacek, The stability of machine tools against self-excited vibrations in
    machining, ASME International Research in Production Engineering, 1963.
    """
    sine = float(np.sin(lead))
    cosine = float(np.cos(lead)) if abs(np.cos(lead)) > 1e-9 else 0.0
    # the edge in the workpiece is longer than the depth of cut by 1 / sin κ
    force = (-radial, side / sine, radial * cosine / sine)
    return one_direction(stiffness, (sine, 0.0, -cosine), force)

"""Straight beams of one section: tube, box, I and channel.

Axes: x along the beam, from the clamped end at x = 0 to the loaded end; y across and z along the
height, from the centroid, at the loaded end the reference point. Channel flanges point along +y.
"""

from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from stiffscope.cad.checks import GAP, length, mm, require
from stiffscope.cad.solid import SolidParameters


@dataclass(frozen=True)
class BeamParameters(SolidParameters):
    """Beam length, m, and common methods; each section adds its own dimensions.

    Raises
    ------
    InputError
        If a value is out of range; it is named as in the robot file (``tube.wall``).
    """

    shape: ClassVar[str]
    length: float

    def __post_init__(self) -> None:
        for field in fields(self):
            length(f"{self.shape}.{field.name}", getattr(self, field.name))
        for name, most in self.largest().items():
            value = getattr(self, name)
            valid = f"up to {mm(max(most, 0.0))} in this section"
            require(value <= most, f"{self.shape}.{name}", valid, mm(value))

    def largest(self) -> dict[str, float]:
        """Return the largest thicknesses by name, m."""
        raise NotImplementedError

    def outline(self) -> list[list[tuple[float, float]]]:
        """Return the corners (y, z) of the section's outer border, then of its hole, m."""
        raise NotImplementedError

    def draw(self) -> Any:
        """See `SolidParameters`."""
        from build123d import Plane, extrude

        return extrude(Plane.YZ * self.section(), 1e3 * self.length)

    def section(self) -> Any:
        """Return the section as a build123d sketch, mm."""
        from build123d import Polygon

        loops = (1e3 * np.array(loop) for loop in self.outline())
        border, *holes = (Polygon(*map(tuple, loop), align=None) for loop in loops)
        return border - holes if holes else border


@dataclass(frozen=True)
class TubeParameters(BeamParameters):
    """A round tube: outer radius and wall, m."""

    shape: ClassVar[str] = "tube"
    radius: float
    wall: float

    def largest(self) -> dict[str, float]:
        """See `BeamParameters`."""
        return {"wall": self.radius - GAP}

    def section(self) -> Any:
        """See `BeamParameters`."""
        from build123d import Circle

        return Circle(1e3 * self.radius) - Circle(1e3 * (self.radius - self.wall))


@dataclass(frozen=True)
class BoxParameters(BeamParameters):
    """A rectangular tube: outer width along y and height along z, and wall, m."""

    shape: ClassVar[str] = "box"
    width: float
    height: float
    wall: float

    def largest(self) -> dict[str, float]:
        """See `BeamParameters`."""
        return {"wall": (min(self.width, self.height) - GAP) / 2}

    def outline(self) -> list[list[tuple[float, float]]]:
        """See `BeamParameters`."""
        inner = self.width - 2 * self.wall, self.height - 2 * self.wall
        return [
            [
                (y * width / 2, z * height / 2)
                for y, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))
            ]
            for width, height in ((self.width, self.height), inner)
        ]


@dataclass(frozen=True)
class _FlangedParameters(BeamParameters):
    """Flange width along y, overall height along z, flange and web thickness, m."""

    width: float
    height: float
    flange: float
    web: float

    def largest(self) -> dict[str, float]:
        """See `BeamParameters`."""
        return {"flange": (self.height - GAP) / 2, "web": self.width - GAP}


@dataclass(frozen=True)
class IParameters(_FlangedParameters):
    """An I: flange width along y, overall height along z, flange and web thickness, m."""

    shape: ClassVar[str] = "i"

    def outline(self) -> list[list[tuple[float, float]]]:
        """See `BeamParameters`."""
        y = self.width / 2
        web = self.web / 2
        z = self.height / 2
        under = self.height / 2 - self.flange
        lower = [
            (-web, -under),
            (-y, -under),
            (-y, -z),
            (y, -z),
            (y, -under),
            (web, -under),
        ]
        return [[*lower, *((-a, -b) for a, b in lower)]]


@dataclass(frozen=True)
class ChannelParameters(_FlangedParameters):
    """A channel: flange width along y, overall height along z, flange and web thickness, m."""

    shape: ClassVar[str] = "channel"

    @property
    def back(self) -> float:
        """Distance of the centroid from the web's outer side, m."""
        flanges = 2 * self.width * self.flange
        web = (self.height - 2 * self.flange) * self.web
        return (flanges * self.width + web * self.web) / (2 * (flanges + web))

    def outline(self) -> list[list[tuple[float, float]]]:
        """See `BeamParameters`."""
        left = -self.back
        z = self.height / 2
        under = self.height / 2 - self.flange
        right = left + self.width
        web = left + self.web
        inner = [(right, -under), (web, -under), (web, under), (right, under)]
        return [[(left, -z), (right, -z), *inner, (right, z), (left, z)]]


BEAMS = {
    k.shape: k for k in (TubeParameters, BoxParameters, IParameters, ChannelParameters)
}

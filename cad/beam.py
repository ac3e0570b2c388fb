"""Straight beams of one section: tube, box, I and channel.

Axes: x along the beam, from the clamped end at x = 0 to the loaded end; y across and z along the
height, from the centroid, at the loaded end the reference point. Channel flanges point along +y.
"""

from abc import abstractmethod
from dataclasses import dataclass, fields
from typing import Annotated, Any

from stiffscope import cad
from stiffscope.cad.checks import GAP, length, mm, require
from stiffscope.cad.cross_sections import Section, box, channel, circle, i_section
from stiffscope.cad.solid import SolidParameters

WALL = "wall thickness"


@dataclass(frozen=True)
class BeamParameters(SolidParameters):
    """Beam length, m, and common methods; each section adds its own dimensions.

    Raises
    ------
    InputError
        If a value is out of range; it is named as in the robot file (``tube.wall``).
    """

    axes = (
        "x along the beam from its clamped end, y across, z along its height; twist (v, omega) "
        "and wrench (f, m) at the centroid of the loaded end"
    )
    length: Annotated[float, "length along x, from clamped to loaded end"]

    def __post_init__(self) -> None:
        for field in fields(self):
            length(f"{self.shape}.{field.name}", getattr(self, field.name))
        for name, most in self.largest().items():
            value = getattr(self, name)
            valid = f"up to {mm(max(most, 0.0))} in this section"
            require(value <= most, f"{self.shape}.{name}", valid, mm(value))

    @abstractmethod
    def largest(self) -> dict[str, float]:
        """Return the largest thicknesses by name, m."""

    def outline(self) -> list[list[tuple[float, float]]]:
        """Return the corners (y, z) of the section's outer border, then of its hole, m."""
        raise NotImplementedError

    @abstractmethod
    def cross_section(self, poisson: float) -> Section:
        """Return the section of beam theory."""

    def segments(self, poisson: float) -> list[tuple[float, Section]]:
        """See `SolidParameters`."""
        return [(self.length, self.cross_section(poisson))]

    def sketch(self) -> dict[str, Any]:
        """See `SolidParameters`."""
        return {"outline": self.outline()}

    def draw(self) -> Any:
        """See `SolidParameters`."""
        return cad.drawing.extrude_along_x(self.section(), 1e3 * self.length)

    def section(self) -> Any:
        """Return the section as a plane face at x = 0, mm."""
        loops = [[(0.0, 1e3 * y, 1e3 * z) for y, z in loop] for loop in self.outline()]
        border, *holes = map(cad.drawing.polygon, loops)
        return cad.drawing.plane_face(border, holes)


@dataclass(frozen=True)
class TubeParameters(BeamParameters):
    """A round tube: outer radius and wall, m.

    Axes: x along it from the clamped end, from the section's centroid.
    """

    shape = "tube"
    is_round = True
    radius: Annotated[float, "outer radius"]
    wall: Annotated[float, WALL]

    @property
    def across(self) -> tuple[float, float]:
        """See `SolidParameters`."""
        return 2.0 * self.radius, 2.0 * self.radius

    def largest(self) -> dict[str, float]:
        """See `BeamParameters`."""
        return {"wall": self.radius - GAP}

    def cross_section(self, poisson: float) -> Section:
        """See `BeamParameters`."""
        return circle(self.radius, self.radius - self.wall, poisson)

    def sketch(self) -> dict[str, Any]:
        """See `SolidParameters`."""
        return {"radius": self.radius}

    def section(self) -> Any:
        """See `BeamParameters`."""
        radii = 1e3 * self.radius, 1e3 * (self.radius - self.wall)
        border, hole = map(cad.drawing.circle_about_x, radii)
        return cad.drawing.plane_face(border, [hole])


@dataclass(frozen=True)
class _FlatParameters(BeamParameters):
    """Width along y and height along z, m."""

    width: Annotated[float, "size along y"]
    height: Annotated[float, "size along z"]

    @property
    def across(self) -> tuple[float, float]:
        """See `SolidParameters`."""
        return self.width, self.height


@dataclass(frozen=True)
class BoxParameters(_FlatParameters):
    """A rectangular tube: outer width along y and height along z, and wall, m.

    Axes: x along it from the clamped end, from the section's centroid.
    """

    shape = "box"
    wall: Annotated[float, WALL]

    def largest(self) -> dict[str, float]:
        """See `BeamParameters`."""
        return {"wall": (min(self.width, self.height) - GAP) / 2}

    def cross_section(self, poisson: float) -> Section:
        """See `BeamParameters`."""
        return box(self.width, self.height, self.wall, poisson)

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
class _FlangedParameters(_FlatParameters):
    """Flange width along y, overall height along z, flange and web thickness, m."""

    flange: Annotated[float, "flange thickness"]
    web: Annotated[float, "web thickness"]

    def largest(self) -> dict[str, float]:
        """See `BeamParameters`."""
        return {"flange": (self.height - GAP) / 2, "web": self.width - GAP}


@dataclass(frozen=True)
class IParameters(_FlangedParameters):
    """An I: flange width along y, overall height along z, flange and web thickness, m.

    Axes: x along it from the clamped end, from the section's centroid.
    """

    shape = "i"

    def cross_section(self, poisson: float) -> Section:
        """See `BeamParameters`."""
        return i_section(self.width, self.height, self.flange, self.web, poisson)

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
    """A channel: flange width along y, overall height along z, flange and web thickness, m.

    Axes: x along it from the clamped end, from the section's centroid.
    """

    shape = "channel"

    def cross_section(self, poisson: float) -> Section:
        """See `BeamParameters`."""
        _ = poisson
        return channel(self.width, self.height, self.flange, self.web)

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

"""Straight beams of one section: tube, box, I and channel.

Axes: x along the beam, from the clamped end at x = 0 to the loaded end; y across and z along the height, from the
section's centroid, which at the loaded end is the reference point. A channel's flanges point along +y.
"""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, ClassVar, cast

from stiffscope.cad.checks import GAP, length, mm, require
from stiffscope.cad.materials import STEEL, AnyMaterial
from stiffscope.cad.part import Part
from stiffscope.cad.solid import span_part

if TYPE_CHECKING:
    from build123d import Sketch


@dataclass(frozen=True)
class BeamParameters:
    """Length of a beam, m, and what its sections share; each section adds its own dimensions.

    Raises
    ------
    InputError
        A value out of range, named as in the robot file (``tube.wall``).
    """

    shape: ClassVar[str]
    length: float

    def __post_init__(self) -> None:
        """Check the dimensions."""
        for field in fields(self):
            length(f"{self.shape}.{field.name}", getattr(self, field.name))
        for name, most in self.largest().items():
            value = getattr(self, name)
            require(value <= most, f"{self.shape}.{name}", f"up to {mm(max(most, 0.0))} in this section", mm(value))

    def largest(self) -> dict[str, float]:
        """Return the largest values of thicknesses by name, m."""
        raise NotImplementedError

    def outline(self) -> list[list[tuple[float, float]]]:
        """Return the corners (y, z) of the section's outer border, m, then those of its hole."""
        raise NotImplementedError

    def present(self) -> "BeamParameters":
        """Return the same: a beam has no features to leave out."""
        return self

    def lengths(self) -> dict[str, float]:
        """Return the lengths (m) that shape the beam, by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


@dataclass(frozen=True)
class TubeParameters(BeamParameters):
    """A round tube: outer radius and wall, m."""

    shape: ClassVar[str] = "tube"
    radius: float
    wall: float

    def largest(self) -> dict[str, float]:
        """See `BeamParameters`."""
        return {"wall": self.radius - GAP}


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
            [(y * width / 2, z * height / 2) for y, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            for width, height in ((self.width, self.height), inner)
        ]


@dataclass(frozen=True)
class _FlangedParameters(BeamParameters):
    """Width of the flanges along y, height over both along z, thickness of a flange and of the web, m."""

    width: float
    height: float
    flange: float
    web: float

    def largest(self) -> dict[str, float]:
        """See `BeamParameters`."""
        return {"flange": (self.height - GAP) / 2, "web": self.width - GAP}


@dataclass(frozen=True)
class IParameters(_FlangedParameters):
    """An I: width of the flanges along y, height over both along z, thickness of a flange and of the web, m."""

    shape: ClassVar[str] = "i"

    def outline(self) -> list[list[tuple[float, float]]]:
        """See `BeamParameters`."""
        y, web, z, under = self.width / 2, self.web / 2, self.height / 2, self.height / 2 - self.flange
        upper = [(y, under), (y, z), (-y, z), (-y, under), (-web, under)]
        return [[(-web, -under), (-y, -under), (-y, -z), (y, -z), (y, -under), (web, -under), (web, under), *upper]]


@dataclass(frozen=True)
class ChannelParameters(_FlangedParameters):
    """A channel: width of the flanges along y, height over both along z, thickness of a flange and of the web, m."""

    shape: ClassVar[str] = "channel"

    @property
    def back(self) -> float:
        """Distance of the centroid from the web's outer side, m."""
        flanges, web = 2 * self.width * self.flange, (self.height - 2 * self.flange) * self.web
        return (flanges * self.width + web * self.web) / (2 * (flanges + web))

    def outline(self) -> list[list[tuple[float, float]]]:
        """See `BeamParameters`."""
        left, z, under = -self.back, self.height / 2, self.height / 2 - self.flange
        right, web = left + self.width, left + self.web
        inner = [(right, -under), (web, -under), (web, under), (right, under)]
        return [[(left, -z), (right, -z), *inner, (right, z), (left, z)]]


BEAMS = {kind.shape: kind for kind in (TubeParameters, BoxParameters, IParameters, ChannelParameters)}


def build(parameters: BeamParameters, material: AnyMaterial = STEEL, name: str = "beam") -> Part:
    """Build a beam.

    Parameters
    ----------
    parameters
        Dimensions.
    material
        Linear elastic material.
    name
        Name of the part.

    Returns
    -------
    Part
        Clamped at x = 0, with the interface ``end`` at the far end.

    """
    from build123d import Circle, Plane, Polygon, extrude

    if isinstance(parameters, TubeParameters):
        section = Circle(1e3 * parameters.radius) - Circle(1e3 * (parameters.radius - parameters.wall))
    else:
        loops = [Polygon(*((1e3 * y, 1e3 * z) for y, z in loop), align=None) for loop in parameters.outline()]
        section = loops[0] - loops[1:] if len(loops) > 1 else loops[0]
    shape = extrude(Plane.YZ * cast("Sketch", section), 1e3 * parameters.length)
    return span_part(shape.wrapped, parameters.length, material, name)

"""A link: a round bar or tube, with optional end fittings.

Axes: x from the clamped end at x = 0 to the loaded end, whose centre is the reference point.
"""

from dataclasses import dataclass
from typing import Annotated, Any

from stiffscope import cad
from stiffscope.cad.checks import (
    GAP,
    length,
    mm,
    optional_length,
    require,
    require_between,
)
from stiffscope.cad.cross_sections import Section, circle
from stiffscope.cad.solid import SolidParameters


@dataclass(frozen=True)
class LinkParameters(SolidParameters):
    """A round bar or tube, with end fittings if wished; axes: x along it from the clamped end.

    A length of 0 omits the feature.

    Raises
    ------
    InputError
        If a value is out of range; it is named as in the robot file (``link.bore``).
    """

    shape = "rod"
    axes = (
        "x along the rod from its clamped end; twist (v, omega) and wrench (f, m) at the "
        "centre of the loaded end"
    )
    required = ("length", "radius")
    is_round = True
    published = "formula"
    length: Annotated[float, "length along x, from clamped to loaded end"] = 0.5
    radius: Annotated[float, "outer radius"] = 0.0125
    bore: Annotated[float, "diameter of the axial through hole"] = 0.0
    fitting_radius: Annotated[float, "radius of the end fittings"] = 0.0
    fitting_length: Annotated[
        float, "length of each end fitting, included in `length`"
    ] = 0.0

    def __post_init__(self) -> None:
        length("link.length", self.length)
        length("link.radius", self.radius)
        for name in ("bore", "fitting_radius", "fitting_length"):
            optional_length(f"link.{name}", getattr(self, name))
        widest = max(2 * (self.radius - GAP), 0.0)
        wanted = f"a diameter up to {mm(widest)} (the link's is {mm(2 * self.radius)})"
        require(self.bore <= widest, "link.bore", wanted, mm(self.bore))
        if not (self.fitting_radius or self.fitting_length):
            return
        least = self.bore / 2 + GAP
        wanted = f"at least {mm(least)} for fittings {mm(self.fitting_length)} long about the bore"
        require(
            self.fitting_radius >= least,
            "link.fitting_radius",
            wanted,
            mm(self.fitting_radius),
        )
        note = f" for fittings on a link of {mm(self.length)}"
        require_between(
            "link.fitting_length", GAP, self.fitting_length, self.length / 2 - GAP, note
        )

    @property
    def has_fittings(self) -> bool:
        """Whether the ends have a different radius."""
        return self.fitting_radius not in {0.0, self.radius}

    @property
    def absent(self) -> tuple[str, ...]:
        """See `SolidParameters`."""
        return () if self.has_fittings else ("fitting_",)

    @property
    def across(self) -> tuple[float, float]:
        """See `SolidParameters`."""
        return 2.0 * self.radius, 2.0 * self.radius

    def segments(self, poisson: float) -> list[tuple[float, Section]]:
        """See `SolidParameters`. With fittings there are three round bars."""
        shank = circle(self.radius, self.bore / 2, poisson)
        if not self.fitting_radius:
            return [(self.length, shank)]
        fitting = circle(self.fitting_radius, self.bore / 2, poisson)
        end = (self.fitting_length, fitting)
        return [end, (self.length - 2 * self.fitting_length, shank), end]

    def vanishing(self, name: str) -> float:
        """See `SolidParameters`; a thick wall is taken as solid."""
        outside = 2.0 * self.radius
        if name == "radius":
            return self.bore / 2.0
        return outside if name == "bore" and self.bore > outside / 4.0 else 0.0

    def sketch(self) -> dict[str, Any]:
        """See `SolidParameters`."""
        return {"radius": self.radius}

    def draw(self) -> Any:
        """See `SolidParameters`."""
        outer = self.radius
        thick = self.fitting_radius
        top = [(0.0, outer), (self.length, outer)]
        if self.has_fittings:
            first = self.fitting_length
            second = self.length - self.fitting_length
            top = [(0.0, thick), (first, thick), (first, outer)]
            top += [(second, outer), (second, thick), (self.length, thick)]
        corners = [(0.0, self.bore / 2), *top, (self.length, self.bore / 2)]
        section = cad.drawing.polygon([(1e3 * x, 1e3 * r, 0.0) for x, r in corners])
        return cad.drawing.revolve_about_x(cad.drawing.plane_face(section))

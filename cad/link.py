"""A link: a round bar or tube, with optional end fittings.

Axes: x from the clamped end at x = 0 to the loaded end, whose centre is the reference point.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from stiffscope.cad.checks import (
    GAP,
    length,
    mm,
    optional_length,
    require,
    require_between,
)
from stiffscope.cad.solid import SolidParameters


@dataclass(frozen=True)
class LinkParameters(SolidParameters):
    """Dimensions of a link, in m; 0 omits a feature.

    Parameters
    ----------
    length
        Total length, end fittings included.
    radius
        Outer radius.
    bore
        Diameter of a bore along the whole link.
    fitting_radius, fitting_length
        Dimensions of the two cylindrical end fittings.

    Raises
    ------
    InputError
        If a value is out of range; it is named as in the robot file (``link.bore``).
    """

    shape: ClassVar[str] = "rod"
    length: float = 0.5
    radius: float = 0.0125
    bore: float = 0.0
    fitting_radius: float = 0.0
    fitting_length: float = 0.0

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

    def draw(self) -> Any:
        """See `SolidParameters`."""
        from build123d import Axis, Polygon, revolve

        outer = self.radius
        thick = self.fitting_radius
        top = [(0.0, outer), (self.length, outer)]
        if self.has_fittings:
            first = self.fitting_length
            second = self.length - self.fitting_length
            top = [(0.0, thick), (first, thick), (first, outer)]
            top += [(second, outer), (second, thick), (self.length, thick)]
        corners = [(0.0, self.bore / 2), *top, (self.length, self.bore / 2)]
        section = Polygon(*((1e3 * x, 1e3 * r) for x, r in corners), align=None)
        return revolve(section.face(), Axis.X)

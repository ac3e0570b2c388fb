"""A slider (slidable platform): a plate with optional ribs, bolt holes and joint pads.

Axes: x away from the clamped face at x = 0, y across, z down; y = z = 0 is the plate's centre line.
The reference point is the centre of the loaded face, or of the middle pad if there are pads.
"""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from stiffscope.cad.checks import (
    FINEST,
    GAP,
    choice,
    count,
    length,
    mm,
    optional_length,
    require,
    require_between,
)
from stiffscope.cad.faces import FaceGeometry, FaceSelector, face_geometries, select
from stiffscope.cad.part import Interface
from stiffscope.cad.solid import GREATEST_X, LEAST_X, SolidParameters
from stiffscope.errors import InputError

if TYPE_CHECKING:
    from build123d import Edge

    from stiffscope.cad.kernel import Solid

_TOLERANCE = 1e-6  # mm
PADS = ("link1", "link2", "link3")  # interfaces of separately loaded pads
OPTIONAL = ("rib_pitch", "fillet", "hole_pitch", "pad_height")  # 0 omits them


@dataclass(frozen=True)
class SliderParameters(SolidParameters):
    """Dimensions of a slider, in m; a count or `pad_height` of 0 omits the feature.

    Parameters
    ----------
    depth, width, thickness
        Dimensions of the plate along x, y and z.
    rib_count
        Ribs on the underside (+z), along x from the clamped face to a half-round nose.
    rib_thickness, rib_height, rib_length
        Dimensions of a rib along y, z and x.
    rib_pitch
        Rib spacing; 0 spreads them evenly over the width.
    fillet
        Radius at the rib roots.
    hole_count
        Bolt holes through the plate along z, in one row across.
    hole_diameter, hole_offset
        Hole diameter, and distance of the hole axes from the clamped face.
    hole_pitch
        Hole spacing; 0 spreads them evenly over the width.
    clamp
        Clamped faces: the "face" at x = 0 or the walls of the "holes".
    pad_height, pad_width
        Joint pad dimensions along x and y, on the loaded face; pads are as thick as the plate.
    pad_spacing
        Distance of the outer pads from the middle pad.
    pads
        Load the pads "together" (one interface) or "apart" (interfaces link1, link2, link3).

    Raises
    ------
    InputError
        If a value is out of range; it is named as in the robot file (``slider.rib_pitch``).
    """

    shape: ClassVar[str] = "plate"
    depth: float = 0.085
    width: float = 0.320
    thickness: float = 0.020
    rib_count: int = 0
    rib_thickness: float = 0.010
    rib_height: float = 0.015
    rib_length: float = 0.075
    rib_pitch: float = 0.0
    fillet: float = 0.0
    hole_count: int = 0
    hole_diameter: float = 0.009
    hole_offset: float = 0.015
    hole_pitch: float = 0.0
    clamp: Literal["face", "holes"] = "face"
    pad_height: float = 0.0
    pad_width: float = 0.030
    pad_spacing: float = 0.070
    pads: Literal["together", "apart"] = "together"

    def __post_init__(self) -> None:
        for name in ("rib_count", "hole_count"):
            count(f"slider.{name}", getattr(self, name))
        for field in fields(self):
            if field.type is float:
                check = optional_length if field.name in OPTIONAL else length
                check(f"slider.{field.name}", getattr(self, field.name))
        choice("slider.clamp", self.clamp, ("face", "holes"))
        choice("slider.pads", self.pads, ("together", "apart"))
        _check_ribs(self)
        _check_holes(self)
        _check_pads(self)

    @property
    def absent(self) -> tuple[str, ...]:
        """See `SolidParameters`."""
        counts = {"rib_": self.rib_count, "hole_": self.hole_count}
        several = {f"{name}pitch": number > 1 for name, number in counts.items()}
        there = {"pad_": self.pad_height, **counts, **several}
        return tuple(name for name, used in there.items() if not used)

    @property
    def rib_positions(self) -> tuple[float, ...]:
        """Centre plane y of each rib (rib_count,), m."""
        return _row(self.rib_count, self.rib_pitch, self.width)

    @property
    def hole_positions(self) -> tuple[float, ...]:
        """Axis y of each bolt hole (hole_count,), m."""
        return _row(self.hole_count, self.hole_pitch, self.width)

    @property
    def pad_positions(self) -> tuple[float, ...]:
        """Centre y of pads 1, 2 and 3 (3,), m; empty without pads."""
        return (0.0, self.pad_spacing, -self.pad_spacing) if self.pad_height else ()

    def draw(self) -> Any:
        """See `SolidParameters`. Raises InputError if the CAD kernel cannot make the fillet."""
        from build123d import Align, Box, Cylinder, Pos, fillet

        depth, width, thickness = (
            1e3 * v for v in (self.depth, self.width, self.thickness)
        )
        outwards = (Align.MIN, Align.CENTER, Align.CENTER)
        below = (Align.MIN, Align.CENTER, Align.MIN)
        centred = (Align.CENTER, Align.CENTER, Align.MIN)
        solid = Box(depth, width, thickness, align=outwards)
        pad = 1e3 * self.pad_height, 1e3 * self.pad_width, thickness
        for y in self.pad_positions:
            solid += Pos(depth, 1e3 * y, 0) * Box(*pad, align=outwards)
        rib = self.rib_length, self.rib_thickness, self.rib_height
        length, bar, height = (1e3 * v for v in rib)
        for y in self.rib_positions:
            nose = Pos(length - bar / 2, 0, 0) * Cylinder(
                bar / 2, height, align=centred
            )
            straight = Box(length - bar / 2, bar, height, align=below)
            solid += Pos(0, 1e3 * y, thickness / 2) * (straight + nose)
        if self.fillet:
            roots = [
                edge
                for edge in solid.edges()
                if _is_root(edge, depth, width, thickness)
            ]
            try:
                solid = fillet(roots, 1e3 * self.fillet)
            except ValueError as error:
                got = f"got {mm(self.fillet)}; {error}"
                raise InputError(
                    f"slider.fillet: expected a smaller radius, {got}"
                ) from error
        for y in self.hole_positions:
            hole = Cylinder(500 * self.hole_diameter, 2 * thickness)
            solid -= Pos(1e3 * self.hole_offset, 1e3 * y, 0) * hole
        return solid

    def select_ends(
        self, solid: "Solid"
    ) -> tuple[frozenset[int], tuple[Interface, ...]]:
        """Return the face x = 0 or the hole walls, and interface ``joints``, or one per pad."""
        axes = [(self.hole_offset, y) for y in self.hole_positions]

        def is_wall(face: FaceGeometry) -> bool:
            near = (np.allclose(face.origin[:2], axis, atol=1e-6) for axis in axes)
            return face.kind == "cylinder" and any(near)

        walls = frozenset(
            face.index for face in filter(is_wall, face_geometries(solid))
        )
        clamped = select(solid, LEAST_X) if self.clamp == "face" else walls
        outer = self.depth + self.pad_height
        if self.pads == "together":
            faces = select(solid, GREATEST_X)
            return clamped, (Interface("joints", faces, np.array([outer, 0.0, 0.0])),)
        pads = []
        for name, y in zip(PADS, self.pad_positions, strict=True):
            place = FaceSelector(normal=(1, 0, 0), position=(outer, y, 0.0))
            pads.append(
                Interface(name, select(solid, [place]), np.array([outer, y, 0.0]))
            )
        return clamped, tuple(pads)


def _row(number: int, pitch: float, width: float) -> tuple[float, ...]:
    """Return positions of a row centred at y = 0; without a pitch, spread evenly over the width."""
    return tuple(
        (i - (number - 1) / 2) * (pitch or width / number) for i in range(number)
    )


def _check_row(slider: SliderParameters, item: str, size: str, needs: float) -> None:
    """Check that ribs or holes, each `needs` wide, clear each other and the plate's sides."""
    number = getattr(slider, f"{item}_count")
    pitch = getattr(slider, f"{item}_pitch")
    most = max((slider.width - 2 * GAP - needs) / max(number - 1, 1), 0.0)
    fits = f"{item}s that fit the plate's width of {mm(slider.width)}"
    require(
        needs < slider.width - 2 * GAP,
        f"slider.{item}_{size}",
        fits,
        f"{mm(needs)} each",
    )
    if pitch and number > 1:
        note = f" for {number} {item}s of {mm(needs)} on {mm(slider.width)}"
        require_between(f"slider.{item}_pitch", needs + GAP, pitch, most, note)
    elif not pitch:
        largest = int(slider.width / (needs + GAP) + 1e-9)
        fits = f"at most {largest} {item}s of {mm(needs)}"
        require(number <= largest, f"slider.{item}_count", fits, number)


def _check_ribs(slider: SliderParameters) -> None:
    if not slider.rib_count:
        valid = "0 without ribs (it rounds their roots)"
        require(not slider.fillet, "slider.fillet", valid, mm(slider.fillet))
        return
    fillet = slider.fillet
    largest = slider.rib_height - GAP
    valid = (
        f"0, or a radius from {mm(FINEST)} to {mm(largest)}, less than the rib's height"
    )
    require(
        fillet == 0 or FINEST <= fillet <= largest, "slider.fillet", valid, mm(fillet)
    )
    _check_row(slider, "rib", "thickness", slider.rib_thickness + 2 * slider.fillet)
    shortest = slider.rib_thickness / 2 + GAP
    longest = slider.depth - slider.fillet - GAP
    note = ", so that nose and fillet end on the plate"
    require_between("slider.rib_length", shortest, slider.rib_length, longest, note)


def _check_holes(slider: SliderParameters) -> None:
    if not slider.hole_count:
        require(
            slider.clamp != "holes",
            "slider.clamp",
            "'face' without bolt holes",
            "'holes'",
        )
        return
    radius = slider.hole_diameter / 2
    _check_row(slider, "hole", "diameter", slider.hole_diameter)
    largest = slider.depth - 2 * GAP
    require(
        2 * radius < largest,
        "slider.hole_diameter",
        f"less than {mm(largest)}",
        mm(2 * radius),
    )
    note = ", so that the holes are inside of the plate"
    least = radius + GAP
    most = slider.depth - radius - GAP
    require_between("slider.hole_offset", least, slider.hole_offset, most, note)
    if slider.hole_offset - radius - GAP > slider.rib_length + slider.fillet:
        return
    clearance = radius + slider.rib_thickness / 2 + slider.fillet + GAP
    valid = f"bolt holes at least {mm(clearance)} from a rib's centre plane"
    valid += " (change a pitch or a count)"
    for hole in slider.hole_positions:
        for rib in slider.rib_positions:
            got = f"a hole at y = {mm(hole)} and a rib at y = {mm(rib)}"
            require(abs(hole - rib) >= clearance, "slider.hole_pitch", valid, got)


def _check_pads(slider: SliderParameters) -> None:
    if not slider.pad_height:
        valid = "'together' without pads (pad_height = 0)"
        require(slider.pads != "apart", "slider.pads", valid, "'apart'")
        return
    widest = min(
        slider.pad_spacing - GAP, slider.width - 2 * slider.pad_spacing - 2 * GAP
    )
    spacing = slider.pad_spacing
    farthest = slider.width / 2 - GAP
    valid = f"less than {mm(farthest)}, so that the pads are on the loaded face"
    require(spacing < farthest, "slider.pad_spacing", valid, mm(spacing))
    valid = f"up to {mm(widest)} for pads {mm(spacing)} apart on {mm(slider.width)}"
    require(slider.pad_width <= widest, "slider.pad_width", valid, mm(slider.pad_width))


def _is_root(edge: "Edge", depth: float, width: float, thickness: float) -> bool:
    """Return whether an edge is inside the outline on the plate's underside: at a rib's root."""
    middle = edge.position_at(0.5)
    inside = (
        _TOLERANCE < middle.X < depth - _TOLERANCE
        and abs(middle.Y) < width / 2 - _TOLERANCE
    )
    return abs(middle.Z - thickness / 2) < _TOLERANCE and inside

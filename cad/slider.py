"""A slider (slidable platform): a plate with optional ribs, bolt holes and joint pads.

Axes: x away from the clamped face at x = 0, y across, z down; y = z = 0 is the plate's centre line.
The reference point is the centre of the loaded face, or of the middle pad if there are pads.
"""

from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np

from stiffscope import cad
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
from stiffscope.cad.cross_sections import Section, rectangle
from stiffscope.cad.faces import FaceGeometry, FaceSelector, face_geometries, select
from stiffscope.cad.part import Interface
from stiffscope.cad.solid import (
    GREATEST_X,
    LEAST_X,
    SolidParameters,
    Support,
    is_length,
)
from stiffscope.errors import InputError

if TYPE_CHECKING:
    from stiffscope.cad.kernel import Edge, Solid

_TOLERANCE = 1e-6  # mm
PAD_HEIGHT = 1 / 4  # of the thickness, for joint pads if the part has none
HOLE_PITCH = 4.0  # spacing of bolt holes in thicknesses, if the part has none
PADS = ("link1", "link2", "link3")  # interfaces of separately loaded pads
OPTIONAL = ("rib_pitch", "fillet", "hole_pitch", "pad_height")  # 0 omits them


@dataclass(frozen=True)
class SliderParameters(SolidParameters):
    """A plate, if wished with ribs, holes, pads; x away from its clamped face, y across, z through it.

    A count or `pad_height` of 0 omits the feature. Ribs end in a half-round nose; pads are as thick
    as the plate.

    Raises
    ------
    InputError
        If a value is out of range; it is named as in the robot file (``slider.rib_pitch``).
    """

    shape = "plate"
    axes = (
        "x away from the clamped face, y across, z through the plate, to the side of its ribs; "
        "twist (v, omega) and wrench (f, m) at the centre of the loaded face"
    )
    required = ("depth", "width", "thickness")
    along = frozenset({"depth", "pad_height"})
    is_plate = True
    whole_load: ClassVar = {"pad_height": 0.0}
    whole_clamp: ClassVar = {"clamp": "face"}
    published = "table"
    depth: Annotated[float, "size along x, from clamped to loaded face"] = 0.085
    width: Annotated[float, "size along y"] = 0.320
    thickness: Annotated[float, "size along z"] = 0.020
    rib_count: Annotated[int, "number of ribs on the underside, parallel to x"] = 0
    rib_thickness: Annotated[float, "rib thickness"] = 0.010
    rib_height: Annotated[float, "rib height below the plate"] = 0.015
    rib_length: Annotated[float, "rib length from the clamped face"] = 0.075
    rib_pitch: Annotated[float, "rib spacing; 0: evenly spaced"] = 0.0
    fillet: Annotated[float, "fillet radius at the rib roots"] = 0.0
    hole_count: Annotated[
        int, "number of bolt holes through the plate, in a row along y"
    ] = 0
    hole_diameter: Annotated[float, "diameter of a bolt hole"] = 0.009
    hole_offset: Annotated[float, "distance from the clamped face to the holes"] = 0.015
    hole_pitch: Annotated[float, "hole spacing; 0: evenly spaced"] = 0.0
    clamp: Annotated[
        Literal["face", "holes"],
        'fixed surface: the clamped `"face"` or the bolt `"holes"`',
    ] = "face"
    pad_height: Annotated[
        float, "height of the joint pads on the loaded face; 0: no pads"
    ] = 0.0
    pad_width: Annotated[float, "pad width"] = 0.030
    pad_spacing: Annotated[
        float, "distance between the outer pads and the middle pad"
    ] = 0.070
    pads: Annotated[
        Literal["together", "apart"],
        'pads as one interface (`"together"`) or one interface each (`"apart"`)',
    ] = "together"

    def __post_init__(self) -> None:
        for name in ("rib_count", "hole_count"):
            count(f"slider.{name}", getattr(self, name))
        for field in fields(self):
            if is_length(field):
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

    @property
    def span(self) -> float:
        """See `SolidParameters`."""
        return self.depth + self.pad_height

    @property
    def across(self) -> tuple[float, float]:
        """See `SolidParameters`."""
        return self.width, self.thickness

    def segments(self, poisson: float) -> list[tuple[float, Section]]:
        """See `SolidParameters`."""
        return [(self.depth, rectangle(self.width, self.thickness, poisson))]

    @property
    def beyond_beam(self) -> tuple[str, ...]:
        """See `SolidParameters`."""
        features = {
            "ribs": self.rib_count,
            "bolt holes": self.hole_count,
            "joint pads": self.pad_height,
        }
        return tuple(words for words, size in features.items() if size)

    @property
    def ports(self) -> tuple[str, ...]:
        """See `SolidParameters`."""
        return PADS if self.pads == "apart" and self.pad_height else ()

    @property
    def loads(self) -> tuple[Support, ...]:
        """See `SolidParameters`."""
        height = self.pad_height or PAD_HEIGHT * self.thickness
        sizes = {"high": height, "wide": self.pad_width, "apart": self.pad_spacing}
        pads = ", ".join(f"{1e3 * size:g} mm {word}" for word, size in sizes.items())
        keys: dict[str, Any] = {"pad_height": height}
        if not self.pad_height:  # pads that are there are loaded as they are
            keys["interface"] = "rigid"
        return (Support("three pads", f"loaded on three joint pads, {pads}", keys),)

    @property
    def clamps(self) -> tuple[Support, ...]:
        """See `SolidParameters`."""
        number = self.hole_count or _hole_count(self)
        holes = f"{number} bolt holes of {1e3 * self.hole_diameter:g} mm"
        words = f"held in {holes} instead of by the face"
        keys = {"hole_count": number, "clamp": "holes", "foundation": None}
        return (Support("bolt holes", words, keys),)

    def draw(self) -> Any:
        """See `SolidParameters`. Raises InputError if the CAD kernel cannot make the fillet."""
        depth, width, thickness = (
            1e3 * v for v in (self.depth, self.width, self.thickness)
        )
        half = thickness / 2
        solid = cad.drawing.box((0, -width / 2, -half), (depth, width, thickness))
        high, wide = 1e3 * self.pad_height, 1e3 * self.pad_width
        for y in self.pad_positions:
            corner = depth, 1e3 * y - wide / 2, -half
            pad = cad.drawing.box(corner, (high, wide, thickness))
            solid = cad.drawing.unite(solid, pad)
        rib = self.rib_length, self.rib_thickness, self.rib_height
        length, bar, height = (1e3 * v for v in rib)
        for y in self.rib_positions:
            end = length - bar / 2
            nose = cad.drawing.cylinder((end, 1e3 * y, half), bar / 2, height)
            corner = 0, 1e3 * y - bar / 2, half
            straight = cad.drawing.box(corner, (end, bar, height))
            solid = cad.drawing.unite(solid, cad.drawing.unite(straight, nose))
        if self.fillet:
            roots = [
                edge
                for edge in cad.kernel.edges(solid)
                if _is_root(edge, depth, width, thickness)
            ]
            try:
                solid = cad.drawing.fillet(solid, roots, 1e3 * self.fillet)
            except ValueError as error:
                got = f"got {mm(self.fillet)}; {error}"
                raise InputError(
                    f"slider.fillet: expected a smaller radius, {got}"
                ) from error
        for y in self.hole_positions:
            base = 1e3 * self.hole_offset, 1e3 * y, -thickness
            hole = cad.drawing.cylinder(base, 500 * self.hole_diameter, 2 * thickness)
            solid = cad.drawing.subtract(solid, hole)
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
        outer = self.span
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


def _hole_count(slider: SliderParameters) -> int:
    """Return the hole count for a pitch of four thicknesses, or the nearest clear of the ribs."""
    wanted = max(2, round(slider.width / (HOLE_PITCH * slider.thickness)))
    tried = range(2, 2 * wanted + 3)
    for number in sorted(tried, key=lambda number: abs(number - wanted)):
        with suppress(InputError):
            return replace(slider, hole_count=number).hole_count
    return wanted


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
    x, y, z = cad.kernel.middle_of_edge(edge)
    inside = _TOLERANCE < x < depth - _TOLERANCE and abs(y) < width / 2 - _TOLERANCE
    return abs(z - thickness / 2) < _TOLERANCE and inside

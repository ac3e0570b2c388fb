"""Parts from any solid: faces selected by geometry, part axes by a placement."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import Field, dataclass, fields, replace
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np

from stiffscope import cad
from stiffscope.cad.checks import POINT, direction, is_point, require
from stiffscope.cad.cross_sections import Section
from stiffscope.cad.faces import FaceSelector, centroid_of, face_geometries, select
from stiffscope.cad.materials import STEEL, AnyMaterial
from stiffscope.cad.part import Interface, Part
from stiffscope.cad.washers import select_interfaces
from stiffscope.errors import InputError

Vector = Sequence[float]
Selectors = Sequence[FaceSelector]
LEAST_X = (FaceSelector(kind="plane", normal=(-1, 0, 0), position="min x"),)
GREATEST_X = (FaceSelector(kind="plane", normal=(1, 0, 0), position="max x"),)


@dataclass(frozen=True)
class Placement:
    """Part axes in the coordinates of the CAD model; y = z × x.

    Parameters
    ----------
    origin
        (3,) m.
    x, z
        (3,) directions of the part's x and z, of any length.

    Raises
    ------
    InputError
        If the origin is out of range, or the directions are not perpendicular.
    """

    origin: Vector = (0.0, 0.0, 0.0)
    x: Vector = (1.0, 0.0, 0.0)
    z: Vector = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        require(is_point(self.origin), "placement.origin", POINT, repr(self.origin))
        direction("placement.x", self.x)
        direction("placement.z", self.z)
        cosine = (
            np.dot(self.x, self.z) / np.linalg.norm(self.x) / np.linalg.norm(self.z)
        )
        require(
            abs(cosine) <= 1e-6, "placement.z", "one at right angles to x", repr(self.z)
        )


def part_of(
    solid: Any,
    *,
    name: str = "part",
    material: AnyMaterial = STEEL,
    clamped: Selectors = LEAST_X,
    loaded: Selectors | Mapping[str, Selectors] = GREATEST_X,
    interfaces: Mapping[str, Selectors] | None = None,
    couplings: Mapping[str, str] | None = None,
    placement: Placement | None = None,
    reference_point: Vector | None = None,
    valid: bool = False,
) -> Part:
    """Create a part from a solid.

    Parameters
    ----------
    solid
        Solid of build123d or of the CAD kernel, mm.
    name
        Name of the part.
    material
        Linear elastic material.
    clamped
        Selectors of the clamped faces; like all selectors, in the coordinates of the solid.
    loaded
        Selectors of the loaded interface, or of several interfaces by name.
    interfaces
        Instead of ``clamped`` and ``loaded``: selectors of two or more interfaces by name; the
        first is at rest.
    couplings
        "rigid" or "distributed" by interface name; by default that of the experiment's settings.
    placement
        Part axes; by default those of the solid.
    reference_point
        (3,) m, of a single interface; by default the centroid of its faces.
    valid
        Whether the solid is known to be valid.

    Raises
    ------
    InputError
        If the solid is invalid, or selectors match no face or every face.
    """
    placement = placement or Placement()
    solid = getattr(solid, "wrapped", solid)
    if not valid:
        solid = cad.validity.valid_solid(solid, name)
    named = dict(loaded) if isinstance(loaded, Mapping) else {"loaded": loaded}
    rest = "clamped"
    if interfaces is not None:
        if len(interfaces) < 2:
            raise InputError(
                f"{name}.interfaces: expected two or more, got {list(interfaces)}"
            )
        (rest, clamped), *others = interfaces.items()
        named = dict(others)
    if reference_point is not None and len(named) > 1:
        none = f"none with {len(named)} interfaces"
        raise InputError(f"{name}.reference_point: expected {none}, got one")
    if reference_point is not None:
        _check_near(solid, reference_point, f"{name}.reference_point")
    solid, selected = select_interfaces(solid, {rest: clamped, **named}, name)
    at_rest = selected.pop(rest)
    vectors = placement.origin, placement.x, placement.z
    origin, x, z = (np.asarray(vector, dtype=float) for vector in vectors)
    moved = cad.kernel.in_axes(solid, origin * 1e3, x, z)
    point = None
    if reference_point is not None:
        point = _axes(x, z) @ (np.asarray(reference_point, dtype=float) - origin)
    geometries = face_geometries(moved)
    ends = (
        Interface(
            key,
            faces,
            centroid_of([geometries[index] for index in sorted(faces)])
            if point is None
            else point,
            (couplings or {}).get(key, ""),
        )
        for key, faces in selected.items()
    )
    return Part(name, moved, material, at_rest, tuple(ends), rest)


class Support(NamedTuple):
    """A way to load or hold a part: name, description, and the keys of the part that it sets."""

    name: str
    words: str
    keys: dict[str, Any]


@dataclass(frozen=True)
class SolidParameters(ABC):
    """A shape: its dimensions, m, and every fact of it that others ask for.

    A field is a key of the robot file: ``Annotated[float, "meaning"]`` is a length, with int a
    count, with Literal a choice. The first paragraph of the class's docstring describes the shape
    in the reference. Shapes are registered in `stiffscope.cad.shapes`.

    Attributes
    ----------
    shape : name in the robot file.
    axes : part axes and reference point, in words.
    required : fields that a robot file must give, besides those without a default.
    along : dimensions from base to tip, on which the places of a body's ends depend.
    is_round : whether all directions across the part are alike.
    is_plate : whether it is too wide for a section of it to contract freely in bending.
    whole_load, whole_clamp : keys by which the whole face is loaded or clamped.
    published : what the source "published" takes, a "formula" or the "table" that the file names.
    """

    shape: ClassVar[str]
    axes: ClassVar[str]
    required: ClassVar[tuple[str, ...]] = ()
    along: ClassVar[frozenset[str]] = frozenset({"length"})
    is_round: ClassVar[bool] = False
    is_plate: ClassVar[bool] = False
    whole_load: ClassVar[dict[str, Any]] = {}
    whole_clamp: ClassVar[dict[str, Any]] = {}
    published: ClassVar[Literal["", "formula", "table"]] = ""

    @property
    def absent(self) -> tuple[str, ...]:
        """Prefixes of unused parameters, those of absent features."""
        return ()

    def present(self) -> Self:
        """Return the solid with unused parameters at their defaults."""
        unused = (field for field in fields(self) if field.name.startswith(self.absent))
        return replace(self, **{field.name: field.default for field in unused})

    def lengths(self) -> dict[str, float]:
        """Return the used lengths (m) by name, except zeros, which omit features."""
        lengths = (field.name for field in fields(self) if is_length(field))
        used = [name for name in lengths if not name.startswith(self.absent)]
        return {name: value for name in used if (value := getattr(self, name))}

    @property
    def span(self) -> float:
        """Distance along x from the clamped faces to the reference point, m."""
        return self.lengths()["length"]

    @property
    @abstractmethod
    def across(self) -> tuple[float, float]:
        """Sizes across the part along y and z, m."""

    def segments(self, poisson: float) -> list[tuple[float, Section]] | None:
        """Return lengths (m) and sections from the clamped end; None without beam theory."""
        _ = poisson
        return None

    @property
    def beyond_beam(self) -> tuple[str, ...]:
        """Features, in words, that `segments` leave out."""
        return ()

    @property
    def bare_volume(self) -> float | None:
        """Volume of the segments, m³; None without beam theory."""
        segments = self.segments(poisson=0.3)
        if segments is None:
            return None
        return sum(length * section.area for length, section in segments)

    @property
    def volume(self) -> float | None:
        """Volume in closed form, m³; None if only the solid has it."""
        return None if self.beyond_beam else self.bare_volume

    def vanishing(self, name: str) -> float:
        """Return the value of a dimension at which no wall is left, m; else 0."""
        _ = name
        return 0.0

    @property
    def ports(self) -> tuple[str, ...]:
        """Names of separately loaded interfaces; empty if there is one."""
        return ()

    @property
    def loads(self) -> tuple[Support, ...]:
        """Further ways to load the part than on its whole face."""
        return ()

    @property
    def clamps(self) -> tuple[Support, ...]:
        """Further ways to hold the part than by its whole face."""
        return ()

    def sketch(self) -> dict[str, Any]:
        """Return what pictures draw before there is a mesh, m: by default a plate or box.

        ``outline``, loops of corners (y, z) extruded along x; ``radius`` of a rod; or ``width`` and
        ``thickness``.
        """
        width, thickness = self.across
        return {"width": width, "thickness": thickness}

    def draw(self) -> Any:
        """Return the shape, drawn with `stiffscope.cad.drawing`, mm."""
        raise NotImplementedError

    def select_ends(self, solid: Any) -> tuple[frozenset[int], tuple[Interface, ...]]:
        """Return the clamped faces, at x = 0, and the interfaces: ``end`` at the far end."""
        clamped, loaded = (select(solid, chosen) for chosen in (LEAST_X, GREATEST_X))
        return clamped, (Interface("end", loaded, np.array([self.span, 0.0, 0.0])),)


def is_length(field: Field[Any]) -> bool:
    """Return whether a field of a shape is a length."""
    return getattr(field.type, "__origin__", field.type) is float


def build(
    parameters: SolidParameters, material: AnyMaterial = STEEL, name: str = "part"
) -> Part:
    """Build a part from its dimensions.

    Parameters
    ----------
    parameters
        Dimensions of a link, a slider or a beam.
    material
        Linear elastic material.
    name
        Name of the part for messages and files.

    Raises
    ------
    InputError
        If the CAD kernel cannot make the solid.
    """
    solid = cad.validity.valid_solid(parameters.draw(), name)
    return Part(name, solid, material, *parameters.select_ends(solid))


def _check_near(solid: Any, point: Vector, field: str) -> None:
    require(is_point(point), field, POINT, repr(point))
    centre = cad.kernel.xyz(cad.kernel.volume_properties(solid).CentreOfMass()) * 1e-3
    reach = cad.kernel.diagonal(solid) * 1e-3 * 100
    valid = (
        f"a point within {reach:.3g} m of the solid's centre, 100 times its diagonal"
    )
    require(math.dist(point, centre) <= reach, field, valid, f"{point} m")


def _axes(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return unit vectors along x, y, z as rows (3, 3)."""
    x = x / np.linalg.norm(x)
    z = z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])

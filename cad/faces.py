"""Faces of a solid: geometry, listing, and selection by geometry."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stiffscope import cad
from stiffscope.cad.checks import POINT, direction, is_point, mm, require
from stiffscope.errors import InputError, say_count

if TYPE_CHECKING:
    from stiffscope.cad.kernel import Face, Shape

KINDS = ("plane", "cylinder", "cone", "sphere", "torus", "other")
ENDS = tuple(f"{end} {axis}" for axis in "xyz" for end in ("min", "max"))
ANGLE = np.deg2rad(1.0)  # tolerance of equal directions
DISTANCE = 1e-5  # m: tolerance of equal places and radii


@dataclass(frozen=True, eq=False)
class FaceGeometry:
    """Geometry of one face, in part axes. Quantities that do not apply to its kind are zero.

    Attributes
    ----------
    index : index in the solid's list of faces.
    kind : one of `KINDS`.
    area : area, m².
    centroid : centroid (3,), m.
    origin : (3,) m; a point of a plane or of a cylinder's or cone's axis; centre of a sphere or
        torus.
    axis : (3,) unit vector; outward normal of a plane, otherwise axis of revolution.
    radius : m; at `origin` for a cone, the major one for a torus.
    half_angle : rad, of a cone; the radius grows along `axis`.
    minor_radius : m, of a torus.
    hollow : whether the material is outside a round face, as for a bore.
    extent : m; ends of a cylinder or cone from `origin` along `axis`, ascending.
    """

    index: int
    kind: str
    area: float
    centroid: NDArray[np.float64]
    origin: NDArray[np.float64]
    axis: NDArray[np.float64]
    radius: float = 0.0
    half_angle: float = 0.0
    minor_radius: float = 0.0
    hollow: bool = False
    extent: tuple[float, float] = (0.0, 0.0)

    def move(
        self, rotation: NDArray[np.floating[Any]], origin: NDArray[np.floating[Any]]
    ) -> "FaceGeometry":
        """Return the face rotated by (3, 3), then translated by `origin` (3,)."""
        places = {
            name: rotation @ getattr(self, name) + origin
            for name in ("centroid", "origin")
        }
        return replace(self, **places, axis=rotation @ self.axis)

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the closest points (n, 3), m, of an unbounded plane or round form, or None."""
        if self.kind == "plane":
            return points - np.outer((points - self.origin) @ self.axis, self.axis)
        if self.kind == "sphere":
            up = np.array([0.0, 0.0, 1.0])
            return self.origin + self.radius * _directions(points - self.origin, up)
        return (
            _on_round(self, points)
            if self.kind in {"cylinder", "cone", "torus"}
            else None
        )


def _on_round(face: FaceGeometry, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Project in the half plane through the axis, in which the surface is a line or a circle."""
    lever = points - face.origin
    height = lever @ face.axis  # (n,)
    across = lever - np.outer(height, face.axis)
    distance = np.linalg.norm(across, axis=1)
    perpendicular = np.cross(face.axis, np.eye(3)[np.argmin(np.abs(face.axis))])
    outward = _directions(across, perpendicular / np.linalg.norm(perpendicular))
    if face.kind == "torus":
        spoke = np.column_stack([distance - face.radius, height])
        spoke = face.minor_radius * _directions(spoke, np.array([1.0, 0.0]))
        distance = face.radius + spoke[:, 0]
        height = spoke[:, 1]
    else:
        sine = np.sin(face.half_angle)
        cosine = np.cos(face.half_angle)
        along = (distance - face.radius) * sine + height * cosine
        distance = face.radius + along * sine
        height = along * cosine
    return face.origin + np.outer(height, face.axis) + distance[:, None] * outward


def _directions(
    vectors: NDArray[np.float64], otherwise: NDArray[Any]
) -> NDArray[np.float64]:
    """Normalize vectors (n, k); a zero vector becomes `otherwise` (k,)."""
    lengths = np.linalg.norm(vectors, axis=1)
    units = np.tile(otherwise, (len(vectors), 1))
    units[lengths > 0] = vectors[lengths > 0] / lengths[lengths > 0, None]
    return units


def face_geometries(shape: "Shape") -> tuple[FaceGeometry, ...]:
    """Return the geometry of each face of the shape, in order (SI)."""
    return tuple(
        _geometry(index, face) for index, face in enumerate(cad.kernel.faces(shape))
    )


def _geometry(index: int, face: "Face") -> FaceGeometry:
    properties = cad.kernel.area_properties(face)
    kind, form = cad.kernel.surface_under(face)
    origin = np.zeros(3)
    axis = np.zeros(3)
    sizes = dict[str, Any]()
    if form is not None:
        origin = cad.kernel.xyz(form.Location()) * 1e-3
        if kind != "sphere":
            axis = cad.kernel.xyz(form.Axis().Direction())
        sizes = _sizes(kind, form)
    if sizes:
        angle = sizes.get("half_angle", 0.0)
        hollow, ends = cad.kernel.round_extent(face, 1e3 * origin, axis, angle)
        sizes |= {"hollow": hollow, "extent": tuple(1e-3 * ends)}
    if kind == "plane":
        axis = axis * np.sign(axis @ cad.kernel.middle_of(face)[1])
    return FaceGeometry(
        index=index,
        kind=kind,
        area=properties.Mass() * 1e-6,
        centroid=cad.kernel.xyz(properties.CentreOfMass()) * 1e-3,
        origin=origin,
        axis=axis,
        **sizes,
    )


def _sizes(kind: str, form: Any) -> dict[str, Any]:
    if kind in {"cylinder", "sphere"}:
        return {"radius": form.Radius() * 1e-3}
    if kind == "cone":
        return {"radius": form.RefRadius() * 1e-3, "half_angle": form.SemiAngle()}
    if kind == "torus":
        return {
            "radius": form.MajorRadius() * 1e-3,
            "minor_radius": form.MinorRadius() * 1e-3,
        }
    return {}


def centroid_of(faces: Sequence[FaceGeometry]) -> NDArray[np.float64]:
    """Return the common centroid (3,), m, of faces."""
    areas = [face.area for face in faces]
    return np.average([face.centroid for face in faces], axis=0, weights=areas)


@dataclass(frozen=True)
class FaceSelector:
    """Selection of faces by geometry: selected faces meet all given conditions.

    Parameters
    ----------
    kind
        One of `KINDS`.
    normal
        Outward normal of a plane, or axis (of either sign) of a round face, within 1 degree.
    position
        "min x", "max z", ...: of the faces that meet the other conditions, those with the farthest
        centroid in that direction; or a point (3,) in m: the faces that contain it within 0.01 mm
        or, if there are none, those with this centroid.
    radius
        m; of a torus the minor one.
    index
        Index or indices in the listing of faces.
    washer
        m; selects annuli of this outer diameter around round holes of plane faces instead of faces.
        The other conditions apply to the hole: radius, centre, normal and index of its face.

    Raises
    ------
    InputError
        If there is no condition, or one that no face can meet.
    """

    kind: str | None = None
    normal: Sequence[float] | None = None
    position: str | Sequence[float] | None = None
    radius: float | None = None
    index: int | Sequence[int] | None = None
    washer: float | None = None

    def __post_init__(self) -> None:
        given = any(value is not None for value in self.__dict__.values())
        require(
            given, "selector", f"at least one of {', '.join(self.__dict__)}", "none"
        )
        known = self.kind is None or self.kind in KINDS
        require(known, "selector.kind", f"one of {', '.join(KINDS)}", repr(self.kind))
        if self.normal is not None:
            direction("selector.normal", self.normal)
        for name, size in (("radius", self.radius), ("washer", self.washer)):
            positive = size is None or (isinstance(size, Real) and 0 < size < np.inf)
            require(positive, f"selector.{name}", "a positive length", repr(size))
        end = isinstance(self.position, str) and self.position in ENDS
        valid = self.position is None or end or is_point(self.position)
        ends = f"one of {', '.join(ENDS)} or {POINT}"
        require(valid, "selector.position", ends, repr(self.position))

    def __str__(self) -> str:
        """Return the conditions as text, lengths in mm as in the listing."""
        given = {
            name: value for name, value in self.__dict__.items() if value is not None
        }
        given |= {key: mm(given[key]) for key in ("radius", "washer") if key in given}
        if self.position is not None and not isinstance(self.position, str):
            given["position"] = (
                "(" + ", ".join(f"{x * 1e3:.6g}" for x in self.position) + ") mm"
            )
        return ", ".join(f"{name} = {value}" for name, value in given.items())


def select(
    shape: "Shape", selectors: Iterable[FaceSelector], field: str = "faces"
) -> frozenset[int]:
    """Return the indices of faces that at least one selector selects.

    Raises InputError, which names the ``field`` and lists the faces, if a selector matches no face,
    or all together every face.

    Parameters
    ----------
    shape, selectors
        Solid, and selectors of its faces.
    field
        Field named in messages.
    """
    geometries = face_geometries(shape)
    faces = cad.kernel.faces(shape)
    chosen: set[int] = set()

    def contains(face: FaceGeometry, point: NDArray[np.float64]) -> bool:
        return cad.kernel.distance(faces[face.index], 1e3 * point) < 1e3 * DISTANCE

    for selector in selectors:
        matches = {face.index for face in match_faces(geometries, selector, contains)}
        if not matches:
            raise InputError(
                f"{field}: no face has {selector}; there are {_summary(geometries)}"
            )
        chosen |= matches
    if not chosen:
        raise InputError(f"{field}: expected at least one face selector, got none")
    if len(chosen) == len(geometries):
        got = f"all {len(chosen)}; there are {_summary(geometries)}"
        raise InputError(f"{field}: expected some of the faces, got {got}")
    return frozenset(chosen)


def match_faces(
    geometries: Sequence[FaceGeometry],
    selector: FaceSelector,
    contains: Callable[[FaceGeometry, NDArray[np.float64]], bool],
) -> list[FaceGeometry]:
    """Return faces that meet a selector; ``contains`` tests if a face contains a point (3,), m."""
    faces = [face for face in geometries if _meets(face, selector)]
    position = selector.position
    if isinstance(position, str) and faces:
        end, axis = position.split()
        along = np.array([face.centroid["xyz".index(axis)] for face in faces])
        furthest = along.min() if end == "min" else along.max()
        faces = [
            face
            for face, x in zip(faces, along, strict=True)
            if abs(x - furthest) < DISTANCE
        ]
    elif position is not None and not isinstance(position, str):
        point = np.asarray(position, dtype=float)
        on = [face for face in faces if contains(face, point)]
        faces = on or [
            face for face in faces if np.linalg.norm(face.centroid - point) < DISTANCE
        ]
    return faces


def _meets(face: FaceGeometry, selector: FaceSelector) -> bool:
    if selector.kind is not None and face.kind != selector.kind:
        return False
    if selector.index is not None and face.index not in np.atleast_1d(selector.index):
        return False
    radius = face.minor_radius or face.radius
    if selector.radius is not None and abs(radius - selector.radius) > DISTANCE:
        return False
    if selector.normal is None:
        return True
    wanted = np.asarray(selector.normal, dtype=float)
    cosine = face.axis @ wanted / np.linalg.norm(wanted)
    return bool((cosine if face.kind == "plane" else abs(cosine)) > np.cos(ANGLE))


def _summary(geometries: Sequence[FaceGeometry]) -> str:
    """Summarize the faces in one line."""
    planes = sorted(
        {_direction(face.axis) for face in geometries if face.kind == "plane"}
    )
    words = [f"planes with normal {', '.join(_few(planes))}"] if planes else []
    for kind in KINDS[1:-1]:
        alike = (face for face in geometries if face.kind == kind)
        radii = sorted(
            {round((face.minor_radius or face.radius) * 1e3, 3) for face in alike}
        )
        if radii:
            words.append(
                f"{kind} of radius {', '.join(_few([f'{r:g}' for r in radii]))} mm"
            )
    others = sum(face.kind == "other" for face in geometries)
    words += [f"{others} of other kinds"] if others else []
    return f"{say_count(len(geometries), 'face')}: {'; '.join(words)} (list them with `stiffscope faces FILE`)"


def _few(words: list[str]) -> list[str]:
    return words if len(words) <= 8 else [*words[:8], "..."]


def _direction(axis: NDArray[np.float64]) -> str:
    for name, unit in zip("xyz", np.eye(3), strict=True):
        for sign, end in (("-", -unit), ("+", unit)):
            if axis @ end > np.cos(ANGLE):
                return sign + name
    return "(" + " ".join(f"{value:.3g}" for value in axis) + ")"


def describe(shape: "Shape") -> list[dict[str, Any]]:
    """Return a listing of the faces.

    Returns
    -------
    list of dict
        For each face ``index``, ``kind``, ``area_mm2``, ``centroid_mm`` (3,), ``axis`` (3,; outward
        normal of a plane, axis of a round face, else None), ``radius_mm`` (None if it has none).
    """
    return [
        {
            "index": face.index,
            "kind": face.kind,
            "area_mm2": face.area * 1e6,
            "centroid_mm": _round_vector(face.centroid * 1e3),
            "axis": _round_vector(face.axis) if face.axis.any() else None,
            "radius_mm": round((face.minor_radius or face.radius) * 1e3, 6) or None,
        }
        for face in face_geometries(shape)
    ]


def _round_vector(vector: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(float(value) for value in np.round(vector, 6) + 0.0)

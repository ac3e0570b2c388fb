"""A part: a solid with its material, where it is held and where it is loaded; what others need to know of it.

A part's coordinates are its reference axes. Outside of this room everything is in SI and plain numpy.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stiffscope.cad.faces import FaceGeometry, face_geometries
from stiffscope.cad.materials import AnyMaterial
from stiffscope.errors import InputError

if TYPE_CHECKING:
    from stiffscope.cad.kernel import Shape, Solid

Floats = NDArray[np.float64]
SMOOTH = np.deg2rad(20.0)  # faces that meet at less leave a mesher no edge to keep


@dataclass(frozen=True, eq=False)
class Interface:
    """Where a load enters: faces, by index, and the point (3,) in m that its twist and wrench refer to."""

    name: str
    faces: frozenset[int]
    reference_point: Floats


@dataclass(frozen=True, eq=False)
class Part:
    """A solid (of the kernel, in mm) held at `clamped` and loaded at `loaded`.

    A face's index is its position in `kernel.faces(solid)`, the order of build123d's `solid.faces()`. The
    compliance of a part refers to `loaded[0].reference_point`.
    """

    name: str
    solid: "Solid"
    material: AnyMaterial
    clamped: frozenset[int]
    loaded: tuple[Interface, ...]

    def __post_init__(self) -> None:
        """Raise InputError unless the face sets are non-empty, exist and are apart from one another."""
        taken: dict[int, str] = {}
        for name, chosen in (("clamped", self.clamped), *((one.name, one.faces) for one in self.loaded)):
            if not chosen:
                raise InputError(f"{self.name}.{name}: expected at least one face, got none")
            for index in sorted(chosen):
                if not 0 <= index < len(self.faces):
                    raise InputError(f"{self.name}.{name}: expected faces from 0 to {len(self.faces) - 1}, got {index}")
                if index in taken:
                    raise InputError(
                        f"{self.name}.{name}: expected faces that nothing else takes, "
                        f"got face {index}, which is of {taken[index]} too"
                    )
                taken[index] = name
        if not self.loaded:
            raise InputError(f"{self.name}.loaded: expected at least one loaded interface, got none")

    @cached_property
    def faces(self) -> tuple[FaceGeometry, ...]:
        """What each face is, in order."""
        return face_geometries(self.solid)

    @cached_property
    def seams(self) -> dict[tuple[int, int], "Shape"]:
        """Pairs of faces that pass into one another smoothly where an interface ends, with the edges between them."""
        from stiffscope.cad import kernel

        interfaces = (self.clamped, *(port.faces for port in self.loaded))
        owner = {face: number for number, chosen in enumerate(interfaces) for face in chosen}
        faces = kernel.faces(self.solid)
        return {
            (a, b): kernel.compound(*edges)
            for (a, b), edges in kernel.borders(self.solid).items()
            if owner.get(a) != owner.get(b) and any(kernel.turn(edge, faces[a], faces[b]) < SMOOTH for edge in edges)
        }


@dataclass(frozen=True, eq=False)
class Surface:
    """The part's surface as plain numpy: closed, outward, with the face of each triangle.

    `vertices` (nv, 3) in m, `triangles` (nt, 3), `face_of_triangle` (nt,), `faces` by index, `seams` as in `Part`.
    """

    vertices: Floats
    triangles: NDArray[np.int64]
    face_of_triangle: NDArray[np.int64]
    faces: tuple[FaceGeometry, ...]
    seams: tuple[tuple[int, int], ...] = ()


def surface(part: Part, deflection: float = 5e-4, angle: float = 0.8) -> Surface:
    """Tessellate the part: chords within `deflection` m of the surface and `angle` rad of one another.

    InputError when the surface does not close.
    """
    vertices, triangles, face_of_triangle = tessellated(part.solid, deflection, angle)
    gaps = open_edges(triangles)
    if gaps:
        raise InputError(f"{part.name}: expected a closed surface, got {gaps} open edges in its tessellation")
    return Surface(vertices, triangles, face_of_triangle, part.faces, tuple(part.seams))


def tessellated(solid: "Solid", deflection: float, angle: float) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Return vertices (nv, 3) in m, each once, outward triangles (nt, 3) and the face of each (nt,)."""
    from stiffscope.cad import kernel

    pieces = kernel.triangulated(solid, deflection * 1e3, angle)
    nodes = np.concatenate([nodes for nodes, _ in pieces])
    starts = np.cumsum([0] + [len(nodes) for nodes, _ in pieces[:-1]])
    triangles = np.concatenate([piece + start for (_, piece), start in zip(pieces, starts, strict=True)])
    face_of_triangle = np.repeat(np.arange(len(pieces)), [len(piece) for _, piece in pieces])
    vertices, number = _merged(nodes)
    triangles = number[triangles]
    a, b, c = triangles.T
    kept = (a != b) & (b != c) & (c != a)
    return vertices * 1e-3, triangles[kept], face_of_triangle[kept]


def _merged(nodes: Floats, step: float = 1e-5) -> tuple[Floats, NDArray[np.int64]]:
    """Merge nodes (n, 3) that are the same up to rounding (in mm): return them once and each one's number.

    The kernel gives the nodes of a border to both faces, equal to 1e-13; the grid that they are compared on is
    shifted off all round numbers, and a pair that it parts all the same shows as an open edge.
    """
    cells = np.floor(nodes / step + (np.sqrt(2) - 1)).astype(np.int64)
    _, first, number = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return nodes[first], number.reshape(-1)


def open_edges(triangles: NDArray[np.int64]) -> int:
    """Count the edges of triangles (nt, 3) that do not run once each way: zero for a closed surface."""
    directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    base = triangles.max(initial=0) + 1
    there, times = np.unique(directed[:, 0] * base + directed[:, 1], return_counts=True)
    back = directed[:, 1] * base + directed[:, 0]
    return int(np.count_nonzero(~np.isin(there, back)) + np.count_nonzero(times > 1))


def project(part: Part, place: int, points: Floats) -> Floats:
    """Return the points (n, 3) of the surface under a face that are closest to `points` (n, 3), in m.

    Places after those of the faces are the edges of the part's seams.
    """
    from stiffscope.cad.projection import on_shape, projected

    points = np.asarray(points, dtype=float)
    if place >= len(part.faces):
        return on_shape(list(part.seams.values())[place - len(part.faces)], points)
    return projected(part.solid, part.faces[place], points)


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Volume in m3, mass in kg, mass centre (3,) in m, inertia (3, 3) about it in kg m2; the part's axes."""

    volume: float
    mass: float
    centre: Floats
    inertia: Floats


def mass_properties(part: Part) -> MassProperties:
    """Return the mass properties of the exact shape, not of a tessellation."""
    from stiffscope.cad import kernel

    properties, density = kernel.volume_properties(part.solid), part.material.density
    volume = properties.Mass() * 1e-9
    centre = kernel.xyz(properties.CentreOfMass()) * 1e-3
    return MassProperties(volume, volume * density, centre, kernel.inertia(properties) * 1e-15 * density)


def geometry_digest(part: Part) -> str:
    """Return a hash (hex) of all that determines the part's compliance: shape, faces chosen, material.

    The same in every process; the part's name is not in it. Lengths count to 1e-6 mm, moments to nine digits.
    """
    digest = hashlib.sha256()
    for line in _description(part):
        digest.update(line.encode() + b"\n")
    return digest.hexdigest()


def _description(part: Part) -> Iterator[str]:
    from stiffscope.cad import kernel

    properties = kernel.volume_properties(part.solid)
    yield _digits(properties.Mass(), *kernel.inertia(properties).flat)
    yield _lengths(kernel.xyz(properties.CentreOfMass()))
    for geometry, face in zip(part.faces, kernel.faces(part.solid), strict=True):
        yield geometry.kind
        yield _lengths(*(1e3 * v for v in (geometry.origin, geometry.centroid)), geometry.axis)
        yield _digits(geometry.area, geometry.radius, geometry.half_angle, geometry.minor_radius)
        yield _digits(*kernel.inertia(kernel.area_properties(face)).flat)
    for edge in kernel.edges(part.solid):
        yield _lengths(kernel.middle(edge))
    for vertex in kernel.vertices(part.solid):
        yield _lengths(kernel.position(vertex))
    yield f"{sorted(part.clamped)}"
    for interface in part.loaded:
        yield f"{interface.name} {sorted(interface.faces)} {_lengths(interface.reference_point * 1e3)}"
    values = (value for value in astuple(part.material)[1:] if not isinstance(value, str))
    yield type(part.material).__name__ + _digits(*values)


def _lengths(*vectors: Floats) -> str:
    return " ".join(f"{value:.6f}" for value in np.round(np.concatenate(vectors), 6) + 0.0)


def _digits(*values: float) -> str:
    """Nine digits of each value; what is 1e-12 of the largest or less is rounding error, and zero."""
    least = 1e-12 * max(map(abs, values), default=0)
    return " ".join(f"{value:.8e}" if abs(value) > least else "0" for value in values)

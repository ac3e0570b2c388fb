"""A part: solid, material, clamped faces and loaded interfaces; its surface and mass properties.

Part coordinates are its reference axes. Values outside this package are SI and plain NumPy.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stiffscope import cad
from stiffscope.cad.checks import require
from stiffscope.cad.faces import FaceGeometry, face_geometries
from stiffscope.cad.materials import AnyMaterial

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stiffscope.cad.kernel import Shape, Solid

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_FINER = 3  # times that a tessellation with gaps is made finer, each by a factor of 5
SMOOTH = np.deg2rad(
    20.0
)  # the mesher keeps no edges between faces whose normals differ by less


@dataclass(frozen=True, eq=False)
class Interface:
    """A loaded interface: faces that transmit a wrench.

    Attributes
    ----------
    name : name of the interface, unique in its part.
    faces : indices of the solid's faces.
    reference_point : (3,) m, reference point of twist and wrench.
    coupling : "rigid" (one body) or "distributed" (evenly loaded); empty: that of the experiment.
    """

    name: str
    faces: frozenset[int]
    reference_point: Floats
    coupling: str = ""


@dataclass(frozen=True, eq=False)
class Part:
    """A solid with a material, clamped faces and loaded interfaces.

    A face's index is its position in `kernel.faces(solid)`, the order of build123d's
    `solid.faces()`. The part's compliance refers to `loaded[0].reference_point`.

    Parameters
    ----------
    name
        Name of the part for messages and files.
    solid
        Solid of the CAD kernel, mm.
    material
        Linear elastic material.
    clamped
        Indices of the clamped faces.
    loaded
        Interfaces that transmit wrenches.
    rest
        Name of the interface at rest, the clamped faces.

    Raises
    ------
    InputError
        If clamped faces or interfaces are missing, or a face index is invalid or used twice.
    """

    name: str
    solid: "Solid"
    material: AnyMaterial
    clamped: frozenset[int]
    loaded: tuple[Interface, ...]
    rest: str = "clamped"

    def __post_init__(self) -> None:
        taken: dict[int, str] = {}
        interfaces = self.clamped, *(one.faces for one in self.loaded)
        for name, chosen in zip(self.names, interfaces, strict=True):
            field = f"{self.name}.{name}"
            last = len(self.faces) - 1
            require(bool(chosen), field, "at least one face", "none")
            for index in sorted(chosen):
                require(0 <= index <= last, field, f"faces from 0 to {last}", index)
                got = f"face {index}, which belongs to {taken.get(index)} too"
                require(
                    index not in taken, field, "faces that no other interface uses", got
                )
                taken[index] = name
        field = f"{self.name}.loaded"
        require(bool(self.loaded), field, "at least one loaded interface", "none")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all interfaces, the one at rest first."""
        return self.rest, *(interface.name for interface in self.loaded)

    @cached_property
    def faces(self) -> tuple[FaceGeometry, ...]:
        """Geometry of each face, in order."""
        return face_geometries(self.solid)

    @cached_property
    def smooth_borders(self) -> dict[tuple[int, int], "Shape"]:
        """Pairs of adjacent faces with nearly equal normals at the border, and common edges."""
        return self._smooth(lambda _a, _b: True)

    @cached_property
    def seams(self) -> dict[tuple[int, int], "Shape"]:
        """Smooth borders between interfaces."""
        interfaces = (self.clamped, *(interface.faces for interface in self.loaded))
        owner = {
            face: number for number, faces in enumerate(interfaces) for face in faces
        }
        return self._smooth(lambda a, b: owner.get(a) != owner.get(b))

    def _smooth(
        self, wanted: "Callable[[int, int], bool]"
    ) -> dict[tuple[int, int], "Shape"]:
        faces = cad.kernel.faces(self.solid)
        angle = cad.kernel.normal_angle
        return {
            (a, b): cad.kernel.compound(*edges)
            for (a, b), edges in cad.kernel.borders(self.solid).items()
            if wanted(a, b)
            and any(angle(edge, (faces[a], faces[b])) < SMOOTH for edge in edges)
        }


@dataclass(frozen=True, eq=False)
class Surface:
    """Tessellated surface of a part: closed, with outward triangles.

    Attributes
    ----------
    vertices : (nv, 3) m.
    triangles : (nt, 3) vertex indices.
    face_of_triangle : (nt,) index of the CAD face of each triangle.
    faces : geometry of the CAD faces, by index.
    seams : pairs of faces, as in `Part.seams`.
    """

    vertices: Floats
    triangles: Ints
    face_of_triangle: Ints
    faces: tuple[FaceGeometry, ...]
    seams: tuple[tuple[int, int], ...] = ()


def surface(part: Part, deflection: float = 5e-4, angle: float = 0.8) -> Surface:
    """Tessellate a part; raise InputError if the result is not closed.

    Parameters
    ----------
    part
        Part whose solid is tessellated.
    deflection
        Largest distance between a chord and the surface, m.
    angle
        Largest angle between neighbouring chords, rad.
    """
    vertices, triangles, face_of_triangle = tessellate_closed(
        part.solid, deflection, angle
    )
    gaps = open_edges(triangles)
    require(
        not gaps,
        part.name,
        "a closed surface",
        f"{gaps} open edges in its tessellation",
    )
    return Surface(vertices, triangles, face_of_triangle, part.faces, tuple(part.seams))


def tessellate(
    solid: "Solid", deflection: float, angle: float
) -> tuple[Floats, Ints, Ints]:
    """Return vertices (nv, 3), m, outward triangles (nt, 3) and each triangle's face (nt,)."""
    pieces = cad.kernel.triangulate(solid, deflection * 1e3, angle)
    nodes = np.concatenate([nodes for nodes, _ in pieces])
    starts = np.cumsum([0] + [len(nodes) for nodes, _ in pieces[:-1]])
    numbered = zip(pieces, starts, strict=True)
    triangles = np.concatenate([piece + start for (_, piece), start in numbered])
    face_of_triangle = np.repeat(
        np.arange(len(pieces)), [len(piece) for _, piece in pieces]
    )
    vertices, number = _merge_nodes(nodes)
    triangles = number[triangles]
    a, b, c = triangles.T
    distinct = (a != b) & (b != c) & (c != a)
    return vertices * 1e-3, triangles[distinct], face_of_triangle[distinct]


def tessellate_closed(
    solid: "Solid", deflection: float, angle: float
) -> tuple[Floats, Ints, Ints]:
    """Do as `tessellate`, up to a hundred times finer where the surface has gaps otherwise."""
    tessellation = tessellate(solid, deflection, angle)
    for _ in range(_FINER):
        if not open_edges(tessellation[1]):
            break
        deflection *= 0.2
        angle = max(0.5 * angle, 0.1)
        tessellation = tessellate(solid, deflection, angle)
    return tessellation


def _merge_nodes(nodes: Floats) -> tuple[Floats, Ints]:
    """Merge coincident nodes (n, 3), mm; return the distinct ones and the index of each node.

    Faces at a border share its nodes to 1e-13. Nodes are compared on a grid with an offset that
    avoids round numbers; a pair split by the grid shows as an open edge.
    """
    cells = np.floor(nodes / 1e-5 + (np.sqrt(2) - 1)).astype(np.int64)
    _, first, number = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return nodes[first], number.reshape(-1)


def open_edges(triangles: Ints) -> int:
    """Count edges of triangles (nt, 3) not used once in each direction: 0 for a closed surface."""
    return len(_open_sides(triangles))


def find_open_edge(vertices: Floats, triangles: Ints) -> Floats:
    """Return the middle (3,) of an open edge of a surface that has one."""
    return vertices[_open_sides(triangles)[0]].mean(axis=0)


def _open_sides(triangles: Ints) -> Ints:
    """Return the directed sides (k, 2) without exactly one partner in the other direction."""
    directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    base = triangles.max(initial=0) + 1
    there, first, times = np.unique(
        directed[:, 0] * base + directed[:, 1], return_index=True, return_counts=True
    )
    back = directed[:, 1] * base + directed[:, 0]
    alone = np.concatenate([first[~np.isin(there, back)], first[times > 1]])
    return directed[alone]


def project(
    part: Part, place: int, points: Floats, borders: "Sequence[Shape] | None" = None
) -> Floats:
    """Return the closest points (n, 3), m, on a face's surface, or on a border of faces.

    Planes and round surfaces are unbounded, others bounded by the face's parameter range.

    Parameters
    ----------
    part
        Part with its faces.
    place
        Index of a face, or ``len(part.faces) + k`` for the k-th border.
    points
        Points to project (n, 3), m.
    borders
        Borders of faces; by default the part's seams.
    """
    points = np.asarray(points, dtype=float)
    if place >= len(part.faces):
        border = list(borders or part.seams.values())[place - len(part.faces)]
        closest = [cad.kernel.closest(border, point) for point in points * 1e3]
        return np.array(closest).reshape(-1, 3) * 1e-3
    projection = part.faces[place].project(points)
    if projection is None:
        projection = (
            cad.kernel.closest_under(cad.kernel.faces(part.solid)[place], points * 1e3)
            * 1e-3
        )
    return projection


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass properties in part axes.

    Attributes
    ----------
    volume : m³.
    mass : kg.
    centre : (3,) centre of mass, m.
    inertia : (3, 3) about the centre of mass, kg·m².
    """

    volume: float
    mass: float
    centre: Floats
    inertia: Floats


def mass_properties(part: Part) -> MassProperties:
    """Return the mass properties of the exact shape, without tessellation."""
    properties = cad.kernel.volume_properties(part.solid)
    density = part.material.density
    volume = properties.Mass() * 1e-9
    centre = cad.kernel.xyz(properties.CentreOfMass()) * 1e-3
    inertia = cad.kernel.inertia(properties) * 1e-15 * density
    return MassProperties(volume, volume * density, centre, inertia)

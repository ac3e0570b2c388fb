"""From a closed CAD surface to linear tetrahedra, and the quadratic mesh of experiments."""

# pyright: reportOptionalSubscript=false
# (scikit-fem declares its types loosely)

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stiffscope.errors import InputError
from stiffscope.runtime.collection import no_collection
from stiffscope.runtime.executor import LateError, WorkerError, do_alone
from stiffscope.runtime.processors import processors

if TYPE_CHECKING:
    from collections.abc import Collection

    from skfem import MeshTet2

    from stiffscope.cad.faces import FaceGeometry
    from stiffscope.cad.part import Surface

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Project = Callable[[int, Floats], Floats]

logger = logging.getLogger(__name__)

MOST_ELEMENTS = 2e6
MESHING = 0.4e-3
SOLVING = 2.5e-3  # processor seconds per element, twice those of a slider; half the latter for modes
MISJUDGED = (
    1.75  # ratio of estimate to time left to refuse meshing: two processors are faster
)
PLANE = 0.8  # share of plane area for flat elements in thin walls; curved walls need small ones
ENERGY = (
    10.0  # largest distortion energy that the mesher leaves; 3 for a regular element
)
FIN = 0.06  # depth of the fins at seams in element sizes; deeper fins cause spurious elements

# The six edges and four outward faces of a tetrahedron, in the order of VTK's (scikit-fem's) tet10.
EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
SIDES = np.array([[0, 1], [1, 2], [2, 0]])  # of a triangle
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
FACE_MIDS = np.array(
    [[6, 5, 4], [4, 8, 7], [5, 9, 8], [7, 9, 6]]
)  # (v0v1, v1v2, v2v0) by face


class MeshError(InputError):
    """The solid cannot be meshed or solved: too fine for the time limit, or an invalid surface."""


@dataclass(frozen=True)
class TetMesh:
    """Quadratic tetrahedra with curved sides; lengths in metres.

    Attributes
    ----------
    points : (n, 3) node positions: vertices, then edge midpoints, in scikit-fem's order.
    cells : (m, 10) nodes of each tetrahedron, VTK's order (4 corners, then midpoints of ``EDGES``).
    facets : (k, 6) nodes of each boundary triangle (3 corners, then 3 midpoints), outward.
    facet_face : (k,) CAD face number of each boundary triangle.
    pulled_back : number of elements moved back because snapping inverted them.
    """

    points: Floats
    cells: Ints
    facets: Ints
    facet_face: Ints
    pulled_back: int = 0

    @cached_property
    def grid(self) -> MeshTet2:
        """The scikit-fem mesh; boundary ``str(face)`` contains the facets on that CAD face."""
        from skfem import MeshTet2

        corners = np.ascontiguousarray(self.cells[:, :4].T, dtype=np.int32)
        grid = MeshTet2(np.ascontiguousarray(self.points.T), corners)
        number = np.empty(len(self.facets), dtype=np.int64)
        outer = grid.boundary_facets()
        order = np.lexsort(np.sort(self.facets[:, :3], axis=1).T)
        number[order] = outer[np.lexsort(grid.facets[:, outer])]
        faces = np.unique(self.facet_face)
        return grid.with_boundaries(
            {str(face): number[self.facet_face == face] for face in faces}
        )

    @cached_property
    def is_curved(self) -> NDArray[np.bool_]:
        """Whether each tetrahedron has curved sides, (m,)."""
        ends = self.points[self.cells[:, EDGES]]  # (m, 6, 2, 3)
        sag = np.linalg.norm(self.points[self.cells[:, 4:]] - ends.mean(axis=2), axis=2)
        length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
        return (sag > 1e-8 * length).any(axis=1)

    def facets_of(self, faces: frozenset[int]) -> Ints:
        """Return the boundary triangles (k, 6) on CAD faces."""
        return self.facets[np.isin(self.facet_face, list(faces))]

    def nodes_of(self, faces: frozenset[int]) -> Ints:
        """Return the sorted nodes (k,) on CAD faces."""
        return np.unique(self.facets_of(faces))


def compact(mesh: TetMesh) -> TetMesh:
    """Remove nodes that no element uses."""
    used, cells = np.unique(mesh.cells, return_inverse=True)
    cells = cells.reshape(mesh.cells.shape)
    facets = np.searchsorted(used, mesh.facets)
    return replace(mesh, points=mesh.points[used], cells=cells, facets=facets)


def default_size(volume: float, area: float, flatness: float = 1.0) -> float:
    """Return a suitable size (m) of cubic elements for a solid's volume (m³) and area (m²).

    Twice volume over area, about the thickness; larger in thin-walled solids with flat elements.

    Parameters
    ----------
    volume
        Volume of the solid, m³.
    area
        Area of its surface, m².
    flatness
        Allowed aspect ratio of elements; 1 is regular.
    """
    return max(2.0 * volume / area, (volume / 2000) ** (1 / 3) * flatness)


def face_area(faces: Collection[FaceGeometry], kind: str = "") -> float:
    """Return the area, m², of faces, or of those of a kind."""
    return sum(face.area for face in faces if kind in {"", face.kind})


def flatness_of(volume: float, faces: Collection[FaceGeometry]) -> float:
    """Return the allowed aspect ratio of elements, 1 to 2: above 1 for thin, plane walls."""
    area = face_area(faces)
    plane = face_area(faces, "plane")
    flatness = 2.0 * thinness(volume, area) - 2.0 if plane > PLANE * area else 1.0
    return float(np.clip(flatness, 1.0, 2.0))


def thinness(volume: float, area: float) -> float:
    """Return the side of a cube of volume / 2000 (m³) over the plate thickness 2 volume / area."""
    return (volume / 2000) ** (1 / 3) * area / (2 * volume)


def edge_length(mesh: TetMesh) -> float:
    """Return the 90 % quantile (m) of the element edge lengths."""
    ends = mesh.points[mesh.cells[:, :4][:, EDGES]]
    return float(
        np.quantile(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2), 0.9)
    )


def expected_elements(surface: Surface, volume: float, size: float) -> float:
    """Estimate the number of tetrahedra of a size (m), with grading, within a factor of about 1.5.

    Surface triangles are as large as the size, or as the sides of curved faces if these are
    shorter, except for features so narrow that the mesher omits them.

    Parameters
    ----------
    surface
        Triangulated surface of the solid.
    volume
        Volume of the solid, m³.
    size
        Edge length of the elements, m; smaller is more accurate and slower.
    """
    ends = surface.vertices[surface.triangles[:, SIDES]]  # (t, 3, 2, 3)
    sides = ends[:, :, 1] - ends[:, :, 0]
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 2]), axis=1) / 2
    shortest = np.linalg.norm(sides, axis=2).min(axis=1)
    curved = np.array([face.kind != "plane" for face in surface.faces])[
        surface.face_of_triangle
    ]
    finest = min(size, 2 * default_envelope(surface, size))
    sides = np.where(curved, np.clip(shortest, finest, size), size)
    return float(2 * (areas / (0.433 * sides**2)).sum() + 12.0 * volume / size**3)


def check_time(
    elements: float, time_limit: float, cure: str, *, meshed: bool = False
) -> None:
    """Raise MeshError if so many tetrahedra far exceed the time limit (s); warn if they may.

    Parameters
    ----------
    cure : advice on how to need fewer elements.
    meshed : whether they exist, so that only solving is left.
    """
    seconds = (SOLVING if meshed else MESHING + SOLVING) * elements
    done = "solve" if meshed else "mesh and solve"
    told = f"some {_round(elements)} tetrahedra, which take about {_round(seconds)} s to {done}"
    if seconds > MISJUDGED * time_limit:
        enough = _round(1.5 * (MESHING + SOLVING) * elements).replace(",", "")
        raise MeshError(
            f"mesh.time_limit: expected a part that is done in time, got one with {told}, "
            f"where {max(time_limit, 0.0):.0f} s are left; {cure}, or set mesh.time_limit = {enough}"
        )
    if seconds > time_limit:
        logger.warning(
            "mesh: %s, where mesh.time_limit leaves %.0f s; %s", told, time_limit, cure
        )


def _round(number: float) -> str:
    return f"{float(f'{number:.2g}'):,.0f}"


def default_envelope(surface: Surface, size: float) -> float:
    """Return fTetWild's envelope (m): 0.03 sizes, limited to the range in which it is fast.

    At most a tenth of the thickness, even if that is slow, to preserve thin walls.
    """
    reach = diagonal(surface)
    return float(
        min(np.clip(0.03 * size, 3e-4 * reach, 1e-3 * reach), 0.1 * thickness(surface))
    )


def diagonal(surface: Surface) -> float:
    """Return the diagonal (m) of a surface's axis-aligned bounding box."""
    return float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))


def thickness(surface: Surface) -> float:
    """Return twice volume over area (m): a plate's thickness, a bar's radius."""
    return 2 * abs(surface_volume(surface)) / face_area(surface.faces)


def check_lengths(
    name: str, solid: tuple[float, float], size: float | None, envelope: float | None
) -> None:
    """Raise MeshError for a size or envelope too small or too large for this part.

    Parameters
    ----------
    solid : volume (m³) and bounding box diagonal (m).
    """
    volume, diagonal = solid
    finest = (8.5 * volume / MOST_ELEMENTS) ** (
        1 / 3
    )  # a regular tetrahedron has size³ / 8.5
    for kind, value, least, most in (
        ("size", size, finest, diagonal),
        ("envelope", envelope, 1e-5 * diagonal, 0.01 * diagonal),
    ):
        if (
            value is not None and not 0.99 * least <= value <= 1.01 * most
        ):  # rounded in the message
            valid = f"{least * 1e3:.3g} mm to {most * 1e3:.3g} mm for this part"
            raise MeshError(
                f"{name}.mesh.{kind}: expected {valid}, got {value * 1e3:g} mm"
            )


def surface_volume(surface: Surface) -> float:
    """Return the volume (m³) enclosed by a triangulated surface."""
    a, b, c = np.moveaxis(surface.vertices[surface.triangles], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def tetrahedralize(
    surface: Surface,
    size: float,
    envelope: float,
    time_limit: float = 300.0,
    threads: int = 0,
    energy: float = ENERGY,
) -> tuple[Floats, Ints]:
    """Fill a closed surface with linear tetrahedra.

    Parameters
    ----------
    surface : watertight triangles, outward, metres.
    size, envelope : target edge length and allowed distance to the surface, metres.
    time_limit : seconds after which the mesher is killed.
    threads : fTetWild's threads; 0 takes all processors of this process.
    energy : largest distortion energy of an element; see ``ENERGY``.

    Returns
    -------
    Points (n, 3) in metres, and cells (m, 4) with positive orientation.

    Raises
    ------
    MeshError : if the surface is open, the mesher fails or is late, or the volume is 10 % wrong.
    """
    _check_surface(surface, size, envelope)
    depth = min(max(FIN * size, 3 * envelope), 0.3 * thickness(surface))
    vertices, triangles = _with_fins(surface, depth)
    lengths = (
        size * 1e3,
        envelope / diagonal(surface),
    )  # fTetWild's tolerances suit millimetres
    work = vertices * 1e3, triangles, *lengths, threads or processors(), energy
    try:  # a crash, an endless loop and its file in the working folder stay in the child
        points, cells = do_alone(_run_ftetwild, *work, name="mesh", limit=time_limit)
    except LateError:
        cure = "choose a larger size or envelope, or a longer limit"
        raise MeshError(
            f"mesh: not finished within {time_limit:.3g} s; {cure}"
        ) from None
    except WorkerError as error:
        raise MeshError(
            f"mesh: the mesher failed: {str(error).removeprefix('mesh: ')}"
        ) from error
    return _check_tets(points * 1e-3, cells, surface_volume(surface))


def _check_surface(surface: Surface, size: float, envelope: float) -> None:
    """Raise MeshError unless the surface is finite, closed and outward, and the sizes are valid."""
    if not (np.isfinite(size) and size > 0 and np.isfinite(envelope) and envelope > 0):
        got = f"got {size} m and {envelope} m"
        raise MeshError(f"mesh: size and envelope must be positive lengths, {got}")
    vertices = surface.vertices
    triangles = surface.triangles
    if not len(triangles) or not np.isfinite(vertices).all():
        raise MeshError(
            "mesh: the surface is empty or has coordinates that are not finite"
        )
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise MeshError("mesh: the surface's triangles name vertices that do not exist")
    sides = triangles[:, SIDES].reshape(-1, 2)
    keys, mirrored = (
        np.sort(directed @ [len(vertices), 1]) for directed in (sides, sides[:, ::-1])
    )
    if not np.array_equal(keys, mirrored):
        raise MeshError("mesh: the surface is not closed; the solid must be watertight")
    if surface_volume(surface) <= 0:
        raise MeshError("mesh: the surface encloses no volume or points inward")


def _with_fins(surface: Surface, depth: float) -> tuple[Floats, Ints]:
    """Return vertices and triangles with an inward fin at each seam.

    The mesher keeps an edge of three sheets, but none between coplanar triangles. Fin triangles
    alternate in orientation, since the mesher finds the interior by winding numbers.
    """
    vertices = surface.vertices
    triangles = surface.triangles
    tags = surface.face_of_triangle
    if not surface.seams:
        return vertices, triangles
    ends, left, right = sides_between(triangles)
    beside = np.sort(np.column_stack([tags[left], tags[right]]), axis=1)
    key = [len(surface.faces), 1]
    along = np.isin(beside @ key, np.array(surface.seams) @ key)
    ends = ends[along]
    corners = vertices[triangles]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.zeros_like(vertices)
    for end in range(2):
        np.subtract.at(
            inward, ends[:, end], outward[left[along]] + outward[right[along]]
        )
    rim, low = np.unique(ends, return_inverse=True)
    foot = vertices[rim] + depth * inward[rim] / np.linalg.norm(
        inward[rim], axis=1, keepdims=True
    )
    low = low.reshape(-1, 2) + len(vertices)
    first = np.column_stack([ends[:, 0], ends[:, 1], low[:, 1]])
    second = np.column_stack([ends[:, 0], low[:, 0], low[:, 1]])
    return np.vstack([vertices, foot]), np.vstack([triangles, first, second])


def _run_ftetwild(
    vertices: Floats,
    triangles: Ints,
    size: float,
    envelope: float,
    threads: int,
    energy: float,
) -> tuple[Floats, Ints]:
    """Mesh a surface in a worker process; only there the mesher is imported."""
    with no_collection():
        import pytetwild

    points, cells = pytetwild.tetrahedralize(  # pyright: ignore[reportPrivateImportUsage]
        vertices,
        triangles.astype(np.int32),
        edge_length_abs=size,
        epsilon=envelope,
        num_threads=threads,
        stop_energy=energy,
        vtk_ordering=True,
    )
    return points, cells.astype(np.int64)


def _check_tets(points: Floats, cells: Ints, volume: float) -> tuple[Floats, Ints]:
    if not len(cells):
        why = "the surface has no inside (a sheet, or it crosses itself)"
        raise MeshError(f"mesh: no tetrahedra; {why}")
    used, cells = np.unique(cells, return_inverse=True)
    points = points[used]
    cells = cells.reshape(-1, 4)
    volumes = tet_volumes(points, cells)
    flipped = volumes < 0
    cells[flipped] = cells[flipped][:, [0, 1, 3, 2]]
    total = float(np.abs(volumes).sum())
    if abs(total - volume) > 0.1 * volume:  # nodes are not on the surface yet
        raise MeshError(
            f"mesh: its volume is {total:.4g} m³ where the solid's surface encloses {volume:.4g} m³; "
            "choose a smaller size or envelope, or check that the solid does not cross itself"
        )
    return points, cells[np.abs(volumes) > 1e-14 * volume]


def tet_volumes(points: Floats, cells: Ints) -> Floats:
    """Return the signed volumes (m,) of straight tetrahedra."""
    a = points[cells[:, 0]]
    b, c, d = (points[cells[:, k]] - a for k in (1, 2, 3))
    return np.einsum("ij,ij->i", b, np.cross(c, d)) / 6


def boundary_facets(cells: Ints) -> tuple[Ints, Ints, Ints]:
    """Return outward boundary triangles (k, 3), their tetrahedra (k,) and local faces (k,)."""
    facets = cells[:, FACES].reshape(-1, 3)
    keys = np.sort(facets, axis=1)
    _, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
    once = first[count == 1]
    return facets[once], once // 4, once % 4


def sides_between(triangles: Ints) -> tuple[Ints, Ints, Ints]:
    """Return a closed surface's sides (e, 2), sorted pairs, and their two triangles (e,), (e,)."""
    pairs = np.sort(triangles[:, SIDES].reshape(-1, 2), axis=1)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))  # each side occurs twice
    return pairs[order[0::2]], order[0::2] // 3, order[1::2] // 3


def unique_edges(cells: Ints) -> tuple[Ints, Ints]:
    """Return the edges (e, 2), sorted vertex pairs, and the edges of each tetrahedron (m, 6)."""
    pairs = np.sort(cells[:, EDGES].reshape(-1, 2), axis=1)
    keys = pairs[:, 0] * (cells.max() + 1) + pairs[:, 1]
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return pairs[first], inverse.reshape(-1, 6)

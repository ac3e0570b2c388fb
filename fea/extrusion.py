"""Meshes of sheets, needles and thin-walled bars: extrusions of prisms cut into tetrahedra.

A general mesher needs elements as small as the thickness everywhere; these are flat or long where
the solution is smooth, and as small as the thickness only around held and loaded faces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from stiffscope.fea.mesh import (
    PLANE,
    Floats,
    Ints,
    MeshError,
    Project,
    boundary_facets,
    diagonal,
    face_area,
    sides_between,
    surface_volume,
    tet_volumes,
    thinness,
)
from stiffscope.fea.section_mesh import fill_section, subdivide
from stiffscope.fea.tags import tag_facets

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from stiffscope.cad.part import Surface

SHEET = 0.01
NEEDLE = 0.002  # height of a sheet, radius of gyration of a needle, over the diagonal
PARALLEL = 1e-5  # sine
UPRIGHT = 1e-4  # cosine
SAME = 1e-6  # tolerance of heights and corners over the diagonal
CELLS = 150  # number of cells of the coarsest size in a section
ALONG_EDGE = (
    25  # most points along the longest side of a section that is held or loaded
)
STRETCH = 6.0  # length of a needle's elements over its section's width
GROWTH = 0.5  # growth of that length with distance from the ends
ROUNDS = 12
THIN = 1.5  # thinness (``stiffscope.fea.mesh.thinness``) of walls meshed by extrusion
AROUND = 16  # elements along the middle line of a thin-walled section
SAG = 0.2  # largest gap between element sides and curved walls, over the thickness
END = 0.6  # element length at a thin-walled bar's ends, over a tube's decay length
FASTER = 1.0  # growth of element length from the ends


@dataclass(frozen=True)
class Extrusion:
    """A solid swept along a direction: the border of its section and the faces on it; metres.

    Attributes
    ----------
    axes : (3, 3) rows: two directions in the section, and the sweep direction.
    height : start and end along the third axis.
    corners : (p, 2) border corners in the section.
    borders : (s, 2) straight border pieces, section on the left, and lines between faces of a cap.
    walls : (s,) CAD face of each piece, -1 for a line on a cap.
    held : (s,) whether the piece borders a held or loaded face.
    """

    axes: Floats
    height: tuple[float, float]
    corners: Floats
    borders: Ints
    walls: Ints
    held: NDArray[np.bool_]

    @property
    def outline(self) -> Floats:
        """Ends (s, 2, 2) of the pieces that bound the section."""
        return self.corners[self.borders[self.walls >= 0]]

    @property
    def area(self) -> float:
        """Area of the section, m²."""
        return float(np.linalg.det(self.outline).sum()) / 2

    @property
    def wall(self) -> float:
        """Twice the section's area over its perimeter, m: the thickness of thin walls."""
        return (
            2
            * self.area
            / float(np.linalg.norm(np.diff(self.outline, axis=1), axis=2).sum())
        )

    @property
    def loops(self) -> int:
        """Number of closed border loops."""
        a, b = self.borders[self.walls >= 0].T
        count = len(self.corners)
        number = connected_components(
            coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
        )[1]
        return len(np.unique(number[a]))


@dataclass(frozen=True)
class FlatMesh:
    """Linear tetrahedra (m, 4): points (n, 3), CAD faces of boundary triangles, typical size."""

    points: Floats
    cells: Ints
    tags: Ints
    size: float


def mesh_extrusion(
    surface: Surface,
    found: Extrusion,
    interfaces: frozenset[int],
    project: Project,
    size: float | None = None,
    check: Callable[[float], None] = lambda _elements: None,
) -> FlatMesh | None:
    """Mesh a sheet, needle or thin-walled bar; return None if its walls leave no room for elements.

    Parameters
    ----------
    surface
        Triangulated surface of the solid.
    found
        The solid as an extrusion; see ``find_extrusion``.
    interfaces
        CAD faces that are held or loaded.
    project
        See ``stiffscope.fea.specimen.Specimen``.
    size
        Largest element size (m); by default some thousand elements fill the sheet.
    check
        Called with the number of elements before meshing; may raise.

    Raises
    ------
    MeshError
        If the section cannot be filled.
    """
    low, high = found.height
    height = high - low
    width = float(np.sqrt(found.area))
    reach = float(np.ptp(found.corners, axis=0).max())
    sheet = height <= SHEET * diagonal(surface)
    walled = has_thin_walls(surface, found)
    if sheet:
        coarse = size or max(width / np.sqrt(CELLS), height)
        finest = max(height, reach / ALONG_EDGE)
        levels = np.array([0.0, 1.0])
    elif walled:
        found = _follow_walls(surface, found, project)
        coarse = size or max(found.wall, width**2 / found.wall / AROUND)
        finest = found.wall
        # layers at the caps are thin anyway
        found = replace(found, held=np.isin(found.walls, list(interfaces)))
        reach = float(np.ptp(found.corners, axis=0).max())
        longest = coarse if size or found.held.any() else max(coarse, reach)
        levels = _layers(
            height, min(END * np.sqrt(finest * reach / 2), longest), longest, FASTER
        )
    else:
        coarse = finest = size or 0.6 * width
        levels = _layers(height, 0.6 * width, size or STRETCH * width, GROWTH)
    sizes = np.where(found.held, min(finest, coarse), coarse)
    try:
        corners, triangles = fill_section(
            found.corners, found.borders, found.walls >= 0, sizes, coarse
        )
    except MeshError:
        if walled and not sheet:
            return None
        raise
    check(3.0 * len(triangles) * (len(levels) - 1))
    count = len(corners)
    heights = np.repeat(low + height * levels, count)
    points = np.column_stack([np.tile(corners, (len(levels), 1)), heights]) @ found.axes
    cells = np.vstack(
        [_prisms(triangles, count * k, count) for k in range(len(levels) - 1)]
    )
    cells[tet_volumes(points, cells) < 0] = cells[tet_volumes(points, cells) < 0][
        :, [0, 1, 3, 2]
    ]
    tags = tag_facets(surface, points[boundary_facets(cells)[0]], coarse / 2)
    return FlatMesh(points, cells, tags, coarse)


def find_extrusion(surface: Surface, interfaces: frozenset[int]) -> Extrusion | None:
    """Return a solid as an extrusion if it is a sheet, a needle, or has thin walls; else None."""
    reach = diagonal(surface)
    thin = _is_thin(surface)
    normals = [face.axis for face in surface.faces if face.kind == "plane"]
    for index, normal in enumerate(normals):
        if any(
            np.linalg.norm(np.cross(normal, other)) < PARALLEL
            for other in normals[:index]
        ):
            continue
        height = float(np.ptp(surface.vertices @ normal))
        if SHEET * reach < height < 0.9 * reach and not thin:
            continue
        extrusion = _find_along(surface, np.asarray(normal, dtype=float), interfaces)
        if extrusion is None:
            continue
        if height <= SHEET * reach:
            return extrusion
        needle = extrusion.loops == 1 and np.sqrt(extrusion.area) < 2 * NEEDLE * reach
        if (needle and height >= 0.9 * reach) or has_thin_walls(surface, extrusion):
            return extrusion
    return None


def _is_thin(surface: Surface) -> bool:
    """Return whether walls are thin and mostly curved; plane ones suit a mesher's flat elements."""
    area = face_area(surface.faces)
    plane = face_area(surface.faces, "plane")
    return plane <= PLANE * area and thinness(surface_volume(surface), area) > THIN


def has_thin_walls(surface: Surface, extrusion: Extrusion) -> bool:
    """Return whether an extrusion's walls are much thinner than its section's width and height."""
    low, high = extrusion.height
    reach = min(high - low, float(np.ptp(extrusion.corners, axis=0).max()))
    return _is_thin(surface) and 5 * extrusion.wall < reach


def _follow_walls(
    surface: Surface, extrusion: Extrusion, project: Project
) -> Extrusion:
    """Subdivide an extrusion's pieces on curved walls until they follow them within ``SAG``."""
    corners = extrusion.corners
    borders = extrusion.borders
    walls = extrusion.walls
    curved = np.array([face.kind != "plane" for face in surface.faces])
    middle = sum(extrusion.height) / 2

    def on_wall(points: Floats, wall: Ints) -> Floats:
        raised = (
            np.column_stack([points, np.full(len(points), middle)]) @ extrusion.axes
        )
        for number in np.unique(wall):
            raised[wall == number] = project(int(number), raised[wall == number])
        return raised @ extrusion.axes[:2].T

    for _ in range(ROUNDS):
        ends = corners[borders]
        gap = np.zeros(len(borders))
        bent = np.flatnonzero((walls >= 0) & curved[walls])
        mids = ends[bent].mean(axis=1)
        gap[bent] = np.linalg.norm(on_wall(mids, walls[bent]) - mids, axis=1)
        allowed = SAG * _thickness(ends, walls >= 0).clip(max=extrusion.wall)
        parts = np.ceil(np.sqrt(gap / allowed) - 0.05).clip(1, AROUND).astype(int)
        if (parts == 1).all():
            break
        piece, share = subdivide(parts)
        new = share > 0
        t = share[share > 0, None]
        places = on_wall(
            (1 - t) * ends[piece[new], 0] + t * ends[piece[new], 1], walls[piece[new]]
        )
        start = borders[piece, 0]
        start[new] = len(corners) + np.arange(new.sum())
        last = np.append(piece[1:] != piece[:-1], True)
        stop = np.where(last, borders[piece, 1], np.roll(start, -1))
        corners = np.vstack([corners, places])
        borders = np.column_stack([start, stop])
        walls = walls[piece]
    return replace(extrusion, corners=corners, borders=borders, walls=walls)


def _thickness(ends: Floats, walls: NDArray[np.bool_]) -> Floats:
    """Return the wall thickness (s,) straight across from the middles of pieces (s, 2, 2)."""
    mids = ends.mean(axis=1)
    along = ends[:, 1] - ends[:, 0]
    across = (
        np.column_stack([-along[:, 1], along[:, 0]])
        / np.linalg.norm(along, axis=1)[:, None]
    )
    start = ends[walls, 0]
    side = along[walls]
    to = start - mids[:, None]  # (s, w, 2)
    sine = across[:, None, 0] * side[:, 1] - across[:, None, 1] * side[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.abs(to[..., 0] * side[:, 1] - to[..., 1] * side[:, 0]) / np.abs(sine)
        share = (
            to[..., 0] * across[:, None, 1] - to[..., 1] * across[:, None, 0]
        ) / sine
    far[
        ~((share >= 0.0) & (share <= 1.0))
        | (far <= 1e-3 * np.linalg.norm(along, axis=1)[:, None])
    ] = np.inf
    return far.min(axis=1)


def _find_along(
    surface: Surface, normal: Floats, interfaces: frozenset[int]
) -> Extrusion | None:
    """Return the solid as swept along a direction; None if a face is neither cap nor full wall."""
    vertices = surface.vertices
    tags = surface.face_of_triangle
    near = SAME * diagonal(surface)
    along = vertices @ normal
    height = float(along.min()), float(along.max())
    corners = vertices[surface.triangles]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    levels = _face_levels(surface, along, outward, normal)
    if levels is None:
        return None
    ends, left, right = sides_between(surface.triangles)
    at_wall = np.where(
        levels[tags[left]] == 2, left, right
    )  # the wall's triangle, if there is one
    on_cap = (tags[left] != tags[right]) & (
        np.minimum(levels[tags[left]], levels[tags[right]]) < 2
    )
    ends = ends[on_cap]
    left = tags[left[on_cap]]
    right = tags[right[on_cap]]
    at_wall = at_wall[on_cap]
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(normal, first), normal]).astype(np.float64)
    flat = (vertices @ axes[:2].T)[ends].reshape(-1, 2)
    _, which, number = np.unique(
        np.round(flat / near).astype(np.int64),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    pieces, where = np.unique(
        np.sort(number.reshape(-1, 2), axis=1), axis=0, return_inverse=True
    )
    walls = np.full(len(pieces), -1)
    holds = np.zeros(len(pieces), dtype=bool)
    sides = np.zeros((len(pieces), 2))
    where = where.reshape(-1)
    wall = np.where(levels[tags[at_wall]] == 2, tags[at_wall], -1)
    np.maximum.at(walls, where, wall)
    np.logical_or.at(
        holds,
        where,
        np.isin(left, list(interfaces)) != np.isin(right, list(interfaces)),
    )
    if not (
        np.bincount(where[wall >= 0], minlength=len(pieces))[walls >= 0] == 2
    ).all():
        return None  # the borders of the two caps differ
    sides[where] = outward[at_wall] @ axes[:2].T
    places = flat[which]
    turned = (
        np.linalg.det(
            np.stack([sides, places[pieces[:, 1]] - places[pieces[:, 0]]], axis=1)
        )
        < 0
    )
    pieces = np.where(turned[:, None], pieces[:, ::-1], pieces)
    return Extrusion(
        axes=np.asarray(axes, dtype=float),
        height=height,
        corners=places,
        borders=pieces,
        walls=walls,
        held=holds,
    )


def _face_levels(
    surface: Surface, along: Floats, outward: Floats, normal: Floats
) -> Ints | None:
    """Return 0 and 1 for faces on caps, 2 for walls between them (f,); None if any is neither."""
    near = SAME * diagonal(surface)
    heights = np.array([along.min(), along.max()])
    cosine = np.abs(outward @ normal) / np.maximum(
        np.linalg.norm(outward, axis=1), 1e-300
    )
    levels = np.full(len(surface.faces), -1)
    for face in range(len(surface.faces)):
        of_face = surface.face_of_triangle == face
        on = (
            np.abs(along[surface.triangles[of_face]][..., None] - heights) < near
        )  # (t, 3, 2)
        if not of_face.any():
            return None
        if on.all(axis=(0, 1)).any():
            levels[face] = np.argmax(on.all(axis=(0, 1)))
        elif (
            on.any(axis=(0, 1)).all()
            and on.any(axis=2).all()
            and cosine[of_face].max() < UPRIGHT
        ):
            levels[face] = 2
        else:
            return None
    return levels


def _layers(height: float, first: float, longest: float, growth: float) -> Floats:
    """Return layer heights of a bar, 0 to 1: short layers at its ends, longer ones between."""
    at = [0.0]
    step = first
    while at[-1] < height / 2:
        at.append(at[-1] + step)
        step = min(longest, step * (1 + growth))
    half = np.array(at) * (height / 2 / at[-1])
    return np.concatenate([half, height - half[-2::-1]]) / height


def _prisms(triangles: Ints, base: int, count: int) -> Ints:
    """Split prisms over triangles into three tetrahedra; diagonals start at the lower number."""
    a, b, c = (np.sort(triangles, axis=1) + base).T
    top_a = a + count
    top_b = b + count
    top_c = c + count
    return np.vstack(
        [
            np.column_stack([a, b, c, top_c]),
            np.column_stack([a, b, top_b, top_c]),
            np.column_stack([a, top_a, top_b, top_c]),
        ]
    )

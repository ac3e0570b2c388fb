"""Meshes of sheets, needles and bars with thin walls: extrusions, filled with prisms that are cut into tetrahedra.

A mesher of general solids needs elements as small as the thickness, everywhere; these are flat or long where the
solution is smooth, and as small as the thickness only around held and loaded faces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.mesh import (
    PLANE,
    MeshError,
    boundary_facets,
    diagonal,
    sides_between,
    surface_volume,
    tet_volumes,
    thinness,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from stiffscope.cad.part import Surface
    from stiffscope.fea.mesh import Floats, Ints, Project

SHEET, NEEDLE = 0.01, 0.002  # height of a sheet, and radius of inertia of a needle's section, over the diagonal
PARALLEL = 1e-5  # sine
GROWTH = 0.5  # of the size with the distance from a held or loaded edge
CELLS = 150  # of the coarsest size that fill a section
ALONG_EDGE = 25  # points along the longest side of a section at most, where it is held or loaded
STRETCH = 6.0  # length of a needle's elements over the width of its section
ROUNDS = 12
THIN = 1.5  # thinness (see ``stiffscope.fea.mesh.thinness``) of walls that an extruded section is filled with
AROUND = 16  # elements along the middle line of a thin-walled section
SAG = 0.2  # distance of the sides of elements to curved walls, over their thickness
END = 0.6  # length of a thin-walled bar's elements at its ends, over that in which a tube's end effects decay
FASTER = 1.0  # growth of their length from there


@dataclass(frozen=True)
class Extrusion:
    """A solid swept along a direction: its section's border and what lies on it; metres.

    Attributes
    ----------
    axes : (3, 3) two directions in the section and that of the sweep, as rows.
    height : from and to, along the third axis.
    corners : (p, 2) of the border in the section.
    borders : (s, 2) straight pieces of the border and of lines between the faces of a cap.
    walls : (s,) CAD face under each piece, -1 for a line on a cap.
    held : (s,) whether a held or loaded face begins at the piece.
    """

    axes: Floats
    height: tuple[float, float]
    corners: Floats
    borders: Ints
    walls: Ints
    held: NDArray[np.bool_]

    @property
    def outline(self) -> Floats:
        """(s, 2, 2) ends of the pieces that bound the section."""
        return self.corners[self.borders[self.walls >= 0]]

    @property
    def wall(self) -> float:
        """Twice the area of the section over its perimeter, m: the thickness of thin walls."""
        return 2 * _area(self) / float(np.linalg.norm(np.diff(self.outline, axis=1), axis=2).sum())


@dataclass(frozen=True)
class FlatMesh:
    """Linear tetrahedra (m, 4) with their points (n, 3), CAD faces of their boundary triangles, and a typical size."""

    points: Floats
    cells: Ints
    tags: Ints
    size: float


def flat_mesh(
    surface: Surface,
    found: Extrusion,
    interfaces: frozenset[int],
    project: Project,
    size: float | None = None,
    check: Callable[[float], None] = lambda _elements: None,
) -> FlatMesh | None:
    """Return the mesh of a sheet, needle or thin-walled bar; None where its walls leave no room for one.

    Parameters
    ----------
    surface : of the solid.
    found : the solid as such an extrusion; see ``slender_extrusion``.
    interfaces : CAD faces that are held or loaded.
    project : see ``stiffscope.fea.specimen.Specimen``.
    size : largest element size (m); by default such that some thousand elements fill the sheet.
    check : called with the number of elements before they are made; may raise.

    Raises
    ------
    MeshError : the section cannot be filled.
    """
    low, high = found.height
    height = high - low
    width = float(np.sqrt(_area(found)))
    sheet, walled = height <= SHEET * diagonal(surface), thin_walled(surface, found)
    if sheet:
        coarse = size or max(width / np.sqrt(CELLS), height)
        finest = max(height, float(np.ptp(found.corners, axis=0).max()) / ALONG_EDGE)
        levels = np.array([0.0, 1.0])
    elif walled:
        found = _rounded(surface, found, project)
        coarse = size or max(found.wall, width**2 / found.wall / AROUND)
        finest = found.wall
        found = replace(found, held=np.isin(found.walls, list(interfaces)))  # layers at the caps are thin anyway
        reach = float(np.ptp(found.corners, axis=0).max())
        longest = coarse if size or found.held.any() else max(coarse, reach)
        levels = _levels(height, min(END * np.sqrt(finest * reach / 2), longest), longest, FASTER)
    else:
        coarse = finest = size or 0.6 * width
        levels = _levels(height, 0.6 * width, size or STRETCH * width, GROWTH)
    try:
        corners, borders, walls, triangles = _section(found, coarse, min(finest, coarse))
    except MeshError:
        if walled and not sheet:
            return None
        raise
    check(3.0 * len(triangles) * (len(levels) - 1))
    count = len(corners)
    points = np.vstack([np.column_stack([corners, np.full(count, low + t * height)]) for t in levels]) @ found.axes
    cells = np.vstack([_prisms(triangles, count * k, count) for k in range(len(levels) - 1)])
    cells[tet_volumes(points, cells) < 0] = cells[tet_volumes(points, cells) < 0][:, [0, 1, 3, 2]]
    tags = _tags(surface, found, cells, (corners, borders, walls, len(levels)))
    return FlatMesh(points, cells, tags, coarse)


def slender_extrusion(surface: Surface, interfaces: frozenset[int]) -> Extrusion | None:
    """Return a solid as an extrusion if it is a sheet swept along its thickness, a needle, or has thin walls."""
    reach, thin = diagonal(surface), _thin(surface)
    normals = [face.axis for face in surface.faces if face.kind == "plane"]
    for index, normal in enumerate(normals):
        if any(np.linalg.norm(np.cross(normal, other)) < PARALLEL for other in normals[:index]):
            continue
        along = surface.vertices @ normal
        height = float(np.ptp(along))
        if SHEET * reach < height < 0.9 * reach and not thin:
            continue
        found = _extrusion(surface, np.asarray(normal, dtype=float), interfaces)
        if found is None:
            continue
        if height <= SHEET * reach:
            return found
        needle = _loops(found) == 1 and np.sqrt(_area(found)) < 2 * NEEDLE * reach
        if (needle and height >= 0.9 * reach) or thin_walled(surface, found):
            return found
    return None


def _thin(surface: Surface) -> bool:
    """Whether its walls are thin and not most of them plane: a general mesher has flat elements for those."""
    area = sum(face.area for face in surface.faces)
    plane = sum(face.area for face in surface.faces if face.kind == "plane")
    return plane <= PLANE * area and thinness(surface_volume(surface), area) > THIN


def thin_walled(surface: Surface, found: Extrusion) -> bool:
    """Whether an extrusion's section consists of walls much thinner than it is wide and high."""
    low, high = found.height
    reach = min(high - low, float(np.ptp(found.corners, axis=0).max()))
    return _thin(surface) and 5 * found.wall < reach


def _rounded(surface: Surface, found: Extrusion, project: Project) -> Extrusion:
    """Return an extrusion whose pieces on curved walls are cut until they follow these within ``SAG``."""
    corners, borders, held, walls = found.corners, found.borders, found.held, found.walls
    curved = np.array([face.kind != "plane" for face in surface.faces])
    middle = sum(found.height) / 2

    def on_wall(points: Floats, wall: Ints) -> Floats:
        raised = np.column_stack([points, np.full(len(points), middle)]) @ found.axes
        for each in np.unique(wall):
            raised[wall == each] = project(int(each), raised[wall == each])
        return raised @ found.axes[:2].T

    for _ in range(ROUNDS):
        ends = corners[borders]
        gap = np.zeros(len(borders))
        round_ = np.flatnonzero((walls >= 0) & curved[walls])
        mids = ends[round_].mean(axis=1)
        gap[round_] = np.linalg.norm(on_wall(mids, walls[round_]) - mids, axis=1)
        allowed = SAG * _thickness(ends, walls >= 0).clip(max=found.wall)
        parts = np.ceil(np.sqrt(gap / allowed) - 0.05).clip(1, AROUND).astype(int)
        if (parts == 1).all():
            break
        cut = np.repeat(np.arange(len(parts)), parts)
        step = np.arange(len(cut)) - np.repeat(np.cumsum(parts) - parts, parts)  # of each part in its piece
        new = step > 0
        t = (step / parts[cut])[new, None]
        places = on_wall((1 - t) * ends[cut[new], 0] + t * ends[cut[new], 1], walls[cut[new]])
        start = borders[cut, 0]
        start[new] = len(corners) + np.arange(new.sum())
        last = step == parts[cut] - 1
        stop = np.where(last, borders[cut, 1], np.roll(start, -1))
        corners, borders = np.vstack([corners, places]), np.column_stack([start, stop])
        walls, held = walls[cut], held[cut]
    return replace(found, corners=corners, borders=borders, walls=walls, held=held)


def _thickness(ends: Floats, walls: NDArray[np.bool_]) -> Floats:
    """Distance (s,) from the middle of each piece (s, 2, 2) of a section straight across to the next wall."""
    mids, along = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    start, side = ends[walls, 0], along[walls]
    to = start - mids[:, None]  # (s, w, 2)
    sine = across[:, None, 0] * side[:, 1] - across[:, None, 1] * side[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.abs(to[..., 0] * side[:, 1] - to[..., 1] * side[:, 0]) / np.abs(sine)
        share = (to[..., 0] * across[:, None, 1] - to[..., 1] * across[:, None, 0]) / sine
    far[~((share >= 0.0) & (share <= 1.0)) | (far <= 1e-3 * np.linalg.norm(along, axis=1)[:, None])] = np.inf
    return far.min(axis=1)


def _extrusion(surface: Surface, normal: Floats, interfaces: frozenset[int]) -> Extrusion | None:
    """The solid as swept along a direction; None if one of its faces is neither a cap nor a wall from cap to cap."""
    vertices, triangles, tags = surface.vertices, surface.triangles, surface.face_of_triangle
    along = vertices @ normal
    low, high = float(along.min()), float(along.max())
    near = 1e-6 * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    corners = vertices[triangles]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cosine = np.abs(flat @ normal) / np.maximum(np.linalg.norm(flat, axis=1), 1e-300)
    level = np.full(len(surface.faces), -1)  # 0 and 1: caps, 2: wall
    for face in range(len(surface.faces)):
        mine = tags == face
        if not mine.any():
            return None
        at = along[triangles[mine]]
        reached = np.array([np.abs(at - low).min(), np.abs(at - high).min()]) < near
        if (np.abs(at - low) < near).all() or (np.abs(at - high) < near).all():
            level[face] = 0 if np.abs(at - low).max() < near else 1
        elif reached.all() and cosine[mine].max() < 1e-4 and (np.minimum(at - low, high - at) < near).all():
            level[face] = 2
        else:
            return None
    ends, left, right = sides_between(triangles)
    between = tags[left] != tags[right]
    both = np.sort(np.column_stack([level[tags[left]], level[tags[right]]]), axis=1)
    on_cap = between & (both[:, 0] < 2)
    ends, left, right, both = ends[on_cap], tags[left[on_cap]], tags[right[on_cap]], both[on_cap]
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(normal, first), normal])
    flat_points = vertices @ axes[:2].T
    used, number = np.unique(np.round(flat_points[ends].reshape(-1, 2) / near).astype(np.int64), axis=0,
                             return_inverse=True)  # fmt: skip
    place = np.zeros((len(used), 2))
    place[number.reshape(-1)] = flat_points[ends].reshape(-1, 2)
    pieces = np.sort(number.reshape(-1, 2), axis=1)
    wall = np.where(both[:, 1] == 2, np.where(level[left] == 2, left, right), -1)
    held = np.isin(left, list(interfaces)) != np.isin(right, list(interfaces))
    pieces, where = np.unique(pieces, axis=0, return_inverse=True)
    where = where.reshape(-1)
    walls, holds = np.full(len(pieces), -1), np.zeros(len(pieces), dtype=bool)
    np.maximum.at(walls, where, wall)
    np.logical_or.at(holds, where, held)
    if not (np.bincount(where[wall >= 0], minlength=len(pieces))[walls >= 0] == 2).all():
        return None  # the borders of the two caps differ
    return Extrusion(np.asarray(axes, dtype=float), (low, high), place, pieces, walls, holds)


def _area(found: Extrusion) -> float:
    """Area of the section: that of its outer border, the largest, less those of its holes."""
    areas = [abs(_loop_area(found, loop)) for loop in _chains(found)]
    return 2 * max(areas) - sum(areas)


def _chains(found: Extrusion) -> list[list[int]]:
    """Closed loops of the outline, as corners in order."""
    beside: dict[int, list[int]] = {}
    for a, b in found.borders[found.walls >= 0].tolist():
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    loops, seen = [], set()
    for start in beside:
        if start in seen:
            continue
        loop, at = [], start
        while at not in seen:
            seen.add(at)
            loop.append(at)
            at = next((each for each in beside[at] if each not in seen), start)
        loops.append(loop)
    return loops


def _loops(found: Extrusion) -> int:
    return len(_chains(found))


def _loop_area(found: Extrusion, loop: list[int]) -> float:
    x, y = found.corners[loop].T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _section(found: Extrusion, coarse: float, finest: float) -> tuple[Floats, Ints, Ints, Ints]:
    """Return points (n, 2), border pieces (s, 2), their walls (s,) and triangles (k, 3) that fill the section."""
    points, borders, walls = _cut_borders(found, coarse, finest)
    ends = points[borders]
    own = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    inner = _inner_points(found, ends.mean(axis=1), own, coarse)
    for _ in range(ROUNDS):
        triangles = _triangulated(found, np.vstack([points, inner]))
        sides = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
        count = len(points) + len(inner)
        missing = ~np.isin(np.sort(borders, axis=1) @ [count, 1], sides @ [count, 1])
        if not missing.any():
            area = _areas(np.vstack([points, inner]), triangles).sum()
            if abs(area / _area(found) - 1) < 1e-6:
                return np.vstack([points, inner]), borders, walls, triangles
            break
        middle = points[borders[missing]].mean(axis=1)
        new = len(points) + np.arange(len(middle))
        halves = [np.column_stack([borders[missing, 0], new]), np.column_stack([new, borders[missing, 1]])]
        close = np.linalg.norm(np.diff(points[borders[missing]], axis=1)[:, 0], axis=1)
        distance = np.linalg.norm(inner[:, None] - middle[None], axis=2) if len(inner) else np.zeros((0, len(middle)))
        inner = inner[~(distance < 0.5 * close).any(axis=1)]
        points = np.vstack([points, middle])
        borders = np.vstack([borders[~missing], *halves])
        walls = np.concatenate([walls[~missing], walls[missing], walls[missing]])
    raise MeshError("mesh: the section of this sheet cannot be filled; remove the smallest of its holes and edges")


def _cut_borders(found: Extrusion, coarse: float, finest: float) -> tuple[Floats, Ints, Ints]:
    """Cut the border's pieces: none longer than its size, which grows with the distance from held ones."""
    ends = found.corners[found.borders]
    own = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    straight = np.where(found.held, finest, coarse)
    seeds = _samples(ends, np.minimum(straight, np.maximum(own, finest)))
    points, borders, walls = list(found.corners), [], []
    for (a, b), wall in zip(found.borders.tolist(), found.walls.tolist(), strict=True):
        left = [(a, b)]
        while left:
            first, last = left.pop()
            middle = (points[first] + points[last]) / 2
            size = min(coarse, float(_sizes(middle[None], *seeds)[0]))
            if np.linalg.norm(points[last] - points[first]) > 1.01 * size:
                points.append(middle)
                left += [(first, len(points) - 1), (len(points) - 1, last)]
            else:
                borders.append((first, last))
                walls.append(wall)
    return np.array(points), np.array(borders), np.array(walls)


def _samples(ends: Floats, size: Floats) -> tuple[Floats, Floats]:
    """Points on pieces (s, 2, 2), about a size (s,) apart, and the size at each."""
    counts = np.clip(np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / size), 1, 400).astype(int)
    places, sizes = [], []
    for (a, b), count, each in zip(ends, counts, size, strict=True):
        t = (np.arange(count) + 0.5)[:, None] / count
        places.append((1 - t) * a + t * b)
        sizes.append(np.full(count, each))
    return np.vstack(places), np.concatenate(sizes)


def _sizes(points: Floats, seeds: Floats, own: Floats) -> Floats:
    """Size (n,) at points: that of the seeds, growing with the distance from them."""
    out = np.empty(len(points))
    step = max(1, 2_000_000 // max(1, len(seeds)))
    for start in range(0, len(points), step):
        distance = np.linalg.norm(points[start : start + step, None] - seeds[None], axis=2)
        out[start : start + step] = (own + GROWTH * distance).min(axis=1)
    return out


def _inner_points(found: Extrusion, seeds: Floats, own: Floats, coarse: float) -> Floats:
    """Centres (n, 2) of the cells of a quadtree as fine as the size asks, inside the section, not close to a border."""
    low, high = found.corners.min(axis=0), found.corners.max(axis=0)
    shape = np.maximum(1, np.ceil((high - low) / coarse)).astype(int)
    cell = (high - low) / shape
    centres = low + (np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 2) + 0.5) * cell
    done = []
    for _ in range(20):
        size = np.minimum(coarse, _sizes(centres, seeds, own))
        large = cell.max() > 1.4 * size
        done.append(centres[~large])
        if not large.any():
            break
        cell = cell / 2
        turns = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) * cell / 2
        centres = (centres[large][:, None] + turns).reshape(-1, 2)
        if len(centres) > 400_000:
            raise MeshError("mesh: the section of this sheet has edges too fine for its size; remove the smallest ones")
    points = np.vstack(done)
    distance = np.full(len(points), np.inf)
    step = max(1, 2_000_000 // len(seeds))
    for start in range(0, len(points), step):
        gap = np.linalg.norm(points[start : start + step, None] - seeds[None], axis=2)
        distance[start : start + step] = (gap / own).min(axis=1)
    return points[(distance > 0.6) & _inside(points, found.outline)]


def _inside(points: Floats, outline: Floats) -> NDArray[np.bool_]:
    """Whether points (n, 2) are inside the pieces (s, 2, 2) of closed borders, by crossings of a ray."""
    inside = np.zeros(len(points), dtype=bool)
    step = max(1, 2_000_000 // len(outline))
    a, b = outline[:, 0], outline[:, 1]
    for start in range(0, len(points), step):
        x, y = points[start : start + step, None, 0], points[start : start + step, None, 1]
        across = (a[:, 1] > y) != (b[:, 1] > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
        inside[start : start + step] = (across & (x < at)).sum(axis=1) % 2 == 1
    return inside


def _triangulated(found: Extrusion, points: Floats) -> Ints:
    """Triangles (k, 3) of Delaunay's triangulation inside the section, anticlockwise."""
    from scipy.spatial import Delaunay, QhullError

    try:
        triangles = Delaunay(points).simplices.astype(np.int64)
    except QhullError as error:
        raise MeshError("mesh: the section of this sheet cannot be filled") from error
    areas = _areas(points, triangles)
    edge = np.linalg.norm(points[triangles] - points[np.roll(triangles, 1, axis=1)], axis=2).max(axis=1)
    triangles = triangles[areas > 1e-7 * edge**2]
    return triangles[_inside(points[triangles].mean(axis=1), found.outline)]


def _areas(points: Floats, triangles: Ints) -> Floats:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def _levels(height: float, first: float, longest: float, growth: float) -> Floats:
    """Heights from 0 to 1 of the layers of a bar: of a first height at its ends, longer away from them."""
    at, step = [0.0], first
    while at[-1] < height / 2:
        at.append(at[-1] + step)
        step = min(longest, step * (1 + growth))
    half = np.array(at) * (height / 2 / at[-1])
    return np.concatenate([half, height - half[-2::-1]]) / height


def _prisms(triangles: Ints, base: int, count: int) -> Ints:
    """Three tetrahedra for each prism over a triangle; diagonals of its sides leave from the lower number."""
    a, b, c = (np.sort(triangles, axis=1) + base).T
    top_a, top_b, top_c = a + count, b + count, c + count
    return np.vstack([
        np.column_stack([a, b, c, top_c]), np.column_stack([a, b, top_b, top_c]),
        np.column_stack([a, top_a, top_b, top_c]),
    ])  # fmt: skip


def _tags(surface: Surface, found: Extrusion, cells: Ints, section: tuple[Floats, Ints, Ints, int]) -> Ints:
    """CAD face (k,) of each boundary triangle, in the order of `boundary_facets`."""
    corners, borders, walls, layers = section
    count = len(corners)
    facets, _, _ = boundary_facets(cells)
    layer, place = facets // count, facets % count
    level = np.where((layer == 0).all(axis=1), 0, np.where((layer == layers - 1).all(axis=1), 1, 2))
    tags = np.full(len(facets), -1)
    sides = np.sort(borders[walls >= 0], axis=1) @ [count, 1]
    order = np.argsort(sides)
    upright = level == 2
    pairs = np.column_stack([place[upright].min(axis=1), place[upright].max(axis=1)]) @ [count, 1]
    slot = np.searchsorted(sides[order], pairs).clip(max=len(sides) - 1)
    tags[upright] = np.where(sides[order][slot] == pairs, walls[walls >= 0][order][slot], -1)
    for cap in (0, 1):
        mine = np.flatnonzero(level == cap)
        tags[mine] = _cap_faces(surface, found, corners[place[mine]].mean(axis=1), cap)
    if (tags < 0).any():
        raise MeshError("mesh: the section of this sheet cannot be filled")
    return tags


def _cap_faces(surface: Surface, found: Extrusion, at: Floats, cap: int) -> Ints:
    """CAD face (n,) of a cap that each point (n, 2) of the section lies on."""
    along = surface.vertices[surface.triangles] @ found.axes[2]
    near = 1e-6 * float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
    on = np.flatnonzero((np.abs(along - found.height[cap]) < near).all(axis=1))
    faces = np.unique(surface.face_of_triangle[on])
    if len(faces) == 1:
        return np.full(len(at), faces[0])
    corners = surface.vertices[surface.triangles[on]] @ found.axes[:2].T
    out = np.full(len(at), -1)
    for (a, b, c), face in zip(corners, surface.face_of_triangle[on], strict=True):
        sides = [(q - p)[0] * (at - p)[:, 1] - (q - p)[1] * (at - p)[:, 0] for p, q in ((a, b), (b, c), (c, a))]
        least, most = np.min(sides, axis=0), np.max(sides, axis=0)
        tolerance = 1e-9 * float(np.ptp(corners)) ** 2
        out[(least >= -tolerance) | (most <= tolerance)] = face
    return out

"""Triangulation of a section: given sizes along its border, growing with distance from there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import Delaunay, QhullError
from scipy.spatial.distance import cdist

from stiffscope.fea.mesh import SIDES, Floats, Ints, MeshError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

GROWTH = 0.5  # growth of the size with distance from the finer border
ROUNDS = 12
CHUNK = 2_000_000  # pairs per chunk
SEEDS = 400
POINTS = 400_000
DEPTH = 20  # most seeds per piece, points, quadtree levels
UNFILLED = "mesh: the section of this sheet cannot be filled"


def fill_section(
    corners: Floats,
    borders: Ints,
    walls: NDArray[np.bool_],
    sizes: Floats,
    coarse: float,
) -> tuple[Floats, Ints]:
    """Return points (n, 2), corners first, and anticlockwise triangles (k, 3) that fill a section.

    Parameters
    ----------
    corners
        Corner positions (p, 2), m.
    borders
        (s, 2) straight border pieces, and interior lines that triangles must not cross.
    walls
        (s,) whether a piece belongs to the border.
    sizes
        (s,) triangle size at each piece, m.
    coarse
        Largest triangle size, m.

    Raises
    ------
    MeshError
        If the section is too fine or cannot be filled.
    """
    outline = corners[borders[walls]]
    points, borders, seeds = _cut_borders(corners, borders, sizes, coarse)
    border_sizes = _lengths(points, borders)
    inner = _place_inside(
        outline,
        points[borders].mean(axis=1),
        border_sizes,
        lambda at: np.minimum(coarse, seeds(at)),
        coarse,
    )
    for _ in range(ROUNDS):
        both = np.vstack([points, inner])
        triangles = _triangulate(both, outline)
        sides = np.sort(triangles[:, SIDES].reshape(-1, 2), axis=1)
        missing = ~np.isin(
            np.sort(borders, axis=1) @ [len(both), 1], sides @ [len(both), 1]
        )
        if not missing.any():
            area = abs(np.linalg.det(outline).sum()) / 2
            if abs(_areas(both, triangles).sum() / area - 1) < 1e-6:
                return both, triangles
            break
        middle = points[borders[missing]].mean(axis=1)
        length = _lengths(points, borders[missing])
        inner = inner[_clearance(inner, middle, length) > 0.5]
        points, borders = _halve(points, borders, missing)
    raise MeshError(f"{UNFILLED}; remove the smallest of its holes and edges")


def _cut_borders(
    corners: Floats, borders: Ints, sizes: Floats, coarse: float
) -> tuple[Floats, Ints, Callable[[Floats], Floats]]:
    """Cut border pieces until none is longer than the local size; also return the size function."""
    ends = corners[borders]
    border_sizes = _lengths(corners, borders)
    apart = np.minimum(sizes, np.maximum(border_sizes, sizes.min()))
    piece, share = subdivide(
        np.clip(np.ceil(border_sizes / apart), 1, SEEDS).astype(int)
    )
    share = (share + 0.5 / np.bincount(piece)[piece])[:, None]
    places = (1 - share) * ends[piece, 0] + share * ends[piece, 1]
    near = apart[piece]

    def size_at(points: Floats) -> Floats:
        return _over_chunks(
            points,
            lambda at: (near + GROWTH * cdist(at, places)).min(axis=1),
            len(places),
        )

    points = corners
    while True:
        wanted = np.minimum(coarse, size_at(points[borders].mean(axis=1)))
        long = _lengths(points, borders) > 1.01 * wanted
        if not long.any():
            return points, borders, size_at
        points, borders = _halve(points, borders, long)


def subdivide(parts: Ints) -> tuple[Ints, Floats]:
    """Return, for pieces cut into parts (s,), each part's piece and its start in it, 0 to 1."""
    piece = np.repeat(np.arange(len(parts)), parts)
    step = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
    return piece, step / parts[piece]


def _halve(
    points: Floats, borders: Ints, marked: NDArray[np.bool_]
) -> tuple[Floats, Ints]:
    new = len(points) + np.arange(marked.sum())
    halves = (
        np.column_stack([borders[marked, 0], new]),
        np.column_stack([new, borders[marked, 1]]),
    )
    return np.vstack([points, points[borders[marked]].mean(axis=1)]), np.vstack(
        [borders[~marked], *halves]
    )


def _place_inside(
    outline: Floats,
    seeds: Floats,
    own: Floats,
    size_at: Callable[[Floats], Floats],
    coarse: float,
) -> Floats:
    """Return quadtree cell centres (n, 2), as fine as the size, inside and not close to pieces."""
    low = outline.min(axis=(0, 1))
    high = outline.max(axis=(0, 1))
    shape = np.maximum(1, np.ceil((high - low) / coarse)).astype(int)
    cell = (high - low) / shape
    centres = low + (np.stack(np.indices(shape), axis=-1).reshape(-1, 2) + 0.5) * cell
    done = []
    for _ in range(DEPTH):
        large = cell.max() > 1.4 * size_at(centres)
        done.append(centres[~large])
        if not large.any():
            break
        cell = cell / 2
        turns = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) * cell / 2
        centres = (centres[large][:, None] + turns).reshape(-1, 2)
        if len(centres) > POINTS:
            fine = "the section of this sheet has edges too fine for its size"
            raise MeshError(f"mesh: {fine}; remove the smallest ones")
    points = np.vstack(done)
    return points[(_clearance(points, seeds, own) > 0.6) & _inside(points, outline)]


def _triangulate(points: Floats, outline: Floats) -> Ints:
    """Return the anticlockwise Delaunay triangles (k, 3) inside the section."""
    try:
        triangles = Delaunay(points).simplices.astype(np.int64)
    except QhullError as error:
        raise MeshError(UNFILLED) from error
    edge = np.linalg.norm(
        points[triangles] - points[np.roll(triangles, 1, axis=1)], axis=2
    ).max(axis=1)
    triangles = triangles[_areas(points, triangles) > 1e-7 * edge**2]
    return triangles[_inside(points[triangles].mean(axis=1), outline)]


def _inside(points: Floats, outline: Floats) -> NDArray[np.bool_]:
    """Return whether points (n, 2) are inside closed border pieces (s, 2, 2), by ray crossings."""
    a = outline[:, 0]
    b = outline[:, 1]
    slope = (b[:, 0] - a[:, 0]) / np.where(
        a[:, 1] == b[:, 1], np.inf, b[:, 1] - a[:, 1]
    )

    def odd(at: Floats) -> NDArray[np.bool_]:
        x = at[:, :1]
        y = at[:, 1:]
        across = (a[:, 1] > y) != (b[:, 1] > y)
        return (across & (x < a[:, 0] + (y - a[:, 1]) * slope)).sum(axis=1) % 2 == 1

    return _over_chunks(points, odd, len(outline)) > 0


def _clearance(points: Floats, others: Floats, lengths: Floats) -> Floats:
    """Return the least distance (n,) of points (n, 2) to others (m, 2), over lengths (m,)."""
    return _over_chunks(
        points, lambda at: (cdist(at, others) / lengths).min(axis=1), len(others)
    )


def _over_chunks(
    points: Floats, function: Callable[[Floats], np.ndarray], width: int
) -> Floats:
    """Evaluate a function (n,) at points (n, 2) in chunks of ``CHUNK`` / width points."""
    step = max(1, CHUNK // max(1, width))
    return np.concatenate(
        [function(points[k : k + step]) for k in range(0, len(points), step)]
        or [np.zeros(0)]
    )


def _lengths(points: Floats, borders: Ints) -> Floats:
    return np.linalg.norm(points[borders[:, 1]] - points[borders[:, 0]], axis=1)


def _areas(points: Floats, triangles: Ints) -> Floats:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])

"""Validity of a solid for meshing: one closed solid of positive volume, not self-intersecting."""

import logging
from collections.abc import Callable, Sequence

import numpy as np

from stiffscope.cad import kernel
from stiffscope.cad.kernel import Shape, Solid
from stiffscope.cad.part import (
    find_open_edge,
    open_edges,
    tessellate,
    tessellate_closed,
)
from stiffscope.errors import InputError, say_count

log = logging.getLogger(__name__)
SMALLEST = 1.0
LARGEST = 40e3  # mm: bounding box diagonal; outside, the unit is probably wrong
FARTHEST = 1e7  # mm: a coordinate; farther away, meshes lack digits
_CHANGE = 1e-3  # of the volume: what healing may change
_ENVELOPE = (
    3e-4  # of the diagonal: of a mesher's envelope, which is no smaller by default
)
_REACHES = 4.0, 16.0, 64.0  # envelopes: radii of the balls in which points are drawn
_SAMPLES = 128
_MEASURED = 24  # points in each ball, and of those of another winding number
_LISTED = 6  # solids that a refusal lists, the largest ones
_TOUCH = 1e-3  # mm: faces of two solids this close touch, and are fused
_OVERLAP = 1e-4  # of the volume: solids that share more are said to overlap
THINNEST = 0.01  # mm: twice the volume over the area, a sheet's thickness; thinner ones cannot be meshed


def valid_solid(shape: Shape, name: str, chosen: int | str | None = None) -> Solid:
    """Return the single solid of a shape, or the chosen one, with outward normals.

    A valid shape is exactly one solid without loose faces, whose faces meet only at their borders
    (but for what a mesher's envelope passes over), consistent (or healed, which is logged), closed,
    of positive volume, of a size between `SMALLEST` and `LARGEST`, nowhere beyond
    `FARTHEST`, and of a mean thickness of at least `THINNEST`.
    Self-intersection of a face is detected if it is free-form, not if it is a whole spindle torus.

    Parameters
    ----------
    shape
        Content of a file, lengths in mm.
    name
        Name of the part or file in messages.
    chosen
        Of several solids, the number of one (the first is 1), or "all": fused, if they touch.

    Raises
    ------
    InputError
        If there is no such solid; the message says what was found, and where.
    """

    def check(valid: object, found: str, expected: str = "one closed solid") -> None:
        if not valid:
            raise InputError(f"{name}: expected {expected}, found {found}")

    solid = _single_solid(shape, name, chosen, check)
    farthest = np.abs(
        [kernel.position(vertex) for vertex in kernel.vertices(solid)]
    ).max(initial=0.0)
    expected = f"a solid whose coordinates are numbers of at most {FARTHEST:g} mm"
    check(farthest <= FARTHEST, f"{farthest:.3g} mm", expected)
    size = kernel.diagonal(solid)
    expected = f"a solid {SMALLEST:g} to {LARGEST:g} mm large (check its units)"
    check(SMALLEST <= size <= LARGEST, f"{size:.3g} mm", expected)
    if not kernel.is_valid(solid):
        solid = _heal(solid, name, check)
    solid = kernel.orient_solid(solid)
    _check_surface(solid, check)
    volume = kernel.volume_properties(solid).Mass()
    check(
        np.isfinite(volume) and volume > 1e-9 * size**3,
        f"a solid without volume ({volume:.3g} mm3)",
        "a solid of positive volume",
    )
    thickness = 2.0 * volume / kernel.area_properties(solid).Mass()
    expected = f"a solid at least {THINNEST:g} mm thick on average"
    check(thickness >= THINNEST, f"{thickness:.2g} mm", expected)
    return solid


def _single_solid(
    shape: Shape, name: str, chosen: int | str | None, check: Callable[..., None]
) -> Solid:
    """Return the only solid of a shape, or the chosen one; refuse several, none, loose faces."""
    if chosen is not None:
        shape = _choose(shape, name, chosen)
    solids, faces = kernel.solids(shape), kernel.faces(shape)
    check(
        len(solids) < 2,
        f"{len(solids)}: {list_solids(solids)}",
        'one solid, or its number here as solid = N, or solid = "all" to fuse them',
    )
    count = say_count(len(faces), "face that bounds", "faces that bound")
    surface = f"a surface without volume ({count} no solid)"
    check(solids, surface if faces else "no solid and no face")
    bounding = kernel.faces(solids[0])
    loose = [
        face for face in faces if not any(face.IsSame(other) for other in bounding)
    ]
    if loose:
        at = _place(kernel.bounds(loose[0]).mean(axis=0))
        check(
            valid=False,
            found=f"{say_count(len(loose), 'loose face')} beside the solid, at {at}",
            expected="one solid and nothing else, or solid = 1",
        )
    return solids[0]


def list_solids(solids: Sequence[Solid]) -> str:
    """Return number, box and volume of each of several solids; of many, the largest ones."""
    volumes = [abs(kernel.volume_properties(solid).Mass()) for solid in solids]
    order = sorted(range(len(solids)), key=lambda k: -volumes[k])
    lines = []
    for k in sorted(order[:_LISTED]):
        low, high = kernel.bounds(solids[k])
        lines.append(
            f"{k + 1} from {_place(low)} to {_place(high)}, {volumes[k]:.4g} mm3"
        )
    rest = len(solids) - len(lines)
    return "; ".join(lines) + (f"; and {rest} smaller" if rest else "")


def _choose(shape: Shape, name: str, chosen: int | str) -> Shape:
    """Return one solid of a shape by its number, or all of them, fused. Raises InputError."""
    solids = kernel.solids(shape)
    if isinstance(chosen, int):
        if not 1 <= chosen <= len(solids):
            raise InputError(
                f"{name}: expected solid from 1 to {len(solids)}, got {chosen}"
                + (f" ({list_solids(solids)})" if len(solids) > 1 else "")
            )
        return solids[chosen - 1]
    if len(solids) < 2:
        return shape
    fused = kernel.fuse(solids, _TOUCH)
    pieces = kernel.solids(fused)
    if len(pieces) != 1:
        got = "none"
        if pieces:
            gap, at = kernel.find_gap(pieces[0], kernel.compound(*pieces[1:]))
            got = f"{len(pieces)} pieces, {gap:.3g} mm apart at {_place(at)}"
        raise InputError(
            f'{name}: expected solids that touch, as solid = "all", found {got}; '
            f"take one of {list_solids(solids)}"
        )
    whole = sum(abs(kernel.volume_properties(solid).Mass()) for solid in solids)
    shared = 1.0 - kernel.volume_properties(pieces[0]).Mass() / whole
    also = f"; they overlap by {100.0 * shared:.2g} %" if shared > _OVERLAP else ""
    log.warning("%s: %d solids fused as one part%s", name, len(solids), also)
    return pieces[0]


def _check_surface(solid: Solid, check: Callable[..., None]) -> None:
    """Refuse a solid with gaps, or that overlaps itself."""
    surface = tessellate_closed(solid, 5e-4, 0.8)[:2]
    gaps = open_edges(surface[1])
    if gaps:
        at = _place(1e3 * find_open_edge(*surface))
        count = say_count(gaps, "open edge")
        check(
            valid=False, found=f"a solid that is not watertight ({count}, one at {at})"
        )
    overlap = find_overlap(solid, surface)
    if overlap is not None:
        check(
            valid=False,
            found=f"a self-intersecting solid at {_place(overlap)}",
            expected="a solid whose faces meet only at their edges",
        )


def _heal(solid: Solid, name: str, check: Callable[..., None]) -> Solid:
    """Return a solid that the kernel finds invalid, healed; log what was done."""
    before = kernel.volume_properties(solid).Mass()
    healed, done = kernel.heal_solid(solid)
    solids = kernel.solids(healed)
    change = np.inf
    if len(solids) == 1 and kernel.is_valid(solids[0]):
        after = kernel.volume_properties(kernel.orient_solid(solids[0])).Mass()
        change = abs(after - abs(before)) / max(after, 1e-300)
    if not change < _CHANGE:
        _check_surface(solid, check)
        at = kernel.find_fault(solid)
        where = "" if at is None else f" at {_place(at)}"
        cure = "(repair it, or export it again)"
        check(
            valid=False,
            found=f"a solid that the CAD kernel finds invalid{where} {cure}",
        )
    log.warning(
        "%s: healed, as the CAD kernel finds it invalid: %s (volume %+.2g %%)",
        name,
        ", ".join(done) or "tolerances",
        100.0 * change,
    )
    return solids[0]


def _place(point: np.ndarray) -> str:
    rounded = np.round(point, 4) + 0.0  # no -0
    return f"({', '.join(f'{number:.6g}' for number in rounded)}) mm"


def find_overlap(
    solid: Solid, surface: tuple[np.ndarray, np.ndarray]
) -> np.ndarray | None:
    """Return a place (3,), mm, where a solid overlaps itself by more than a mesher passes over.

    Where the kernel finds neighbours that interfere, which may be within their tolerances, the
    surface winds once around each point inside, and not at all around one outside: another
    number at points farther than `envelope` from the surface is an overlap. None without any.

    Parameters
    ----------
    solid
        Solid, mm, with outward normals.
    surface
        Vertices (n, 3), m, and triangles (t, 3) of its closed tessellation.
    """
    places = kernel.find_interferences(solid)
    if not places:
        return None
    depth = envelope(solid)
    fine = tessellate(solid, 0.25e-3 * depth, 0.4)[:2]
    vertices, triangles = surface if open_edges(fine[1]) else fine
    corners = 1e3 * vertices[triangles]
    shell = kernel.compound(*kernel.faces(solid))
    rng = np.random.default_rng(0)
    judged: list[np.ndarray] = []
    for place, size in places:
        if any(np.linalg.norm(place - other) < depth for other in judged):
            continue
        if not size:
            judged.append(place)
        radii = [0.5 * size] if size else [reach * depth for reach in _REACHES]
        for radius in radii:
            points = place + radius * _draw_ball(rng, _SAMPLES)
            turns = count_turns(points, corners)
            odd = points[(turns < -0.5) | (turns > 1.5)]
            for point in odd[:_MEASURED]:
                if kernel.distance(shell, point) > 0.5 * depth:
                    return point
    return None


def envelope(solid: Solid) -> float:
    """Return the distance, mm, within which a mesher follows a solid's surface."""
    volume = abs(kernel.volume_properties(solid).Mass())
    thickness = 2.0 * volume / kernel.area_properties(solid).Mass()
    size = kernel.diagonal(solid)
    return min(_ENVELOPE * size, max(0.1 * thickness, 0.1 * _ENVELOPE * size))


def count_turns(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the winding numbers (n,) of closed triangles (t, 3, 3) around points (n, 3).

    References
    ----------
    A. van Oosterom, J. Strackee, The solid angle of a plane triangle, IEEE Trans. Biomed. Eng. 30
    (1983) 125-126.
    """
    out = np.empty(len(points))
    for k, point in enumerate(points):
        a, b, c = np.moveaxis(corners - point, 1, 0)
        la, lb, lc = (
            np.sqrt(np.einsum("ti,ti->t", corner, corner)) for corner in (a, b, c)
        )
        top = np.einsum("ti,ti->t", a, np.cross(b, c))
        below = (
            la * lb * lc
            + np.einsum("ti,ti->t", a, b) * lc
            + np.einsum("ti,ti->t", b, c) * la
            + np.einsum("ti,ti->t", c, a) * lb
        )
        out[k] = np.arctan2(top, below).sum() / (2.0 * np.pi)
    return out


def _draw_ball(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return points (count, 3) spread evenly in the unit ball."""
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    return ways * rng.uniform(size=(count, 1)) ** (1.0 / 3.0)

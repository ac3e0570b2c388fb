"""Washers: annuli around round holes of plane faces, imprinted on a solid to be held or loaded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stiffscope import cad
from stiffscope.cad.checks import mm
from stiffscope.cad.faces import (
    DISTANCE,
    FaceGeometry,
    FaceSelector,
    face_geometries,
    match_faces,
    select,
)
from stiffscope.errors import InputError

if TYPE_CHECKING:
    from stiffscope.cad.kernel import Edge, Face, Solid

_SAMPLES = 48  # rim points of a washer that must lie on its face


@dataclass(frozen=True, eq=False)
class _Hole:
    """A round hole of a plane face: face index; hole centre (3,), normal, radius, m; an edge."""

    geometry: FaceGeometry
    edge: "Edge"

    def rim(self, radius: float) -> NDArray[np.float64]:
        """Return points (n, 3) on a concentric circle, m."""
        x, y = np.linalg.svd(self.geometry.axis[None])[2][1:]
        turn = np.linspace(0.0, 2.0 * np.pi, _SAMPLES, endpoint=False)[:, None]
        return self.geometry.centroid + radius * (np.cos(turn) * x + np.sin(turn) * y)


def select_interfaces(
    solid: "Solid", chosen: Mapping[str, Sequence[FaceSelector]], name: str
) -> tuple["Solid", dict[str, frozenset[int]]]:
    """Return a solid with the rims of its washers as edges, and face indices by interface.

    ``chosen``: selectors by interface; those with a ``washer`` select holes, others faces without
    washers. Raises InputError, which names the part, if a selector matches nothing, or a washer is
    no wider than its hole, reaches beyond its face, or overlaps another one.
    """
    plain = {
        each: [one for one in some if one.washer is None]
        for each, some in chosen.items()
    }
    wanted = {each: some for each, some in plain.items() if some or not chosen[each]}
    plain = {
        each: select(solid, some, f"{name}.{each}") for each, some in wanted.items()
    }
    rims = [(each, one) for each, some in chosen.items() for one in some if one.washer]
    holes = _list_holes(solid) if rims else []
    pieces = [[face] for face in cad.kernel.faces(solid)]
    washers: dict[str, list[Face]] = {selector: [] for selector in chosen}
    done: dict[int, tuple[float, Face]] = {}
    for each, one in rims:
        field = f"{name}.{each}"
        for k in _find_holes(holes, one, field):
            if k not in done or done[k][0] != one.washer:
                solid, ring = _imprint(
                    solid, pieces[holes[k].geometry.index], holes[k], one, field
                )
                done[k] = one.washer or 0.0, ring
            washers[each].append(done[k][1])
    rings = [ring for _, ring in done.values()]
    faces = cad.kernel.faces(solid)

    def number(face: "Face") -> int:
        return next(index for index, other in enumerate(faces) if other.IsSame(face))

    selected = {}
    for each in chosen:
        whole = [face for k in plain.get(each, ()) for face in pieces[k]]
        whole = [face for face in whole if not any(face.IsSame(ring) for ring in rings)]
        selected[each] = frozenset(number(face) for face in (*whole, *washers[each]))
    return solid, selected


def _list_holes(solid: "Solid") -> list[_Hole]:
    faces = cad.kernel.faces(solid)
    holes = list[_Hole]()
    for plane in face_geometries(solid):
        rims = (
            cad.kernel.round_holes(faces[plane.index]) if plane.kind == "plane" else ()
        )
        for edge, centre, radius in rims:
            form = "plane", 0.0, 1e-3 * centre, 1e-3 * centre, plane.axis, 1e-3 * radius
            holes.append(_Hole(FaceGeometry(plane.index, *form), edge))
    return holes


def _find_holes(
    holes: Sequence[_Hole], selector: FaceSelector, field: str
) -> list[int]:
    """Return indices of holes that meet a selector: centre, radius, normal and face index."""
    matches = match_faces(
        [hole.geometry for hole in holes], selector, lambda _face, _point: False
    )
    if not matches:
        radii = (
            ", ".join(sorted({mm(hole.geometry.radius) for hole in holes})) or "none"
        )
        missing = f"no round hole of a plane face has {selector}"
        raise InputError(f"{field}: {missing}; there are radii {radii}")
    return [
        k
        for k, hole in enumerate(holes)
        if any(hole.geometry is face for face in matches)
    ]


def _imprint(
    solid: "Solid",
    pieces: list["Face"],
    hole: _Hole,
    selector: FaceSelector,
    field: str,
) -> tuple["Solid", "Face"]:
    """Split the piece of a face around a hole, in place; return the solid and the new annulus."""
    radius = 0.5 * (selector.washer or 0.0)
    geometry = hole.geometry
    edge = hole.edge
    if radius <= geometry.radius + DISTANCE:
        wider = f"a washer wider than its hole of {mm(2 * geometry.radius)}"
        raise InputError(f"{field}: expected {wider}, got {mm(2 * radius)}")

    def is_beside(face: "Face") -> bool:
        return any(other.IsSame(edge) for other in cad.kernel.edges(face))

    face = next(filter(is_beside, pieces))
    if (
        max(cad.kernel.distance(face, 1e3 * point) for point in hole.rim(radius))
        > 1e3 * DISTANCE
    ):
        at = ", ".join(f"{1e3 * x:.6g}" for x in geometry.centroid)
        got = f"got one of {mm(2 * radius)} at ({at}) mm"
        raise InputError(
            f"{field}: expected washers within their face and apart, {got}"
        )
    circle = 1e3 * geometry.centroid, geometry.axis, 1e3 * radius
    solid, split = cad.kernel.imprint_circle(solid, face, *circle)
    pieces[:] = [piece for piece in pieces if not piece.IsSame(face)] + split
    return solid, next(filter(is_beside, split))

"""Solids as turned parts: axis, steps and bores, head, hexagon and slots."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope import cad

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.cad.faces import FaceGeometry
    from stiffscope.cad.kernel import Face
    from stiffscope.runtime.types import Array

_ALONG = 0.999999  # cosine of parallel axes


@dataclass(frozen=True, eq=False)
class Turned:
    """A solid as a turned part: axis, surface fraction about it, outer and inner steps.

    ``steps``, ``bores``: (low, high, radius), m, along the axis from ``point``; ``ends``: of all;
    ``flare``: largest radius of other round faces, m; ``hexagon``: half the width across flats, m;
    ``holed``: whether it has other holes along the axis; ``slotted``: alike slots all around.
    """

    point: Array
    axis: Array
    share: float
    steps: tuple[tuple[float, float, float], ...]
    bores: tuple[tuple[float, float, float], ...]
    ends: tuple[float, float]
    flare: float = 0.0
    hexagon: float = 0.0
    holed: bool = False
    slotted: bool = False

    @property
    def length(self) -> float:
        """Length along the axis, m."""
        return self.ends[1] - self.ends[0]

    @property
    def radius(self) -> float:
        """Radius of the widest step, cone or hexagon, m."""
        return max((self.flare, self.hexagon, *(step[2] for step in self.steps)))

    @property
    def body(self) -> tuple[float, float]:
        """Radius and length of the longest outer step, m."""
        return max(
            _lengths(self.steps).items(), key=lambda each: each[1], default=(0.0, 0.0)
        )

    @property
    def middle(self) -> float:
        """Mean radius of a ring, m."""
        return 0.5 * (self.bore + self.radius)

    @property
    def bore(self) -> float:
        """Radius of the widest bore over a third of the length (grooves may divide it), m, or 0."""
        return max(
            (
                r
                for r, along in _lengths(self.bores).items()
                if along > 0.3 * self.length
            ),
            default=0.0,
        )

    @property
    def section(self) -> float:
        """Ratio of a ring's width to the height of its section; 0 if it is not a ring."""
        return (
            self.length / (self.radius - self.bore)
            if 0.0 < self.bore < self.radius
            else 0.0
        )


def turned_form(faces: Sequence[FaceGeometry], shapes: Sequence[Face]) -> Turned | None:
    """Return a solid of faces as turned about its main round axis; None without round faces."""
    rounds = [face for face in faces if face.kind in {"cylinder", "cone"}]
    if not rounds:
        return None
    best = max(
        rounds,
        key=lambda face: sum(other.area for other in rounds if _on_axis(other, face)),
    )
    hexagon, flats, slotted = _find_flats(faces, best)
    about = [face for face in faces if _on_axis(face, best)]
    steps = []
    bores = []
    ends: list[float] = []
    for face in about:
        shift = float(best.axis @ (face.origin - best.origin))
        if face.kind in {"cylinder", "cone"}:
            along = sorted(
                shift + float(best.axis @ face.axis) * end for end in face.extent
            )
            ends += along
            if face.kind == "cylinder":
                (bores if face.hollow else steps).append(
                    (along[0], along[1], face.radius)
                )
        elif face.kind == "plane":
            ends.append(shift)
    curved = [f for f in about if f.kind not in {"plane", "cylinder"} and not f.hollow]
    corners = [v for face in curved for v in cad.kernel.vertices(shapes[face.index])]
    levers = (
        1e-3 * np.reshape([cad.kernel.position(corner) for corner in corners], (-1, 3))
        - best.origin
    )
    flare = float(np.linalg.norm(np.cross(best.axis, levers), axis=1).max(initial=0.0))
    share = sum(face.area for face in (*about, *flats)) / sum(
        face.area for face in faces
    )
    limits = min(ends), max(ends)
    holed = any(
        face.hollow and face not in about and abs(face.axis @ best.axis) > _ALONG
        for face in rounds
    )
    return Turned(
        best.origin,
        best.axis,
        share,
        tuple(steps),
        tuple(bores),
        limits,
        flare,
        hexagon,
        holed,
        slotted,
    )


def _find_flats(
    faces: Sequence[FaceGeometry], of: FaceGeometry
) -> tuple[float, list[FaceGeometry], bool]:
    """Return a hexagon's half width, m, or 0, its faces about a face's axis, and whether slots are."""
    apart = defaultdict[float, list["FaceGeometry"]](list)
    for face in faces:
        if face.kind == "plane" and abs(face.axis @ of.axis) < 1e-4:
            apart[round(float(face.axis @ (face.origin - of.origin)), 6)].append(face)
    slotted = False
    for distance, flats in sorted(apart.items(), reverse=True):
        turned = np.array([face.axis for face in flats])
        if (
            distance > 0
            and len(flats) == 6
            and np.all(np.abs(np.abs(turned @ turned.T) - 0.75) < 0.2501)
        ):
            return distance, flats, False
        slotted |= (
            distance > 0
            and len(flats) > 2
            and float(np.abs(turned.sum(axis=0)).max()) < 1e-4
        )
    return 0.0, [], slotted


def _on_axis(face: FaceGeometry, of: FaceGeometry) -> bool:
    """Return whether a face is turned about the axis of another."""
    if face.kind == "other":
        return False
    aside = np.linalg.norm(np.cross(of.axis, face.origin - of.origin)) < 5e-6
    along = face.kind == "sphere" or np.linalg.norm(np.cross(of.axis, face.axis)) < 1e-4
    return bool(along and (aside or face.kind == "plane"))


def _lengths(steps: Sequence[tuple[float, float, float]]) -> dict[float, float]:
    """Return the axial length of all steps by radius, m; both halves of a step count once."""
    spans = {
        (round(low, 7), round(high, 7), round(radius, 7)) for low, high, radius in steps
    }
    lengths = dict.fromkeys((radius for _, _, radius in spans), 0.0)
    for low, high, radius in spans:
        lengths[radius] += high - low
    return lengths

"""Any solid as a part: its faces chosen by geometry, its axes by a frame."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stiffscope.cad.checks import POINT, direction, is_point, require
from stiffscope.cad.faces import FaceSelector, select
from stiffscope.cad.materials import STEEL, AnyMaterial
from stiffscope.cad.part import Interface, Part
from stiffscope.cad.soundness import sound_solid
from stiffscope.errors import InputError

Vector = Sequence[float]
Selectors = Sequence[FaceSelector]
LEAST_X = (FaceSelector(kind="plane", normal=(-1, 0, 0), position="min x"),)
GREATEST_X = (FaceSelector(kind="plane", normal=(1, 0, 0), position="max x"),)


@dataclass(frozen=True)
class Frame:
    """The part's axes in the coordinates of the CAD model: origin in m, directions of x and of z (y = z × x)."""

    origin: Vector = (0.0, 0.0, 0.0)
    x: Vector = (1.0, 0.0, 0.0)
    z: Vector = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        """Raise InputError unless the origin is a point and the directions are at right angles."""
        require(is_point(self.origin), "frame.origin", POINT, repr(self.origin))
        direction("frame.x", self.x)
        direction("frame.z", self.z)
        cosine = np.dot(self.x, self.z) / np.linalg.norm(self.x) / np.linalg.norm(self.z)
        require(abs(cosine) <= 1e-6, "frame.z", "a direction at right angles to x", repr(self.z))


def part_of(
    solid: Any,
    *,
    name: str = "part",
    material: AnyMaterial = STEEL,
    clamped: Selectors = LEAST_X,
    loaded: Selectors | Mapping[str, Selectors] = GREATEST_X,
    frame: Frame | None = None,
    reference_point: Vector | None = None,
) -> Part:
    """Return a build123d (or kernel) solid, in mm, as a part.

    Selectors, `frame` and `reference_point` (m) are in the coordinates of the solid; the part's are the frame's.
    `loaded` may name several interfaces. Without a reference point, an interface refers to the centroid of its
    faces. InputError for a solid that is not sound and for selectors that fit no face or every face.
    """
    return chosen_part(
        sound_solid(getattr(solid, "wrapped", solid), name),
        name=name,
        material=material,
        clamped=clamped,
        loaded=loaded,
        frame=frame or Frame(),
        reference_point=reference_point,
    )


def chosen_part(
    solid: Any,
    *,
    name: str,
    material: AnyMaterial,
    clamped: Selectors,
    loaded: Selectors | Mapping[str, Selectors],
    frame: Frame,
    reference_point: Vector | None,
) -> Part:
    """Return a solid known to be sound as a part, as `part_of` does."""
    from stiffscope.cad import kernel

    held = select(solid, clamped, f"{name}.clamped")
    named = loaded if isinstance(loaded, Mapping) else {"loaded": loaded}
    if reference_point is not None and len(named) > 1:
        raise InputError(f"{name}.reference_point: expected none with {len(named)} interfaces, got one")
    if reference_point is not None:
        _check_near(solid, reference_point, f"{name}.reference_point")
    chosen = {key: select(solid, selectors, f"{name}.{key}") for key, selectors in named.items()}
    origin, x, z = (np.asarray(vector, dtype=float) for vector in (frame.origin, frame.x, frame.z))
    moved = kernel.in_frame(solid, origin * 1e3, x, z)
    point = None if reference_point is None else _axes(x, z) @ (np.asarray(reference_point, dtype=float) - origin)
    centred = Part(
        name, moved, material, held, tuple(Interface(key, faces, np.zeros(3)) for key, faces in chosen.items())
    )
    interfaces = (
        Interface(key, faces, _centroid(centred, faces) if point is None else point) for key, faces in chosen.items()
    )
    return Part(name, moved, material, held, tuple(interfaces))


def _check_near(solid: Any, point: Vector, field: str) -> None:
    from stiffscope.cad import kernel

    require(is_point(point), field, POINT, repr(point))
    centre = kernel.xyz(kernel.volume_properties(solid).CentreOfMass()) * 1e-3
    reach = kernel.diagonal(solid) * 1e-3 * 100
    valid = f"a point within {reach:.3g} m of the solid's centre, 100 times its diagonal"
    require(math.dist(point, centre) <= reach, field, valid, f"{point} m")


def _axes(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(3, 3) the unit directions x, y, z as rows."""
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def _centroid(part: Part, chosen: frozenset[int]) -> np.ndarray:
    faces = [part.faces[index] for index in sorted(chosen)]
    return np.average([face.centroid for face in faces], axis=0, weights=[face.area for face in faces])

"""Contacts between solids of an assembly: pins in bores, faces, balls in sockets, cones."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import nnls

from stiffscope import cad
from stiffscope.cad.assembly import Instance
from stiffscope.cad.faces import FaceGeometry
from stiffscope.runtime.types import Array, Progress

PARALLEL = 1e-4  # rad: tolerance of equal directions
ASIDE = 5e-6  # m: tolerance of equal axes and centres
TOUCHING = 2e-5  # m: tolerance of touching planes
LOOSE = 0.24
TIGHT = 0.2  # of the radius: largest clearance (ISO 273, M2 coarse) and overlap
PLAY = 2.2e-4
_PLAY_SHARE = 0.02  # m, and of its size: largest play of a plane guide
_LEAST_AREA = 1e-8  # m²


@dataclass(frozen=True, eq=False)
class Contact:
    """A face of one solid in contact with a face of another.

    Attributes
    ----------
    first, second : indices of the solids.
    faces : index of the face on each solid.
    kind : "plane", "cylinder", "sphere" or "cone".
    point, axis : centre (3,) of the contact, m, and normal (3,) of a plane or axis of a round face.
    gap : m; negative if the solids overlap. For round faces, the difference of radii.
    size : m; length of a round contact along its axis, √area of others.
    radius : m; of a round contact.
    inner : which solid is inside, 0 or 1; None for planes.
    """

    first: int
    second: int
    faces: tuple[int, int]
    kind: str
    point: Array
    axis: Array
    gap: float
    size: float
    radius: float = 0.0
    inner: int | None = None

    def find_other(self, solid: int) -> int:
        """Return the other solid of the contact."""
        return self.second if solid == self.first else self.first

    def face_of(self, solid: int) -> int:
        """Return the face index of one of the two solids."""
        return self.faces[solid != self.first]


def find_contacts(
    solids: Sequence[Instance], progress: Progress | None = None
) -> list[Contact]:
    """Find all pairs of faces in contact between the solids of one assembly.

    They are parallel to 1e-4 rad, coaxial or concentric to 5 um; planes within 20 um, or with a
    play of up to 0.22 mm if other planes or a pin bound it; radii within the range of screw
    clearances and thread undercuts (-20 to +24 %).
    """
    boxes = np.array([solid.box for solid in solids])
    near = np.all(boxes[:, None, 0] <= boxes[None, :, 1] + PLAY, axis=-1)
    pairs = [(i, j) for i, j in np.argwhere(near & near.T).tolist() if i < j]
    contacts: list[Contact] = []
    for done, (i, j) in enumerate(pairs):
        contacts += _contacts_of(i, j, solids[i], solids[j])
        if progress is not None:
            progress("contacts", (done + 1) / len(pairs))
    return _drop_open(_drop_covered(contacts))


def _drop_covered(contacts: list[Contact]) -> list[Contact]:
    """Drop contacts of a pin and a bore with a ring between them."""
    bores = defaultdict[tuple[int, int], set[int]](set)
    pins = defaultdict[tuple[int, int], set[int]](set)
    fits = []
    for contact in contacts:
        ends = (contact.first, contact.faces[0]), (contact.second, contact.faces[1])
        pin, bore = ends[::-1] if contact.inner else ends
        fits.append((contact, pin, bore))
        if contact.kind == "cylinder":
            bores[pin].add(bore[0])
            pins[bore].add(pin[0])
    return [
        e
        for e, pin, bore in fits
        if e.kind != "cylinder" or not bores[pin] & pins[bore]
    ]


def _drop_open(contacts: list[Contact]) -> list[Contact]:
    """Drop planes with unbounded play: no opposing plane of one of the solids."""
    normals = defaultdict[int, list[Array]](list)
    axes = defaultdict[tuple[int, int], list[Array]](list)
    for each in contacts:
        if each.kind == "plane":
            normals[each.first].append(each.axis)
            normals[each.second].append(-each.axis)
        else:
            axes[each.first, each.second].append(each.axis)

    def is_kept(each: Contact) -> bool:
        if each.kind != "plane" or each.gap <= TOUCHING:
            return True
        pins = axes[each.first, each.second]
        if any(np.linalg.norm(np.cross(each.axis, axis)) < PARALLEL for axis in pins):
            return True
        ends = (each.first, -each.axis), (each.second, each.axis)
        return any(
            nnls(np.transpose(normals[solid]), axis)[1] < 1e-3 for solid, axis in ends
        )

    return [contact for contact in contacts if is_kept(contact)]


def _contacts_of(i: int, j: int, one: Instance, other: Instance) -> Iterator[Contact]:
    box = np.stack(
        [np.maximum(one.box[0], other.box[0]), np.minimum(one.box[1], other.box[1])]
    )
    boxed = (
        zip(instance.faces, instance.face_boxes, strict=True)
        for instance in (one, other)
    )
    shared = (
        [face for face, limits in pairs if _meet(limits, box, PLAY)] for pairs in boxed
    )
    for a, b in product(*shared):
        if a.kind != b.kind:
            continue
        if a.kind == "plane":
            plane = _plane(a, b, one, other)
        elif a.kind in {"cylinder", "sphere", "cone"} and a.hollow != b.hollow:
            plane = {"cylinder": _cylinder, "sphere": _sphere, "cone": _cone}[a.kind](
                a, b
            )
        else:
            continue
        if plane is not None:
            bounds = (
                (0.0, None)
                if a.kind == "plane"
                else (min(a.radius, b.radius), int(a.hollow))
            )
            yield Contact(i, j, (a.index, b.index), a.kind, *plane, *bounds)


def _meet(box: Array, other: Array, within: float) -> bool:
    return bool(
        np.all(box[0] <= other[1] + within) and np.all(other[0] <= box[1] + within)
    )


_Found = tuple[Array, Array, float, float] | None  # middle, axis, gap, size


def _plane(a: FaceGeometry, b: FaceGeometry, one: Instance, other: Instance) -> _Found:
    if a.axis @ b.axis > -1.0 + 0.5 * PARALLEL**2:
        return None
    gap = float(a.axis @ (b.origin - a.origin))
    boxes = one.face_boxes[a.index], other.face_boxes[b.index]
    if not -TOUCHING <= gap <= PLAY or not _meet(*boxes, PLAY):
        return None
    faces = one.shapes[a.index], other.shapes[b.index]
    area, centre = cad.kernel.common_area(faces, -1e3 * gap * a.axis)
    size = 1e-3 * float(np.sqrt(area))
    if 1e-6 * area < _LEAST_AREA or gap > max(TOUCHING, _PLAY_SHARE * size):
        return None
    return 1e-3 * centre, a.axis, gap, size


def _fit(a: FaceGeometry, b: FaceGeometry) -> float | None:
    """Return the radial clearance of a bore, m; None if the faces do not fit."""
    gap = (a.radius - b.radius) * (1.0 if a.hollow else -1.0)
    radius = max(a.radius, b.radius)
    return gap if -TIGHT * radius <= gap <= LOOSE * radius + TOUCHING else None


def _cylinder(a: FaceGeometry, b: FaceGeometry) -> _Found:
    gap = _fit(a, b)
    if gap is None or not _coaxial(a, b):
        return None
    low, high = _overlap(a, b)
    if high - low < 1e-2 * max(a.radius, b.radius):
        return None
    return a.origin + 0.5 * (low + high) * a.axis, a.axis, gap, high - low


def _coaxial(a: FaceGeometry, b: FaceGeometry) -> bool:
    aside = np.cross(a.axis, b.origin - a.origin)
    parallel = np.linalg.norm(np.cross(a.axis, b.axis)) < PARALLEL
    return bool(parallel and np.linalg.norm(aside) < ASIDE)


def _overlap(a: FaceGeometry, b: FaceGeometry) -> tuple[float, float]:
    """Return the overlap of two coaxial round faces, m along the first's axis from its origin."""
    ends = np.array(
        [a.axis @ (b.origin - a.origin) + (a.axis @ b.axis) * end for end in b.extent]
    )
    return max(a.extent[0], float(ends.min())), min(a.extent[1], float(ends.max()))


def _sphere(a: FaceGeometry, b: FaceGeometry) -> _Found:
    gap = _fit(a, b)
    if gap is None or np.linalg.norm(a.origin - b.origin) > ASIDE:
        return None
    return a.origin, a.axis, gap, float(np.sqrt(min(a.area, b.area)))


def _cone(a: FaceGeometry, b: FaceGeometry) -> _Found:
    if abs(abs(a.half_angle) - abs(b.half_angle)) > PARALLEL or not _coaxial(a, b):
        return None
    tips = [
        surface.origin - surface.radius / np.tan(surface.half_angle) * surface.axis
        for surface in (a, b)
    ]
    gap = float(np.linalg.norm(tips[0] - tips[1]) * np.sin(abs(a.half_angle)))
    low, high = _overlap(a, b)
    if gap > TOUCHING or high <= low:
        return None
    return a.origin + 0.5 * (low + high) * a.axis, a.axis, gap, high - low

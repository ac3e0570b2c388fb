"""Imprints of contacts: the outlines of what touches a solid, as edges that split its faces.

The solid stays one solid of the same volume; the patches on which others act become faces.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from stiffscope import cad
from stiffscope.cad.assembly import Instance
from stiffscope.cad.contacts import Contact
from stiffscope.cad.faces import FaceGeometry
from stiffscope.runtime.types import Array

_INSIDE = 2e-5  # m: a border nearer to that of a face is the same
_ON = 2e-6  # m: distance of a patch from what touches it, beyond the clearance
_ALIKE = 1e-9  # relative change of volume by an imprint: rounding


def imprint_contacts(
    number: int, solids: Sequence[Instance], contacts: Iterable[Contact]
) -> tuple[Instance, dict[Contact, tuple[int, ...]]]:
    """Return a solid with the outlines of its contacts as edges, and the faces of each contact.

    Parameters
    ----------
    number, solids
        The solid's number, and all solids of the assembly.
    contacts
        Contacts of this solid with others.

    Returns
    -------
    Instance
        The solid at its place; the same one if nothing had to be split, or if the kernel could not.
    dict
        Indices of the faces that each contact covers; the whole face if it could not be split.
    """
    solid = solids[number]
    remaining = list(contacts)
    lines = [line for face in remaining for line in _find_lines(number, solids, face)]
    imprinted = cad.kernel.imprint_lines(solid.solid, lines) if lines else None
    pieces = {index: (index,) for index in range(len(solid.faces))}
    new = solid
    if imprinted is not None:
        split, pieces = imprinted
        change = abs(cad.kernel.volume_properties(split).Mass() * 1e-9)
        if abs(change - solid.product.volume) <= _ALIKE * solid.product.volume:
            new = replace(solid, product=_in_own_axes(solid, split))
        else:
            pieces = {index: (index,) for index in range(len(solid.faces))}
    edges_by_solid = {}
    for each in remaining:
        whole = pieces[each.face_of(number)]
        covered = [face for face in whole if _covers(new, face, number, solids, each)]
        edges_by_solid[each] = tuple(covered) or whole
    return new, edges_by_solid


def _in_own_axes(solid: Instance, split: "cad.kernel.Solid") -> cad.assembly.Product:
    back = solid.rotation.T
    moved = cad.kernel.place_solid(split, back, -1e3 * back @ solid.origin)
    return replace(solid.product, solid=moved)


def _find_lines(
    number: int, solids: Sequence[Instance], contact: Contact
) -> list["cad.kernel.Edge"]:
    """Return the outline of a contact on a solid's face, mm; none where it covers the face."""
    other = contact.find_other(number)
    index = contact.face_of(number)
    face = solids[number].faces[index]
    shape = solids[number].shapes[index]
    other_face = solids[other].faces[contact.face_of(other)]
    their_shape = solids[other].shapes[contact.face_of(other)]
    if contact.kind == "plane":
        # `gap` is measured along the first solid's normal
        sign = -1.0 if contact.first == number else 1.0
        step = sign * 1e3 * contact.gap * contact.axis
        return cad.kernel.common_outline((shape, their_shape), step)
    if contact.kind == "sphere":
        return []
    lines = []
    middle = face.axis @ (contact.point - face.origin)
    for end in (middle - 0.5 * contact.size, middle + 0.5 * contact.size):
        if face.extent[0] + _INSIDE < end < face.extent[1] - _INSIDE:
            at = 1e3 * (face.origin + end * face.axis)
            lines += cad.kernel.section(shape, at, face.axis)
    for spoke in _find_spokes(their_shape, other_face):
        across = np.cross(face.axis, spoke)
        for line in cad.kernel.section(shape, 1e3 * face.origin, across):
            point = 1e-3 * cad.kernel.middle_of_edge(line) - face.origin
            if point @ spoke > 0.0:
                lines.append(line)
    return lines


def _find_spokes(shape: "cad.kernel.Face", face: FaceGeometry) -> list[Array]:
    """Return the directions (3,) of the straight borders of a round face that is not closed."""
    spokes = []
    for edge in cad.kernel.edges(shape):
        if cad.kernel.is_seam(edge, shape):
            continue
        ends = [1e-3 * cad.kernel.position(v) for v in cad.kernel.vertices(edge)]
        if len(ends) != 2:
            continue
        along = ends[1] - ends[0]
        size = float(np.linalg.norm(along))
        if size < _INSIDE or np.linalg.norm(np.cross(along, face.axis)) > 1e-3 * size:
            continue
        out = ends[0] - face.origin
        out = out - face.axis * (face.axis @ out)
        spokes.append(out / np.linalg.norm(out))
    return spokes


def _covers(
    solid: Instance,
    piece: int,
    number: int,
    solids: Sequence[Instance],
    contact: Contact,
) -> bool:
    """Return whether the inside of a piece of a face lies where the other solid touches it."""
    other = contact.find_other(number)
    other_face = solids[other].faces[contact.face_of(other)]
    shape = solids[other].shapes[contact.face_of(other)]
    point = 1e-3 * cad.kernel.inner_point(solid.shapes[piece])
    on = solid.faces[piece].project(point[None])
    on = point[None] if on is None else on
    foot = other_face.project(on)
    foot = on if foot is None else foot
    away = 1e-3 * cad.kernel.distance(shape, 1e3 * foot[0])
    return away < _ON + 1e-3 * float(np.sqrt(other_face.area))

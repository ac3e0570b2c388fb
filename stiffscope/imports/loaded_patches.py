"""Interfaces of an imported part: the patches of its faces on which its joints act.

Where two joints act on the same patch they share an interface; patches that touch are parted by
leaving out the smaller one, as the same nodes cannot belong to two rigid interfaces.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from stiffscope import cad
from stiffscope.cad.imprint import imprint_contacts
from stiffscope.imports.hardware import FIT
from stiffscope.imports.part_motions import Freedom

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.cad.assembly import Instance
    from stiffscope.cad.contacts import Contact

_ENOUGH = 0.2  # of an interface's area that must stay where patches are left out
_SLIVER = 1e-3  # of an interface's area: smaller pieces are left out


@dataclass(frozen=True, eq=False)
class LoadedPart:
    """A part with the outlines of its contacts as edges, and the faces of each of its joints.

    ``shared``: joints that act on the same faces as another, by that other; ``touching``: pairs of
    joints whose faces touch and cannot be parted.
    """

    solid: Instance
    faces: dict[Freedom, tuple[int, ...]]
    shared: dict[Freedom, Freedom] = field(default_factory=dict)
    touching: list[tuple[Freedom, Freedom]] = field(default_factory=list)


def find_patches(
    number: int, solids: Sequence[Instance], joints: Sequence[Freedom]
) -> LoadedPart:
    """Return a part with the patches that its joints load as faces of their own.

    Parameters
    ----------
    number, solids
        The part's number, and all solids of the assembly.
    joints
        Its joints.
    """
    loads = {joint: _loading(number, joint) for joint in joints}
    contacts = list(
        dict.fromkeys(contact for some in loads.values() for contact in some)
    )
    solid, patches = imprint_contacts(number, solids, contacts)
    areas = [face.area for face in solid.faces]
    faces = dict[Freedom, set[int]]()
    for joint, some in loads.items():
        faces_of_joint = {face for contact in some for face in patches[contact]}
        if not some and solid is solids[number]:  # a joint of the assembly itself
            faces_of_joint = {*joint.faces[joint.first != number]}
        whole = sum(areas[face] for face in faces_of_joint)
        faces[joint] = {
            face for face in faces_of_joint if areas[face] > _SLIVER * whole
        }
    shared = _share_faces(faces, areas)
    touching = _part_touching(solid, faces, areas)
    loaded = {joint: tuple(sorted(own)) for joint, own in faces.items()}
    return LoadedPart(solid, loaded, shared, touching)


def _loading(number: int, joint: Freedom) -> list[Contact]:
    """Return the contacts by which a joint loads a part.

    In a moving joint with round contacts these carry, not the planes beside them.
    """
    contacts_of_part = [
        contact
        for contact in joint.contacts
        if number in {contact.first, contact.second}
    ]
    round_ = [contact for contact in contacts_of_part if contact.kind != "plane"]
    if joint.kind == "fixed":
        # a screw in a clearance hole presses on the planes, if there are any
        planes = [contact for contact in contacts_of_part if contact.kind == "plane"]
        tight = [
            contact
            for contact in round_
            if not contact.radius or contact.gap <= FIT[1] * contact.radius
        ]
        return [*planes, *tight] or contacts_of_part
    return round_ or contacts_of_part


def _share_faces(
    faces: dict[Freedom, set[int]], areas: Sequence[float]
) -> dict[Freedom, Freedom]:
    """Give each face to one joint; return joints that have none left, and whose faces they share."""
    shared = dict[Freedom, Freedom]()
    joints = list(faces)
    for k, joint in enumerate(joints):
        for other in joints[:k]:
            if other in shared:
                continue
            both = faces[joint] & faces[other]
            if not both:
                continue
            common = sum(areas[face] for face in both)
            left = {
                candidate: sum(areas[face] for face in faces[candidate]) - common
                for candidate in (joint, other)
            }
            richer = max((joint, other), key=left.__getitem__)
            if left[richer] >= _ENOUGH * (left[richer] + common):
                faces[richer] -= both
            else:
                faces[other] |= faces[joint]
                shared[joint] = other
                del faces[joint]
                break
    return shared


def _part_touching(
    solid: Instance, faces: dict[Freedom, set[int]], areas: Sequence[float]
) -> list[tuple[Freedom, Freedom]]:
    """Leave out faces until no two joints' faces touch; return the pairs that still do."""
    corners = cad.kernel.corner_numbers(solid.product.solid)
    whole = {joint: sum(areas[face] for face in own) for joint, own in faces.items()}
    stuck = list[tuple[Freedom, Freedom]]()
    joints = list(faces)
    for k, joint in enumerate(joints):
        for other in joints[:k]:
            if not _separate(
                joint=joint,
                other=other,
                faces=faces,
                corners=corners,
                areas=areas,
                whole=whole,
            ):
                stuck.append((other, joint))
    return stuck


def _separate(
    joint: Freedom,
    other: Freedom,
    faces: dict[Freedom, set[int]],
    corners: Sequence[frozenset[int]],
    areas: Sequence[float],
    whole: dict[Freedom, float],
) -> bool:
    """Leave out the smaller of touching faces of two joints, while enough of either stays."""
    while True:
        pairs = [
            (one, two)
            for one in faces[joint]
            for two in faces[other]
            if corners[one] & corners[two]
        ]
        if not pairs:
            return True
        able = []
        for one, two in pairs:
            for owner, face in ((joint, one), (other, two)):
                left = sum(areas[number] for number in faces[owner]) - areas[face]
                if left >= _ENOUGH * whole[owner]:
                    able.append((areas[face] / whole[owner], owner is joint, face))
        if not able:
            return False
        _, of_joint, face = min(able)
        faces[joint if of_joint else other].remove(face)

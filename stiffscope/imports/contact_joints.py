"""Joints of an assembly from its contacts: the freedoms that all contacts of two parts leave.

A contact constrains the relative twist: a plane its normal and two tilts, a pin in a bore two
translations and two tilts, a ball three translations, a cone all but the spin about its axis.
Hardware between two parts is a mechanism: screws fix, bearings leave their spin, pins and rings
constrain by their contacts. A round fit with overlap is a thread or press fit, which fixes. Planes
that can be lifted off each other are no moving joint: parts connected only by them are fixed, with
a doubt. The null space of the constraints is the freedom of the joint; its dimension and pitches
define the kind (K. H. Hunt, Kinematic Geometry of Mechanisms, Oxford 1978, ch. 3 and 12).
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from scipy.cluster.hierarchy import DisjointSet
from scipy.optimize import nnls

from stiffscope.imports.doubts import (
    Doubt,
    doubt_bores,
    doubt_built,
    doubt_threads,
)
from stiffscope.imports.hardware import FIT, NUTTED
from stiffscope.imports.part_motions import (
    Bond,
    Freedom,
    held_by,
    holds_more,
    joint_freedom,
    relative_freedom,
)
from stiffscope.vjm.model.screws import shift, skew
from stiffscope.vjm.model.subspaces import null_space, range_space

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stiffscope.cad.assembly import Instance
    from stiffscope.cad.built_assembly import BuiltJoint
    from stiffscope.cad.contacts import Contact
    from stiffscope.imports.hardware import Hardware
    from stiffscope.runtime.types import Array

THREADED = {"screw", "nut", "shaft nut", "shoulder screw"}
_SAME = 1e-6
_ALIKE = 1e-4  # of the radius: fits that do not differ
_LAID = "planes from which one could be lifted off the other: taken as fixed, "
_LAID += "as if glued or screwed; if it slides"
_SCREWED = (
    "planes with holes in line: taken as fixed, as if screws are missing; if it slides"
)
_SLIDES = "planes that slide on each other: taken as planar; if glued or screwed"
_IDLE = "plane on plane where other joints guide already: taken as no joint; if it carries load"


def hold(kind: str, axis: Array, at: Array) -> Array:
    """Return rows (m, 6) on twists at the base origin that a contact about an axis (3,) holds."""
    across = null_space(axis[None, :]).T
    if kind == "plane":
        lines = axis[None, :]
        turns = across
    elif kind == "sphere":
        lines = np.eye(3)
        turns = np.zeros((0, 3))
    else:
        lines = np.eye(3) if kind == "cone" else across
        turns = across
    rows = np.zeros((len(lines) + len(turns), 6))
    rows[: len(lines), :3] = lines
    rows[len(lines) :, 3:] = turns
    return rows @ shift(at)


def _bonds_of(
    solids: Sequence[Instance],
    contacts: Iterable[Contact],
    hardware: Hardware,
    scale: float,
    built: Sequence[BuiltJoint],
) -> list[Bond]:
    """Return the bonds by contacts; screws and seats fix everything, bearings leave their spin.

    The assembly's own joints replace the contacts of their two solids.
    """
    bonds = []
    taken = {frozenset((joint.first, joint.second)) for joint in built}
    touching = defaultdict[frozenset[int], list["Contact"]](list)
    for contact in contacts:
        pair = frozenset((contact.first, contact.second))
        touching[pair].append(contact)
        rows = None if pair in taken else _held_by(contact, hardware, scale)
        if rows is not None:
            bonds.append(Bond(contact.first, contact.second, rows, contact))
    for joint in built:
        free = [
            joint_freedom(kind, at / scale, axis, None)
            for kind, at, axis in joint.motions
        ]
        rows = null_space(np.hstack(free).T).T
        for each in touching[frozenset((joint.first, joint.second))] or [None]:
            at = joint.motions[0][1]
            bonds.append(
                Bond(
                    first=joint.first,
                    second=joint.second,
                    rows=rows,
                    contact=each,
                    label=joint.label,
                    at=at,
                )
            )
    for small, large in hardware.pairs:  # a cone leaves the spin alone, too
        form = solids[small].product.form
        ring = solids[small]
        axis = np.array([0.0, 0.0, 1.0]) if form is None else ring.place_axis(form)[1]
        bonds.append(Bond(small, large, hold("cone", axis, ring.centre / scale), None))
    return bonds


def _held_by(contact: Contact, hardware: Hardware, scale: float) -> Array | None:
    """Return the constraint rows (m, 6) of a contact, considering hardware; None if it has none."""
    ends = contact.first, contact.second
    roles = [hardware.roles.get(end, "") for end in ends]
    bearing = next(
        (n for n, role in enumerate(roles) if role in {"bearing", "ring"}), None
    )
    fits = (
        contact.kind in {"plane", "cone"}
        or FIT[0] <= contact.gap / contact.radius <= FIT[1]
    )
    if "rolling element" in roles:
        return None
    if bearing is not None:
        if contact.kind != "cylinder" or not fits:
            return None
        if roles[bearing] == "ring" or contact.inner != bearing:
            return np.eye(
                6
            )  # a seat; of a bearing drawn as one solid, only on its inner ring
        return hold("cone", contact.axis, contact.point / scale)
    turns = fits and "shoulder screw" in roles
    thread = THREADED & {*roles} and contact.kind != "plane" and not turns
    tight = contact.kind == "cylinder" and contact.gap / contact.radius < FIT[0]
    if thread or tight:
        return np.eye(6)
    return hold(contact.kind, contact.axis, contact.point / scale) if fits else None


def kind_of(
    freedom: Array, near: Array
) -> tuple[str, Array, Array | None, Array | None]:
    """Return kind, place near a point (3,), and axes of the joint with free twists (6, k).

    The kind is "" if a robot file has no such joint.
    """
    turns = range_space(freedom[3:])
    slides = range_space(freedom[:3] @ null_space(freedom[3:]))
    counts = turns.shape[1], slides.shape[1]
    if counts == (0, 1):
        return "prismatic", near, _positive(slides[:, 0]), None
    if counts[0] == 1:
        return _about_one(freedom, turns[:, 0], slides, near)
    if counts[0] and not counts[1]:
        return _about_point(freedom, turns, near)
    return "" if any(counts) else "fixed", near, None, None


_Kind = tuple[str, "Array", "Array | None", "Array | None"]
_Pair = tuple[int, int]


def _about_one(freedom: Array, axis: Array, slides: Array, near: Array) -> _Kind:
    """Return a joint that rotates about one direction, with any sliding directions."""
    line = (freedom @ np.linalg.lstsq(freedom[3:], axis, rcond=None)[0])[:3]
    off = line - slides @ (slides.T @ line)
    foot = np.cross(axis, line)
    at = foot + axis * float(axis @ (near - foot))
    along = float(np.linalg.norm(slides.T @ axis))
    straight = abs(off @ axis) < _SAME
    kinds = {
        0: "revolute" if straight else "",
        1: "cylindrical" if along > 1.0 - _SAME else "",
        2: "planar" if along < _SAME and straight else "",
    }
    kind = kinds.get(slides.shape[1], "")
    return kind, near if kind == "planar" else at, _positive(axis), None


def _about_point(freedom: Array, turns: Array, near: Array) -> _Kind:
    """Return a joint that rotates about two or three directions through a point c: v = -w x c."""
    lines = freedom[:3] @ np.linalg.lstsq(freedom[3:], turns, rcond=None)[0]
    matrix = np.vstack([-skew(turn) for turn in turns.T])
    centre = np.linalg.lstsq(matrix, lines.T.ravel(), rcond=None)[0]
    if np.abs(matrix @ centre - lines.T.ravel()).max() > _SAME:
        return "", near, None, None
    if turns.shape[1] == 3:
        return "spherical", centre, None, None
    return "universal", centre, turns[:, 0], turns[:, 1]


def _positive(axis: Array) -> Array:
    """Return the axis with its largest component positive."""
    return axis * np.sign(axis[int(np.argmax(np.abs(np.round(axis, 9))))])


def measure_size(solids: Sequence[Instance]) -> float:
    """Return the diagonal of the bounding box, m: the unit of length of `Freedom.freedom`."""
    boxes = np.array([solid.box for solid in solids])
    return float(np.linalg.norm(boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)))


def find_joints(
    solids: Sequence[Instance],
    contacts: Sequence[Contact],
    hardware: Hardware,
    built: Sequence[BuiltJoint] = (),
) -> tuple[list[Freedom], list[Doubt]]:
    """Find the joints between parts, numbered as the solids, and doubts on ambiguous contacts.

    ``built``: joints of the assembly itself, which take precedence over contacts.
    """
    scale = measure_size(solids)
    bonds = _bonds_of(solids, contacts, hardware, scale, built)
    between: dict[tuple[int, int], list[Bond]] = defaultdict(list)
    for bond in bonds:
        if not hardware.roles.keys() & {*bond.ends}:
            between[bond.ends].append(bond)
    direct = set(between)
    bought = [bond for bond in bonds if hardware.roles.keys() >= {*bond.ends}]
    for cluster in _join(hardware.roles, bought).subsets():
        inside = [bond for bond in bonds if cluster & {*bond.ends}]
        ends = sorted({end for bond in inside for end in bond.ends} - cluster)
        for i, j in _pair_up(ends, inside, direct):
            within = (bond for bond in inside if cluster | {i, j} >= {*bond.ends})
            between[i, j] += [bond for bond in within if {*bond.ends} != {i, j}]
    joints, doubts, planes = list[Freedom](), list[Doubt](), dict[Freedom, float]()
    for (i, j), held in between.items():
        joint = _freedom(
            i=i, j=j, bonds=held, solids=solids, scale=scale, hardware=hardware
        )
        kinds = {"" if b.contact is None or b.label else b.contact.kind for b in held}
        bare = kinds == {"plane"} and not hardware.roles.keys() & {
            n for b in held for n in b.ends
        }
        if joint.kind == "planar" or (joint.kind == "prismatic" and bare):
            planes[joint] = -sum(
                bond.contact.size for bond in held if bond.contact is not None
            )
        elif joint.kind:
            joints.append(joint)
            turning = _turning_kind(joint, held, hardware, scale)
            doubts += doubt_threads(
                joint=joint,
                turning=turning,
                bonds=held,
                solids=solids,
                hardware=hardware,
                contacts=contacts,
            )
        else:
            left = f"{joint.freedom.shape[1]} freedoms are left ({joint.reason})"
            text = f"{left}, which no joint has; say which with --joint"
            doubts.append(
                Doubt((solids[i].name, solids[j].name), text, tuple(joint.at))
            )
    if built:
        doubts += doubt_built(
            joints, find_joints(solids, contacts, hardware)[0], built, solids
        )
    joints = _hold_rods(joints, [*planes], solids, doubts)
    joints = _add_planes(
        joints, sorted(planes, key=planes.__getitem__), contacts, solids, doubts
    )

    def adds(contact: Contact) -> bool:
        rows = hold(contact.kind, contact.axis, contact.point / scale)
        return contact.gap < 0 or holds_more(
            rows, joints, contact.first, contact.second
        )

    return joints, doubts + doubt_bores(solids, contacts, hardware, adds)


def _hold_rods(
    joints: list[Freedom],
    planes: Sequence[Freedom],
    solids: Sequence[Instance],
    doubts: list[Doubt],
) -> list[Freedom]:
    """Fix rods that slide in all their bores, so that nothing holds them, in the tightest of these.

    Of equal fits those at the rod's ends hold it. A rod in one bore is a slide. A rod that all its
    bores would hold is held by parts that are joined without it, and the others move on it: pressed
    into all of them, it would be no joint where it is the only one. Rods apart whose ends lie in the
    same parts leave these no turn, and no way but off the rods: tie rods, held by all of them.
    """
    joints_of = defaultdict[int, list[Freedom]](list)
    for joint in [*joints, *planes]:
        for end in joint.ends:
            joints_of[end].append(joint)
    rods = {
        rod: around for rod, around in joints_of.items() if _is_bare_rod(rod, around)
    }
    fixed = [joint for joint in joints if joint.kind == "fixed"]
    laid = [plane for plane in planes if not _is_turned_on(plane, rods)]
    bodies = _join(range(len(solids)), [*fixed, *laid])
    tightest = {rod: _tightest(rod, around, solids) for rod, around in rods.items()}
    ties = _find_ties(rods, tightest, bodies, solids)
    held = set[Freedom]()
    for rod, around in rods.items():
        tight = tightest[rod]
        others = list[str]()
        if len(tight) == len(around) and rod not in ties:
            tight = _choose_seats(rod, around, bodies)
            rest = [_other_end(joint, rod) for joint in around if joint not in tight]
            others = [solids[n].name for n in rest]
        held |= {*tight}
        names = [solids[_other_end(joint, rod)].name for joint in tight]
        text = "a rod that nothing else holds: taken as a press fit in "
        text += f"{' and '.join(names)}; if it slides, say --joint "
        text += f'"{solids[rod].name}/{names[0]}=cylindrical"'
        if others:
            text += f"; if it is pressed into {' and '.join(others)}, too, say --joint "
            text += f'"{solids[rod].name}/{others[0]}=fixed"'
        doubts.append(Doubt((solids[rod].name,), text, tuple(tight[0].at)))
    return [
        replace(_fix(joint), reason=f"{joint.reason}, press fit")
        if joint in held
        else joint
        for joint in joints
    ]


def _tightest(
    rod: int, around: Sequence[Freedom], solids: Sequence[Instance]
) -> list[Freedom]:
    """Return the bores that may hold a rod: the tightest, and of equal fits those at its ends."""
    clearance = {contact: _clearance(contact) for contact in around}
    least = min(clearance.values())
    tight = [contact for contact in around if clearance[contact] <= least + _ALIKE]
    if len(tight) < len(around):
        return tight
    return [contact for contact in tight if _is_at_end(contact, rod, solids)] or tight


def _find_ties(
    rods: Mapping[int, Sequence[Freedom]],
    tightest: Mapping[int, Sequence[Freedom]],
    bodies: DisjointSet,
    solids: Sequence[Instance],
) -> set[int]:
    """Return the rods that end in the same bodies as another rod that is not in line with them."""
    spans = defaultdict[frozenset[int], list[int]](list)
    for rod, tight in tightest.items():
        ends = {bodies[_other_end(joint, rod)] for joint in tight}
        if len(ends) > 1 and all(_is_at_end(joint, rod, solids) for joint in tight):
            spans[frozenset(ends)].append(rod)
    ties = set[int]()
    for alike in spans.values():
        for one, other in combinations(alike, 2):
            if not _are_in_line(rods[one][0].contacts[0], rods[other][0].contacts[0]):
                ties |= {one, other}
    return ties


def _are_in_line(one: Contact, other: Contact) -> bool:
    """Return whether two cylinders have the same axis."""
    parallel = np.linalg.norm(np.cross(one.axis, other.axis)) <= _SAME
    off = np.linalg.norm(np.cross(one.axis, other.point - one.point))
    return bool(parallel and off <= _ALIKE * one.radius)


def _choose_seats(
    rod: int, around: Sequence[Freedom], bodies: DisjointSet
) -> list[Freedom]:
    """Return the bores that hold a rod among equal ones: most, then longest, in one body."""
    seats = defaultdict[int, list[Freedom]](list)
    for joint in around:
        seats[bodies[_other_end(joint, rod)]].append(joint)

    def grip(joints: Sequence[Freedom]) -> tuple[int, float]:
        lengths = [contact.size for joint in joints for contact in joint.contacts]
        return len(joints), sum(lengths)

    return max(seats.values(), key=grip)


def _is_turned_on(plane: Freedom, rods: Mapping[int, Sequence[Freedom]]) -> bool:
    """Return whether a plane lies across a rod in both its parts, which turn about the rod on it."""
    for rod, around in rods.items():
        parts = {_other_end(joint, rod) for joint in around}
        axis = around[0].contacts[0].axis
        tilts = [np.linalg.norm(np.cross(axis, c.axis)) for c in plane.contacts]
        if parts >= {*plane.ends} and all(tilt <= _SAME for tilt in tilts):
            return True
    return False


def _other_end(joint: Freedom, part: int) -> int:
    """Return the part that a joint connects with a part."""
    return joint.first + joint.second - part


def _is_bare_rod(rod: int, around: Sequence[Freedom]) -> bool:
    """Return whether all joints of a part are those of a rod in parallel bores of several parts."""
    if len(around) < 2 or not all(_is_bare_fit(joint, rod) for joint in around):
        return False
    axes = [joint.contacts[0].axis for joint in around]
    return all(np.linalg.norm(np.cross(axes[0], axis)) <= _SAME for axis in axes)


def _is_bare_fit(joint: Freedom, rod: int) -> bool:
    """Return whether a joint is nothing but a rod in bores, in which it turns and slides."""
    kinds = {contact.kind for contact in joint.contacts}
    inside = all(
        (contact.first, contact.second)[contact.inner or 0] == rod
        for contact in joint.contacts
    )
    return joint.kind == "cylindrical" and kinds == {"cylinder"} and inside


def _clearance(joint: Freedom) -> float:
    """Return the clearance of a rod in its bores, relative to the radius."""
    return max(contact.gap / contact.radius for contact in joint.contacts)


def _is_at_end(joint: Freedom, rod: int, solids: Sequence[Instance]) -> bool:
    """Return whether a bore reaches an end of the rod's face in it, or nearly so."""
    for contact in joint.contacts:
        face = solids[rod].faces[contact.face_of(rod)]
        middle = float(face.axis @ (contact.point - face.origin))
        low, high = face.extent
        near = 0.1 * (high - low)
        if middle - 0.5 * contact.size < low + near:
            return True
        if middle + 0.5 * contact.size > high - near:
            return True
    return False


def _join(pieces: Iterable[int], links: Iterable[Bond | Freedom]) -> DisjointSet:
    """Return the sets of pieces that links connect."""
    joined = DisjointSet(pieces)
    for link in links:
        joined.merge(link.first, link.second)
    return joined


def _pair_up(
    ends: Sequence[int], bonds: Sequence[Bond], direct: set[_Pair]
) -> list[_Pair]:
    """Return pairs of parts joined by hardware: in contact, or else nearest along its axis."""
    if len(ends) < 2:
        return []
    touching = [
        (bond.ends, bond.contact.point) for bond in bonds if bond.contact is not None
    ]
    places = np.array(
        [np.mean([p for pair, p in touching if end in pair], axis=0) for end in ends]
    )
    axis = np.linalg.svd(places - places.mean(axis=0))[2][0]
    order = [ends[n] for n in np.argsort(places @ axis, kind="stable")]
    apart = {
        (i, j): abs(order.index(j) - order.index(i))
        for i, j in combinations(sorted(ends), 2)
    }
    rank = apart | dict.fromkeys(direct & apart.keys(), 0)
    group = DisjointSet(ends)
    pairs = list[_Pair]()
    for i, j in sorted(rank, key=lambda pair: (rank[pair], pair)):
        if group.merge(i, j) or (i, j) in direct:
            pairs.append((i, j))
    return pairs


def _freedom(
    i: int,
    j: int,
    bonds: list[Bond],
    solids: Sequence[Instance],
    scale: float,
    hardware: Hardware,
) -> Freedom:
    scaled = relative_freedom([(*bond.ends, bond.rows) for bond in bonds], i, j)
    touching = [bond.contact for bond in bonds if bond.contact is not None]
    round_ = [contact for contact in touching if contact.kind != "plane"] or touching
    points = [contact.point for contact in round_] or [
        bond.at for bond in bonds if bond.at is not None
    ]
    near = np.mean(points, axis=0)
    kind, at, axis, axis2 = kind_of(scaled, near / scale)
    screwed = THREADED & {hardware.roles.get(n) for bond in bonds for n in bond.ends}
    if kind == "planar" and screwed:
        kind = "fixed"
        axis = None
        scaled = np.zeros((6, 0))  # clamped by screws in clearance holes
    faces = _loaded_faces(i, touching, solids[i]), _loaded_faces(j, touching, solids[j])
    reason = _reason((i, j), bonds, solids, hardware)
    place = kind, at * scale, axis, axis2
    return Freedom(i, j, *place, reason, faces, scaled, tuple(touching))


def _turning_kind(
    joint: Freedom, bonds: Sequence[Bond], hardware: Hardware, scale: float
) -> str:
    """Return the kind of a joint if its screws with nuts turn in their bores."""
    nutted = {n for n in hardware.roles if hardware.reasons[n] == NUTTED}
    if not nutted & {n for bond in bonds for n in bond.ends}:
        return joint.kind
    pins = replace(hardware, roles=hardware.roles | dict.fromkeys(nutted, "pin"))
    holds = list[tuple[int, int, "Array"]]()
    for bond in bonds:
        contact = None if bond.label else bond.contact
        rows = bond.rows if contact is None else _held_by(contact, pins, scale)
        holds += [] if rows is None else [(*bond.ends, rows)]
    return kind_of(relative_freedom(holds, *joint.ends), joint.at / scale)[0]


def _loaded_faces(
    end: int, touching: Sequence[Contact], solid: Instance
) -> tuple[int, ...]:
    """Return a joint's loaded faces of a solid: round, or plane and mostly in contact; else all."""
    contacts_of_end = [
        contact for contact in touching if end in {contact.first, contact.second}
    ]
    shares = defaultdict[int, float](float)
    for contact in contacts_of_end:
        face = solid.product.faces[contact.face_of(end)]
        shares[face.index] += (
            1.0 if contact.kind != "plane" else contact.size**2 / face.area
        )
    least = 0.9 if any(contact.kind != "plane" for contact in contacts_of_end) else 0.5
    return tuple(
        sorted([face for face, share in shares.items() if share > least] or shares)
    )


_CALLED = {
    "plane": "plane on plane",
    "cylinder": "pin in bore",
    "sphere": "ball in socket",
    "cone": "cone in cone",
}


def _reason(
    pair: _Pair, bonds: Sequence[Bond], solids: Sequence[Instance], hardware: Hardware
) -> str:
    """Describe the contacts."""
    words = defaultdict[str, int](int)
    for bond in bonds:
        if bond.label:
            words[bond.label] = 0
        for end in bond.ends:
            role = hardware.roles.get(end)
            if role in {"screw", "bearing", "pin", "ring"}:
                name = solids[end].name
                words[name if role in name.lower() else f"{role} {name}"] += 0
        if {*bond.ends} == {*pair} and bond.contact is not None:
            radius = (
                f" of radius {1e3 * bond.contact.radius:.4g} mm"
                if bond.contact.radius
                else ""
            )
            words[_CALLED[bond.contact.kind] + radius] += 1
    return ", ".join(
        f"{count} x {word}" if count > 1 else word for word, count in words.items()
    )


def _add_planes(
    joints: list[Freedom],
    planes: list[Freedom],
    contacts: Sequence[Contact],
    solids: Sequence[Instance],
    doubts: list[Doubt],
) -> list[Freedom]:
    """Add joints of planes: guides, and fixed joints of parts that only lie on each other.

    Planes between parts already guided by other joints are not joints. Doubts report both.
    """
    remaining, groups = list(joints), _join(range(len(solids)), joints)
    bodies = _join(
        range(len(solids)), [joint for joint in joints if joint.kind == "fixed"]
    )

    def settle(plane: Freedom, joint: Freedom | None, text: str) -> None:
        planes.remove(plane)
        names = tuple(solids[n].name for n in plane.ends)
        other = "fixed" if text is _SLIDES else plane.kind
        say = f', say --joint "{"/".join(names)}={other}"'
        doubts.extend([Doubt(names, text + say, tuple(plane.at))] if text else [])
        if joint is not None:
            remaining.append(joint)
            groups.merge(*joint.ends)

    screwed = {side for side in planes if _count_holes(side, solids) > 1}
    for guide in planes:
        if guide.kind == "prismatic" and not _lifts_off(guide, contacts, bodies):
            groups.merge(*guide.ends)

    def is_laid(plane: Freedom) -> bool:
        joined = groups.connected(
            *plane.ends
        )  # else what moves with either is lifted off with it
        return plane in screwed or _lifts_off(
            plane, contacts, bodies if joined else groups
        )

    while laid := next(filter(is_laid, planes), None):
        if groups.connected(*laid.ends) and _moves(laid, remaining):
            settle(laid, None, _IDLE)
            continue
        settle(laid, _fix(laid), _SCREWED if laid in screwed else _LAID)
        bodies.merge(*laid.ends)
    for plane in [*planes]:
        adds = plane.kind == "prismatic" or holds_more(
            held_by(plane)[2], remaining, *plane.ends
        )
        text = _SLIDES if plane.kind == "planar" else ""
        if not adds and not _moves(plane, remaining):
            settle(plane, _fix(plane), _LAID)
            continue
        settle(plane, plane if adds else None, text if adds else _IDLE)
    return remaining


def _fix(joint: Freedom) -> Freedom:
    """Return a joint as a fixed one."""
    return replace(joint, kind="fixed", axis=None, freedom=np.zeros((6, 0)))


def _moves(plane: Freedom, joints: Sequence[Freedom]) -> bool:
    """Return whether the parts of a plane move against each other, whatever the plane holds."""
    return bool(relative_freedom(map(held_by, joints), *plane.ends).shape[1])


def _count_holes(plane: Freedom, solids: Sequence[Instance]) -> int:
    """Return the number of round holes in line of two solids on a plane, as for missing screws."""

    def places(solid: Instance, axis: Array) -> set[tuple[float, ...]]:
        holes = (
            face for face in solid.faces if face.kind == "cylinder" and face.hollow
        )
        along = (
            face for face in holes if np.linalg.norm(np.cross(axis, face.axis)) < _SAME
        )
        return {
            tuple(np.round(1e4 * np.cross(axis, face.origin)) + 0.0) for face in along
        }

    if plane.axis is None or plane.kind != "planar":
        return 0
    return len(set.intersection(*(places(solids[n], plane.axis) for n in plane.ends)))


def _lifts_off(
    plane: Freedom, contacts: Sequence[Contact], bodies: DisjointSet
) -> bool:
    """Return whether one of two parts on planes, with its ``bodies``, lifts off the other."""
    ends = [bodies.subset(end) for end in plane.ends]
    planes = [contact for contact in contacts if contact.kind == "plane"]
    for one, other in (ends, ends[::-1]):
        touching = [
            side for side in planes if (side.first in one) != (side.second in one)
        ]
        outward = np.array(
            [
                contact.axis * (1.0 if contact.first in one else -1.0)
                for contact in touching
            ]
        )
        between = outward[
            [bool({contact.first, contact.second} & other) for contact in touching]
        ]
        if any(nnls(outward.T, -normal)[1] > 1e-3 for normal in between):
            return True
    return False

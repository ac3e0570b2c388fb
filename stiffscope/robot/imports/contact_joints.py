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
from typing import TYPE_CHECKING

import numpy as np
from scipy.cluster.hierarchy import DisjointSet
from scipy.optimize import nnls

from stiffscope.robot.imports.doubts import Doubt, doubt_bores, doubt_built, doubt_threads
from stiffscope.robot.imports.hardware import FIT, NUTTED
from stiffscope.robot.imports.part_motions import Bond, Freedom, held_by, holds_more, joint_freedom, relative_freedom
from stiffscope.vjm.screws import shift, skew
from stiffscope.vjm.subspaces import null_space, range_space

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from stiffscope.cad.assembly import Instance
    from stiffscope.cad.built_assembly import BuiltJoint
    from stiffscope.cad.contacts import Contact
    from stiffscope.robot.imports.hardware import Hardware
    from stiffscope.runtime.types import Array

THREADED = {"screw", "nut", "shaft nut", "shoulder screw"}
_SAME = 1e-6
_LAID = "planes from which one could be lifted off the other: taken as fixed, as if glued or screwed; if it slides"
_SCREWED = "planes with holes in line: taken as fixed, as if by screws that are missing; if it slides"
_SLIDES = "planes that slide on each other: taken as planar; if glued or screwed"
_IDLE = "plane on plane where other joints guide already: taken as no joint; if it carries load"


def hold(kind: str, axis: Array, at: Array) -> Array:
    """Rows (m, 6) that a contact with an axis (3,) through a point (3,) takes to zero, on twists at the base origin."""
    across = null_space(axis[None, :]).T
    if kind == "plane":
        lines, turns = axis[None, :], across
    elif kind == "sphere":
        lines, turns = np.eye(3), np.zeros((0, 3))
    else:
        lines, turns = (np.eye(3) if kind == "cone" else across), across
    rows = np.zeros((len(lines) + len(turns), 6))
    rows[: len(lines), :3], rows[len(lines) :, 3:] = lines, turns
    return rows @ shift(at)


def _bonds_of(
    solids: Sequence[Instance], contacts: Iterable[Contact], hardware: Hardware, scale: float,
    built: Sequence[BuiltJoint],
) -> list[Bond]:  # fmt: skip
    """Return the bonds by contacts; screws and seats fix everything, bearings leave their spin.

    The assembly's own joints replace the contacts of their two solids.
    """
    found, taken = [], {frozenset((joint.first, joint.second)) for joint in built}
    touching = defaultdict[frozenset[int], list["Contact"]](list)
    for contact in contacts:
        pair = frozenset((contact.first, contact.second))
        touching[pair].append(contact)
        rows = None if pair in taken else _held_by(contact, hardware, scale)
        if rows is not None:
            found.append(Bond(contact.first, contact.second, rows, contact))
    for joint in built:
        free = [joint_freedom(kind, at / scale, axis, None) for kind, at, axis in joint.motions]
        rows = null_space(np.hstack(free).T).T
        for each in touching[frozenset((joint.first, joint.second))] or [None]:
            at = joint.motions[0][1]
            found.append(Bond(joint.first, joint.second, rows, each, joint.label, at))
    for small, large in hardware.pairs:  # a cone leaves the spin alone, too
        form, ring = solids[small].product.form, solids[small]
        axis = np.array([0.0, 0.0, 1.0]) if form is None else ring.place_axis(form)[1]
        found.append(Bond(small, large, hold("cone", axis, ring.centre / scale), None))
    return found


def _held_by(contact: Contact, hardware: Hardware, scale: float) -> Array | None:
    """Return the constraint rows (m, 6) of a contact, considering hardware; None if it has none."""
    ends = contact.first, contact.second
    roles = [hardware.roles.get(each, "") for each in ends]
    bearing = next((each for each, role in zip(ends, roles, strict=True) if role in {"bearing", "ring"}), None)
    fits = contact.kind in {"plane", "cone"} or FIT[0] <= contact.gap / contact.radius <= FIT[1]
    if "rolling element" in roles or (bearing is not None and (contact.kind != "cylinder" or not fits)):
        return None
    if bearing is not None and (
        hardware.roles[bearing] == "ring" or contact.inner is None or ends[contact.inner] != bearing
    ):
        return np.eye(6)  # a seat; of a bearing drawn as one solid, only on its inner ring
    if bearing is not None:
        return hold("cone", contact.axis, contact.point / scale)
    thread = THREADED & {*roles} and contact.kind != "plane" and not (fits and "shoulder screw" in roles)
    tight = contact.kind == "cylinder" and contact.gap / contact.radius < FIT[0]
    if thread or tight:
        return np.eye(6)
    return hold(contact.kind, contact.axis, contact.point / scale) if fits else None


def kind_of(freedom: Array, near: Array) -> tuple[str, Array, Array | None, Array | None]:
    """Return kind, place and axes of the joint with free twists (6, k) at the base origin, near a point (3,).

    The kind is "" if a robot file has no such joint.
    """
    turns, slides = range_space(freedom[3:]), range_space(freedom[:3] @ null_space(freedom[3:]))
    counts = turns.shape[1], slides.shape[1]
    if counts == (0, 1):
        return "prismatic", near, _positive(slides[:, 0]), None
    if counts[0] == 1:
        return _about_one(freedom, turns[:, 0], slides, near)
    if counts[0] and not counts[1]:
        return _about_point(freedom, turns, near)
    return "" if any(counts) else "fixed", near, None, None


_Kind = tuple[str, "Array", "Array | None", "Array | None"]


def _about_one(freedom: Array, axis: Array, slides: Array, near: Array) -> _Kind:
    """Return a joint that rotates about one direction, with any sliding directions."""
    line = (freedom @ np.linalg.lstsq(freedom[3:], axis, rcond=None)[0])[:3]
    off = line - slides @ (slides.T @ line)
    foot = np.cross(axis, line)
    at = foot + axis * float(axis @ (near - foot))
    along = float(np.linalg.norm(slides.T @ axis))
    straight = abs(off @ axis) < _SAME
    found = {
        0: "revolute" if straight else "",
        1: "cylindrical" if along > 1.0 - _SAME else "",
        2: "planar" if along < _SAME and straight else "",
    }
    kind = found.get(slides.shape[1], "")
    return kind, near if kind == "planar" else at, _positive(axis), None


def _about_point(freedom: Array, turns: Array, near: Array) -> _Kind:
    """Return a joint that rotates about two or three directions through a point c: v = -w x c."""
    lines = freedom[:3] @ np.linalg.lstsq(freedom[3:], turns, rcond=None)[0]
    matrix = np.vstack([-skew(turn) for turn in turns.T])
    centre = np.linalg.lstsq(matrix, lines.T.ravel(), rcond=None)[0]
    if np.abs(matrix @ centre - lines.T.ravel()).max() > _SAME:
        return "", near, None, None
    return ("spherical", centre, None, None) if turns.shape[1] == 3 else ("universal", centre, turns[:, 0], turns[:, 1])


def _positive(axis: Array) -> Array:
    """Return the axis with its largest component positive."""
    return axis * np.sign(axis[int(np.argmax(np.abs(np.round(axis, 9))))])


def measure_size(solids: Sequence[Instance]) -> float:
    """Return the diagonal of the bounding box, m: the unit of length of `Freedom.freedom`."""
    boxes = np.array([solid.box for solid in solids])
    return float(np.linalg.norm(boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)))


def find_joints(
    solids: Sequence[Instance], contacts: Sequence[Contact], hardware: Hardware,
    built: Sequence[BuiltJoint] = (),
) -> tuple[list[Freedom], list[Doubt]]:  # fmt: skip
    """Find the joints between parts, numbered as the solids, and doubts on ambiguous contacts.

    ``built``: joints of the assembly itself, which take precedence over contacts.
    """
    scale = measure_size(solids)
    bonds = _bonds_of(solids, contacts, hardware, scale, built)
    between: dict[tuple[int, int], list[Bond]] = defaultdict(list)
    for bond in bonds:
        if bond.first not in hardware.roles and bond.second not in hardware.roles:
            between[bond.first, bond.second].append(bond)
    direct = set(between)
    bought = [b for b in bonds if {b.first, b.second} <= hardware.roles.keys()]
    for cluster in _join(hardware.roles, bought).subsets():
        inside = [bond for bond in bonds if bond.first in cluster or bond.second in cluster]
        ends = sorted({each for bond in inside for each in (bond.first, bond.second)} - cluster)
        for i, j in _pair_up(ends, inside, direct):
            between[i, j] += [
                b for b in inside if {b.first, b.second} <= cluster | {i, j} and {b.first, b.second} != {i, j}
            ]
    joints, doubts, planes = list[Freedom](), list[Doubt](), dict[Freedom, float]()
    for (i, j), held in between.items():
        found = _freedom(i, j, held, solids, scale, hardware)
        of_planes = all(bond.contact is not None and bond.contact.kind == "plane" and not bond.label for bond in held)
        bare = of_planes and not hardware.roles.keys() & {n for bond in held for n in (bond.first, bond.second)}
        if found.kind == "planar" or (found.kind == "prismatic" and bare):
            planes[found] = -sum(bond.contact.size for bond in held if bond.contact is not None)
        elif found.kind:
            joints.append(found)
            turning = _turning_kind(found, held, hardware, scale)
            doubts += doubt_threads(found, turning, held, solids, hardware, contacts)
        else:
            left = f"{found.freedom.shape[1]} freedoms are left ({found.reason})"
            text = f"{left}, which no joint has; say which with --joint"
            doubts.append(Doubt((solids[i].name, solids[j].name), text, tuple(found.at)))
    if built:
        doubts += doubt_built(joints, find_joints(solids, contacts, hardware)[0], built, solids)
    joints = _add_planes(joints, sorted(planes, key=planes.__getitem__), contacts, solids, doubts)

    def adds(contact: Contact) -> bool:
        rows = hold(contact.kind, contact.axis, contact.point / scale)
        return contact.gap < 0 or holds_more(rows, joints, contact.first, contact.second)

    return joints, doubts + doubt_bores(solids, contacts, hardware, adds)


def _join(pieces: Iterable[int], links: Iterable[Bond | Freedom]) -> DisjointSet:
    """Return the sets of pieces that links connect."""
    joined = DisjointSet(pieces)
    for link in links:
        joined.merge(link.first, link.second)
    return joined


def _pair_up(ends: Sequence[int], bonds: Sequence[Bond], direct: set[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return pairs of parts joined by hardware: in contact, or else nearest along its axis."""
    if len(ends) < 2:
        return []
    at = {end: [b.contact for b in bonds if end in {b.first, b.second}] for end in ends}
    places = {end: np.mean([c.point for c in found if c is not None], axis=0) for end, found in at.items()}
    spread = np.array(list(places.values())) - np.mean(list(places.values()), axis=0)
    axis = np.linalg.svd(spread)[2][0]
    order = sorted(ends, key=lambda end: float(axis @ places[end]))
    candidates = ((i, j) for i in ends for j in ends if i < j)
    rank = {pair: 0 if pair in direct else abs(order.index(pair[1]) - order.index(pair[0])) for pair in candidates}
    group, pairs = DisjointSet(ends), list[tuple[int, int]]()
    for i, j in sorted(rank, key=lambda pair: (rank[pair], pair)):
        if group.merge(i, j) or (i, j) in direct:
            pairs.append((i, j))
    return pairs


def _freedom(
    i: int, j: int, bonds: list[Bond], solids: Sequence[Instance], scale: float, hardware: Hardware
) -> Freedom:
    scaled = relative_freedom([(bond.first, bond.second, bond.rows) for bond in bonds], i, j)
    touching = [bond.contact for bond in bonds if bond.contact is not None]
    round_ = [each for each in touching if each.kind != "plane"] or touching
    points = [each.point for each in round_] or [bond.at for bond in bonds if bond.at is not None]
    near = np.mean(points, axis=0)
    kind, at, axis, axis2 = kind_of(scaled, near / scale)
    if kind == "planar" and any(hardware.roles.get(n) in THREADED for b in bonds for n in (b.first, b.second)):
        kind, axis, scaled = "fixed", None, np.zeros((6, 0))  # clamped by screws in clearance holes
    faces = _loaded_faces(i, touching, solids[i]), _loaded_faces(j, touching, solids[j])
    reason = _reason(i, j, bonds, solids, hardware)
    return Freedom(i, j, kind, at * scale, axis, axis2, reason, faces, scaled)


def _turning_kind(found: Freedom, bonds: Sequence[Bond], hardware: Hardware, scale: float) -> str:
    """Return the kind of a joint if its screws with nuts turn in their bores."""
    nutted = {n for n in hardware.roles if hardware.reasons[n] == NUTTED}
    if not nutted & {n for bond in bonds for n in (bond.first, bond.second)}:
        return found.kind
    pins = replace(hardware, roles=hardware.roles | dict.fromkeys(nutted, "pin"))
    rows = [b.rows if b.contact is None or b.label else _held_by(b.contact, pins, scale) for b in bonds]
    holds = [(b.first, b.second, held) for b, held in zip(bonds, rows, strict=True) if held is not None]
    return kind_of(relative_freedom(holds, found.first, found.second), found.at / scale)[0]


def _loaded_faces(end: int, touching: Sequence[Contact], solid: Instance) -> tuple[int, ...]:
    """Return a joint's loaded faces of a solid: round, or plane and mostly in contact; else all."""
    own = [contact for contact in touching if end in {contact.first, contact.second}]
    shares = defaultdict[int, float](float)
    for contact in own:
        face = solid.product.faces[contact.face_of(end)]
        shares[face.index] += 1.0 if contact.kind != "plane" else contact.size**2 / face.area
    least = 0.9 if any(contact.kind != "plane" for contact in own) else 0.5
    return tuple(sorted([face for face, share in shares.items() if share > least] or shares))


def _reason(i: int, j: int, bonds: Sequence[Bond], solids: Sequence[Instance], hardware: Hardware) -> str:
    """Describe the contacts."""
    words = defaultdict[str, int](int)
    what = {"plane": "plane on plane", "cylinder": "pin in bore", "sphere": "ball in socket", "cone": "cone in cone"}
    for bond in bonds:
        if bond.label:
            words[bond.label] = 0
        for each in (bond.first, bond.second):
            role = hardware.roles.get(each)
            if role in {"screw", "bearing", "pin", "ring"}:
                name = solids[each].name
                words[name if role in name.lower() else f"{role} {name}"] += 0
        if {bond.first, bond.second} == {i, j} and bond.contact is not None:
            radius = f" of radius {1e3 * bond.contact.radius:.4g} mm" if bond.contact.radius else ""
            words[what[bond.contact.kind] + radius] += 1
    return ", ".join(f"{count} x {word}" if count > 1 else word for word, count in words.items())


def _add_planes(
    joints: list[Freedom], planes: list[Freedom], contacts: Sequence[Contact], solids: Sequence[Instance],
    doubts: list[Doubt],
) -> list[Freedom]:  # fmt: skip
    """Add joints of planes: guides, and fixed joints of parts that only lie on each other.

    Planes between parts already guided by other joints are not joints. Doubts report both.
    """
    kept, groups = list(joints), _join(range(len(solids)), joints)
    bodies = _join(range(len(solids)), [joint for joint in joints if joint.kind == "fixed"])

    def settle(plane: Freedom, joint: Freedom | None, text: str) -> None:
        planes.remove(plane)
        names = solids[plane.first].name, solids[plane.second].name
        other = "fixed" if text is _SLIDES else plane.kind
        say = f', say --joint "{"/".join(names)}={other}"'
        doubts.extend([Doubt(names, text + say, tuple(plane.at))] if text else [])
        if joint is not None:
            kept.append(joint)
            groups.merge(joint.first, joint.second)

    screwed = {each for each in planes if _count_holes(solids[each.first], solids[each.second], each) > 1}
    for guide in planes:
        if guide.kind == "prismatic" and not _lifts_off(guide, contacts, bodies):
            groups.merge(guide.first, guide.second)

    def is_laid(plane: Freedom) -> bool:
        joined = groups.connected(plane.first, plane.second)  # else what moves with either is lifted off with it
        return plane in screwed or _lifts_off(plane, contacts, bodies if joined else groups)

    while laid := next(filter(is_laid, planes), None):
        i, j = laid.first, laid.second
        if groups.connected(i, j):
            settle(laid, None, _IDLE)
            continue
        fixed = replace(laid, kind="fixed", axis=None, freedom=np.zeros((6, 0)))
        settle(laid, fixed, _SCREWED if laid in screwed else _LAID)
        bodies.merge(i, j)
    for plane in [*planes]:
        adds = plane.kind == "prismatic" or holds_more(held_by(plane)[2], kept, plane.first, plane.second)
        settle(plane, plane if adds else None, _IDLE if not adds else _SLIDES if plane.kind == "planar" else "")
    return kept


def _count_holes(one: Instance, other: Instance, plane: Freedom) -> int:
    """Return the number of aligned round holes of two solids on a plane, as for missing screws."""

    def places(solid: Instance, axis: Array) -> set[tuple[float, ...]]:
        holes = (face for face in solid.faces if face.kind == "cylinder" and face.hollow)
        along = (face for face in holes if np.linalg.norm(np.cross(axis, face.axis)) < _SAME)
        return {tuple(np.round(1e4 * np.cross(axis, face.origin)) + 0.0) for face in along}

    if plane.axis is None or plane.kind != "planar":
        return 0
    return len(places(one, plane.axis) & places(other, plane.axis))


def _lifts_off(plane: Freedom, contacts: Sequence[Contact], bodies: DisjointSet) -> bool:
    """Whether nothing keeps one of two parts that planes touch, with its ``bodies``, from being lifted off."""
    ends = [bodies.subset(each) for each in (plane.first, plane.second)]
    for one, other in (ends, ends[::-1]):
        touching = [each for each in contacts if each.kind == "plane" and (each.first in one) != (each.second in one)]
        outward = np.array([each.axis * (1.0 if each.first in one else -1.0) for each in touching])
        between = outward[[bool({each.first, each.second} & other) for each in touching]]
        if any(nnls(outward.T, -normal)[1] > 1e-3 for normal in between):
            return True
    return False

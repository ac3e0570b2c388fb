"""A mechanism as an MJCF model: a tree of bodies, tendons that carry the springs, closed loops."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np

from stiffscope.exports.floating_body import (
    diagonalize,
    elastic_of,
    float_body,
)
from stiffscope.exports.frames import compose, displacement, relative
from stiffscope.exports.spanning_tree import is_loaded, span_deep_tree
from stiffscope.vjm.model.checks import BASE, GROUND, TOOL
from stiffscope.vjm.model.screws import Frame, shift
from stiffscope.vjm.network.network import END, FOOT, list_elements

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.exports.floating_body import Springs
    from stiffscope.exports.spanning_tree import Branch
    from stiffscope.vjm.model.bodies import Body
    from stiffscope.vjm.model.joints import Joint, Law
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.network import Element

MASSLESS = 1e-14  # kg: of bodies that carry none; MuJoCo has no bodies without
LEAST_INERTIA = 1e-10  # kg·m²: the same
SITE = "tool"
_FASTEST = 3e8  # rad/s, of a joint that closes a loop, on the springs that close it


@dataclass(frozen=True)
class Tuning:
    """How a robot is put into MuJoCo.

    Attributes
    ----------
    highest
        Angular frequency, rad/s, below which springs and masses vibrate.
    damping
        s; damping of every spring over its stiffness.
    smallest
        (6,) compliances, m/N and rad/(N·m), where elastic bodies are rigid in some directions.
    closing
        (2,) stiffness of the springs that close loops, N/m and N·m/rad: nearly rigid.
    unknown
        Moment of inertia of bodies that have none, over mass times squared size.
    idle
        Inertia of the joints of bodies that have no mass, kg.
    """

    highest: float
    damping: float
    smallest: Array
    closing: tuple[float, float]
    unknown: float
    idle: float


@dataclass(frozen=True, eq=False)
class Coordinate:
    """A MuJoCo joint that has a value at poses: a free motion of a joint of the mechanism.

    ``sign``: -1 if the tree leads from the joint's second body to its first. ``turn`` (3, 3): axes
    of the body in base axes at home, of a ball joint.
    """

    name: str
    joint: str
    motion: int
    sign: float
    turn: Array | None = None


@dataclass
class Writer:
    """The model while it is written; ``places``: element and home place of every node's body."""

    tuning: Tuning
    root: ET.Element
    places: dict[str, tuple[ET.Element, Frame]] = field(default_factory=dict)
    coordinates: list[Coordinate] = field(default_factory=list)
    commands: list[tuple[str, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.world = ET.SubElement(self.root, "worldbody")
        self.tendons = ET.SubElement(self.root, "tendon")
        self.actuators = ET.SubElement(self.root, "actuator")


def numbers(values: object) -> str:
    """Return numbers as text that reads back as the same floats."""
    flat = np.atleast_1d(np.asarray(values, dtype=float)).ravel()
    return " ".join(f"{value + 0.0!r}" for value in flat.tolist())


def write_tree(mechanism: Mechanism, name: str, tuning: Tuning) -> Writer:
    """Return a robot as an MJCF model without keyframes and time step.

    Parameters
    ----------
    mechanism
        The robot.
    name
        Name of the model.
    tuning
        See `Tuning`.
    """
    writer = Writer(tuning, ET.Element("mujoco", model=name))
    elements = {e.name: _fold_drive(e) for e in list_elements(mechanism)}
    tree = span_deep_tree(mechanism)
    writer.places[GROUND] = writer.world, Frame(np.eye(3), np.zeros(3))
    _add_base(writer, elements[BASE])
    for branch in tree.branches:
        _add_branch(writer, mechanism, branch, elements[branch.joint.name])
    for cut in tree.cuts:
        _close_loop(writer, cut, elements[cut.joint.name])
    _add_tool(writer, mechanism, elements[TOOL])
    return writer


def _fold_drive(element: Element) -> Element:
    """Return a joint's element whose bearing's compliance along the drive is part of the drive."""
    joint = element.joint
    if joint is None or joint.drive is None or joint.compliance is None:
        return element
    along = joint.type.driven
    assert along is not None  # noqa: S101
    more = float(joint.compliance[along, along])
    rest = joint.compliance.copy()
    coupled = np.delete(rest[along], along)
    if coupled.any():
        return element
    rest[along] = 0.0
    rest[:, along] = 0.0
    drive = joint.drive.add_compliance(more) if more else joint.drive
    bearing = rest if rest.any() else None
    return replace(element, joint=replace(joint, drive=drive, compliance=bearing))


def _joint_of(element: Element) -> Joint:
    """Return the joint of a joint's element, displaced if it is."""
    if element.joint is None:
        raise TypeError(f"{element.name} is no joint")
    return element.joint


def _add_base(writer: Writer, base: Element) -> None:
    """Add the base's own yielding, if it has any."""
    writer.places[FOOT] = writer.places[GROUND]
    frame = Frame(base.axes, base.at)
    if base.factor.size or base.offset is not None:
        body, place = _add_body(writer, FOOT[1:-1], GROUND, frame, base.offset)
        _add_bearing(writer, body, "base", IDENTITY, base.compliance)
        _set_mass(body, 0.0, np.zeros(3), None, place)
        writer.places[FOOT] = body, place


def _add_tool(writer: Writer, mechanism: Mechanism, tool: Element) -> None:
    """Add the tool's grip, if it yields, and the site at the tool point."""
    frame = Frame(np.eye(3), tool.at)
    carrier = mechanism.tool.body
    if tool.factor.size or tool.offset is not None:
        body, place = _add_body(writer, f"{SITE}:end", carrier, frame, tool.offset)
        _add_bearing(writer, body, "grip", IDENTITY, tool.compliance)
        _set_mass(body, 0.0, np.zeros(3), None, place)
        writer.places[END] = body, place
        carrier = END
    _add_site(writer, SITE, carrier, frame, size="0.01", rgba="1 0.4 0 1")


def _add_body(
    writer: Writer,
    name: str,
    parent: str,
    home: Frame,
    offset: Array | None = None,
    about: Frame | None = None,
) -> tuple[ET.Element, Frame]:
    """Add a body to that of a node; ``home``: its place in base axes.

    ``offset`` (6,): the twist by which it is displaced from there, in the frame ``about``.
    """
    element, place = writer.places[parent]
    there = home
    if offset is not None:
        there = compose(displacement(offset, about or home), home)
    local = relative(place, there)
    called = f"{name}:body" if name == "world" else name  # MuJoCo's name of the ground
    body = ET.SubElement(element, "body", name=called)
    body.set("pos", numbers(local.origin()))
    body.set("quat", numbers(quaternion(local.matrix())))
    return body, home


def quaternion(rotation: Array) -> Array:
    """Return the unit quaternion (4,), scalar first, of a rotation (3, 3)."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return np.array([w, x, y, z])


def _set_mass(
    body: ET.Element,
    mass: float,
    centre: Array,
    inertia: Array | None,
    place: Frame,
    least: float = LEAST_INERTIA,
) -> None:
    """Give a body its mass, centre (3,) and inertia (3, 3) about it, both in base axes at home.

    ``least``: smallest principal moment of inertia, kg·m².
    """
    turn = place.matrix()
    tensor = np.zeros((3, 3)) if inertia is None else turn.T @ inertia @ turn
    values, vectors = np.linalg.eigh(0.5 * (tensor + tensor.T))
    values = values.clip(min=max(LEAST_INERTIA, least))
    # MuJoCo wants moments of inertia that a solid can have.
    values[2] = min(values[2], values[0] + values[1])
    if np.linalg.det(vectors) < 0.0:
        vectors = -vectors
    inertial = ET.Element("inertial")
    inertial.set("pos", numbers(turn.T @ (centre - place.origin())))
    inertial.set("quat", numbers(quaternion(vectors)))
    inertial.set("mass", numbers(max(mass, MASSLESS)))
    inertial.set("diaginertia", numbers(values))
    body.insert(0, inertial)


def _add_six(body: ET.Element, name: str, frame: Frame) -> list[str]:
    """Add three slides and three hinges at a frame, given in the body's axes; return their names."""
    names = []
    for kind, words in (("slide", "xyz"), ("hinge", ("rx", "ry", "rz"))):
        for word, axis in zip(words, frame.matrix().T, strict=True):
            names.append(f"{name}:{word}")
            joint = ET.SubElement(body, "joint", name=names[-1], type=kind)
            joint.set("pos", numbers(frame.origin()))
            joint.set("axis", numbers(axis))
    return names


def _add_springs(
    writer: Writer, name: str, joints: Sequence[str], springs: Springs
) -> None:
    """Add a tendon for each spring along joint coordinates."""
    damping = writer.tuning.damping
    rows = zip(springs.directions, springs.stiffness, springs.armature, strict=True)
    for number, (direction, stiffness, armature) in enumerate(rows, start=1):
        tendon = ET.SubElement(writer.tendons, "fixed", name=f"{name}:{number}")
        tendon.set("stiffness", numbers(stiffness))
        tendon.set("damping", numbers(stiffness * damping))
        tendon.set("armature", numbers(armature))
        tendon.set("springlength", "0")
        for joint, coefficient in zip(joints, direction, strict=True):
            if coefficient:
                pull = ET.SubElement(tendon, "joint", joint=joint)
                pull.set("coef", numbers(coefficient))


def _add_bearing(
    writer: Writer, body: ET.Element, name: str, local: Frame, compliance: Array
) -> None:
    """Let a body yield against its parent along the axes in which a compliance (6, 6) is not zero."""
    used = np.flatnonzero(np.diagonal(compliance) > 0.0)
    joints = _add_six(body, name, local)
    for k in sorted(set(range(6)) - set(used.tolist()), reverse=True):
        name_of = joints.pop(k)
        body.remove(next(j for j in body.iter("joint") if j.get("name") == name_of))
    if not joints:
        return
    free_compliance = compliance[np.ix_(used, used)]
    scale = np.sqrt(np.diagonal(free_compliance))
    values, vectors = np.linalg.eigh(free_compliance / np.outer(scale, scale))
    values = values.clip(min=1e-9 * values[-1])
    stiffness = (vectors / values) @ vectors.T / np.outer(scale, scale)
    springs = diagonalize(stiffness, None, writer.tuning.highest)
    _add_springs(writer, name, joints, springs)


def _add_branch(
    writer: Writer, mechanism: Mechanism, branch: Branch, element: Element
) -> None:
    """Add a joint and the body to which it leads."""
    body = mechanism.body(branch.body)
    home = Frame(np.eye(3), element.at)
    end = 0
    if body.elastic is not None:
        end = body.nodes.index(branch.node)
        home = Frame(body.elastic.axes, body.elastic.places[end])
    extra = _lacking_inertia(mechanism, body, tuning=writer.tuning)
    _add_joint(writer, branch, element, branch.node, home, extra)
    entered, place = writer.places[branch.node]
    if body.elastic is None:
        centre = element.at if body.centre is None else body.centre
        least = writer.tuning.unknown * body.mass * _measure(mechanism, body) ** 2
        _set_mass(
            body=entered,
            mass=body.mass,
            centre=centre,
            inertia=body.inertia,
            place=place,
            least=least,
        )
        return
    _add_elastic(writer, body, end)


def _add_joint(
    writer: Writer,
    branch: Branch,
    element: Element,
    name: str,
    home: Frame,
    extra: tuple[float, float],
) -> None:
    """Add a joint's motions and bearing, and a body behind them at its place ``home``.

    ``extra``: armature of the joint's translations, kg, and rotations, kg·m².
    """
    parent = FOOT if branch.parent == GROUND else branch.parent
    joint = _joint_of(element)
    frame = Frame(element.axes, element.at)
    sign = 1.0 if branch.forward else -1.0
    offset = element.offset
    if offset is not None and not branch.forward:
        offset = -offset
    moves = partial(
        _add_motions,
        writer=writer,
        joint=joint,
        element=element,
        sign=sign,
        extra=extra,
    )
    if not _yields(element):
        entered, place = _add_body(writer, name, parent, home)
        moves(body=entered, place=place)
        writer.places[name] = entered, place
        return
    # A bearing has the axes of the first body and its place on the second: it slides, but
    # does not turn, with the joint. On the first body it does neither.
    before, after = ("", "PRS") if joint.is_on_first else ("P", "RS")
    if not branch.forward:
        before, after = after, before
    if any(kind in before for kind, _ in joint.motions):
        middle, place = _add_body(writer, f"{joint.name}:between", parent, frame)
        moves(body=middle, place=place, kinds=before)
        _set_mass(middle, 0.0, place.origin(), None, place)
        parent = f"{joint.name}:between"
        writer.places[parent] = middle, place
    between = f"{joint.name}:bearing"
    middle, place = _add_body(writer, between, parent, frame, offset)
    if joint.compliance is not None:
        _add_bearing(writer, middle, between, IDENTITY, joint.compliance)
    _set_mass(middle, 0.0, place.origin(), None, place)
    writer.places[between] = middle, place
    entered, place = _add_body(writer, name, between, home)
    moves(body=entered, place=place, kinds=after)
    writer.places[name] = entered, place


def _yields(element: Element) -> bool:
    """Return whether a joint has a bearing that yields or does not fit."""
    compliance = _joint_of(element).compliance
    yields = compliance is not None and compliance.any()
    return bool(yields) or element.offset is not None


def _close_loop(writer: Writer, cut: Branch, element: Element) -> None:
    """Close a loop: the joint leads to a body of its own, which springs tie to the actual one.

    The springs act between a body and one of its ancestors, so that their damping is within the
    sparse matrices by which MuJoCo integrates damping implicitly; ``span_deep_tree``.
    """
    joint = _joint_of(element)
    last = FOOT if cut.node == GROUND else cut.node
    node = FOOT if cut.parent == GROUND else cut.parent
    held = range(6)
    if joint.type.is_ball and not is_loaded(joint) and not _yields(element):
        held = range(3)
    elif joint.motions or _yields(element):
        node = f"{joint.name}:end"
        sliding, turning = (k / _FASTEST**2 for k in writer.tuning.closing)
        home = Frame(np.eye(3), element.at)
        _add_joint(writer, cut, element, node, home, (sliding, turning))
        entered, place = writer.places[node]
        _set_mass(entered, 0.0, place.origin(), None, place)
    frame = Frame(element.axes, element.at)
    _add_site(writer, f"{joint.name}:a", last, frame)
    _add_site(writer, f"{joint.name}:b", node, frame)
    for k in held:
        spring = ET.SubElement(
            writer.actuators, "general", name=f"{joint.name}:{k + 1}"
        )
        spring.set("site", f"{joint.name}:b")
        spring.set("refsite", f"{joint.name}:a")
        spring.set("gear", numbers(np.eye(6)[k]))
        spring.set("gainprm", "0")
        spring.set("biastype", "affine")
        stiffness = writer.tuning.closing[k // 3]
        damped = -stiffness * writer.tuning.damping
        spring.set("biasprm", numbers([0.0, -stiffness, damped]))


IDENTITY = Frame(np.eye(3), np.zeros(3))


def _lacking_inertia(
    mechanism: Mechanism, body: Body, tuning: Tuning
) -> tuple[float, float]:
    """Return an armature, kg and kg·m², for the joint of a body that has no mass or no inertia.

    It has no weight, and is small beside what moves with it.
    """
    if body.elastic is not None:
        if body.elastic.dynamics is not None:
            return 0.0, 0.0
        points = body.elastic.places
        size = float(np.ptp(points, axis=0).max())
        return 0.0, 0.1 * tuning.unknown * max(body.mass, tuning.idle) * size**2
    if body.mass > 0.0:
        return 0.0, 0.0
    return tuning.idle, tuning.idle * _measure(mechanism, body) ** 2


def _measure(mechanism: Mechanism, body: Body) -> float:
    """Return the size of a rigid body, m: the extent of its joints."""
    joints = mechanism.joints
    points = np.array([j.at for j in joints if body.name in {j.first, j.second}])
    return float(np.linalg.norm(np.ptp(points, axis=0))) or 0.01


def _add_motions(
    writer: Writer,
    body: ET.Element,
    place: Frame,
    joint: Joint,
    element: Element,
    sign: float,
    extra: tuple[float, float],
    kinds: str = "PRS",
) -> None:
    """Add a joint's free motions of some kinds to a body, with its drive or spring.

    ``extra``: armature of translations, kg, and rotations, kg·m².
    """
    back = place.matrix().T
    at = numbers(back @ (element.at - place.origin()))
    motions = list(enumerate(_joint_of(element).motions))
    for index, (kind, axis) in motions if sign > 0.0 else motions[::-1]:
        if kind not in kinds:
            continue
        several = len(motions) > 1
        name = f"{joint.name}:{index + 1}" if several else joint.name
        out = ET.SubElement(body, "joint", name=name, pos=at)
        out.set("type", {"R": "hinge", "P": "slide", "S": "ball"}[kind])
        if kind != "S":
            out.set("axis", numbers(back @ (sign * axis)))
        turn = place.matrix() if kind == "S" else None
        writer.coordinates.append(
            Coordinate(name, joint.name, index, 1.0 if kind != "S" else sign, turn)
        )
        if extra[kind != "P"]:
            out.set("armature", numbers(extra[kind != "P"]))
        if joint.drive is not None and index == joint.driven:
            _add_drive(writer, out, name, joint, extra[kind != "P"])
        elif joint.spring is not None:
            out.set("stiffness", numbers(joint.spring))
            out.set("damping", numbers(joint.spring * writer.tuning.damping))
            out.set("armature", numbers(joint.spring / writer.tuning.highest**2))
            if kind != "S":
                out.set("springref", numbers(joint.rest))


def _add_drive(
    writer: Writer, out: ET.Element, name: str, joint: Joint, extra: float
) -> None:
    """Add a servo whose control is the commanded displacement from home, m or rad."""
    drive = joint.drive
    assert drive is not None  # noqa: S101
    slopes = [drive.stiffness] if drive.law is None else drive.law.slopes
    out.set("armature", numbers(max(slopes) / writer.tuning.highest**2 + extra))
    for number, (gain, limit) in enumerate(servos(drive.stiffness, drive.law)):
        called = name if number == 0 else f"{name}:law{number}"
        servo = ET.SubElement(writer.actuators, "general", name=called, joint=name)
        damped = -abs(gain) * writer.tuning.damping if number == 0 else 0.0
        servo.set("gainprm", numbers(gain))
        servo.set("biastype", "affine")
        servo.set("biasprm", numbers([0.0, -gain, damped]))
        if limit is not None:
            servo.set("forcelimited", "true")
            servo.set("forcerange", numbers([-limit, limit]))
        if np.isfinite([drive.low, drive.high]).all():
            servo.set("ctrlrange", numbers([drive.low, drive.high]))
            servo.set("ctrllimited", "false")
        writer.commands.append((called, joint.name))


def servos(stiffness: float, law: Law | None) -> list[tuple[float, float | None]]:
    """Return gains of parallel servos, and the forces at which they saturate, that have a law.

    A change of slope by Δk at a deflection d is a servo of gain -Δk that saturates at Δk d.
    """
    if law is None:
        return [(stiffness, None)]
    slopes = np.concatenate([[0.0], law.slopes])
    out: list[tuple[float, float | None]] = [(float(slopes[-1]), None)]
    for start, change in zip(law.starts, np.diff(slopes), strict=True):
        if start > 0.0 and change:
            out.append((float(-change), float(abs(change) * start)))
    return out


def _add_elastic(writer: Writer, body: Body, root: int) -> None:
    """Add an elastic body's mean axes, further ends and springs to its root end."""
    elastic = elastic_of(body)
    tuning = writer.tuning
    chain = float_body(body, root, tuning.smallest, tuning.highest)
    nodes = [body.nodes[k] for k in chain.order]
    last = nodes[0]
    entered, place = writer.places[last]
    axes = elastic.axes
    masses = chain.end_masses
    _set_mass(entered, float(masses[0]), place.origin(), None, place)
    joints: list[str] = []
    if chain.mass:
        centre = axes @ chain.centre + place.origin()
        home = Frame(axes, centre)
        middle, there = _add_body(writer, body.name, last, home)
        joints += _add_six(middle, body.name, IDENTITY)
        inertia = axes @ chain.inertia @ axes.T
        _set_mass(middle, chain.mass, centre, inertia, there)
        writer.places[body.name] = middle, there
        last = body.name
    else:
        writer.places[body.name] = entered, place
    displaced = _displace_ends(body, root)
    at = chain.order[0]
    for node, k, mass in zip(nodes[1:], chain.order[1:], masses[1:], strict=True):
        home = Frame(axes, elastic.places[k])
        way = axes.T @ (elastic.places[k] - elastic.places[at])
        offset = displaced[k] - shift(way) @ displaced[at]
        end, there = _add_body(
            writer, node, last, home, offset if offset.any() else None
        )
        joints += _add_six(end, node, IDENTITY)
        _set_mass(end, float(mass), home.origin(), None, there)
        writer.places[node] = end, there
        last = node
        at = k
    for number in range(chain.flywheels):
        name = f"{body.name}:mode{number + 1}"
        wheel, there = _add_body(writer, name, last, writer.places[last][1])
        ET.SubElement(wheel, "joint", name=name, type="slide", axis="1 0 0")
        _set_mass(wheel, 0.0, there.origin(), None, there)
        writer.places[name] = wheel, there
        joints.append(name)
        last = name
    _add_springs(writer, body.name, joints, chain.springs)


def _displace_ends(body: Body, root: int) -> Array:
    """Return the twists (n, 6) of unloaded ends relative to the root, in part axes."""
    elastic = elastic_of(body)
    out = np.zeros((len(elastic.ends), 6))
    if elastic.offset is None:
        return out
    out[1:] = elastic.offset.reshape(-1, 6)
    root_frame = out[root].copy()
    ways = (elastic.places - elastic.places[root]) @ elastic.axes
    for k, way in enumerate(ways):
        out[k] -= shift(way) @ root_frame
    return out


def _add_site(writer: Writer, name: str, node: str, home: Frame, **looks: str) -> None:
    """Add a site to a node's body at a place given at home in base axes."""
    element, place = writer.places[node]
    local = relative(place, home)
    site = ET.SubElement(element, "site", name=name)
    site.set("pos", numbers(local.origin()))
    site.set("quat", numbers(quaternion(local.matrix())))
    for key, value in {"size": "0.001", "group": "4", **looks}.items():
        site.set(key, value)

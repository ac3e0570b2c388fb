"""A robot as a calibrated URDF, its stiffnesses beside it.

Every link's frame is parallel to the base's at home, at the joint that leads to it: axes and places
read as in the robot file. What geometric errors displace is in the origins of the joints.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from stiffscope.exports.floating_body import rigid_inertia
from stiffscope.exports.frames import compose, displacement, invert, relative
from stiffscope.exports.spanning_tree import span_tree
from stiffscope.exports.target import Exported
from stiffscope.exports.yaml_text import yaml_text
from stiffscope.vjm.model.checks import BASE, GROUND, TOOL
from stiffscope.vjm.model.screws import CONVENTION, Frame
from stiffscope.vjm.network.network import list_elements

if TYPE_CHECKING:
    from stiffscope.exports.spanning_tree import Branch, SpanningTree
    from stiffscope.exports.target import Order
    from stiffscope.vjm.model.bodies import Body
    from stiffscope.vjm.model.joints import Drive, Joint
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.network.network import Element

BASE_LINK = "base_link"
TOOL_LINK = "tool0"
_UNKNOWN = (
    "1e6"  # effort and velocity, which URDF wants and the robot file does not have
)
_COMMENT = """Stiffnesses of {file}, which URDF cannot hold; SI.
Joints of the URDF are zero at the robot file's home. A compliance (6, 6) gives the twist (v, omega)
of a joint's child, or of a body's end, for a wrench (f, m), at the point and in the axes given,
which are those of the base at home."""


def export_robot(order: Order) -> Exported:
    """Return the URDF and the YAML of a robot."""
    robot = order.assembled.robot
    mechanism = order.assembled.mechanism
    name = re.sub(r"[^\w.-]+", "-", robot.name)
    tree = span_tree(mechanism)
    root = _write(mechanism, robot.name, tree)
    ET.indent(root)
    text = '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
    beside = yaml_text(_stiffnesses(order, tree), _COMMENT.format(file=f"{name}.urdf"))
    files = {f"{name}.urdf": text, f"{name}.yaml": beside}

    def write(folder: Any) -> None:
        for file, content in files.items():
            (folder / file).write_text(content, encoding="utf-8")

    cut = [branch.joint.name for branch in tree.cuts]
    links = sum(1 for _ in root.iter("link"))
    rows = (
        ("links", str(links)),
        ("joints that close loops, in the YAML", ", ".join(cut) or "none"),
    )
    answer = {"files": list(files), "links": links, "cut_joints": cut}
    return Exported(write, answer, rows, tuple(_remark(mechanism, cut)))


def _remark(mechanism: Mechanism, cut: list[str]) -> list[str]:
    out = []
    if cut:
        out.append(f"URDF has no loops: {', '.join(cut)} are cut")
    if not mechanism.drives:
        out.append("the robot has no drives, so that all joints are passive")
    return out


def _write(mechanism: Mechanism, name: str, tree: SpanningTree) -> ET.Element:
    root = ET.Element("robot", name=name)
    elements = {element.name: element for element in list_elements(mechanism)}
    ET.SubElement(root, "link", name=BASE_LINK)
    places: dict[str, Frame] = {GROUND: Frame(np.eye(3), np.zeros(3))}
    base = elements[BASE]
    if base.offset is not None:
        _add_fixed(root, "base", BASE_LINK, "base", _moved(base))
    ground = BASE_LINK if base.offset is None else "base"
    for branch in tree.branches:
        _add_branch(root, mechanism, branch, elements, places, ground)
    tool = elements[TOOL]
    carrier = mechanism.carrier(mechanism.tool.body)
    place = _node_place(mechanism, mechanism.tool.body, places)
    there = Frame(np.eye(3), mechanism.tool.at)
    local = relative(places[carrier], compose(place, compose(_moved(tool), there)))
    ET.SubElement(root, "link", name=TOOL_LINK)
    _add_joint(
        root=root,
        name=f"{TOOL_LINK}_joint",  # pinocchio wants frames' names apart
        kind="fixed",
        parent=carrier,
        child=TOOL_LINK,
        origin=local,
    )
    return root


def _moved(element: Element) -> Frame:
    """Return the displacement of an element's unloaded second node, as a map of base coordinates."""
    if element.offset is None:
        return Frame(np.eye(3), np.zeros(3))
    return displacement(element.offset, Frame(element.axes, element.at))


def _node_place(mechanism: Mechanism, node: str, places: dict[str, Frame]) -> Frame:
    """Return the displacement of a node of a body against the body's link, as a map."""
    still = Frame(np.eye(3), np.zeros(3))
    if node == GROUND:
        return still
    body = mechanism.body(mechanism.carrier(node))
    del places
    elastic = body.elastic
    if elastic is None or elastic.offset is None or node == body.nodes[0]:
        return still
    k = body.nodes.index(node)
    twist = elastic.offset[6 * k - 6 : 6 * k]
    return displacement(twist, Frame(elastic.axes, elastic.places[k]))


def _add_branch(
    root: ET.Element,
    mechanism: Mechanism,
    branch: Branch,
    elements: dict[str, Element],
    places: dict[str, Frame],
    ground: str,
) -> None:
    """Add a joint of the tree and its link; several free motions have massless links between them."""
    element = elements[branch.joint.name]
    joint = element.joint
    assert joint is not None  # noqa: S101
    parent = mechanism.carrier(branch.parent)
    home = Frame(np.eye(3), element.at)
    before = _node_place(mechanism, branch.parent, places)
    after = _node_place(mechanism, branch.node, places)
    moved = _moved(element)
    if branch.forward:
        first = compose(before, compose(moved, home))
        last = relative(home, compose(invert(after), home))
    else:
        first = compose(before, home)
        last = relative(home, compose(invert(moved), compose(invert(after), home)))
    places[branch.body] = home
    motions = list(enumerate(joint.motions))
    steps = [step for number, motion in motions for step in _steps(number, motion)]
    if not branch.forward:
        steps = steps[::-1]
    sign = 1.0 if branch.forward else -1.0
    names = _step_names(joint.name, steps)
    link = ground if parent == GROUND else parent
    origin = relative(places[parent], first)
    body = mechanism.body(branch.body)
    displaced = not np.allclose(last.matrix(), np.eye(3)) or last.origin().any()
    for position, (number, kind, axis) in enumerate(steps):
        final = position == len(steps) - 1 and not displaced
        child = body.name if final else f"{names[position]}.link"
        if not final:
            ET.SubElement(root, "link", name=child)
        driven = joint.drive if number == joint.driven else None
        out = _add_joint(
            root=root,
            name=names[position],
            kind=kind,
            parent=link,
            child=child,
            origin=origin,
            drive=driven,
        )
        ET.SubElement(out, "axis", xyz=_numbers(sign * axis))
        origin = Frame(np.eye(3), np.zeros(3))
        link = child
    if displaced or not steps:
        fixed = joint.name if not steps else f"{joint.name}.zero"
        origin = last if steps else compose(origin, last)
        _add_joint(
            root=root,
            name=fixed,
            kind="fixed",
            parent=link,
            child=body.name,
            origin=origin,
        )
    _add_link(root, body, home)


def _steps(
    number: int, motion: tuple[str, np.ndarray]
) -> list[tuple[int, str, np.ndarray]]:
    """Return hinges and slides for a free motion: number of the motion, type, axis."""
    kind, axis = motion
    if kind == "S":
        return [(number, "continuous", each) for each in np.eye(3)]
    return [(number, "continuous" if kind == "R" else "prismatic", axis)]


def _step_names(name: str, steps: list[Any]) -> list[str]:
    if len(steps) == 1:
        return [name]
    return [f"{name}.{k + 1}" for k in range(len(steps))]


def _add_fixed(
    root: ET.Element, name: str, parent: str, child: str, origin: Frame
) -> None:
    ET.SubElement(root, "link", name=child)
    _add_joint(
        root=root, name=name, kind="fixed", parent=parent, child=child, origin=origin
    )


def _add_joint(
    root: ET.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    origin: Frame,
    drive: Drive | None = None,
) -> ET.Element:
    limited = drive is not None and np.isfinite([drive.low, drive.high]).all()
    if kind == "continuous" and limited:
        kind = "revolute"
    out = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(out, "parent", link=parent)
    ET.SubElement(out, "child", link=child)
    rpy = Rotation.from_matrix(origin.matrix()).as_euler("xyz")
    ET.SubElement(out, "origin", xyz=_numbers(origin.origin()), rpy=_numbers(rpy))
    if kind in {"revolute", "prismatic"}:
        low, high = (drive.low, drive.high) if limited and drive else (-1e3, 1e3)
        limit = ET.SubElement(out, "limit", effort=_UNKNOWN, velocity=_UNKNOWN)
        limit.set("lower", _numbers(low))
        limit.set("upper", _numbers(high))
    return out


def _add_link(root: ET.Element, body: Body, place: Frame) -> None:
    link = ET.SubElement(root, "link", name=body.name)
    mass, centre, inertia = rigid_inertia(body)
    if not mass:
        return
    inertial = ET.SubElement(link, "inertial")
    xyz = _numbers(centre - place.origin())
    ET.SubElement(inertial, "origin", xyz=xyz, rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=_numbers(mass))
    words = {
        f"i{a}{b}": (i, j)
        for i, a in enumerate("xyz")
        for j, b in enumerate("xyz")
        if i <= j
    }
    entries = {word: _numbers(inertia[at]) for word, at in words.items()}
    ET.SubElement(inertial, "inertia", entries)


def _numbers(values: object) -> str:
    flat = np.atleast_1d(np.asarray(values, dtype=float)).ravel()
    return " ".join(repr(value + 0.0) for value in flat.tolist())


def _stiffnesses(order: Order, tree: SpanningTree) -> dict[str, Any]:
    """Return what URDF cannot hold."""
    mechanism = order.assembled.mechanism
    out: dict[str, Any] = {
        "robot": order.assembled.robot.name,
        "order": CONVENTION["order"],
        "gravity": mechanism.gravity,
        "tool": {"link": TOOL_LINK, "at": mechanism.tool.at},
    }
    for key, change in (("base", mechanism.base), ("grip", mechanism.grip)):
        if change.compliance is not None:
            out[key] = {"compliance": change.compliance}
    out["joints"] = {j.name: _joint_facts(j) for j in mechanism.joints if _yields(j)}
    out["bodies"] = {
        body.name: _body_facts(body)
        for body in mechanism.bodies
        if body.elastic is not None
    }
    cut = [branch.joint for branch in tree.cuts]
    out["cut_joints"] = {joint.name: _cut_facts(mechanism, joint) for joint in cut}
    configurations = order.asked.configurations
    out["poses"] = {
        name: {
            j.name: float(configurations.coordinates(j.name)[k, j.driven or 0])
            for j in mechanism.drives
        }
        for k, name in enumerate(order.asked.names)
    }
    return out


def _yields(joint: Joint) -> bool:
    return (
        joint.drive is not None
        or joint.spring is not None
        or joint.compliance is not None
    )


def _joint_facts(joint: Joint) -> dict[str, Any]:
    """Return the drive, the spring and the bearing of a joint."""
    out: dict[str, Any] = {"type": joint.kind}
    if joint.drive is not None:
        drive: dict[str, Any] = {"stiffness": float(joint.drive.stiffness)}
        law = joint.drive.law
        if law is not None:
            drive["backlash"] = law.backlash
            drive["starts"] = law.starts
            drive["slopes"] = law.slopes
        out["drive"] = drive
    if joint.spring is not None:
        out["spring"] = {"stiffness": float(joint.spring), "rest": float(joint.rest)}
    if joint.compliance is not None:
        turn = np.kron(np.eye(2), joint.axes)
        out["bearing"] = {
            "at": joint.at,
            "carried_by": joint.carried_by,
            "compliance": turn @ joint.compliance @ turn.T,
        }
    return out


def _body_facts(body: Body) -> dict[str, Any]:
    """Return the compliance of an elastic body."""
    elastic = body.elastic
    assert elastic is not None  # noqa: S101
    ends = elastic.ends
    turn = np.kron(np.eye(2 * (len(ends) - 1)), elastic.axes)
    return {
        "ends": dict(zip(ends, elastic.places, strict=True)),
        "clamped": ends[0],
        "compliance": turn @ elastic.compliance @ turn.T,
    }


def _cut_facts(mechanism: Mechanism, joint: Joint) -> dict[str, Any]:
    """Return a joint that closes a loop, at home in base axes."""
    ends = [mechanism.carrier(node) for node in (joint.first, joint.second)]
    out: dict[str, Any] = {
        "type": joint.kind,
        "between": [BASE_LINK if end == GROUND else end for end in ends],
        "at": joint.at,
    }
    for key in ("axis", "axis2"):
        if getattr(joint, key) is not None:
            out[key] = getattr(joint, key)
    return out

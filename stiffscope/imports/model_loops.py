"""Loops of a parallel robot in a YAML file beside its URDF, which is a tree: `--loops FILE`.

The convention is that of public collections of parallel robots (Gepetto's example-parallel-robots):

- ``closed_loop``: pairs of frames that coincide: links of the URDF, or joints (the frame of a joint
  is that of its child);
- ``type``: of each, "6d" (fixed to each other) or "3d" (their origins coincide, a ball joint);
- ``joint_name``, ``joint_type``: joints that are others than the URDF says: "SPHERICAL",
  "UJOINT_XY" (two hinges, about x and y of the joint's frame) or "FIXED";
- ``name_mot``: joints with a motor.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import repeat
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

from stiffscope.errors import InputError, say_count, suggest
from stiffscope.robot.file.tables import list_some
from stiffscope.runtime.reading import read_text, show_path

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

_KINDS = ("3d", "6d")
_UNIVERSAL = re.compile(r"UJOINT_([XYZ])([XYZ])")
_AXES = {"X": [1.0, 0.0, 0.0], "Y": [0.0, 1.0, 0.0], "Z": [0.0, 0.0, 1.0]}


@dataclass(frozen=True)
class Loops:
    """Pairs of frames with their kind, joints of another kind, and driven joints, of a file."""

    file: Path
    pairs: tuple[tuple[str, str, str], ...]
    joints: tuple[tuple[str, str], ...]
    motors: tuple[str, ...]


def read_loops(path: Path) -> Loops:
    """Read a file of loops. Raises InputError if it is not one, or PyYAML is missing."""
    try:
        import yaml
    except ImportError as error:
        raise InputError(
            "--loops: expected the package pyyaml, got none; "
            "install it by: python -m pip install pyyaml"
        ) from error
    where = show_path(path)
    try:
        held = yaml.safe_load(read_text(path, "a YAML file of loops"))
    except yaml.YAMLError as error:
        line = getattr(getattr(error, "problem_mark", None), "line", 0) + 1
        raise InputError(f"{where}:{line}: expected YAML, got other text") from error
    if not isinstance(held, dict) or "closed_loop" not in held:
        got = "got none"
        raise InputError(f"{where}: closed_loop: expected pairs of frames, {got}")
    pairs = _list(held, "closed_loop", where)
    kinds = [str(each).lower() for each in _list(held, "type", where)]
    kinds = kinds or list(repeat("6d", len(pairs)))
    for pair in pairs:
        if not isinstance(pair, list) or len(pair) != 2:
            raise InputError(
                f"{where}: closed_loop: expected pairs of frames, got {pair!r}"
            )
    if len(kinds) != len(pairs) or not {*kinds} <= {*_KINDS}:
        what = f'"3d" or "6d" for each of {say_count(len(pairs), "loop")}'
        raise InputError(f"{where}: type: expected {what}, got {kinds}")
    names = [str(each) for each in _list(held, "joint_name", where)]
    types = [str(each).upper() for each in _list(held, "joint_type", where)]
    known = ("SPHERICAL", "FIXED", "UJOINT_XY")
    for each in types:
        if each not in known and not _UNIVERSAL.fullmatch(each):
            raise InputError(
                f'{where}: joint_type: expected one of {", ".join(known)}, got "{each}"'
            )
    if len(names) != len(types):
        what = f"a type for each of {say_count(len(names), 'joint')}"
        raise InputError(f"{where}: joint_type: expected {what}, got {len(types)}")
    ends = [(str(a), str(b)) for a, b in pairs]
    loops = [(*end, kind) for end, kind in zip(ends, kinds, strict=True)]
    motors = tuple(str(each) for each in _list(held, "name_mot", where))
    joints = tuple(zip(names, types, strict=True))
    return Loops(path, tuple(loops), joints, motors)


def _list(held: dict[str, Any], key: str, where: str) -> list[Any]:
    value = held.get(key) or []
    if not isinstance(value, list):
        raise InputError(f"{where}: {key}: expected a list, got {value!r}")
    return value


def close_loops(mj: Any, spec: Any, loops: Loops, urdf: bytes) -> list[str]:
    """Close loops in a MuJoCo spec, and change its joints; return notes.

    ``urdf``: content of the model, whose fixed joints the spec has no more.
    Raises InputError if a frame or joint is not in the model.
    """
    where = show_path(loops.file)
    links = {body.name: body for body in spec.bodies}
    frames = {
        joint: links[link] for joint, link in _children(urdf).items() if link in links
    }
    bodies = frames | links
    joints = {joint.name: joint for joint in spec.joints}
    for name, kind in loops.joints:
        _check_known(name, list(joints), f"{where}: joint_name", "a joint")
        _change_joint(mj, spec, joints[name], kind)
    for number, (first, second, kind) in enumerate(loops.pairs, 1):
        for name in (first, second):
            place = f"{where}: closed_loop"
            _check_known(name, list(bodies), place, "a link or joint")
        sites = []
        for side, name in zip("AB", (first, second), strict=True):
            site = bodies[name].add_site()
            site.name = f"loop{number}.{side}"
            sites.append(site.name)
        loop = spec.add_equality()
        loop.name = f"loop{number}"
        of = mj.mjtEq.mjEQ_WELD if kind == "6d" else mj.mjtEq.mjEQ_CONNECT
        loop.type = of
        loop.objtype = mj.mjtObj.mjOBJ_SITE
        loop.name1, loop.name2 = sites
        loop.active = True
        if kind == "6d":
            loop.data[10] = 1.0  # scale of rotations; the frames coincide
    closed = say_count(len(loops.pairs), "loop is", "loops are")
    notes = [f"{closed} closed as {loops.file.name} says"]
    if loops.motors:
        listed = list_some(loops.motors, 6)
        notes.append(f"motors of {loops.file.name}: {listed}; stiffness by --drive")
    return notes


def _children(urdf: bytes) -> Mapping[str, str]:
    """Return the child link of each joint of a URDF."""
    try:
        tree = ET.fromstring(urdf)  # noqa: S314 (MuJoCo has read it)
    except ET.ParseError:  # MuJoCo reads more than XML
        return {}
    children = dict[str, str]()
    for joint in tree.iterfind("joint"):
        child = joint.find("child")
        if child is not None:
            children[joint.get("name", "")] = child.get("link", "")
    return children


def _check_known(name: str, known: Sequence[str], place: str, what: str) -> None:
    if name not in known:
        raise InputError(
            f'{place}: expected {what} of the URDF, got "{name}"{suggest(name, known)}'
        )


def _change_joint(mj: Any, spec: Any, joint: Any, kind: str) -> None:
    """Make a joint a ball, two hinges, or none."""
    if kind == "FIXED":
        spec.delete(joint)
        return
    joint.limited = 0
    if kind == "SPHERICAL":
        joint.type = mj.mjtJoint.mjJNT_BALL
        return
    axes = _UNIVERSAL.fullmatch(kind)
    if axes is not None:
        joint.axis = _AXES[axes[1]]
        more = joint.parent.add_joint()
        more.name = f"{joint.name}_{axes[2]}"
        more.type = mj.mjtJoint.mjJNT_HINGE
        more.pos = joint.pos
        more.axis = _AXES[axes[2]]

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
from typing import TYPE_CHECKING, Annotated, Any, Self
from xml.etree import ElementTree as ET

from pydantic import BaseModel, BeforeValidator, ConfigDict, model_validator

from stiffscope.errors import (
    FieldError,
    InputError,
    expecting,
    require,
    say_count,
    suggest,
)
from stiffscope.robot.file.quantities import show_value
from stiffscope.robot.file.tables import list_some, read_table
from stiffscope.robot.file.values import Says
from stiffscope.runtime.reading import read_text, show_path

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

_KINDS = ("3d", "6d")
_JOINTS = ("SPHERICAL", "FIXED", "UJOINT_XY")
_UNIVERSAL = re.compile(r"UJOINT_([XYZ])([XYZ])")
_AXES = {"X": [1.0, 0.0, 0.0], "Y": [0.0, 1.0, 0.0], "Z": [0.0, 0.0, 1.0]}


@dataclass(frozen=True)
class Loops:
    """Pairs of frames with their kind, joints of another kind, and driven joints, of a file."""

    file: Path
    pairs: tuple[tuple[str, str, str], ...]
    joints: tuple[tuple[str, str], ...]
    motors: tuple[str, ...]


def _joint_type(value: Any) -> str:
    kind = str(value).upper()
    known = kind in _JOINTS or _UNIVERSAL.fullmatch(kind)
    require(known, "", f"one of {', '.join(_JOINTS)}", f'"{kind}"')
    return kind


def _pair(value: Any) -> tuple[str, str]:
    valid = isinstance(value, list) and len(value) == 2
    require(valid, "", "pairs of frames", show_value(value))
    first, second = value
    return str(first), str(second)


_List = BeforeValidator(lambda value: value or [])  # YAML's empty value is null


class _LoopsFile(BaseModel):
    """Keys of a file of loops; others of the same collections, such as of feet, are ignored."""

    model_config = ConfigDict(coerce_numbers_to_str=True)

    closed_loop: Annotated[
        tuple[Annotated[tuple[str, str], BeforeValidator(_pair)], ...],
        _List,
        Says("pairs of frames"),
    ]
    type: Annotated[
        tuple[Annotated[str, BeforeValidator(lambda kind: str(kind).lower())], ...],
        _List,
    ] = ()
    joint_name: Annotated[tuple[str, ...], _List] = ()
    joint_type: Annotated[
        tuple[Annotated[str, BeforeValidator(_joint_type)], ...], _List
    ] = ()
    name_mot: Annotated[tuple[str, ...], _List] = ()

    @model_validator(mode="after")
    def _check_lengths(self) -> Self:
        loops = len(self.closed_loop)
        fits = len(self.type) in {0, loops} and {*self.type} <= {*_KINDS}
        expected = f'"3d" or "6d" for each of {say_count(loops, "loop")}'
        require(fits, "loops.type", expected, list(self.type))
        joints = len(self.joint_name)
        expected = f"a type for each of {say_count(joints, 'joint')}"
        types = len(self.joint_type)
        require(types == joints, "loops.joint_type", expected, types)
        return self


def read_loops(path: Path) -> Loops:
    """Read a file of loops. Raises InputError if it is not one, or PyYAML is missing."""
    cure = "none; install it by: python -m pip install pyyaml"
    with expecting("--loops", "the package pyyaml", ImportError, got=cure):
        import yaml
    where = show_path(path)
    text = read_text(path, "a YAML file of loops")
    try:
        held = yaml.safe_load(text)
    except yaml.YAMLError as error:
        line = getattr(getattr(error, "problem_mark", None), "line", 0) + 1
        raise InputError(f"{where}:{line}: expected YAML, got other text") from error
    try:
        file = read_table(_LoopsFile, held, ())
    except FieldError as error:
        key = error.key[0] if error.key else "closed_loop"
        raise InputError(f"{where}: {key}: {error}") from error
    kinds = file.type or tuple(repeat("6d", len(file.closed_loop)))
    ends = zip(file.closed_loop, kinds, strict=True)
    loops = tuple((first, second, kind) for (first, second), kind in ends)
    joints = tuple(zip(file.joint_name, file.joint_type, strict=True))
    return Loops(path, loops, joints, file.name_mot)


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
    got = f'"{name}"{suggest(name, known)}'
    require(name in known, place, f"{what} of the URDF", got)


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

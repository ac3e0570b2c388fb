"""Checks across a robot file's sections: parts, lengths, directions, and the mechanism."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.cad.checks import mm
from stiffscope.errors import FieldError, InputError, require, require_given
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.copies import tensor
from stiffscope.robot.file.description import ENDS, GROUND, HOME
from stiffscope.robot.file.parse import naming_key, split_place
from stiffscope.robot.file.part_sections import ParametricPart
from stiffscope.robot.file.sections import Bearing, ElasticBody, RigidBody
from stiffscope.robot.file.tables import one_of
from stiffscope.robot.mechanism_of import rigid_mechanism, written_axes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stiffscope.errors import Key
    from stiffscope.robot.file.description import RobotFile

SAME_LENGTH = 1e-4  # relative tolerance; coordinates are often rounded to 0.01 mm
_ROUNDED = 1e-9  # relative tolerance of moments of inertia
MESHES = (".stl", ".obj", ".ply", ".vtp", ".vtk", ".vtu", ".glb", ".gltf")
"""Mesh files for pictures, readable by PyVista without further packages."""
_PARALLEL = 1e-6  # sine of the angle below which two directions are parallel
_FILE_NAME = re.compile(r"[^/\\\x00-\x1f]{0,100}")


def check_robot(robot: RobotFile) -> RobotFile:
    """Return a robot, with its home as the pose of a file without poses.

    Raises
    ------
    FieldError
        At the first error across the sections of the file.
    """
    require(robot.bodies, ("bodies",), "at least one body", "none")
    for name in robot.parts:
        _check_part(robot, name)
    for name in robot.poses:
        _check_file_name(("poses", name), name)
    for name, body in robot.bodies.items():
        if isinstance(body, ElasticBody):
            _check_elastic(robot, name, body)
        elif isinstance(body, RigidBody):
            _check_rigid(robot, name, body)
    known = robot.nodes()
    for name in robot.joints:
        _check_joint(robot, name, known)
    moving = {each: of for each, of in known.items() if of != GROUND}
    _check_node(("tool", "body"), robot.tool.body, moving, robot)
    try:
        mechanism = rigid_mechanism(robot)
    except (
        InputError
    ) as error:  # such as a name used twice, or a body that nothing holds
        place, message = split_place(str(error))
        if not place:
            raise
        raise FieldError(place, message) from error
    home = tuple(map(float, mechanism.tool.home))
    return replace(robot, home=home, poses=robot.poses or {HOME: home})


def _check_part(robot: RobotFile, name: str) -> None:
    key = ("parts", name)
    _check_file_name(key, name)
    with naming_key(*key, "material", inner=True):  # "material: expected one of …"
        robot.material(name)


def _check_file_name(key: Key, name: str) -> None:
    require(
        name not in {"", ".", ".."} and _FILE_NAME.fullmatch(name),
        key,
        "a name that a file of results can have",
        q.show_value(name),
    )


def _check_elastic(robot: RobotFile, name: str, body: ElasticBody) -> None:
    key = ("bodies", name)
    with naming_key(*key, "part"):
        one_of(body.part, robot.parts, "a part")
    part = robot.parts[body.part]
    along = np.subtract(body.tip, body.base)
    size = body.length
    require(
        size >= 1e-9,
        (*key, "tip"),
        "a point away from the base",
        f"the same, {list(body.tip)} m",
    )
    length = part.span
    if length is not None:
        require(
            abs(length - size) <= SAME_LENGTH * length,
            (*key, "tip"),
            f"a tip {mm(length)} from the base, as part {body.part} is long, to {SAME_LENGTH:.2%}",
            mm(size),
        )
    if body.y is None:
        require(
            isinstance(part, ParametricPart) and part.describes.is_round,
            (*key, "y"),
            f"a direction across a {part.shape} part, such as [0, 1, 0]",
            "nothing",
        )
        return
    across = np.linalg.norm(np.cross(along / size, body.y)) / np.linalg.norm(body.y)
    require(
        across >= _PARALLEL,
        (*key, "y"),
        "a direction across the line from base to tip",
        f"one along it, {list(body.y)}",
    )


def _check_rigid(robot: RobotFile, name: str, body: RigidBody) -> None:
    key = ("bodies", name)
    owner, _, end = name.rpartition(".")
    require(
        end not in robot.ends(owner),
        key,
        "another name",
        f'"{name}", which is an end of the elastic body "{owner}"',
    )
    if body.mesh is not None:
        file = robot.path.parent / body.mesh
        require(
            file.suffix.lower() in MESHES,
            (*key, "mesh"),
            f"a file for pictures ({', '.join(MESHES)})",
            q.show_value(body.mesh),
        )
        require(
            file.is_file(), (*key, "mesh"), "a file for pictures", f"none at {file}"
        )
    if body.mass:
        what = f"a point where the mass of {body.mass:g} kg acts"
        require_given(body.centre, (*key, "centre"), what)
    if body.inertia is not None:
        require(body.mass, (*key, "mass"), "a mass above 0 kg beside an inertia", "0")
        with naming_key(*key, "inertia"):
            _check_inertia(body.inertia)


def _check_inertia(inertia: tuple[float, ...]) -> None:
    least, middle, most = map(float, np.linalg.eigvalsh(tensor(inertia)))
    require(
        least >= -_ROUNDED * max(map(abs, inertia)),
        "",
        "no negative principal moment",
        f"{least:.6g} kg·m²",
    )
    require(
        most <= (least + middle) * (1.0 + 1e-3),  # tolerates rounded numbers
        "",
        "principal moments of which none exceeds the sum of the others",
        f"{least:.6g}, {middle:.6g}, {most:.6g} kg·m²",
    )


def _check_joint(robot: RobotFile, name: str, known: Mapping[str, str]) -> None:
    joint = robot.joints[name]
    key = ("joints", name)
    for number, each in enumerate(joint.between):
        _check_node((*key, "between", number), each, known, robot)
    first, second = joint.between
    require(
        known[first] != known[second],
        (*key, "between"),
        "two bodies",
        f"{first} and {second}",
    )
    axis = getattr(joint, "axis", None)
    axis2 = getattr(joint, "axis2", None)
    if axis is not None and axis2 is not None:
        sine = (
            np.linalg.norm(np.cross(axis, axis2))
            / np.linalg.norm(axis)
            / np.linalg.norm(axis2)
        )
        require(
            sine >= _PARALLEL,
            (*key, "axis2"),
            "a direction other than axis",
            list(axis2),
        )
    _check_bearing(robot, name)


def _check_bearing(robot: RobotFile, name: str) -> None:
    """Refuse a joint's compliance beside a bearing or along the direction of its drive."""
    joint = robot.joints[name]
    key = ("joints", name)
    if joint.bearing is not None:
        require(
            joint.compliance is None,
            (*key, "compliance"),
            "none beside a bearing, whose data give it",
            "one",
        )
        with naming_key(*key, "bearing", inner=True):
            joint.yielding(written_axes(robot, name))
    if getattr(joint, "drive", None) is None or joint.compliance is None:
        return
    along = joint.describes.driven or 0
    given = joint.compliance
    free = (
        (given.axial if along == 0 else 0.0)
        if isinstance(given, Bearing)
        else given[along]
    )
    require(
        not free,
        (*key, "compliance", "axial" if isinstance(given, Bearing) else along),
        "0 along what the drive moves, which has the drive's stiffness",
        f"{free:g}",
    )


def _check_node(
    key: Key, name: str, known: Mapping[str, str], robot: RobotFile
) -> None:
    """Raise FieldError unless a name is a rigid body or an end of an elastic one."""
    if name in known:
        return
    listed = " or ".join(f'"{name}.{end}"' for end in robot.ends(name))
    require(not listed, key, f"an end of the elastic body, {listed}", f'"{name}"')
    for end in ENDS:
        body = name.removesuffix(f".{end}")
        require(
            body == name or not isinstance(robot.bodies.get(body), RigidBody),
            key,
            f'"{body}", which is rigid and has no ends',
            f'"{name}"',
        )
    with naming_key(*key):
        one_of(name, known, "a body or an end of one")

"""Elastic parts of URDF bodies whose visual is a STEP file of one solid.

Interfaces are the solid's faces at the body's joints: round about the joint's axis or centre, else
those that its point lies on.
"""

from __future__ import annotations

import fnmatch
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from stiffscope import cad
from stiffscope.cad.assembly import Instance, read_assembly
from stiffscope.cad.materials import MATERIALS
from stiffscope.errors import InputError
from stiffscope.imports.assembly_parts import (
    PartFile,
    choose_materials,
    part_name,
)
from stiffscope.imports.compiled_model import print_safely
from stiffscope.imports.simulator_model import ModelBody, ModelJoint
from stiffscope.vjm.model.joints import LED

if TYPE_CHECKING:
    from collections.abc import Sequence
    from xml.etree.ElementTree import Element

    from stiffscope.imports.simulator_model import SimulatorModel

_NEAR = 1e-4  # m, and of a direction: tolerance of a face at a joint
_STEP = re.compile(r"\.(step|stp|p21)$", re.IGNORECASE)


def add_solids(
    path: Path, model: SimulatorModel, texts: Sequence[str]
) -> tuple[SimulatorModel, list[PartFile]]:
    """Return a URDF's model with elastic bodies where it points to solids, and their parts.

    ``texts``: materials as in `--material`. Notes tell which bodies bend, and why others do not.
    """
    try:
        tree = ET.parse(path).getroot()  # noqa: S314 (read before)
    except ET.ParseError:  # MuJoCo reads more than XML
        return model, []
    bodies = {body.name: body for body in model.bodies}
    notes = list(model.notes)
    found = dict[str, tuple[Instance, dict[str, tuple[int, ...]]]]()
    for link in tree.iterfind("link"):
        name = link.get("name", "")
        mesh = link.find("visual/geometry/mesh")
        file = "" if mesh is None else mesh.get("filename", "")
        if name in bodies and _STEP.search(file):
            try:
                found[name] = _read_solid(
                    path=path, file=file, link=link, tree=tree, model=model, said=texts
                )
            except InputError as error:
                visual = print_safely(file)
                notes.append(
                    f"{name} stays rigid, though its visual is {visual}: {error}"
                )
    solids = [solid for solid, _ in found.values()]
    parts = list[PartFile]()
    ends = dict[tuple[str, str], str]()
    materials = (
        choose_materials(range(len(solids)), solids, texts, path) if solids else {}
    )
    for number, (name, (solid, faces)) in enumerate(found.items()):
        faces_by_joint = {
            re.sub(r"[.\s]", "_", joint): each for joint, each in faces.items()
        }
        parts.append(
            PartFile(part_name(solid, parts), solid, materials[number], faces_by_joint)
        )
        ends |= {
            (name, joint): f"{name}.{end}"
            for joint, end in zip(faces, faces_by_joint, strict=True)
        }
        mass = MATERIALS[materials[number]].density * solid.product.volume
        given = f"not {bodies[name].mass:.4g} kg"
        notes.append(f"{name} bends, and has its solid's {mass:.4g} kg, {given}")
        none = np.zeros((3, 3))
        bodies[name] = ModelBody(
            name=name,
            mass=0.0,
            centre=solid.origin,
            inertia=none,
            part=parts[-1].name,
            axes=solid.rotation,
        )
    joints = list[ModelJoint]()
    for j in model.joints:
        first, second = (ends.get((end, j.name), end) for end in (j.first, j.second))
        joints.append(replace(j, first=first, second=second))
    tool = {name: end for (name, _), end in ends.items()}.get(
        model.tool_body, model.tool_body
    )
    new = {
        "bodies": tuple(bodies.values()),
        "joints": tuple(joints),
        "notes": tuple(notes),
    }
    return replace(model, tool_body=tool, **new), parts


def _read_solid(
    path: Path,
    file: str,
    link: Element,
    tree: Element,
    model: SimulatorModel,
    said: Sequence[str],
) -> tuple[Instance, dict[str, tuple[int, ...]]]:
    """Return a link's solid at its place, and its faces at joints; InputError if it stays rigid."""
    name = link.get("name", "")
    held = [joint for joint in model.joints if name in {joint.first, joint.second}]
    fixed = [
        {end.get("link") for end in joint}
        for joint in tree.iterfind("joint[@type='fixed']")
    ]
    heavy = {
        element.get("name") for element in tree if element.find("inertial") is not None
    } - {name}
    if len(link.findall("visual")) > 1 or any(
        name in ends and ends & heavy for ends in fixed
    ):
        raise InputError("expected one visual and no other link fixed to it, got more")
    if len(held) < 2:
        raise InputError("one joint, so that nothing but its own weight loads it")
    patterns = [text.partition("=")[0].strip().lower() for text in said]
    if not any(fnmatch.fnmatch(name.lower(), pattern) for pattern in patterns):
        raise InputError(f'say --material "{name}=NAME" to let it bend')
    tail = re.sub(r"^\w+://", "", file)
    tails = (tail, tail.partition("/")[2])
    places = (base / end for base in path.absolute().parents for end in tails)
    one, *more = read_assembly(next(filter(Path.is_file, places), path.parent / tail))
    if more:
        raise InputError(f"expected one solid, got {1 + len(more)}")
    origin = link.find("visual/origin")
    texts = [
        ("" if origin is None else origin.get(key, "")) or "0 0 0"
        for key in ("xyz", "rpy")
    ]
    xyz, rpy = (np.array(text.split(), float) for text in texts)
    axes = next(body.axes for body in model.bodies if body.name == name)
    turn = axes @ Rotation.from_euler("xyz", rpy).as_matrix()
    at = next(joint.at for joint in held if joint.second == name) + axes @ xyz
    solid = Instance(name, one.product, turn @ one.rotation, turn @ one.origin + at)
    faces = {joint.name: _faces_at(solid, joint) for joint in held}
    bare = [joint for joint, own in faces.items() if not own]
    if bare:
        raise InputError(f"no face of the solid is at {', '.join(bare)}")
    if len({face for own in faces.values() for face in own}) < sum(
        map(len, faces.values())
    ):
        raise InputError("two of its joints share a face")
    return solid, faces


def _faces_at(solid: Instance, joint: ModelJoint) -> tuple[int, ...]:
    """Return the nearest faces of one radius about a joint's axis or centre, else at its point."""
    about = list[tuple[float, float, int]]()
    for face in solid.faces:
        lever = joint.at - face.origin
        off = np.inf
        if face.kind == "sphere" and joint.kind == "spherical":
            off = np.linalg.norm(lever)
        elif face.kind == "cylinder" and joint.kind in LED and joint.axis is not None:
            off = np.linalg.norm(np.cross(face.axis, np.array([lever, joint.axis])))
        if off < _NEAR:
            about.append(
                (
                    float(np.linalg.norm(face.centroid - joint.at)),
                    face.radius,
                    face.index,
                )
            )
    if about:
        return tuple(n for _, radius, n in about if abs(radius - min(about)[1]) < _NEAR)
    away = [1e-3 * cad.kernel.distance(shape, 1e3 * joint.at) for shape in solid.shapes]
    return tuple(n for n, distance in enumerate(away) if distance < _NEAR)

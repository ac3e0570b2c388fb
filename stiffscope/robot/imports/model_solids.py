"""Elastic parts of URDF bodies whose visual is a STEP file of one solid.

A part's interfaces are its faces at the body's joints: round about the joint's axis or centre, else
those that the joint's point lies on.
"""

from __future__ import annotations

import fnmatch
import re
from dataclasses import replace
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from stiffscope import cad
from stiffscope.cad.assembly import Instance, read_assembly
from stiffscope.cad.materials import MATERIALS
from stiffscope.errors import InputError
from stiffscope.robot.imports.assembly_parts import PartFile, choose_materials, part_name
from stiffscope.robot.imports.compiled_model import print_safely
from stiffscope.robot.imports.simulator_model import ModelBody

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path
    from xml.etree.ElementTree import Element

    from stiffscope.robot.imports.simulator_model import ModelJoint, SimulatorModel

_NEAR = 1e-4  # m, and of a direction: tolerance of a face at a joint


def add_solids(path: Path, model: SimulatorModel, said: Sequence[str]) -> tuple[SimulatorModel, list[PartFile]]:
    """Return a URDF's model with elastic bodies where it points to solids, and their parts.

    ``said``: materials as in `--material`. Notes tell which bodies bend, and why others do not.
    """
    try:
        links = {each.get("name", ""): each for each in ET.parse(path).getroot()}  # noqa: S314 (read before)
    except ET.ParseError:  # MuJoCo reads more than XML
        return model, []
    bodies, notes = {body.name: body for body in model.bodies}, list(model.notes)
    found = list[tuple[Instance, dict[str, tuple[int, ...]]]]()
    for name, link in links.items():
        file = next((each.get("filename", "") for each in link.iterfind("visual/geometry/mesh")), "")
        if link.tag != "link" or name not in bodies or not re.search(r"\.(step|stp|p21)$", file, re.IGNORECASE):
            continue
        try:
            held = [joint for joint in model.joints if name in {joint.first, joint.second}]
            found.append(_read_solid(path, file, links, bodies[name], held, said))
        except InputError as error:
            notes.append(f"{name} stays rigid, though its visual is {print_safely(file)}: {error}")
    solids, parts, ends = [solid for solid, _ in found], list[PartFile](), dict[tuple[str, str], str]()
    materials = choose_materials(range(len(solids)), solids, said, path) if solids else {}
    for number, (solid, faces) in enumerate(found):
        name, mass = solid.name, MATERIALS[materials[number]].density * solid.product.volume
        notes.append(f"{name} bends, and has its solid's {mass:.4g} kg, not {bodies[name].mass:.4g} kg")
        own = {re.sub(r"[.\s]", "_", joint): each for joint, each in faces.items()}
        parts.append(PartFile(part_name(solid, parts), solid, materials[number], own))
        ends |= {(name, joint): f"{name}.{end}" for joint, end in zip(faces, own, strict=True)}
        bodies[name] = ModelBody(name, 0.0, solid.origin, np.zeros((3, 3)), part=parts[-1].name, axes=solid.rotation)
    joints = [
        replace(j, first=ends.get((j.first, j.name), j.first), second=ends.get((j.second, j.name), j.second))
        for j in model.joints
    ]
    tool = [end for (name, _), end in ends.items() if name == model.tool_body]
    changed = replace(model, bodies=tuple(bodies.values()), joints=tuple(joints), notes=tuple(notes))
    return replace(changed, tool_body=[model.tool_body, *tool][-1]), parts


def _read_solid(
    path: Path, file: str, links: Mapping[str, Element], body: ModelBody, held: Sequence[ModelJoint],
    said: Sequence[str],
) -> tuple[Instance, dict[str, tuple[int, ...]]]:  # fmt: skip
    """Return the solid of a body at its place, and its faces at joints; InputError if it is to stay rigid."""
    link = links[body.name]
    fixed = [[each.get("link", "") for each in joint if each.tag in {"parent", "child"}]
             for joint in links.values() if joint.get("type") == "fixed"]  # fmt: skip
    welded = {name for ends in fixed for name in ends if body.name in ends} - {body.name}
    if len(link.findall("visual")) > 1 or any(links[name].find("inertial") is not None for name in welded):
        raise InputError("expected one visual and no other link fixed to it, got more")
    if len(held) < 2:
        raise InputError("one joint, so that nothing but its own weight loads it")
    if not any(fnmatch.fnmatch(body.name.lower(), text.partition("=")[0].strip().lower()) for text in said):
        raise InputError(f'say --material "{body.name}=NAME" to let it bend')
    tail = re.sub(r"^\w+://", "", file)
    places = (base / each for base in path.absolute().parents for each in (tail, tail.partition("/")[2]))
    solids = read_assembly(next((place for place in places if place.is_file()), path.parent / tail))
    if len(solids) != 1:
        raise InputError(f"expected one solid, got {len(solids)}")
    origin = link.find("visual/origin")
    texts = ["0 0 0"] * 2 if origin is None else [origin.get(key, "0 0 0") for key in ("xyz", "rpy")]
    xyz, rpy = (np.array(text.split(), float) for text in texts)
    turn = body.axes @ Rotation.from_euler("xyz", rpy).as_matrix()
    at = next(joint.at for joint in held if joint.second == body.name) + body.axes @ xyz
    solid = Instance(body.name, solids[0].product, turn @ solids[0].rotation, turn @ solids[0].origin + at)
    faces = {joint.name: _faces_at(solid, joint) for joint in held}
    if bare := [name for name, own in faces.items() if not own]:
        raise InputError(f"no face of the solid is at {', '.join(bare)}")
    if len({face for own in faces.values() for face in own}) < sum(map(len, faces.values())):
        raise InputError("two of its joints share a face")
    return solid, faces


def _faces_at(solid: Instance, joint: ModelJoint) -> tuple[int, ...]:
    """Return the faces that carry a joint: the nearest round ones about it, else those at its point."""
    about = list[tuple[float, float, int]]()
    for face in solid.faces:
        lever = joint.at - face.origin
        if face.kind in {"cylinder", "cone"} and joint.kind in {"revolute", "cylindrical"}:
            skewed = np.linalg.norm(np.cross(face.axis, joint.axis)), np.linalg.norm(np.cross(face.axis, lever))
            along = float(face.axis @ lever)
            apart = max(face.extent[0] - along, along - face.extent[1], 0.0)
        elif face.kind == joint.kind.replace("spherical", "sphere"):
            skewed, apart = (np.linalg.norm(lever),), 0.0
        else:
            continue
        about += [(apart, face.radius, face.index)] if max(skewed) < _NEAR else []
    if about:
        return tuple(n for _, radius, n in about if abs(radius - min(about)[1]) < _NEAR)
    away = [1e-3 * cad.kernel.distance(shape, 1e3 * joint.at) for shape in solid.shapes]
    return tuple(n for n, distance in enumerate(away) if distance < _NEAR)

"""`stiffscope import machine.step`: conversion of a STEP assembly to a robot file and parts."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.cad.assembly import read_assembly
from stiffscope.cad.contacts import find_contacts
from stiffscope.cad.materials import MATERIALS
from stiffscope.errors import InputError, require
from stiffscope.imports.assembly_parts import (
    PartFile,
    choose_materials,
    interface_names,
    part_lines,
    part_name,
    write_import,
)
from stiffscope.imports.compiled_model import GROUND, print_safely
from stiffscope.imports.contact_joints import find_joints, measure_size
from stiffscope.imports.doubts import Doubt, doubt_twins, gather_alike
from stiffscope.imports.hardware import find_hardware
from stiffscope.imports.import_record import (
    check_place,
    make_record,
    parts_folder,
    tell_changes,
)
from stiffscope.imports.loaded_patches import LoadedPart, find_patches
from stiffscope.imports.model_tool import choose_coordinates
from stiffscope.imports.part_estimates import Estimate, estimate_part
from stiffscope.imports.part_motions import Freedom, tool_motions
from stiffscope.imports.robot_text import driven, robot_text
from stiffscope.imports.simulator_model import (
    ModelBody,
    ModelJoint,
    SimulatorModel,
    find_distances,
)
from stiffscope.imports.user_settings import (
    ImportSettings,
    apply_stated_joints,
    match_solids,
    read_settings,
    settings_beside,
)
from stiffscope.robot.file.parse import place_of
from stiffscope.robot.file.tables import list_some
from stiffscope.runtime.reading import show_path

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.cad.assembly import Instance
    from stiffscope.cad.built_assembly import BuiltJoint
    from stiffscope.imports.hardware import Hardware
    from stiffscope.imports.import_record import ImportRecord
    from stiffscope.runtime.types import Progress

_GROUND = re.compile(
    r"ground|base|bed|frame|foot|gestell|grund|rahmen|sockel|bett", re.IGNORECASE
)
_TOOLS = "tool|platt?form|effector|tcp|spindle|flange|plate|werkzeug|greifer|gripper"
_TOOL = re.compile(_TOOLS, re.IGNORECASE)
_TINY = 2e-3  # a part with a smaller fraction of the total volume is rigid,
_TINY_SHARE = 0.02  # if it bends by less than this fraction of the softest part
_HEAD = """# Imported from {file}: parts, joints and masses of its assembly; SI, axes of the assembly.
#
# Look at what was found (stiffscope check), and fill in what an assembly does not say:
#   - drives: give each driven joint a stiffness, by hand below or with --drive PATTERN=STIFFNESS.
#   - bearings: compliance = {{ radial = "...", axial = "...", tilting = "..." }} of a joint.
#   - gravity: [gravity] direction = [0, 0, -1] says which way is down.
"""


_REVIEW = "#\n# Review these; other interpretations are possible:\n"


@dataclass(frozen=True, eq=False)
class Imported:
    """Result of an import, with doubts for a person to check."""

    file: Path
    model: SimulatorModel
    doubts: tuple[Doubt, ...]
    hardware: Mapping[str, str] = field(default_factory=dict)
    solids: int = 0
    contacts: int = 0
    driven: tuple[str, ...] = ()
    changes: tuple[str, ...] | None = None
    """Changes since the last import to the same file; None at the first."""


def import_assembly(
    path: str | Path,
    out: str | Path,
    settings: ImportSettings | None = None,
    progress: Progress | None = None,
) -> Imported:
    """Write a robot file from a STEP assembly, and its elastic parts to a folder named after it.

    A robot file from an earlier import is overwritten unless it was changed since. Raises InputError
    if the file is not an assembly, an option matches nothing, or a part's material is unknown.

    Parameters
    ----------
    path, out
        STEP assembly, and robot file to write.
    settings
        Settings, which take precedence over an `assembly.toml` beside the assembly.
    progress
        Receives the progress of reading and of the search for contacts.
    """
    path = Path(path)
    out = Path(out)
    earlier = check_place(out)
    settings = settings_beside(path, settings or ImportSettings())
    left_out = list[str]()
    solids = read_assembly(path, left_out=left_out)
    return _import(
        path=path,
        out=out,
        settings=settings,
        solids=solids,
        built=(),
        left_out=left_out,
        earlier=earlier,
        progress=progress,
    )


def from_assembly(
    assembly: Any, out: str | Path | None = None, **settings: Any
) -> Imported:
    """Write a robot file from a build123d assembly, as `stiffscope import` does from a STEP file.

    Connected joints of build123d (`connect_to`) are used: RevoluteJoint, LinearJoint, BallJoint,
    CylindricalJoint, and RigidJoint to RigidJoint as fixed. Others are found from contacts.

    Parameters
    ----------
    assembly
        build123d Compound whose children are solids or compounds, each with a label. Lengths in mm.
    out
        Robot file to write, by default named after the assembly's label. Its elastic parts are STEP
        files in a folder beside it. ``settings`` takes precedence over an `assembly.toml` beside it.
    **settings
        ``ground``, ``tool``: names; ``joint``, ``weld``, ``part``, ``rigid``, ``material``,
        ``drive``: texts as in the command's options, lists of these, or tables such as
        ``material={"*": "steel"}``.

    Returns
    -------
    Imported
        Bodies, joints and doubts; `load_robot` reads the file written, its ``file``.

    Raises
    ------
    InputError
        If it is not an assembly, a name is not in it, or a part's material is unknown.
    """
    from stiffscope.cad.built_assembly import read_built

    label = print_safely(str(getattr(assembly, "label", "") or "machine")).replace(
        "/", "_"
    )
    out = Path(f"{label}.toml" if out is None else out)
    earlier = check_place(out)
    chosen = settings_beside(out, read_settings(settings))
    left_out = list[str]()
    solids, built = read_built(assembly, label, left_out)
    return _import(
        path=Path(label),
        out=out,
        settings=chosen,
        solids=solids,
        built=built,
        left_out=left_out,
        earlier=earlier,
    )


def _import(
    path: Path,
    out: Path,
    settings: ImportSettings,
    solids: Sequence[Instance],
    built: Sequence[BuiltJoint],
    left_out: list[str],
    earlier: ImportRecord | None,
    progress: Progress | None = None,
) -> Imported:
    """Write the robot file of an assembly; ``path`` is its file or name."""
    if progress is not None:
        progress("read", 1.0)
    contacts = find_contacts(solids, progress)
    roles = dict.fromkeys(match_solids(solids, settings.weld, "--weld"), "screw")
    roles |= dict.fromkeys(match_solids(solids, settings.part, "--part"), "part")
    hardware = find_hardware(solids, contacts, roles)
    joints, doubts = find_joints(solids, contacts, hardware, built)
    joints, settled = apply_stated_joints(joints, settings.joint, solids, contacts)
    named = [{solids[n].name for n in pair} for pair in settled]
    doubts = [doubt for doubt in doubts if {*doubt.solids} not in named]
    assembly = _Found(path, solids, hardware, tuple(joints))
    ground = _choose_ground(assembly, settings.ground)
    reached = find_distances(assembly.joints, ground)
    loose = {end for joint in assembly.joints for end in joint.ends} - {
        *reached,
        *hardware.roles,
    }
    doubts += [Doubt((path.name,), text) for text in left_out] + doubt_twins(solids)
    text = "no joint leads from it to the ground: left out"
    doubts += [
        Doubt((solids[n].name,), text, tuple(solids[n].centre)) for n in sorted(loose)
    ]
    doubts = gather_alike(doubts, solids)
    assembly = replace(
        assembly,
        joints=tuple(joint for joint in assembly.joints if joint.first in reached),
    )
    tool = _choose_tool(assembly, ground, settings.tool, reached)
    model, parts, warnings = _model(path, assembly, ground, tool, settings)
    doubts = warnings + doubts
    lines = [f"#   - {', '.join(doubt.solids)}: {doubt.text}\n" for doubt in doubts]
    review = "".join([_REVIEW, *lines]) if lines else ""
    head = _HEAD + review.replace("{", "{{").replace("}", "}}")
    drives = driven(model, settings.drive)
    text = robot_text(
        model, print_safely(path.name), drives, head, part_lines(parts, out)
    )
    record = make_record(solids, hardware.roles, assembly.joints, doubts)
    write_import(
        path=path, out=out, text=text, parts=parts, what="an assembly", record=record
    )
    changes = None
    if earlier is not None:
        changes = tuple(tell_changes(earlier, record))
        for name in {*earlier.files} - {f"{part.name}.step" for part in parts}:
            (parts_folder(out) / name).unlink(missing_ok=True)
    roles = {
        solids[n].name: f"{hardware.roles[n]} ({hardware.reasons[n]})"
        for n in hardware.roles
    }
    counts = len(solids), len(contacts)
    return Imported(out, model, tuple(doubts), roles, *counts, tuple(drives), changes)


@dataclass(frozen=True, eq=False)
class _Found:
    """An assembly, its file or name, with its hardware and joints."""

    path: Path
    solids: Sequence[Instance]
    hardware: Hardware
    joints: tuple[Freedom, ...]

    def find_joints(self, number: int) -> list[Freedom]:
        """Return the joints of a part."""
        return [joint for joint in self.joints if number in joint.ends]


def _choose_ground(assembly: _Found, wanted: str | None) -> int:
    """Return the ground part: as given, else the largest of those with a usual name or of all."""
    parts = [n for n in range(len(assembly.solids)) if n not in assembly.hardware.roles]
    got = "hardware alone; say --part NAME of what is a part"
    require(parts, show_path(assembly.path), "an assembly with parts", got)
    if wanted is not None:
        return _find_wanted(assembly, "--ground", wanted, parts, "a part, no hardware")
    named = [n for n in parts if _GROUND.search(assembly.solids[n].name.split(".")[-1])]
    named = (
        named or [n for n in parts if _GROUND.search(assembly.solids[n].name)] or parts
    )
    return max(named, key=lambda n: (assembly.solids[n].product.volume, -n))


def _choose_tool(
    assembly: _Found, ground: int, wanted: str | None, reached: Mapping[int, int]
) -> int:
    """Return the tool part: as given, else with a usual name, else behind most moving joints."""
    solids = assembly.solids
    able = [n for n in reached if n != ground]
    got = (
        f"none that touches {solids[ground].name}, the ground; say --ground or --joint"
    )
    if len(solids) == 1:
        single = 'describe a single part in a robot file, with shape = "step"'
        got = f"one solid; {single}"
    require(able, show_path(assembly.path), "parts that joints connect", got)
    if wanted is not None:
        return _find_wanted(assembly, "--tool", wanted, able, "a part that moves")
    fixed = [joint for joint in assembly.joints if joint.kind == "fixed"]
    whole = {
        n: min(find_distances(fixed, n)) for n in reached
    }  # rigid groups, by their first part
    ends = [
        replace(j, first=whole[j.first], second=whole[j.second])
        for j in assembly.joints
    ]
    distance = find_distances(ends, whole[ground])
    tiny = _TINY * sum(solids[n].product.volume for n in able)
    for kind in (
        lambda n: distance[whole[n]] > 0 and _TOOL.search(solids[n].name),
        lambda n: distance[whole[n]] > 0 and solids[n].product.volume > tiny,
    ):
        able = [n for n in able if kind(n)] or able
    return max(
        able,
        key=lambda n: (
            distance[whole[n]],
            reached[n],
            len(assembly.find_joints(n)),
            -n,
        ),
    )


def _find_wanted(
    assembly: _Found, option: str, wanted: str, able: Sequence[int], what: str
) -> int:
    """Return the first part that a pattern names among those able."""
    named = match_solids(assembly.solids, (wanted,), option).intersection(able)
    names = list_some([assembly.solids[n].name for n in able])
    where = place_of(option, wanted)
    require(named, where, f"{what} ({names})", f'"{wanted}"')
    return min(named)


def _model(
    path: Path, assembly: _Found, ground: int, tool: int, settings: ImportSettings
) -> tuple[SimulatorModel, list[PartFile], list[Doubt]]:
    """Return bodies, joints and tool as in a robot file, the elastic parts, and warnings."""
    solids = assembly.solids
    moving = sorted({end for joint in assembly.joints for end in joint.ends} - {ground})
    materials = choose_materials(moving, solids, settings.material, path)
    rigid = match_solids(solids, settings.rigid, "--rigid")
    estimates = {n: estimate_part(solids[n], MATERIALS[materials[n]]) for n in moving}
    total = sum(solids[n].product.volume for n in moving)
    soft = max(
        (estimates[n].compliance for n in moving if len(assembly.find_joints(n)) > 1),
        default=0.0,
    )
    bodies = list[ModelBody]()
    parts = list[PartFile]()
    ends = dict[tuple[int, Freedom], str]()
    warnings = list[Doubt]()
    for number in moving:
        solid = solids[number]
        held = assembly.find_joints(number)
        estimate = estimates[number]
        tiny = (
            solid.product.volume < _TINY * total
            and not estimate.is_slender
            and estimate.wall < _TINY_SHARE * soft
        )
        why = _rigid_reason(number, held, rigid, tiny=tiny, is_tool=number == tool)
        loaded = None if why else find_patches(number, solids, held)
        if loaded is not None and len(loaded.faces) < 2:
            why = "rigid: its joints act on the same faces"
        if why or loaded is None:
            density = MATERIALS[materials[number]].density
            note = f"{why}; {materials[number]}"
            weight = (
                density * solid.product.volume,
                solid.centre,
                density * solid.inertia,
            )
            bodies.append(ModelBody(solid.name, *weight, note=note))
            ends |= {(number, joint): solid.name for joint in held}
            if number not in rigid and (len(held) > 1 or number == tool):
                warnings += _warn_of_rigid(solid, why, estimate, soft, len(held))
            continue
        part, names = _part_of(
            parts=parts,
            solid=solid,
            material=materials[number],
            loaded=loaded,
            solids=solids,
            number=number,
        )
        part.bodies.append(solid.name)
        ends |= {
            (number, joint): f"{solid.name}.{names[loaded.shared.get(joint, joint)]}"
            for joint in held
        }
        placed = solid.origin, np.zeros((3, 3)), part.name, solid.rotation
        bodies.append(ModelBody(solid.name, 0.0, *placed))
    joints = list[ModelJoint]()
    for joint in assembly.joints:
        first, second = (
            GROUND if end == ground else ends[end, joint] for end in joint.ends
        )
        axis = None if joint.kind in {"fixed", "spherical"} else joint.axis
        name = "/".join(solids[end].name for end in joint.ends)
        place = joint.kind, joint.at, axis, joint.axis2
        joints.append(ModelJoint(name, first, second, *place, note=joint.reason))
    last = assembly.find_joints(tool)[-1]
    tool_body = ends[tool, last]
    at = solids[tool].centre if tool_body == solids[tool].name else last.at
    motions = tool_motions(assembly.joints, tool, ground, at, measure_size(solids))
    is_frame = not any(joint.kind != "fixed" for joint in assembly.joints)
    if not motions.size and not (is_frame and settings.tool and parts):
        others = len(solids) - len(assembly.hardware.roles) - 1
        fixed = (
            f"{solids[ground].name} ({len(moving)} of {others} parts are joined to it)"
        )
        raise InputError(
            f"{show_path(path)}: expected a tool that joints let move, got {solids[tool].name}, which "
            f"they fix to the ground, {fixed}; say --tool, --ground or --joint"
            + (
                "; --tool alone imports a frame, which nothing moves"
                if is_frame
                else ""
            )
        )
    name = print_safely(path.stem)
    elastic = {n for n in moving if (n, assembly.find_joints(n)[0]) in ends}
    bending = [
        n for n in elastic if ends[n, assembly.find_joints(n)[0]] != solids[n].name
    ]
    notes = _notes(assembly, ground, tool, settings) + _softest(
        bending, estimates, solids
    )
    pose = choose_coordinates(motions)
    if not pose:
        notes = (*notes, "nothing moves: a frame, whose one pose is home")
    content = tuple(bodies), tuple(joints), tool_body, at, pose, np.zeros(3), notes
    return SimulatorModel(name, *content), parts, warnings


def _part_of(
    parts: list[PartFile],
    solid: Instance,
    material: str,
    loaded: LoadedPart,
    solids: Sequence[Instance],
    number: int,
) -> tuple[PartFile, dict[Freedom, str]]:
    """Return the part of a body, an equal one if there is one, and its interface of each joint."""
    owners = list(loaded.faces)
    even = {_smaller(pair, loaded) for pair in loaded.touching}
    owners.sort(key=lambda joint: joint in even)  # the first one is at rest
    names = dict(zip(owners, interface_names(number, owners, solids), strict=True))
    faces = loaded.solid.product.faces

    def places(indices: tuple[int, ...]) -> list[tuple[float, ...]]:
        return sorted(
            (*np.round(1e6 * faces[k].centroid).tolist(), round(1e10 * faces[k].area))
            for k in indices
        )

    mine = {names[joint]: places(own) for joint, own in loaded.faces.items()}
    for part in parts:
        known = part.places
        alike = part.product is solid.product and part.material == material
        if alike and sorted(known.values()) == sorted(mine.values()):
            # by value: 0.0 and -0.0 are one place
            by_place = {tuple(place): name for name, place in known.items()}
            return part, {j: by_place[tuple(mine[name])] for j, name in names.items()}
    interfaces = {names[joint]: loaded.faces[joint] for joint in owners}
    new = PartFile(
        part_name(solid, parts),
        loaded.solid,
        material,
        interfaces,
        distributed=frozenset(names[joint] for joint in even),
        product=solid.product,
        places=mine,
    )
    parts.append(new)
    return new, names


def _smaller(pair: tuple[Freedom, Freedom], loaded: LoadedPart) -> Freedom:
    """Return the joint of a pair with the smaller faces."""
    faces = loaded.solid.product.faces
    return min(pair, key=lambda joint: sum(faces[k].area for k in loaded.faces[joint]))


def _warn_of_rigid(
    solid: Instance, why: str, estimate: Estimate, soft: float, joints: int
) -> list[Doubt]:
    """Return a warning of a part that is rigid by default though it may be soft.

    A part with several joints, or the tool with one, whose load acts on no face of it.
    """
    beside = estimate.wall >= 0.1 * soft > 0.0  # soft beside parts that bend, if any
    if not estimate.is_slender and not beside:
        return []
    size = f"as a bar of its size it bends by {1e6 * estimate.compliance:.2g} um/N"
    size += f", {estimate.slenderness:.0f} times as long as thick"
    text = f"taken as {why}; {size}: the stiffness may be far too high; "
    if joints > 1:
        text += "change its contacts in CAD, or describe the part in the robot file"
    else:
        text += "it is the tool: draw what loads it as a part that touches it there, "
        text += "or describe the part with an interface there in the robot file"
    return [Doubt((solid.name,), text, tuple(solid.centre), warning=True)]


def _softest(
    bending: Sequence[int],
    estimates: Mapping[int, Estimate],
    solids: Sequence[Instance],
) -> tuple[str, ...]:
    """Return a note that names the elastic parts that bend most, by an estimate."""
    order = sorted(bending, key=lambda n: -estimates[n].compliance)
    if not order:
        return ()
    most = estimates[order[0]].compliance
    named = [
        f"{solids[n].name} ({1e6 * estimates[n].compliance:.2g} um/N)"
        for n in order[:6]
        if estimates[n].compliance > 0.3 * most
    ]
    return (
        f"softest parts, as bars of their size clamped at one end: {', '.join(named)}",
    )


def _notes(
    assembly: _Found, ground: int, tool: int, settings: ImportSettings
) -> tuple[str, ...]:
    """Return notes on choices and omissions."""
    solids = assembly.solids
    density = MATERIALS["steel"].density
    bought = density * sum(solids[n].product.volume for n in assembly.hardware.roles)
    base = f"the ground is {solids[ground].name}, rigid"
    where = "M at its centre of mass where it is rigid, else at its last joint"
    last = f"the tool is {solids[tool].name}, {where}"
    base += "" if settings.ground else "; --ground NAME chooses another"
    last += "" if settings.tool else "; --tool NAME chooses another"
    left = f"the mass of screws, pins and bearings ({bought:.3g} kg if of steel) is left out"
    return (*([left] if bought else []), base, last)


def _rigid_reason(
    number: int,
    joints: Sequence[Freedom],
    with_material: set[int],
    *,
    tiny: bool,
    is_tool: bool = False,
) -> str:
    """Return the reason why a part is rigid; empty if it is elastic."""
    if number in with_material:
        return "rigid, as said"
    faces = [joint.faces[joint.first != number] for joint in joints]
    if not all(faces):
        return "rigid: nothing touches it at one of its joints"
    if len(joints) < 2 and is_tool:
        return "rigid: one joint, and no part touches it where it is loaded"
    if len(joints) < 2:
        return "rigid: one joint, so that nothing but its own weight loads it"
    return "rigid: tiny" if tiny else ""

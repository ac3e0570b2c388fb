"""Record of an import, kept beside the parts, and comparison with later imports."""

from __future__ import annotations

import json
import operator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.robot.inspection import Doubt
from stiffscope.runtime.output import MAKER, check_new, is_forced
from stiffscope.runtime.reading import file_digest, show_path

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from stiffscope.cad.assembly import Instance
    from stiffscope.imports.part_motions import Freedom
    from stiffscope.robot.file.description import RobotFile

RECORD = "import.json"
SETTINGS = "assembly.toml"
_SAME = 1e-6  # relative tolerance of volume and inertia; m and 1 for places


def parts_folder(out: Path) -> Path:
    """Return the folder of the parts' STEP files beside a robot file."""
    return out.with_name(f"{out.stem}-parts")


@dataclass(frozen=True)
class ImportRecord:
    """Record of an import: solids by name, hardware, joints by their parts, doubts, files written.

    ``shapes``: volume (m³), principal inertias / volume^(5/3) (3,), face count; ``places``:
    rotation, origin (12,); ``joints``: first, second, kind; ``robot``: digest of the robot file.
    """

    shapes: dict[str, list[float]]
    places: dict[str, list[float]]
    roles: dict[str, str]
    joints: list[tuple[str, str, str]]
    doubts: list[Doubt] = field(default_factory=list)
    files: list[str] = field(default_factory=list)  # STEP files of the parts
    robot: str = ""
    made_by: str = MAKER


def make_record(
    solids: Sequence[Instance],
    roles: Mapping[int, str],
    joints: Sequence[Freedom],
    doubts: list[Doubt],
) -> ImportRecord:
    """Return the record of an import."""
    shapes = dict[str, list[float]]()
    places = dict[str, list[float]]()
    names = [solid.name for solid in solids]
    for name, solid in zip(names, solids, strict=True):
        product = solid.product
        inertia = np.linalg.eigvalsh(product.inertia) / product.volume ** (5 / 3)
        shapes[name] = [product.volume, *inertia.tolist(), len(product.faces)]
        places[name] = [*solid.rotation.ravel().tolist(), *solid.origin.tolist()]
    linked = [(names[joint.first], names[joint.second], joint.kind) for joint in joints]
    named = {names[n]: role for n, role in roles.items()}
    return ImportRecord(shapes, places, named, linked, doubts)


def read_record(folder: Path) -> ImportRecord | None:
    """Return the record in a folder of parts; None if it has none."""
    try:
        held = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        joints = [tuple(joint) for joint in held["joints"]]
        doubts = [
            Doubt(**{**doubt, "solids": tuple(doubt["solids"])})
            for doubt in held["doubts"]
        ]
        return ImportRecord(**{**held, "joints": joints, "doubts": doubts})
    except (OSError, ValueError, TypeError, KeyError):
        return None


def find_doubts(robot: RobotFile) -> list[Doubt]:
    """Return the doubts of the import that wrote a robot file; none if none did."""
    record = read_record(parts_folder(robot.path))
    return [] if record is None else record.doubts


def check_place(out: Path) -> ImportRecord | None:
    """Return an earlier import's record; refuse to overwrite other files, or one changed since."""
    if out.name == SETTINGS:
        why = f"as {SETTINGS} holds settings of an import"
        raise InputError(f"{show_path(out)}: expected another name, {why}")
    folder = parts_folder(out) if out.name else out
    earlier = read_record(folder)
    if not out.exists() or not (earlier or is_forced()):
        check_new(out)
    elif earlier and not is_forced() and file_digest(out) != earlier.robot:
        raise InputError(
            f"{show_path(out)}: expected the file as the last import wrote it, got one that was changed "
            f"since; import to another file, or --force writes over it"
        )
    for name in (
        () if is_forced() else sorted(path.name for path in folder.glob("*.step"))
    ):
        if earlier is None or name not in earlier.files:
            check_new(folder / name)
    return earlier


def tell_changes(earlier: ImportRecord, now: ImportRecord) -> list[str]:
    """Describe changes since an earlier import: solids, their shape and place, roles and joints."""
    before = _match(earlier, now)
    gone = [name for name in earlier.shapes if name not in before.values()]
    told = [f"{name} is new" for name in now.shapes if name not in before]
    told += [f"{name} is gone" for name in gone]
    moved = list[str]()
    for name, old in before.items():
        was = earlier.shapes[old]
        here = now.shapes[name]
        if not _is_same(was, here):
            volume = f"volume {1e6 * was[0]:.4g} -> {1e6 * here[0]:.4g} cm³"
            told.append(
                f"{name} has another shape ({volume}, faces {was[-1]:g} -> {here[-1]:g})"
            )
        away = np.subtract(earlier.places[old], now.places[name])
        if np.abs(away).max() > _SAME:
            moved.append(f"{name} ({1e3 * float(np.linalg.norm(away[9:])):.3g} mm)")
        before_role = earlier.roles.get(old, "part")
        role = now.roles.get(name, "part")
        if before_role != role:
            told.append(f"{name} was a {before_role}, is a {role}")
    if moved:
        more = f" and {len(moved) - 8} more" if len(moved) > 8 else ""
        told.append(f"stand elsewhere: {', '.join(moved[:8])}{more}")
    return told + _tell_joints(earlier, now, before)


def _tell_joints(
    earlier: ImportRecord, now: ImportRecord, before: Mapping[str, str]
) -> list[str]:
    """Describe joints that are new, gone or of another kind."""
    old = {frozenset(joint[:2]): joint for joint in earlier.joints}
    told = []
    for first, second, kind in now.joints:
        was = old.pop(frozenset((before.get(first, ""), before.get(second, ""))), None)
        if was is None:
            told.append(f"the {kind} joint {first}/{second} is new")
        elif was[2] != kind:
            told.append(f"the joint {first}/{second} was {was[2]}, is {kind}")
    return told + [
        f"the {kind} joint {one}/{two} is gone" for one, two, kind in old.values()
    ]


def _match(earlier: ImportRecord, now: ImportRecord) -> dict[str, str]:
    """Return the earlier names of solids by name: equal in shape and place, or else in name."""

    def is_here(name: str, old: str) -> bool:
        same = np.allclose(earlier.places[old], now.places[name], rtol=0.0, atol=_SAME)
        return same and _is_same(earlier.shapes[old], now.shapes[name])

    matches = dict[str, str]()
    for rule in (
        lambda name, old: name == old and is_here(name, old),
        is_here,
        operator.eq,
    ):
        left = [old for old in earlier.shapes if old not in matches.values()]
        for name in now.shapes:
            old = (
                None
                if name in matches
                else next((each for each in left if rule(name, each)), None)
            )
            if old is not None:
                matches[name] = old
                left.remove(old)
    return matches


def _is_same(shape: Sequence[float], other: Sequence[float]) -> bool:
    return bool(np.allclose(shape, other, rtol=_SAME, atol=1e-3 * _SAME**2))

"""Parts of an imported assembly: materials, interfaces, STEP files and tables in the robot file."""

from __future__ import annotations

import fnmatch
import hashlib
import json
import re
from collections import defaultdict
from dataclasses import asdict, dataclass, field, replace
from itertools import chain, count
from typing import TYPE_CHECKING

from stiffscope import cad
from stiffscope.cad.materials import DESIGNATIONS, MATERIALS
from stiffscope.errors import InputError, require
from stiffscope.imports.compiled_model import print_safely
from stiffscope.imports.import_record import RECORD, parts_folder
from stiffscope.imports.robot_text import (
    check_text,
    to_toml,
    toml_key,
    vector_text,
)
from stiffscope.robot.file.parse import place_of
from stiffscope.runtime.output import refusing, scratch_folder, write_bytes
from stiffscope.runtime.reading import show_path

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.cad.assembly import Instance, Product
    from stiffscope.imports.import_record import ImportRecord
    from stiffscope.imports.part_motions import Freedom


@dataclass(frozen=True, eq=False)
class PartFile:
    """An elastic part: name, solid of one of its bodies, material, interfaces' faces by name.

    ``distributed``: interfaces that are loaded evenly, as their faces touch those of another.
    """

    name: str
    solid: Instance
    material: str
    interfaces: dict[str, tuple[int, ...]]
    bodies: list[str] = field(default_factory=list)
    distributed: frozenset[str] = frozenset()
    product: Product | None = None
    """Its product as in the assembly, and places and areas of its faces by interface."""
    places: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)


def interface_names(
    number: int, joints: Sequence[Freedom], solids: Sequence[Instance]
) -> list[str]:
    """Name a part's interfaces after the adjacent parts, without numbers if still unique."""
    others = [solids[sum(joint.ends) - number].name for joint in joints]
    names = [
        re.sub(r"[^A-Za-z]+$", "", re.split(r"[._\- ]", each)[0]) or each
        for each in others
    ]
    if len(set(names)) < len(names):
        names = [re.sub(r"[.\s]", "_", other) for other in others]
    numbered = enumerate(names, 1)
    return [
        name if names.count(name) == 1 else f"{name}_{index}"
        for index, name in numbered
    ]


def part_name(solid: Instance, parts: Sequence[PartFile]) -> str:
    """Return a unique name for the part of a solid: the solid's name without its number."""
    taken = {part.name for part in parts}
    base = re.sub(r"[^\w\-]", "_", re.sub(r"[\d_.\- ]+$", "", solid.name) or solid.name)
    names = chain([base], (f"{base}{n}" for n in count(2)))
    return next(name for name in names if name not in taken)


def choose_materials(
    parts: Sequence[int], solids: Sequence[Instance], texts: Sequence[str], path: Path
) -> dict[int, str]:
    """Return each part's material: as said of its name or the file's word for it, else that word.

    A name or word itself counts more than a pattern, and of several patterns the last.
    """
    known = {name.lower(): name for name in MATERIALS}
    known |= {word.lower(): name for word, name in DESIGNATIONS.items()}
    words = [
        word.lower()
        for solid in solids
        for word in (solid.name, solid.product.material)
    ]
    rules = list[tuple[str, str]]()
    for text in texts:
        pattern, equals, name = (piece.strip() for piece in text.partition("="))
        where = place_of("--material", text)
        names = ", ".join(MATERIALS)
        valid = equals and name.lower() in known
        require(valid, where, f"PATTERN=NAME with a name of {names}", f'"{text}"')
        matching = fnmatch.filter(words, pattern.lower())
        expected = "the name of a solid, or of its material"
        require(matching, where, expected, f'"{print_safely(pattern)}"')
        rules.append((pattern.lower(), known[name.lower()]))
    materials = dict[int, str]()
    missing = defaultdict[str, list[str]](list)
    for number in parts:
        word = solids[number].product.material.lower()
        words_of = [each for each in (solids[number].name.lower(), word) if each]
        named = [
            candidate for candidate in rules if fnmatch.filter(words_of, candidate[0])
        ]
        if named:
            materials[number] = sorted(named, key=lambda rule: rule[0] in words_of)[-1][
                1
            ]
        elif word in known:
            materials[number] = known[word]
        else:
            missing[solids[number].product.material].append(solids[number].name)
    if missing:
        word, names = next(iter(missing.items()))
        listed = ", ".join(names[:8]) + (
            f" and {len(names) - 8} more" if len(names) > 8 else ""
        )
        what = f'one that is not known, "{print_safely(word)}"' if word else "none"
        raise InputError(
            f"{show_path(path)}: expected a material for {listed}, got {what}; "
            f'say --material "PATTERN=NAME" with a name of {", ".join(MATERIALS)}'
        )
    return materials


def part_lines(parts: Sequence[PartFile], out: Path) -> list[str]:
    """Return the lines of the parts' tables, and of groups of bodies of the same part."""
    lines = list[str]()
    for part in parts:
        here = f"parts.{toml_key(part.name)}"
        file = f"{parts_folder(out).name}/{part.name}.step"
        lines += [f"[{here}]", 'shape = "step"', f"file = {to_toml(file)}"]
        lines += [f"material = {to_toml(part.material)}"]
        for name, faces in part.interfaces.items():
            chosen = _selectors(part.solid, faces)
            if name in part.distributed:
                chosen = f'{{ faces = {chosen}, interface = "distributed" }}'
            lines.append(f"interfaces.{toml_key(name)} = {chosen}")
        lines.append("")
    several = {part.name + "s": part.bodies for part in parts if len(part.bodies) > 1}
    groups = [
        f"{toml_key(name)} = {to_toml(bodies)}" for name, bodies in several.items()
    ]
    return [*lines, "[groups]", *groups, ""] if groups else lines


def write_import(
    path: Path,
    out: Path,
    text: str,
    parts: Sequence[PartFile],
    what: str,
    record: ImportRecord | None = None,
) -> None:
    """Write a robot file, if a robot can be read from it, its parts' STEP files and its record."""
    folder = parts_folder(out)
    content = text.encode()
    files = [f"{part.name}.step" for part in parts]
    with scratch_folder(out.parent) as scratch:
        trial = scratch / folder.name
        trial.mkdir()
        for name, part in zip(files, parts, strict=True):
            with refusing(out):
                cad.kernel_files.write_step(part.solid.product.solid, trial / name)
        check_text(path, scratch / out.name, text, what)
        if record is not None:
            record = replace(
                record, files=files, robot=hashlib.sha256(content).hexdigest()
            )
            written = json.dumps(asdict(record), ensure_ascii=False)
            (trial / RECORD).write_text(written, encoding="utf-8")
        folder.mkdir(exist_ok=True)
        for file in sorted(trial.iterdir()):
            file.replace(folder / file.name)
    write_bytes(out, content)


def _selectors(solid: Instance, faces: Sequence[int]) -> str:
    texts = []
    for index in faces:
        face = solid.product.faces[index]
        shape = cad.kernel.faces(solid.product.solid)[index]
        inside = cad.kernel.inner_point(shape)  # no border, which is a neighbour's too
        point = 1e-3 * cad.kernel.closest(shape, inside)
        size = (
            to_toml(f"{1e3 * face.radius:.9g} mm")
            if face.kind in {"cylinder", "sphere"}
            else ""
        )
        keys = {
            "kind": to_toml(face.kind),
            "radius": size,
            "position": vector_text(point),
        }
        texts.append(
            f"{{ {', '.join(f'{key} = {text}' for key, text in keys.items() if text)} }}"
        )
    return texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]"

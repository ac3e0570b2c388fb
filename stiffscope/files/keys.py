"""Keys of all user files (robot, study, job, campaign), for the documentation and `keys`."""

from __future__ import annotations

import inspect
import re
import tomllib
from dataclasses import astuple, dataclass
from functools import cache
from importlib import resources
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

from pydantic_core import PydanticUndefined

from stiffscope.cad.materials import MATERIALS
from stiffscope.errors import InputError, suggest
from stiffscope.gap.effects.vocabulary import EFFECTS
from stiffscope.registry import load, slices
from stiffscope.report.terminal import show_line, show_table
from stiffscope.robot.file import element_sections, part_sections, sections
from stiffscope.robot.file.values import Reads, Says, measured_quantity

if TYPE_CHECKING:
    from collections.abc import Iterable

TOP = {
    "name": ("a text", "**needed**"),
    "[parameters]": ("numbers with units by name", "–"),
    "[groups]": ("lists of bodies or joints by name", "–"),
    "[poses]": (
        "by name, as many numbers as `[tool] pose` has coordinates",
        "`home` as the file describes it",
    ),
    **{
        f"[{kind}.NAME]": ("a table for each", "–")
        for kind in ("parts", "bodies", "joints")
    },
    "[[copies]]": ("tables in a list", "–"),
    **dict.fromkeys(("[tool]", "[gravity]", "[map]"), ("a table", "–")),
    "[materials.NAME]": ("a table for each", "–"),
    "[[effects]]": ("tables in a list", "–"),
}
_KINDS: dict[Any, list[str]] = {}  # of bearings, by the section that describes them
for _kind, _model in element_sections.ELEMENTS.items():
    _KINDS.setdefault(_model, []).append(_kind)
TABLES = (
    *(
        (f'[parts.NAME], shape = "{name}"', part)
        for name, part in part_sections.PARTS.items()
    ),
    ('[parts.NAME], shape = "matrix", with `interfaces`', part_sections.InterfacePart),
    ("[parts.NAME.mesh]", part_sections.Mesh),
    ("interfaces.NAME of a STEP part", part_sections.NamedFaces),
    ("A choice of faces: clamped, loaded of a STEP part", part_sections.Face),
    ("[materials.NAME], isotropic", part_sections.Isotropic),
    ("[materials.NAME], of fibres along x", part_sections.Fibrous),
    ("[bodies.NAME], with a part", sections.ElasticBody),
    ("[bodies.NAME], with a part of named interfaces", sections.InterfaceBody),
    ("[bodies.NAME], rigid", sections.RigidBody),
    *(
        (f'[joints.NAME], type = "{name}"', joint)
        for name, joint in sections.JOINTS.items()
    ),
    ("drive of a slide", sections.LinearDrive),
    ("drive about an axis", sections.RotaryDrive),
    ("compliance of a joint", sections.Bearing),
    *(
        (f"bearing of a joint, kind = {' or '.join(kinds)}", model)
        for model, kinds in _KINDS.items()
    ),
    ("[[copies]]", sections.Copies),
    ("[tool]", sections.ToolSection),
    ("[gravity]", sections.GravitySection),
    ("[map]", sections.MapSection),
    ("[[effects]]", sections.Effect),
)


@dataclass(frozen=True)
class Key:
    """A key of a file: its meaning, accepted values and default, in words."""

    key: str
    means: str
    takes: str = ""
    default: str = ""


@cache
def _meanings() -> dict[str, dict[str, Any]]:
    text = (
        resources.files("stiffscope.data")
        .joinpath("keys.toml")
        .read_text(encoding="utf-8")
    )
    return tomllib.loads(text)


def _meaning(kind: str, title: str, key: str) -> str:
    """Return a key's meaning: the one of the section if it has its own, else the general one."""
    meanings = _meanings()[kind]
    end = f".{key}"
    words = (name.removesuffix(end) for name in meanings if name.endswith(end))
    meaning = next((meanings[word + end] for word in words if word in title), "")
    return meaning or meanings.get(key, "")


def _section_keys(kind: str, tables: Iterable[tuple[str, Any]]) -> dict[str, list[Key]]:
    """Return the keys of the sections of one kind of file, by title."""
    sections = {}
    for title, model in tables:
        sections[title] = [
            _describe_field(kind, title, field.alias or own, field)
            for own, field in model.model_fields.items()
        ]
    return sections


def _describe_field(kind: str, title: str, name: str, field: Any) -> Key:
    takes = _said(field.metadata) or _words_of(field.annotation)
    default = "**needed**" if field.is_required() else _default(field, takes)
    means = field.description or _meaning(kind, title, name)
    return Key(name, means, takes, default)


def _robot_keys() -> dict[str, list[Key]]:
    """Return the keys of a robot file by section, and the built-in materials."""
    title = "the top level"
    materials = list[Key]()
    for name, each in MATERIALS.items():
        moduli = f"E {each.youngs_modulus / 1e9:.4g} GPa, G {each.shear_modulus / 1e9:.3g} GPa"
        materials.append(Key(name, each.source, f"{moduli}, {each.density:g} kg/m³"))
    return {
        title: [
            Key(key, _meaning("robot", title, key), *rest) for key, rest in TOP.items()
        ],
        **_section_keys("robot", TABLES),
        "built-in materials": materials,
    }


def all_keys() -> dict[str, dict[str, list[Key]]]:
    """Return all keys by kind of file and section."""
    others = dict[str, dict[str, list[Key]]]()
    # a file's own sections stand before those that other slices add to it
    ordered = sorted(slices().values(), key=lambda each: bool(each.sections))
    for each in ordered:
        for kind, tables in each.keys:
            others.setdefault(kind, {}).update(_section_keys(kind, load(tables)))
    campaign = others["campaign"]
    quantities = _meanings()["quantities at M"].items()
    campaign["quantities at M"] = [Key(*quantity) for quantity in quantities]
    campaign["effects"] = []
    for name, parameters in EFFECTS.items():
        words = ", ".join(f"{parameter} ({unit})" for parameter, unit in parameters[:9])
        campaign["effects"].append(Key(name, words or "no parameters"))
    kinds = ("study", "job", "campaign")
    return {"robot": _robot_keys(), **{kind: others[kind] for kind in kinds}}


def find_keys(wanted: str | None) -> dict[str, dict[str, list[Key]]]:
    """Return the sections that match a text, all for None. Raise InputError if nothing matches."""
    every = all_keys()
    if wanted is None or wanted in every:
        return {wanted: every[wanted]} if wanted else every
    keys = {
        kind: {
            title: rows
            for title, rows in titles.items()
            if wanted.lower() in title.lower()
        }
        for kind, titles in every.items()
    }
    keys = {kind: titles for kind, titles in keys.items() if titles}
    if not keys:
        titles = [title for titles in every.values() for title in titles]
        guess = suggest(wanted, [*every, *titles], cutoff=0.4)
        expected = f"expected {', '.join(every)} or part of a section's title"
        raise InputError(f'keys: {expected}, got "{wanted}"{guess}')
    return keys


def show_keys(keys_by_kind: dict[str, dict[str, list[Key]]]) -> None:
    """Print one table per section."""
    for kind, titles in keys_by_kind.items():
        show_line(
            f"{kind[0].upper()}{kind[1:]} file" if kind != "campaign" else "Campaign",
            "bold",
        )
        show_line("")
        for title, rows in titles.items():
            cells = [
                [re.sub(r"`|\*\*", "", cell) for cell in astuple(row)] for row in rows
            ]
            groups = [["key"], ["means", "takes", "default"]]
            show_table(title, groups, cells, prose={"means", "takes"})


def _said(metadata: Iterable[Any]) -> str:
    notes = (note for note in metadata if isinstance(note, Reads | Says))
    return next(
        (note.says if isinstance(note, Reads) else str(note) for note in notes), ""
    )


def _words_of(annotation: Any) -> str:  # noqa: PLR0911 (one return per kind of type)
    """Return a type in words."""
    said = _said(getattr(annotation, "__metadata__", ()))
    if said:
        return said
    origin = get_origin(annotation)
    inner = get_args(annotation)
    if origin is Annotated:
        return _words_of(inner[0])
    if origin is Literal:
        return " or ".join(f'"{choice}"' for choice in inner)
    if origin in {Union, UnionType}:
        return " or ".join(
            dict.fromkeys(_words_of(each) for each in inner if each is not NoneType)
        )
    if origin is dict:
        return "a table by name"
    if origin in {tuple, list}:
        words = (_words_of(each) for each in inner if each is not Ellipsis)
        return f"a list of {' and '.join(dict.fromkeys(words))}"
    known = {
        str: "a text",
        int: "a whole number",
        float: "a number",
        bool: "true or false",
    }
    other = "a table of its own" if inspect.isclass(annotation) else "any value"
    return known.get(annotation, other)


def _default(field: Any, takes: str) -> str:
    """Return a default as a file would have it, in the unit of the example."""
    value = field.get_default(call_default_factory=True)
    if value is None or value is PydanticUndefined or value in ("", (), {}):
        return "–"
    if isinstance(value, tuple):
        return f"`[{', '.join(f'{item:g}' for item in value)}]`"
    if isinstance(value, float):
        unit = re.search(r'such as "[\d.]+ ([^"]+)"', takes)
        known = unit and value and measured_quantity(f"1 {unit[1]}")
        return f"`{value / known:g} {unit[1]}`" if unit and known else f"`{value:g}`"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{value}`" if isinstance(value, str | int) else "its own"

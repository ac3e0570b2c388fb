"""Second pass over a robot file: apply `--set NAME.KEY=VALUE`."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from stiffscope.cad.materials import MATERIALS
from stiffscope.errors import InputError, require, suggest
from stiffscope.robot.file.copies import copied_names
from stiffscope.robot.file.part_sections import PARTS, InterfacePart
from stiffscope.robot.file.sections import JOINTS, ElasticBody, InterfaceBody, RigidBody
from stiffscope.robot.file.tables import keys_of, list_some

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stiffscope.errors import Key
    from stiffscope.robot.file.parse import Source

# sections whose names need no prefix; keys of their tables decide if two sections share a name
NAMED = {
    section: {key for model in models for key in keys_of(model)}
    for section, models in (
        ("parts", (*PARTS.values(), InterfacePart)),
        ("joints", JOINTS.values()),
        ("bodies", (ElasticBody, InterfaceBody, RigidBody)),
    )
}
_NESTED = (
    *NAMED,
    "materials",
    "poses",
    "groups",
    "parameters",
)  # sections of named entries
TABLES = (
    *NAMED,
    "parameters",
    "tool",
    "gravity",
    "poses",
    "map",
    "materials",
    "groups",
)
MOST_CHARACTERS = 5_000  # a matrix needs about 1000
_EXAMPLE = "slider.thickness=25mm"
_STATED = re.compile(
    r"\s*[+-]?[\d.][\d._]*(?:[eE][+-]?\d+)?\s*([^\d\s.±][^±]*?)\s*(?:±.*)?"
)


class TypedOverride(str):
    """An override that a person has typed, rather than a program that computes in SI."""

    __slots__ = ()


@dataclass(frozen=True)
class Override:
    """A value for a key, the text of the override, and whether a person typed it."""

    key: tuple[str, ...]
    value: Any
    text: str
    is_typed: bool = False


def write_override(name: str, value: Any) -> str:
    """Return an override for `--set`."""
    text = (
        json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)
    )
    return f"{name}={text}"


def apply_overrides(
    data: dict[str, Any], source: Source, tolerance: str | None
) -> tuple[list[Override], list[Override]]:
    """Apply overrides to a parsed file, in place.

    Parameters
    ----------
    data
        Parsed file.
    source
        Source with the overrides; their keys are added to its `changed`.
    tolerance
        Tolerance of the meshes of all solid parts; None: as in the file.

    Returns
    -------
    list of Override
        All overrides by the source.
    list of Override
        Overrides of copies, which do not exist yet.
    """
    names = {key: list(value) for key, value in data.items() if isinstance(value, dict)}
    copied = {
        key: list(copied_names(data, names.get(key, [])))
        for key in ("bodies", "joints")
    }
    names |= {key: [*names.get(key, []), *more] for key, more in copied.items()}
    changes = [locate(text, names) for text in source.overrides]
    for name, table in data.get("parts", {}).items() if tolerance is not None else ():
        if isinstance(table, dict) and table.get("shape") != "matrix":
            key = ("parts", name, "mesh", "tolerance")
            changes.append(Override(key, tolerance, f"--tolerance {tolerance}"))
    later = []
    for change in changes:
        if change.key[1] in copied.get(change.key[0], ()):
            later.append(change)
        else:
            assign(data, change.key, change.value, change.text)
        source.changed[change.key] = change.text
    return changes, later


def check_unit(change: Override, written: Mapping[str, Any], owner: str) -> None:
    """Raise InputError for a typed bare number where the file states a number with a unit.

    A person probably means that unit, and SI is a thousand times as much.

    Parameters
    ----------
    change
        The override.
    written
        The file as it was parsed, without changes.
    owner
        Name of the entry that states the value: of a copy, its original.
    """
    is_number = type(change.value) in {int, float}
    if not change.is_typed or not is_number:
        return
    stated: Any = written
    for part in (change.key[0], owner, *change.key[2:]):
        if _is_within(stated, part):
            stated = stated[int(part)]
        else:
            stated = stated.get(part) if isinstance(stated, dict) else None
    unit = _STATED.fullmatch(stated) if isinstance(stated, str) else None
    if unit and change.value:
        example = f"{change.value:g} {unit[1]}"
        what = f'a number with a unit such as {example}, as the file states "{stated}"'
        raise InputError(f"{change.text}: expected {what}; got {change.value:g}")


def split(text: str) -> tuple[str, Any]:
    """Split "slider.thickness=25mm" (value in TOML, or else a string); InputError if invalid."""
    require(
        len(text) <= MOST_CHARACTERS,
        f"--set {text[:60]}…",
        f"at most {MOST_CHARACTERS:,} characters",
        f"{len(text):,}",
    )
    name, equals, value = text.partition("=")
    name = name.strip().replace('"', "")
    require(
        equals and value.strip() and all(name.split(".")) and "." in name,
        f"--set {text}",
        f"NAME.KEY=VALUE such as {_EXAMPLE}",
        f'"{text}"',
    )
    try:
        return name, tomllib.loads(f"value = {value.strip()}")["value"]
    except (KeyError, ValueError, RecursionError):  # usually a string without quotes
        return name, value.strip()


def locate(text: str, names: Mapping[str, Sequence[str]]) -> Override:
    """Resolve a text such as "slider.thickness=25mm" to a key, given the names in each section."""
    name, value = split(text)
    keys: list[tuple[str, ...]] = [
        (section, *rest)
        for section in NAMED
        for rest in _ways(name, names.get(section, ()))
    ]
    section, _, rest = name.partition(".")
    if section == "parameters" and rest not in (there := names.get(section, ())):
        what = f"a parameter of the file ({list_some(there) or 'it has none'})"
        raise InputError(
            f'--set {text}: expected {what}, got "{rest}"{suggest(rest, there)}'
        )
    if section in TABLES:
        inside = _ways(rest, names.get(section, ())) if section in _NESTED else []
        keys.append((section, *(inside[0] if inside else rest.split("."))))
    if not keys:
        known = [candidate for section in NAMED for candidate in names.get(section, ())]
        guess = suggest(section, [*known, *TABLES])
        what = (
            f"NAME.KEY=VALUE with a NAME of {list_some(known)} or {', '.join(TABLES)}"
        )
        raise InputError(f'--set {text}: expected {what}, got "{name}"{guess}')
    fitting = [key for key in keys if len(key) > 2 and key[2] in NAMED.get(key[0], ())]
    require(
        not (
            len({key[0] for key in fitting} & {"bodies", "joints"}) > 1
            and fitting[0][0] != "parts"
        ),
        f"--set {text}",
        f"bodies.{name} or joints.{name}",
        f"{name}, which both have",
    )
    is_typed = isinstance(text, TypedOverride)
    return Override((fitting or keys)[0], value, f"--set {text}", is_typed)


def _ways(name: str, known: Iterable[str]) -> list[tuple[str, ...]]:
    """Split into a known name and the keys after it, longest name first."""
    fitting = sorted(
        (each for each in known if name.startswith(f"{each}.")), key=len, reverse=True
    )
    return [(each, *name[len(each) + 1 :].split(".")) for each in fitting]


def assign(data: dict[str, Any], key: Key, value: Any, text: str) -> None:
    """Set the value of a key; raise InputError with the override's text if it is not in a table.

    Parameters
    ----------
    data
        Tables to change.
    key
        Keys from the outermost table to the value.
    value
        New value.
    text
        Text of the override, for messages.
    """
    table: Any = data
    if key[0] == "materials" and key[2:]:
        _add_material(data, str(key[1]))
    for part in key[:-1]:
        if _is_within(table, part):
            table = table[int(part)]
        else:
            table = table.setdefault(part, {}) if isinstance(table, dict) else None
    last = key[-1]
    if _is_within(table, last):
        table[int(last)] = value
    elif isinstance(table, dict):
        table[last] = value
    else:
        raise InputError(
            f'{text}: expected a key of a table, got "{last}" of a value that is none'
        )


def _is_within(table: Any, part: str | int) -> bool:
    return isinstance(table, list) and str(part).isdecimal() and int(part) < len(table)


def _add_material(data: dict[str, Any], name: str) -> None:
    """Add the constants of a built-in material, of which one is set, unless the file has its own."""
    materials = data.setdefault("materials", {})
    if isinstance(materials, dict) and name not in materials and name in MATERIALS:
        materials[name] = {
            key: value
            for key, value in asdict(MATERIALS[name]).items()
            if key != "name"
        }

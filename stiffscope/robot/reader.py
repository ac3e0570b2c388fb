"""Read a robot file: apply `--set`, evaluate expressions, make copies, check; errors name file, line and field."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError
from stiffscope.robot.checks import check_robot
from stiffscope.robot.file import copies as sets
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.description import RobotFile
from stiffscope.robot.file.evaluate import FieldError, parameter_values, with_values
from stiffscope.robot.file.overrides import Override, assign, located
from stiffscope.robot.file.part_sections import PARTS, Fibrous, Isotropic, PartSection
from stiffscope.robot.file.sections import (
    AXES,
    JOINTS,
    BodySection,
    Copies,
    Effect,
    ElasticBody,
    GravitySection,
    JointSection,
    MapSection,
    RigidBody,
    ToolSection,
)
from stiffscope.robot.file.source import Source, parse_text, read_text
from stiffscope.robot.file.tolerances import without_tolerances
from stiffscope.robot.file.validate import keys_of, one_of, section, unknown_key
from stiffscope.robot.file.values import ANGLE
from stiffscope.robot.library import find_robot

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from stiffscope.cad.materials import AnyMaterial

TOP = (
    "name", "parameters", "parts", "bodies", "joints", "copies", "groups", "tool", "gravity", "poses", "map",
    "materials", "effects",
)  # fmt: skip
_KEYS = {
    "parts": {key for model in PARTS.values() for key in keys_of(model)},
    "joints": {key for model in JOINTS.values() for key in keys_of(model)},
    "bodies": {*keys_of(ElasticBody), *keys_of(RigidBody)},
}


def load_robot(name_or_path: str | Path, overrides: Sequence[str] = (), tolerance: str | None = None) -> RobotFile:
    """Load and check a robot file.

    Parameters
    ----------
    name_or_path
        A path, or the name of a robot in `data/robots` ("biglide").
    overrides
        Texts as `--set` takes them: "slider.thickness=25mm", "leg1.motor.drive.stiffness=2e7", "parameters.a=0.2".
        They change what is written: copies of a body follow it, and a copy's own name changes that copy alone.
    tolerance
        Text as `--tolerance` takes it ("0.1 %", "1e-3"): for the experiments on all parts, whatever the file says.

    Returns
    -------
    RobotFile
        Immutable; SI units.

    Raises
    ------
    InputError
        One line that names the file, the line, the field, what was expected and what was found.

    """
    path = find_robot(name_or_path)
    text = read_text(path)
    return read_robot(path, text, overrides, tolerance)


def read_robot(path: Path, text: str, overrides: Sequence[str] = (), tolerance: str | None = None) -> RobotFile:
    """Read a robot from a text; `path` is what errors call it and what paths in it are relative to. As `load_robot`."""
    data = parse_text(path, text)
    source = Source(path, text, tuple(overrides))
    try:
        return _read(data, source, overrides, tolerance)
    except FieldError as error:
        raise source.refuse(error.key, str(error)) from error


def _read(data: dict[str, Any], source: Source, overrides: Sequence[str], tolerance: str | None) -> RobotFile:
    for key in data:
        if key not in TOP:
            raise FieldError((key,), unknown_key(key, TOP))
    for key in TOP:
        _of_kind(data, key)
    later = _overridden(data, source, overrides, tolerance)
    data, tolerances = without_tolerances(data)
    values = parameter_values(data)
    data = with_values({key: value for key, value in data.items() if key != "parameters"}, values)

    parts = {name: _part(name, table) for name, table in data.get("parts", {}).items()}
    written = sets.Written(
        {name: _body(name, table) for name, table in data.get("bodies", {}).items()},
        {name: _joint(name, table) for name, table in data.get("joints", {}).items()},
        {},
    )
    _make_copies(
        written, [section(Copies, each, ("copies", i)) for i, each in enumerate(data.get("copies", []))], source
    )
    _change_copies(written, later, values)

    if "tool" not in data:
        raise FieldError(("tool",), "expected a table of body, at, pose, got nothing")
    tool = section(ToolSection, data["tool"], ("tool",))
    robot = RobotFile(
        name=_name(data, source),
        parts=MappingProxyType(parts),
        bodies=MappingProxyType(written.bodies),
        joints=MappingProxyType(written.joints),
        tool=tool,
        parameters=MappingProxyType({name: value for name, value in values.items() if "." not in name}),
        groups=MappingProxyType(_groups(data.get("groups", {}), written)),
        gravity=section(GravitySection, data["gravity"], ("gravity",)) if "gravity" in data else None,
        poses=MappingProxyType(
            {name: _pose(each, tool, ("poses", name)) for name, each in data.get("poses", {}).items()}
        ),
        map=_map(data["map"], tool) if "map" in data else None,
        materials=MappingProxyType({name: _material(name, each) for name, each in data.get("materials", {}).items()}),
        effects=tuple(section(Effect, each, ("effects", i)) for i, each in enumerate(data.get("effects", []))),
        copied=MappingProxyType(written.copied),
        tolerances=MappingProxyType(tolerances),
        source=source,
    )
    check_robot(robot)
    return robot


def _of_kind(data: Mapping[str, Any], key: str) -> None:
    """Refuse a section that is no table, or no list of tables."""
    if key in {"copies", "effects"}:
        if not isinstance(data.get(key, []), list):
            raise FieldError((key,), f"expected [[{key}]], a list of tables, got {q.shown(data[key])}")
    elif key != "name" and not isinstance(data.get(key, {}), dict):
        raise FieldError((key,), f"expected a table, got {q.shown(data[key])}")


def _name(data: Mapping[str, Any], source: Source) -> str:
    name = data.get("name", source.path.stem)
    if not isinstance(name, str) or not name.strip():
        raise FieldError(("name",), f"expected a name in quotes, got {q.shown(name)}")
    return name


def _overridden(
    data: dict[str, Any], source: Source, overrides: Sequence[str], tolerance: str | None
) -> list[Override]:
    """Apply overrides to what is written; those of copies are returned for later."""
    if not overrides and tolerance is None:
        return []
    names = {key: list(value) for key, value in data.items() if isinstance(value, dict)}
    copied = {key: list(_copied_names(data, names.get(key, []))) for key in ("bodies", "joints")}
    for key, more in copied.items():
        names[key] = [*names.get(key, []), *more]
    later = []
    for text in overrides:
        override = located(text, names, _KEYS)
        if override.key[0] in copied and override.key[1] in copied[override.key[0]]:
            later.append(override)
        else:
            assign(data, override)
        source.changed[override.key] = override.text
    if tolerance is not None:
        for name, table in data.get("parts", {}).items():
            if isinstance(table, dict) and table.get("shape") != "matrix":
                override = Override(("parts", name, "mesh", "tolerance"), tolerance, f"--tolerance {tolerance}")
                assign(data, override)
                source.changed[override.key] = override.text
    return later


def _copied_names(data: Mapping[str, Any], written: Iterable[str]) -> Iterator[str]:
    """Names that `[[copies]]` will make, found before anything is checked."""
    names = list(written)
    entries = [each for each in data.get("copies", []) if isinstance(each, dict)]
    for _ in entries:  # a copy of a copy needs another round
        for entry in entries:
            new = entry.get("as", [])
            for name in [each for each in names if sets.belongs(each, str(entry.get("of")))]:
                for made in new if isinstance(new, list) else []:
                    copied = sets.renamed(name, str(entry["of"]), str(made))
                    if copied not in names:
                        names.append(copied)
                        yield copied


def _part(name: str, table: Any) -> PartSection:
    key = ("parts", name)
    model = PARTS[_choice(table, "shape", PARTS, key, "a shape")]
    return section(model, table, key)


def _choice(table: Any, word: str, valid: Iterable[str], key: tuple[str, ...], what: str) -> str:
    """Which of several kinds a table is. Raises FieldError."""
    if not isinstance(table, dict):
        raise FieldError(key, f"expected a table, got {q.shown(table)}")
    if word not in table:
        raise FieldError((*key, word), f"expected {what} ({', '.join(valid)}), got nothing")
    try:
        return one_of(table[word], valid, what)
    except ValueError as error:
        raise FieldError((*key, word), str(error)) from error


def _body(name: str, table: Any) -> BodySection:
    """An elastic body where a part is named or an end is given, else a rigid one."""
    key = ("bodies", name)
    if isinstance(table, dict):
        elastic = [each for each in table if each in keys_of(ElasticBody)]
        rigid = [each for each in table if each in keys_of(RigidBody)]
        if "part" in elastic and rigid:
            message = (
                f"expected no {rigid[0]} of a body with a part, which has its part's, got {q.shown(table[rigid[0]])}"
            )
            raise FieldError((*key, rigid[0]), message)
        if elastic and not rigid:
            return section(ElasticBody, table, key)
        if elastic:
            raise FieldError((*key, elastic[0]), f"expected no {elastic[0]} of a rigid body, which has no part")
    return section(RigidBody, table, key)


def _joint(name: str, table: Any) -> JointSection:
    key = ("joints", name)
    kind = _choice(table, "type", JOINTS, key, "a type")
    if "drive" in table and "drive" not in JOINTS[kind].model_fields:
        driven = ", ".join(each for each, model in JOINTS.items() if "drive" in model.model_fields)
        raise FieldError((*key, "drive"), f"expected a joint that a drive can move ({driven}), got a {kind} one")
    return section(JOINTS[kind], table, key)


def _make_copies(written: sets.Written, entries: Sequence[Copies], source: Source) -> None:
    """Add the copies, each checked as if it were written."""
    for number in sets.ordered(entries):
        entry = entries[number]
        sets.check(written, entry, number)
        originals = written.in_set(entry.of)
        for position, new in enumerate(entry.as_):
            turn = sets.turn_of(entry, position)
            for name in originals:
                copied = sets.renamed(name, entry.of, new)
                origin = sets.origin(written.copied, name, turn)
                written.copied[copied] = origin
                source.origins[copied] = origin.name
                if name in written.bodies:
                    table = sets.turned(written.bodies[name], entry.of, new, turn)
                    written.bodies[copied] = _body(copied, table)
                else:
                    table = sets.turned(written.joints[name], entry.of, new, turn)
                    written.joints[copied] = _joint(copied, table)


def _change_copies(written: sets.Written, later: Sequence[Override], values: Mapping[str, float]) -> None:
    """Apply the overrides of copied bodies and joints."""
    for override in later:
        kind, name = override.key[:2]
        known, read = (written.bodies, _body) if kind == "bodies" else (written.joints, _joint)
        if name not in known:
            raise InputError(f'{override.text}: expected the name of a body or joint, got "{name}"')
        data: dict[str, Any] = {kind: {name: known[name].model_dump(exclude_unset=True)}}
        assign(data, override)
        known[name] = read(name, with_values(data, values)[kind][name])  # type: ignore[assignment]


def _material(name: str, table: Any) -> AnyMaterial:
    key = ("materials", name)
    model = Fibrous if isinstance(table, dict) and "axial_modulus" in table else Isotropic
    made = section(model, table, key)
    try:
        return made.build(name)
    except InputError as error:  # "materials.steel.density: expected ..."
        where, _, message = str(error).removeprefix(f"materials.{name}.").partition(": ")
        raise FieldError((*key, where), message) from error


def _groups(table: Mapping[str, Any], written: sets.Written) -> dict[str, tuple[str, ...]]:
    """The sets, those that name other sets resolved."""
    elements = {**written.bodies, **written.joints}
    for name, listed in table.items():
        key = ("groups", name)
        if name in elements:
            raise FieldError(key, f'expected a name that no body or joint has, got "{name}"')
        if not isinstance(listed, list):
            raise FieldError(key, f"expected a list of bodies and joints, got {q.shown(listed)}")
        for number, each in enumerate(listed):
            try:
                one_of(each, [*elements, *(other for other in table if other != name)], "a body, a joint or a group")
            except ValueError as error:
                raise FieldError((*key, number), str(error)) from error

    def members(name: str, above: tuple[str, ...]) -> Iterator[str]:
        if name in above:
            raise FieldError(("groups", name), f"expected no group within itself, got {' -> '.join((*above, name))}")
        for each in table[name]:
            yield from members(each, (*above, name)) if each in table else (each,)

    return {name: tuple(dict.fromkeys(members(name, ()))) for name in table}


def _pose(value: Any, tool: ToolSection, key: tuple[str | int, ...]) -> tuple[float, ...]:
    """A tool pose: as many numbers as `[tool] pose` names."""
    if not isinstance(value, list | tuple) or len(value) != len(tool.pose):
        raise FieldError(key, f"expected a pose of {len(tool.pose)}, {' '.join(tool.pose)}, got {q.shown(value)}")
    found = []
    for number, (name, each) in enumerate(zip(tool.pose, value, strict=True)):
        try:
            found.append(q.to_si(each, q.LENGTH if name in AXES[:3] else ANGLE, sign="any"))
        except ValueError as error:
            raise FieldError((*key, number), str(error)) from error
    return tuple(found)


def _map(table: Any, tool: ToolSection) -> MapSection:
    found = section(MapSection, table, ("map",))
    for name in found.ranges():
        if name not in tool.pose:
            raise FieldError(("map", name), f"expected coordinates of the pose ({' '.join(tool.pose)}), got {name}")
    if len(found.ranges()) != min(2, len(tool.pose)):
        raise FieldError(("map",), f"expected two coordinates to sweep, got {' '.join(found.ranges()) or 'none'}")
    if found.at is None:
        return found
    return found.model_copy(update={"at": _pose(found.at, tool, ("map", "at"))})


def pose_of(robot: RobotFile, numbers: Sequence[Any]) -> tuple[float, ...]:
    """A pose given by numbers or texts with units, as `--at` has them. Raises InputError."""
    try:
        return _pose(list(numbers), robot.tool, ("at",))
    except FieldError as error:
        raise InputError(f"--at: {error}") from error

"""Fourth pass over a robot file: validate each section by itself (`robot.checks` follows)."""

from __future__ import annotations

from itertools import chain
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from stiffscope.errors import FieldError, InputError, require
from stiffscope.fea.superelement_files import read_superelement
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file import sections
from stiffscope.robot.file.description import RobotFile, find_element
from stiffscope.robot.file.parse import naming_key
from stiffscope.robot.file.part_sections import (
    PARTS,
    Fibrous,
    InterfacePart,
    Isotropic,
    MatrixPart,
    ParametricPart,
)
from stiffscope.robot.file.tables import keys_of, one_of, read_table, unknown_key

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping
    from pathlib import Path

    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.errors import Key
    from stiffscope.robot.file.description import Turned
    from stiffscope.robot.file.parse import Source
    from stiffscope.robot.file.part_sections import PartSection

LISTS = ("copies", "effects")
_DEEPEST = 30  # groups within each other
TOP = (
    *(
        "name",
        "parameters",
        "parts",
        "bodies",
        "joints",
        "copies",
        "groups",
        "tool",
        "gravity",
    ),
    *("poses", "map", "materials", "effects"),
)


def check_top(data: Mapping[str, Any]) -> None:
    """Raise FieldError for an unknown section, or one that is not a table or list of tables."""
    for key in data:
        if key not in TOP:
            raise FieldError((key,), unknown_key(key, TOP))
    for key in {**data, "name": {}}:
        kind, what = (
            (list, f"[[{key}]], a list of tables")
            if key in LISTS
            else (dict, "a table")
        )
        if key == "name":
            continue
        require(isinstance(data[key], kind), (key,), what, q.show_value(data[key]))
        for name in data[key] if kind is dict else ():
            # a terminal would obey it
            require(
                name.isprintable(),
                (key, name),
                "a name of printable characters",
                q.show_value(name),
            )


def validate(
    data: Mapping[str, Any],
    source: Source,
    values: Mapping[str, float],
    tolerances: Mapping[Key, float],
    copied: dict[str, Turned],
) -> RobotFile:
    """Create a robot from evaluated tables.

    Parameters
    ----------
    data
        Content of the file, with copies.
    source
        Source of the file.
    values, tolerances
        Results of `evaluate`.
    copied
        Result of `make_copies`.

    Returns
    -------
    RobotFile
        Robot with each section valid by itself.

    Raises
    ------
    FieldError
        For the first error found.
    """

    def read(key: str, function: Callable[[str, Any], Any]) -> Mapping[str, Any]:
        tables = data.get(key, {}).items()
        return MappingProxyType({name: function(name, table) for name, table in tables})

    parts = read(
        "parts", lambda name, table: _read_part(name, table, source.path.parent)
    )
    joints = read("joints", _read_joint)
    bodies = read("bodies", lambda name, table: _read_body(name, table, parts))
    shared = {name: f"joints.{name}" for name in joints if name in bodies}
    joints = MappingProxyType(
        {shared.get(name, name): joint for name, joint in joints.items()}
    )
    copied = copied | {
        joint: copied[name] for name, joint in shared.items() if name in copied
    }
    tool = read_table(sections.ToolSection, data.get("tool"), ("tool",))
    gravity = None
    if "gravity" in data:
        gravity = read_table(sections.GravitySection, data["gravity"], ("gravity",))
    effects = enumerate(data.get("effects", []))
    name = data.get("name", source.path.stem)
    is_name = isinstance(name, str) and name.strip() and name.isprintable()
    form = "a name in quotes, one printable line"
    require(is_name, ("name",), form, q.show_value(name))
    return RobotFile(
        name=name,
        parts=parts,
        bodies=bodies,
        joints=joints,
        tool=tool,
        parameters=MappingProxyType(
            {key: si for key, si in values.items() if "." not in key}
        ),
        groups=MappingProxyType(_read_groups(data.get("groups", {}), bodies, joints)),
        gravity=gravity,
        poses=read("poses", lambda name, pose: read_pose(pose, tool, ("poses", name))),
        map=_read_map(data["map"], tool) if "map" in data else None,
        materials=read("materials", _read_material),
        effects=tuple(
            read_table(sections.Effect, each, ("effects", i)) for i, each in effects
        ),
        copied=MappingProxyType(copied),
        tolerances=MappingProxyType(tolerances),
        source=source,
    )


def _read_part(name: str, table: Any, folder: Path) -> PartSection:
    key = ("parts", name)
    model = PARTS[_choose(table, "shape", PARTS, key, "a shape")]
    if model is MatrixPart and {"interfaces", "file"} & table.keys():
        model = InterfacePart
        table = _with_matrices(table, folder, key) if "file" in table else table
    return read_table(model, table, key)


def _with_matrices(table: dict[str, Any], folder: Path, key: Key) -> dict[str, Any]:
    """Add interfaces and matrices of its file to a part's table; own interfaces take precedence."""
    for other in ("stiffness", "mass_matrix", "mode_squares", "matrix"):
        require(
            other not in table,
            (*key, other),
            "none beside a file, which holds the matrices",
            "one",
        )
    file = table["file"]
    form = 'a path such as "bracket.npz"'
    require(isinstance(file, str), (*key, "file"), form, q.show_value(file))
    with naming_key(*key, "file"):
        superelement = read_superelement(folder / table["file"])
        interfaces = table.get("interfaces", superelement.interfaces)
        require(
            interfaces,
            "",
            "interfaces beside a file that names none, in the order of its rows",
            "nothing",
        )
        require(
            isinstance(interfaces, dict),
            (*key, "interfaces"),
            "a table of places",
            q.show_value(interfaces),
        )
        require(
            len(interfaces) == len(superelement.interfaces or interfaces),
            (*key, "interfaces"),
            f"{len(superelement.interfaces)}, as the file has nodes",
            len(interfaces),
        )
        ends = 6 * len(interfaces)
        shape = superelement.stiffness.shape
        square = shape == shape[:1] * 2 and shape[0] >= ends
        require(
            square and (superelement.mass is None or superelement.mass.shape == shape),
            "",
            f"matrices of at least {ends} rows, six for each interface",
            " x ".join(map(str, shape)),
        )
        require(
            superelement.mass is not None or shape[0] == ends,
            "",
            f"a mass matrix beside {shape[0] - ends} modes",
            "stiffness alone",
        )
    matrices = {
        "interfaces": interfaces,
        "stiffness": superelement.stiffness[:ends, :ends].tolist(),
    }
    if superelement.mass is not None:
        squares = superelement.stiffness.diagonal()[ends:].tolist()
        matrices |= {"mass_matrix": superelement.mass.tolist(), "mode_squares": squares}
    return table | matrices


def _choose(
    table: Any, word: str, valid: Iterable[str], key: tuple[str, ...], what: str
) -> str:
    """Return the kind of a table, given by its key ``word``; raise FieldError if invalid."""
    require(isinstance(table, dict), key, "a table", q.show_value(table))
    require(word in table, (*key, word), f"{what} ({', '.join(valid)})", "nothing")
    with naming_key(*key, word):
        return one_of(table[word], valid, what)


def _read_body(
    name: str, table: Any, parts: Mapping[str, PartSection]
) -> sections.BodySection:
    """Read a body: with interfaces if its part has them, elastic if part or ends, else rigid."""
    key = ("bodies", name)
    if isinstance(table, dict):
        part = parts.get(str(table.get("part")))
        bare = isinstance(part, ParametricPart) and {"base", "tip"} & table.keys()
        if part is not None and part.interface_names and not bare:
            return read_table(sections.InterfaceBody, table, key)
        elastic = [word for word in table if word in keys_of(sections.ElasticBody)]
        rigid = [word for word in table if word in keys_of(sections.RigidBody)]
        if "part" in elastic and rigid:
            what = f"no {rigid[0]} of a body with a part, which has its part's"
            raise FieldError((*key, rigid[0]), q.expected(what, table[rigid[0]]))
        if elastic and not rigid:
            return read_table(sections.ElasticBody, table, key)
        if elastic:
            message = f"expected no {elastic[0]} of a rigid body, which has no part"
            raise FieldError((*key, elastic[0]), message)
    return read_table(sections.RigidBody, table, key)


def _read_joint(name: str, table: Any) -> sections.JointSection:
    key = ("joints", name)
    kind = _choose(table, "type", sections.JOINTS, key, "a type")
    driven = [
        each for each, model in sections.JOINTS.items() if "drive" in model.model_fields
    ]
    require(
        "drive" not in table or kind in driven,
        (*key, "drive"),
        f"a joint that a drive can move ({', '.join(driven)})",
        f"a {kind} one",
    )
    return read_table(sections.JOINTS[kind], table, key)


def _read_material(name: str, table: Any) -> AnyMaterial:
    key = ("materials", name)
    model = (
        Fibrous if isinstance(table, dict) and "axial_modulus" in table else Isotropic
    )
    section = read_table(model, table, key)
    try:
        return section.build(name)
    except InputError as error:  # "materials.NAME.density: expected …"
        where, _, message = (
            str(error).removeprefix(f"materials.{name}.").partition(": ")
        )
        raise FieldError((*key, where), message) from error


def _read_groups(
    table: Mapping[str, Any], bodies: Collection[str], joints: Collection[str]
) -> dict[str, tuple[str, ...]]:
    """Return the groups, with groups inside groups resolved."""
    elements = [*bodies, *joints]
    for name, listed in table.items():
        key = ("groups", name)
        require(
            name not in elements, key, "a name that no body or joint has", f'"{name}"'
        )
        form = "a list of bodies and joints"
        require(isinstance(listed, list), key, form, q.show_value(listed))
        for number, each in enumerate(listed):
            with naming_key(*key, number):
                if not isinstance(each, str) or not find_element(each, bodies, joints):
                    others = [other for other in table if other != name]
                    one_of(each, [*elements, *others], "a body, a joint or a group")

    groups: dict[str, tuple[str, ...]] = {}

    def members(name: str, above: tuple[str, ...] = ()) -> tuple[str, ...]:
        require(
            name not in above,
            ("groups", name),
            "no group within itself",
            " -> ".join((*above, name)),
        )
        require(
            len(above) <= _DEEPEST,
            ("groups", *above[:1]),
            f"at most {_DEEPEST} groups within each other",
            "more",
        )
        if name not in groups:
            parts = (
                members(word, (*above, name))
                if word in table
                else [find_element(word, bodies, joints) or word]
                for word in table[name]
            )
            groups[name] = tuple(dict.fromkeys(chain.from_iterable(parts)))
        return groups[name]

    return {name: members(name) for name in table}


def read_pose(value: Any, tool: sections.ToolSection, key: Key) -> tuple[float, ...]:
    """Read a tool pose: a number for each coordinate in `[tool] pose`; FieldError if invalid.

    Parameters
    ----------
    value
        Value in the file.
    tool
        Section of the tool, with the coordinates.
    key
        Key of the value: keys of its tables, outermost first.
    """
    names = " ".join(tool.pose) or "as tool.pose has none"
    require(
        isinstance(value, list | tuple) and len(value) == len(tool.pose),
        key,
        f"a pose of {len(tool.pose)}, {names}",
        q.show_value(value),
    )
    pose = []
    for number, (name, each) in enumerate(zip(tool.pose, value, strict=True)):
        with naming_key(*key, number):
            dimension = q.LENGTH if name in sections.AXES[:3] else q.ANGLE
            pose.append(q.to_si(each, dimension, sign="any"))
    return tuple(pose)


def _read_map(table: Any, tool: sections.ToolSection) -> sections.MapSection:
    section = read_table(sections.MapSection, table, ("map",))
    swept = section.ranges()
    known = " ".join(tool.pose)
    for name in swept:
        require(
            name in tool.pose, ("map", name), f"coordinates of the pose ({known})", name
        )
    require(
        len(swept) == 2,
        ("map",),
        f"two coordinates of the pose ({known}) to sweep",
        " ".join(swept) or "none",
    )
    at = None if section.at is None else read_pose(section.at, tool, ("map", "at"))
    return section.model_copy(update={"at": at})

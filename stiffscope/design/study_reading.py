"""Reading of study files: every name, value and unit is checked against the robot."""

from __future__ import annotations

import math
import re
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import field_validator

from stiffscope.design.responses import (
    ALONG_PATH,
    CRITICAL,
    Response,
    known_units,
    worst_of,
)
from stiffscope.design.study_file import (
    Goal,
    Limit,
    StudyFile,
    Variable,
    round_off,
)
from stiffscope.errors import FieldError, InputError, require, require_given
from stiffscope.lobes.chatter import check_cut
from stiffscope.path.job import load_job
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.expressions import parse
from stiffscope.robot.file.override import write_override
from stiffscope.robot.file.parse import Source, naming_key, parse_text
from stiffscope.robot.file.tables import one_of, read_table
from stiffscope.robot.file.validate import read_pose
from stiffscope.robot.file.values import (
    Reads,
    Says,
    Section,
    any_quantity,
    parse_whole,
    unit_of,
)
from stiffscope.robot.mechanism_of import configured_poses, rigid_mechanism
from stiffscope.robot.parameters import parameters
from stiffscope.robot.reader import load_robot_of, read_robot
from stiffscope.runtime import reading

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.design.study_file import Pose, Value
    from stiffscope.errors import Key
    from stiffscope.path.job import Job
    from stiffscope.robot.file.description import RobotFile

Method = Literal["grid", "latin-hypercube", "sobol", "optimum", "pareto"]
DESIGNS = {"latin-hypercube": 64, "sobol": 64, "optimum": 120, "pareto": 400}
MOST_DESIGNS = 1_000_000
RANGE = 'a range such as ["15 mm", "40 mm"]'


def _read_count(value: Any) -> int:
    require(1 <= parse_whole(value) <= MOST_DESIGNS, "", f"1 to {MOST_DESIGNS}", value)
    return parse_whole(value)


Texts = Annotated[
    tuple[str, ...],
    Reads(
        lambda value: [value] if isinstance(value, str) else value,
        says="texts in a list",
    ),
]
Number = Annotated[int, Reads(_read_count, says="a whole number above 0")]


class StudySection(Section):
    """The top level of the file; `minimize` and `maximize` name responses, a sweep needs neither."""

    robot: Annotated[
        str,
        Says(
            "a robot file, seen from the study's folder, or the name of a bundled robot"
        ),
    ]
    components: Literal["fea", "beam", "published"] | None = None
    set: Texts = ()
    tolerance: Annotated[
        str | None, Says("error bar of the parts' matrices, as `--tolerance` takes it")
    ] = None
    method: Method
    designs: Annotated[int | None, Reads(_read_count, says="how many at most")] = None
    seed: Annotated[int, Reads(parse_whole, says="a whole number")] = 1
    parameters: Annotated[
        dict[str, Any], Says('a table such as "slider.thickness" = ["15 mm", "40 mm"]')
    ]
    responses: Annotated[dict[str, Any], Says('a table such as stiffness = "K_tx"')]
    constraints: Annotated[Texts, Says('texts such as "mass <= 3 kg"')] = ()
    minimize: Texts = ()
    maximize: Texts = ()


class RangeSection(Section):
    """A parameter as a table: a range with its number of grid points, or a list of values."""

    exactly_one = (("range", "values"),)

    range: Annotated[list[Any] | None, Says(RANGE)] = None
    steps: Number = 5
    values: Annotated[
        list[Any] | None, Says('values such as [0, 2, 4] or ["steel", "titanium"]')
    ] = None

    @field_validator("values")
    @classmethod
    def _some(cls, value: list[Any] | None) -> list[Any] | None:
        require(value != [], "", "one value at least", "[]")
        return value


class ResponseSection(Section):
    """A response as a table; a text alone is its `of`, with the worst value over the named poses."""

    excludes = {"path": ("at",)}  # noqa: RUF012 (not a field)

    of: Annotated[
        str, Says('an expression over quantities such as "K_tx" or "K_tx/mass"')
    ]
    at: Annotated[
        Any,
        Says(
            'poses by name or numbers in a list, or "map": a grid of the robot file\'s [map]'
        ),
    ] = None
    points: Annotated[Number, Says("points of that grid along either coordinate")] = 5
    path: Annotated[
        str | None,
        Says("a job of `stiffscope path`; `of`: error, normal, along, binormal"),
    ] = None
    take: Literal["least", "greatest", "mean", "worst", "rms"] | None = None
    unit: Annotated[
        str | None, Says('SI unit, for expressions of several quantities: "N/m/kg"')
    ] = None


SECTIONS = (
    ("the top level", StudySection),
    ("[parameters], NAME.KEY = a range, or a table", RangeSection),
    ("[responses], NAME = an expression, or a table", ResponseSection),
)

_NAME = re.compile(r"[^\W\d]\w*")
_LIMIT = re.compile(r"\s*([^\W\d]\w*)\s*(<=|>=)\s*(.+?)\s*")


def load_study(path: str | Path) -> StudyFile:
    """Load and check a study's file.

    Parameters
    ----------
    path
        TOML file; the path of the robot is relative to its folder.

    Raises
    ------
    InputError
        The file is invalid; the message names file, line, field, expected and found value.
    """
    path = Path(path)
    source = Source(path, reading.read_text(path, "a study's file in TOML"))
    with source.refusing():
        table = parse_text(path, source.text, "a study's file")
        return _read(read_table(StudySection, table, ()), source)


def _read(top: StudySection, source: Source) -> StudyFile:
    robot = load_robot_of(source.path, top.robot, top.set, top.tolerance)
    given = _list_entries(top.parameters, ("parameters",), RangeSection)
    for key, name, _ in given:
        other = name.partition(".")[2]
        require(
            other not in (value[1] for value in given),
            key,
            "each value once",
            f'"{other}" too',
        )
    variables = tuple(_read_variable(*value, robot, top) for value in given)
    poses: dict[Pose, int] = {}
    wanted = _list_entries(top.responses, ("responses",), ResponseSection)
    find_job = cache(lambda path: load_job(source.path.parent / path, robot))
    responses = tuple(_read_response(*each, robot, poses, find_job) for each in wanted)
    units = {response.name: response.unit for response in responses}
    for key, name, _ in wanted:
        require(
            _NAME.fullmatch(name), key, "a name of letters, digits and _", f'"{name}"'
        )
    limits = tuple(
        _read_limit(text, k, units) for k, text in enumerate(top.constraints)
    )
    return StudyFile(
        path=source.path,
        robot=robot,
        components=top.components,
        tolerance=top.tolerance,
        method=top.method,
        designs=_count_designs(top, variables),
        seed=top.seed,
        variables=variables,
        responses=responses,
        limits=limits,
        goals=_read_goals(top, units),
        poses=tuple(poses),
    )


def _list_entries(
    table: dict[str, Any], key: Key, model: type[Section]
) -> list[tuple[Key, str, Any]]:
    """Return key, name and value of a table's entries; slider.thickness may be a dotted key."""
    entries: list[tuple[Key, str, Any]] = []

    def walk(inner: Key, name: str, value: Any) -> None:
        if (
            isinstance(value, dict)
            and value
            and not set(model.model_fields) & set(value)
        ):
            for word, each in value.items():
                walk((*inner, word), f"{name}.{word}" if name else word, each)
        else:
            entries.append((inner, name, value))

    walk(key, "", table)
    require(table, key, "one entry at least", "none")
    return entries


def _read_variable(
    key: Key, name: str, given: Any, robot: RobotFile, top: StudySection
) -> Variable:
    table = given if isinstance(given, dict) else {"range": given}
    section = read_table(RangeSection, table, key)
    known = {
        parameter.name: parameter for parameter in parameters(robot, top.components)
    }
    texts = (section.range if section.values is None else section.values) or []
    shown = q.show_value(texts)
    require(section.range is None or len(texts) == 2, key, f"{RANGE}, two ends", shown)
    _check_takes(name, texts, robot, key)
    unit = known[name].unit if name in known else unit_of(texts[0])
    read = _read_number if section.values is None else _read_value
    values = tuple(read(text, key) for text in texts)
    alike = len({isinstance(value, str) for value in values}) == 1
    require(alike, key, "values that are all numbers or all words", shown)
    others = [text for text in texts if isinstance(text, str) and unit_of(text) != unit]
    what = f"{RANGE}, both ends" if section.values is None else "values that are all"
    is_word = isinstance(values[0], str)
    require(is_word or not others, key, f"{what} in {unit}", shown)
    if section.values is not None:
        return Variable(name, unit, values)
    low, high = map(float, values)
    require(low < high, key, f"{RANGE}, the lower end first", shown)
    levels = tuple(
        round_off(float(level)) for level in np.linspace(low, high, section.steps)
    )
    return Variable(name, unit, levels, low, high)


def _read_number(value: Any, key: Key) -> float:
    with naming_key(*key):
        return float(any_quantity(value))


def _read_value(value: Any, key: Key) -> Value:
    """Return an integer unchanged, a quantity as float in SI, and any other text unchanged."""
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    try:
        return _read_number(value, key)
    except FieldError:
        if isinstance(value, str):
            return value
        raise


def _check_takes(name: str, texts: list[Any], robot: RobotFile, key: Key) -> None:
    """Raise FieldError if a word is invalid itself, or no value gives a valid robot."""
    refused = list[FieldError]()
    valid = False
    source = robot.source
    for value in texts:
        text = write_override(name, value)
        is_word = isinstance(value, str) and isinstance(_read_value(value, key), str)
        try:
            changed_robot = read_robot(
                source.path, source.text, [*source.overrides, text]
            )
        except InputError as error:
            message = str(error).removeprefix(f"--set {text}: ")
            refused.append(FieldError(key, message))
            if is_word and message != str(error):
                raise refused[-1] from error
            continue
        changed = changed_robot.source.changed.keys() - source.changed
        copied = [each[1] for each in changed if each[1] in changed_robot.copied]
        got = f'"{"".join(map(str, copied[:1]))}", a copy: vary its original'
        require(not copied, key, "what the robot file writes", got)
        if not is_word:
            return
        valid = True
    if refused and not valid:
        raise refused[0]


def _read_response(
    key: Key,
    name: str,
    given: Any,
    robot: RobotFile,
    poses: dict[Pose, int],
    find_job: Callable[[str], Job],
) -> Response:
    section = read_table(
        ResponseSection, {"of": given} if isinstance(given, str) else given, key
    )
    where = (*key, "of") if isinstance(given, dict) else key
    job = None if section.path is None else find_job(section.path)
    along: dict[str, str] = dict.fromkeys(ALONG_PATH, "m")
    units = known_units(robot) if job is None else along
    with naming_key(*where):
        expression = parse(section.of)
        for symbol in expression.names:
            one_of(symbol, units, "a quantity")
    alone = expression.text if expression.text in units else None
    unit = section.unit
    take = section.take
    of_unit = (*key, "unit")
    if alone:
        unit = units[alone]
        take = take or worst_of(alone)
    example = 'the SI unit of the expression such as "N/m/kg"'
    unit = require_given(unit, of_unit, example)
    stated = measured = None
    with suppress(ValueError):
        stated = q.powers_of(unit)
    with suppress(ValueError):  # an index may be a sum of unlike quantities
        measured = expression.powers(
            {symbol: q.powers_of(units[symbol]) for symbol in expression.names}
        )
    example = 'a product of SI units such as "N/m/kg"'
    stated = require_given(stated, of_unit, example, q.show_value(unit))
    if unit != "1" and measured is not None:
        require(
            np.allclose(stated[:-1], measured[:-1]),
            of_unit,
            f"a unit of {q.show_powers(measured)}, which {expression.text} measures",
            q.show_value(unit),
        )
    if job is not None:
        points = np.flatnonzero(job.path.acting)
        if CRITICAL in expression.names:
            with naming_key(*key, "path"):
                check_cut(job)
        take = section.take or ("least" if alone == CRITICAL else "worst")
        return Response(name, expression, unit, tuple(points.tolist()), take, job)
    at = [
        poses.setdefault(pose, len(poses)) for pose in _list_poses(section, robot, key)
    ]
    if len(at) > 1:
        which = "least, greatest, mean, worst or rms: what of several poses counts"
        take = require_given(take, (*key, "take"), which)
    return Response(name, expression, unit, tuple(at), take or "least")


def _list_poses(section: ResponseSection, robot: RobotFile, key: Key) -> list[Pose]:
    where = (*key, "at")
    if section.at == "map":
        return _list_grid(robot, section.points, where)
    names = list(robot.poses) if section.at is None else section.at
    if isinstance(names, str):
        names = [names]
    what = 'names of poses, numbers in a list, or "map"'
    listed = isinstance(names, list) and names
    require(listed, where, what, q.show_value(section.at))
    numeric = (
        re.match(r"\s*[-+.\d]", str(names[0])) and names[0] not in robot.known_poses
    )
    chosen = [names] if numeric else names
    out: list[Pose] = []
    for name in names if isinstance(section.at, str) else chosen:
        with naming_key(*where):
            out.append(
                read_pose(name, robot.tool, where)
                if isinstance(name, list)
                else one_of(name, robot.known_poses, "a pose")
            )
    numbers = [
        robot.known_poses[response] if isinstance(response, str) else response
        for response in out
    ]
    configurations = configured_poses(robot, rigid_mechanism(robot), numbers)
    for index, valid in enumerate(configurations.valid):
        if not valid:
            raise FieldError(where, configurations.refusal(index))
    return out


def _list_grid(robot: RobotFile, points: int, where: Key) -> list[Pose]:
    """Return the map points reachable for the nominal robot; a design must reach all of them."""
    swept = require_given(robot.map, where, f"a pose: {robot.path} has no [map]", "map")
    mechanism = rigid_mechanism(robot)
    ranges = swept.ranges()
    mesh = np.meshgrid(
        *(np.linspace(*ends, points) for ends in ranges.values()), indexing="ij"
    )
    base = mechanism.tool.home if swept.at is None else np.array(swept.at, dtype=float)
    grid = np.tile(base, (mesh[0].size, 1))
    for name, values in zip(ranges, mesh, strict=True):
        grid[:, robot.tool.pose.index(name)] = values.ravel()
    reached = grid[configured_poses(robot, mechanism, grid).valid]
    require(len(reached), where, "a map with points within reach", "none")
    return [tuple(map(float, pose)) for pose in reached]


def _read_limit(text: str, number: int, units: dict[str, str]) -> Limit:
    key: Key = ("constraints", number)
    form = 'RESPONSE <= VALUE or RESPONSE >= VALUE such as "mass <= 3 kg"'
    match = require_given(_LIMIT.fullmatch(text), key, form, f'"{text}"')
    name, relation, value = match.groups()
    with naming_key(*key):
        unit = units[one_of(name, units, "a response")]
    dimension = q.Dimension(
        f"a value of {name}", "" if unit == "1" else unit, f"3 {unit}"
    )
    given: Any = value
    with suppress(ValueError):
        given = float(value)
    with naming_key(*key):
        return Limit(
            name, relation == "<=", q.to_si(given, dimension, sign="any"), text
        )


def _read_goals(top: StudySection, units: dict[str, str]) -> tuple[Goal, ...]:
    goals = []
    for word, sign in (("minimize", 1.0), ("maximize", -1.0)):
        for number, name in enumerate(getattr(top, word)):
            with naming_key(word, number):
                goals.append(Goal(one_of(name, units, "a response"), sign))
    count = len(goals)
    one = "one response to minimize or maximize for an optimum"
    require(top.method != "optimum" or count == 1, ("method",), one, count)
    two = "two or more to minimize and maximize for pareto"
    require(top.method != "pareto" or count > 1, ("method",), two, count)
    return tuple(goals)


def _count_designs(top: StudySection, variables: tuple[Variable, ...]) -> int:
    if top.method != "grid":
        return top.designs or DESIGNS[top.method]
    none = "none for a grid, whose ranges have steps and values"
    require(top.designs is None, ("designs",), none, top.designs)
    count = math.prod(len(variable.levels) for variable in variables)
    most = f"a grid of at most {MOST_DESIGNS} designs"
    require(count <= MOST_DESIGNS, ("method",), most, count)
    return count

"""Read a robot file: find it, apply `--set`, check everything, and name file, line and key of what is wrong."""

from __future__ import annotations

import difflib
import json
import re
import tomllib
import types
import typing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiffscope.data import FOLDER
from stiffscope.errors import InputError
from stiffscope.robot.toml_lines import key_lines, line_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from pydantic import BaseModel, ValidationError

    from stiffscope.robot.schema import RobotFile
    from stiffscope.robot.toml_lines import Key


def robot_names() -> list[str]:
    """Names of the robots that `data/` knows."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def find_robot(name_or_path: str | Path) -> Path:
    """Path of a robot file given as a path or as the name of a robot in `data/`."""
    path = Path(name_or_path)
    if path.is_file():
        return path
    named = FOLDER / f"{name_or_path}.toml"
    if path.name == str(name_or_path) and named.is_file():
        return named
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give a robot file or one of the names {_listed(robot_names())}")
    raise InputError(f"{path}: no such robot file; give a path or one of the names {_listed(robot_names())}")


def load_robot(name_or_path: str | Path, overrides: Sequence[str] = (), tolerance: str | None = None) -> RobotFile:
    """Load and check a robot file.

    Parameters
    ----------
    name_or_path
        A path, or the name of a robot in `data/` ("biglide").
    overrides
        Texts as `--set` takes them: "slider.thickness=25mm", "link.mesh.size=6mm", "slider.compliance=beam".
    tolerance
        Text as `--tolerance` takes it ("0.1 %", "1e-3"): for the experiments on both parts, whatever the file says.

    Returns
    -------
    RobotFile
        Immutable; SI units.

    Raises
    ------
    InputError
        One line that names the file, the line, the key, what was expected and an example.

    """
    path = find_robot(name_or_path)
    text = _read(path)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(_syntax_line(path, text, error)) from error
    changed: dict[Key, str] = {}
    for override in overrides:
        key, value = _parse_override(override)
        _assign(data, key, value, f"--set {override}")
        changed[key] = f"--set {'.'.join(key)}"
    if tolerance is not None:
        for part in ("link", "slider"):
            key = (part, "mesh", "tolerance")
            _assign(data, key, tolerance, f"--tolerance {tolerance}")
            changed[key] = "--tolerance"
    return _check(data, _Source(path, text, changed), overrides)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8 (byte {error.start}); expected a robot file in TOML") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def _syntax_line(path: Path, text: str, error: tomllib.TOMLDecodeError) -> str:
    place = re.search(r"\(at line (\d+), column (\d+)\)", str(error))
    reason = str(error).split(" (at ")[0]
    if place is None:
        return f"{path}:{text.count(chr(10)) + 1}: not valid TOML: {reason}, at the end of the file"
    lines = text.splitlines()
    number = min(int(place[1]), len(lines))
    return f'{path}:{number}: not valid TOML: {reason}, column {place[2]}, in "{lines[number - 1].strip()[:60]}"'


def _parse_override(text: str) -> tuple[tuple[str, ...], Any]:
    """Split "slider.thickness=25mm"; the value is TOML where it reads as such, else a string."""
    name, equals, value = text.partition("=")
    key = tuple(part.strip() for part in name.split("."))
    if not equals or not all(key) or not value.strip():
        raise InputError(f"--set {text}: expected part.parameter=VALUE, such as slider.thickness=25mm")
    try:
        return key, tomllib.loads(f"value = {value.strip()}")["value"]
    except (tomllib.TOMLDecodeError, KeyError):
        return key, value.strip()


def _assign(data: dict[str, Any], key: tuple[str, ...], value: Any, origin: str) -> None:
    table = data
    for i, part in enumerate(key[:-1]):
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise InputError(f"{origin}: {'.'.join(key[: i + 1])} is a value, not a table of parameters")
    table[key[-1]] = value


@dataclass(frozen=True)
class _Source:
    """Where a robot's values come from: the file, and what `--set` changed."""

    path: Path
    text: str
    changed: dict[Key, str]

    def refuse(self, key: Key, message: str) -> InputError:
        """Error for a key: names the `--set` that brought it, else file and line."""
        name = ".".join(map(str, key))
        for length in range(len(key), 0, -1):
            if key[:length] in self.changed:
                inside = f"{name}: " if length < len(key) else ""
                return InputError(f"{self.changed[key[:length]]}: {inside}{message}")
        lines = key_lines(self.text)
        if (key[:-1] or key) not in lines:
            for changed, origin in self.changed.items():
                if changed[: len(key) - 1] == key[:-1]:
                    return InputError(f"{origin}: {name}: {message}")
        return InputError(f"{self.path}:{line_of(lines, key)}: {name}: {message}")


def _check(data: dict[str, Any], source: _Source, overrides: Sequence[str]) -> RobotFile:
    from pydantic import ValidationError

    from stiffscope.robot.schema import RobotFile

    try:
        robot = RobotFile.model_validate(data)
    except ValidationError as error:
        key, message = _first(error, RobotFile)
        others = len({(e["msg"], source.changed.get(e["loc"], e["loc"])) for e in error.errors()}) - 1
        raise source.refuse(key, message + (f" (and {others} more)" if others else "")) from error
    try:
        _check_parts(robot)
    except InputError as error:  # cad names the parameter: "link.bore: ..."
        name, _, message = str(error).partition(":")
        key = tuple(name.strip().split("."))
        if _known(data, key[:1]):
            raise source.refuse(key, message.strip()) from error
        raise InputError(f"{source.path}: {error}") from error
    robot.remember(source.path, overrides)
    return robot


def _check_parts(robot: RobotFile) -> None:
    """Raise InputError for what only the parts together can tell."""
    from stiffscope.robot.components import geometry
    from stiffscope.robot.schema import PARTS

    for name in PARTS:
        robot.parameters(name)
        robot.material(name)
    geometry(robot)


def _known(data: Any, key: Key) -> bool:
    for part in key:
        if not isinstance(data, dict) or part not in data:
            return False
        data = data[part]
    return True


def _first(error: ValidationError, model: type[BaseModel]) -> tuple[Key, str]:
    """Key and message of the first error; an unknown key comes before what it leaves missing."""
    errors = error.errors(include_url=False)
    item = next((e for e in errors if e["type"] == "extra_forbidden"), errors[0])
    key = tuple(part for part in item["loc"] if not str(part).startswith(("function-", "tagged-")))
    if key[:1] == ("poses",) and (item["type"] in {"missing", "too_long", "tuple_type"}):
        return key[:2], 'expected three lengths such as ["0 mm", "0 mm", "350 mm"]'
    if item["type"] == "extra_forbidden":
        return key, _unknown(str(key[-1]), list(_section(model, key[:-1]).model_fields))
    if item["type"] == "missing":
        return key, "is missing"
    if item["type"] == "literal_error":
        return key, f"expected {item.get('ctx', {}).get('expected')}, got {json.dumps(item['input'], default=str)}"
    if item["type"] in {"model_type", "dict_type", "model_attributes_type", "tuple_type"}:
        inside = ", ".join(_section(model, key).model_fields) if item["type"].startswith("model") else "any names"
        kind = "a list" if item["type"] == "tuple_type" else f"a table of {inside}"
        return key, f"expected {kind}, got {json.dumps(item['input'], default=str)[:60]}"
    named, message = "", item["msg"].removeprefix("Value error, ")
    if isinstance(item.get("ctx", {}).get("error"), InputError):  # cad names the field: "frame.x: ..."
        named, _, message = message.partition(": ")
    return (*key, *named.split(".")[1:]), message


def _section(model: type[BaseModel], key: Key) -> type[BaseModel]:
    """Model of the section that a key leads to."""
    for part in key:
        if isinstance(part, int):
            continue
        field = model.model_fields.get(str(part))
        model = next((m for m in _models(field.annotation) if m is not None), model) if field else model
    return model


def _models(annotation: Any) -> Iterable[type[BaseModel]]:
    if isinstance(annotation, type) and hasattr(annotation, "model_fields"):
        yield annotation
    elif isinstance(annotation, types.UnionType) or typing.get_origin(annotation) is not None:
        for inner in typing.get_args(annotation):
            yield from _models(inner)


def _unknown(word: str, valid: list[str]) -> str:
    close = difflib.get_close_matches(word, valid, n=1, cutoff=0.6)
    guess = f'; did you mean "{close[0]}"?' if close else ""
    return f"unknown key{guess} (valid: {', '.join(valid)})"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "(none)"

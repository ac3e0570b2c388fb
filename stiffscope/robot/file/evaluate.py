"""The expressions of a robot file, evaluated: parameters in the order of their dependence, then all other values."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING, Any

from stiffscope.robot.file.expressions import Expression, check_names, is_expression, normal, parse, refusal_of_name
from stiffscope.robot.file.part_sections import PARTS
from stiffscope.robot.file.values import Reads, any_quantity

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from pydantic.fields import FieldInfo

    from stiffscope.robot.file.positions import Key

TEXTS = {"name", "source", "file"}  # free text, whatever it begins with


class FieldError(ValueError):
    """What is wrong with the value of a key; the reader adds file and line."""

    def __init__(self, key: Key, message: str) -> None:
        super().__init__(message)
        self.key = key


def parameter_values(data: Mapping[str, Any]) -> dict[str, float]:
    """Values, SI, of all names that expressions may use: "a" of `[parameters]`, "arm.length" of `[parts.arm]`.

    Raises
    ------
    FieldError
        A value is none, a name is not known, or parameters depend on one another in a circle.

    """
    given = _given(data)
    known = {normal(name) for name in given}
    expressions: dict[str, Expression] = {}
    values: dict[str, float] = {}
    for name, (key, value) in given.items():
        if is_expression(value):
            expressions[name] = parsed(key, value, known)
        elif key[0] == "parameters":
            values[name] = _checked(key, any_quantity, value)
        elif (number := _number_of_part(value)) is not None:
            values[name] = number
        else:
            _check_field(data["parts"][key[1]], key, value)
    order = TopologicalSorter({name: expression.names for name, expression in expressions.items()})
    try:
        ordered = list(order.static_order())
    except CycleError as error:
        circle = error.args[1][::-1]
        key = given[circle[0]][0]
        raise FieldError(key, f"expected no parameter that depends on itself, got {' -> '.join(circle)}") from error
    for name in ordered:
        if name in expressions:
            values[name] = evaluated(given[name][0], expressions[name], values)
    return values


def _given(data: Mapping[str, Any]) -> dict[str, tuple[Key, Any]]:
    """Every name with the key where its value stands; what a part leaves out has its default."""
    found: dict[str, tuple[Key, Any]] = {}
    for name, value in data.get("parameters", {}).items():
        why = refusal_of_name(name)
        if why:
            raise FieldError(("parameters", name), why)
        found[normal(name)] = (("parameters", name), value)
    for part, section in data.get("parts", {}).items():
        if isinstance(section, dict):
            defaults = {key: field.default for key, field in _fields(section).items() if not field.is_required()}
            for key, value in {**defaults, **section}.items():
                found[normal(f"{part}.{key}")] = (("parts", part, key), value)
    return found


def _fields(section: Mapping[str, Any]) -> dict[str, FieldInfo]:
    """What a part of its shape has; nothing where the shape is unknown."""
    shape = section.get("shape")
    model = PARTS.get(shape) if isinstance(shape, str) else None
    return model.model_fields if model else {}


def _check_field(section: Mapping[str, Any], key: Key, value: Any) -> None:
    """Raise FieldError for a text that is not what its own field takes, before an expression is blamed that uses it."""
    field = _fields(section).get(str(key[-1])) if isinstance(value, str) else None
    for reads in field.metadata if field else ():
        if isinstance(reads, Reads):
            _checked(key, reads.func, value)


def _number_of_part(value: Any) -> float | None:
    """A part's number, or None for what is none; whether it measures what it should is checked later."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        return any_quantity(value)
    except ValueError:
        return None


def parsed(key: Key, text: str, known: Collection[str]) -> Expression:
    """An expression whose names are all known. Raises FieldError."""
    expression = _checked(key, parse, text)
    _checked(key, lambda each: check_names(each, known), expression)
    return expression


def evaluated(key: Key, expression: Expression, values: Mapping[str, float]) -> float:
    """Value of an expression. Raises FieldError."""
    for name in expression.names:
        if name not in values:
            raise FieldError(key, f'expected names of numbers, got "{name}", which is none')
    return _checked(key, lambda each: each.value(values), expression)


def _checked(key: Key, function: Any, value: Any) -> Any:
    try:
        return function(value)
    except ValueError as error:
        raise FieldError(key, str(error)) from error


def with_values(data: Any, values: Mapping[str, float], key: Key = ()) -> Any:
    """The data with every expression replaced by its value. Raises FieldError."""
    if isinstance(data, dict):
        return {
            name: value if _free(name, value) else with_values(value, values, (*key, name))
            for name, value in data.items()
        }
    if isinstance(data, list):
        return [with_values(value, values, (*key, number)) for number, value in enumerate(data)]
    if is_expression(data):
        return evaluated(key, parsed(key, data, values), values)
    return data


def _free(name: str, value: Any) -> bool:
    return (name in TEXTS and isinstance(value, str)) or name == "provenance"

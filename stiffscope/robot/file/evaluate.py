"""Third pass over a robot file: separate tolerances, evaluate expressions in dependency order."""

from __future__ import annotations

import math
import re
from contextlib import suppress
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING, Any

from stiffscope.errors import FieldError, require
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.expressions import (
    check_names,
    is_expression,
    normalize,
    parse,
    refuse_name,
)
from stiffscope.robot.file.parse import naming_key
from stiffscope.robot.file.part_sections import PARTS
from stiffscope.robot.file.values import Reads, measured_quantity, read_any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from pydantic.fields import FieldInfo

    from stiffscope.errors import Key
    from stiffscope.robot.file.expressions import Expression

_TEXTS = {"name", "source", "file"}  # free text, never an expression
_MARK = re.compile(r"\s*(?:±|\+/-|\+-)\s*")
_FACTOR = re.compile(r"factor\s+(\d+(?:\.\d*)?)")
_EXAMPLE = '"20 mm ± 0.1 mm", "20 mm ± 0.5 %" or "2 kN*m/rad ± factor 5"'


def evaluate(
    data: dict[str, Any],
) -> tuple[dict[str, Any], dict[str, float], dict[Key, float]]:
    """Evaluate tolerances and expressions of a file.

    Parameters
    ----------
    data
        Parsed file, overrides applied.

    Returns
    -------
    data
        Content without `[parameters]`, with numbers for expressions and toleranced values.
    values
        Values, SI, of all names: "a" of `[parameters]`, "arm.length" of `[parts.arm]`.
    tolerances
        Tolerances of values written with one ("20 mm ± 0.1 mm"), SI, by key; for a factor f, ln f
        times the value.

    Raises
    ------
    FieldError
        If a value is invalid, a name is unknown, or parameters depend on each other circularly.
    """
    tolerances: dict[Key, float] = {}
    data = _map_texts(data, lambda text, key: _nominal(text, key, tolerances))
    rest = {key: value for key, value in data.items() if key != "parameters"}
    try:
        values = _parameter_values(data)
        return evaluate_value(rest, values), values, tolerances
    except (
        FieldError
    ):  # if a value's own field refuses it, so, before the expression that uses it
        for key, value, field in _list_given(data).values():
            given = value is not None and not is_expression(value)
            for reads in field.metadata if field is not None and given else ():
                with naming_key(*key):
                    reads.read(value) if isinstance(reads, Reads) else None
        raise


def evaluate_value(data: Any, values: Mapping[str, float], key: Key = ()) -> Any:
    """Evaluate all expressions in a value, list or table; raise FieldError if one is invalid.

    Parameters
    ----------
    data
        Value, list or table with expressions.
    values
        Values of the names.
    key
        Key of the value: keys of its tables, outermost first.
    """

    def number(text: str, here: Key) -> Any:
        return (
            _evaluate(here, _parse(here, text, values), values)
            if is_expression(text)
            else text
        )

    return _map_texts(data, number, key)


def _map_texts(data: Any, change: Callable[[str, Key], Any], key: Key = ()) -> Any:
    """Return data with all texts changed, except free texts."""
    if isinstance(data, dict):
        return {
            name: value
            if (name in _TEXTS and isinstance(value, str)) or name == "provenance"
            else _map_texts(value, change, (*key, name))
            for name, value in data.items()
        }
    if isinstance(data, list):
        return [
            _map_texts(value, change, (*key, number))
            for number, value in enumerate(data)
        ]
    return change(data, key) if isinstance(data, str) else data


def _nominal(text: str, key: Key, tolerances: dict[Key, float]) -> str:
    """Return the text of the nominal value; add its tolerance, SI, to ``tolerances``."""
    if is_expression(text) or not _MARK.search(text):
        return text
    value, _, width = (
        piece.strip() for piece in _MARK.sub("\0", text, count=1).partition("\0")
    )
    factor = _FACTOR.fullmatch(width)
    if factor and float(factor[1]) > 1.0:
        width = f"{100.0 * math.log(float(factor[1])):.12g} %"
    if not re.search(r"[^\d.eE+\-\s]", value):  # "20 ± 0.1 mm"
        value += " " + re.sub(r"^[\d.eE+\-\s]*", "", width) * (not width.endswith("%"))
    try:
        nominal, dimension = read_any(value.strip())
        share = width.endswith("%")
        sigma = q.to_si(width, q.SHARE if share else dimension)
        tolerances[key] = abs(nominal) * sigma if share else sigma
    except ValueError as error:
        what = f"a quantity with its tolerance such as {_EXAMPLE}"
        why = str(error).rpartition(", got ")[2]
        raise FieldError(key, f"{q.expected(what, text)}: {why}") from error
    return value.strip()


def _parameter_values(data: Mapping[str, Any]) -> dict[str, float]:
    given = _list_given(data)
    expressions: dict[str, Expression] = {}
    values: dict[str, float] = {}
    for name, (key, value, _) in given.items():
        if is_expression(value):
            expressions[name] = _parse(key, value, given)
        elif key[0] == "parameters":
            with naming_key(*key):
                values[name] = measured_quantity(value)
        else:
            with suppress(
                ValueError
            ):  # whether it measures what it should is checked later
                values[name] = measured_quantity(value)
    order = TopologicalSorter(
        {name: expression.names for name, expression in expressions.items()}
    )
    try:
        ordered = list(order.static_order())
    except CycleError as error:
        circle = error.args[1][::-1]
        message = (
            f"expected no parameter that depends on itself, got {' -> '.join(circle)}"
        )
        raise FieldError(given[circle[0]][0], message) from error
    for name in ordered:
        if name in expressions:
            values[name] = _evaluate(given[name][0], expressions[name], values)
    return values


def _list_given(
    data: Mapping[str, Any],
) -> dict[str, tuple[Key, Any, FieldInfo | None]]:
    """Return key, value and part's field for each name, including defaults of parts."""
    parameters: dict[str, tuple[Key, Any, FieldInfo | None]] = {}
    for name, value in data.get("parameters", {}).items():
        key = ("parameters", name)
        with naming_key(*key):
            refuse_name(name)
        other = parameters.get(normalize(name))
        got = f'"{name}", one letter with "{other[0][1] if other else ""}"'
        require(other is None, key, "a name of its own", got)
        parameters[normalize(name)] = (key, value, None)
    for part, section in data.get("parts", {}).items():
        shape = section.get("shape") if isinstance(section, dict) else None
        fields = (
            PARTS[shape].model_fields
            if isinstance(shape, str) and shape in PARTS
            else {}
        )
        defaults = {
            key: field.default
            for key, field in fields.items()
            if not field.is_required()
        }
        for key, value in {
            **defaults,
            **(section if isinstance(section, dict) else {}),
        }.items():
            parameters[normalize(f"{part}.{key}")] = (
                ("parts", part, key),
                value,
                fields.get(key),
            )
    return parameters


def _parse(key: Key, text: str, known: Mapping[str, Any]) -> Expression:
    with naming_key(*key):
        expression = parse(text)
        check_names(expression, known)
        return expression


def _evaluate(key: Key, expression: Expression, values: Mapping[str, float]) -> float:
    for name in expression.names:
        require(name in values, key, "names of numbers", f'"{name}", which is none')
    with naming_key(*key):
        known = {
            name: getattr(values[name], "powers", None) for name in expression.names
        }
        return q.Measured(expression.value(values), expression.powers(known))

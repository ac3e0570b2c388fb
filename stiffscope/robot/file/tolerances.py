"""Manufacturing tolerances of a robot file: ``"20 mm ± 0.1 mm"`` is 20 mm wherever it is read, and known to scatter."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.evaluate import TEXTS, FieldError
from stiffscope.robot.file.expressions import is_expression
from stiffscope.robot.file.values import ANY

if TYPE_CHECKING:
    from stiffscope.robot.file.positions import Key

_MARK = re.compile(r"\s*(?:±|\+/-|\+-)\s*")
_EXAMPLE = '"20 mm ± 0.1 mm" or "20 mm ± 0.5 %"'


def without_tolerances(data: Any, key: Key = ()) -> tuple[Any, dict[Key, float]]:
    """The data with nominal values alone, and the tolerances of them, SI, by key.

    Raises
    ------
    FieldError
        What stands after ± is no positive quantity like the one before it.

    """
    found: dict[Key, float] = {}

    def nominal(value: Any, here: Key) -> Any:
        if isinstance(value, dict):
            return {
                name: each if name in TEXTS or name == "provenance" else nominal(each, (*here, name))
                for name, each in value.items()
            }
        if isinstance(value, list):
            return [nominal(each, (*here, number)) for number, each in enumerate(value)]
        if not isinstance(value, str) or is_expression(value) or not _MARK.search(value):
            return value
        text, found[here] = _split(value, here)
        return text

    return nominal(data, key), found


def _split(text: str, key: Key) -> tuple[str, float]:
    """Text of the nominal value and the tolerance in SI."""
    value, _, width = (each.strip() for each in _MARK.sub("\0", text, count=1).partition("\0"))
    if not re.search(r"[^\d.eE+\-\s]", value):  # "20 ± 0.1 mm"
        value += " " + re.sub(r"^[\d.eE+\-\s]*", "", width) * (not width.endswith("%"))
    for dimension in ANY:
        try:
            nominal = q.to_si(value.strip(), dimension, sign="any")
            share = width.endswith("%")
            tolerance = abs(nominal) * q.to_si(width, q.SHARE) if share else q.to_si(width, dimension)
        except ValueError:
            continue
        return value.strip(), tolerance
    raise FieldError(key, f"expected a quantity with its tolerance such as {_EXAMPLE}, got {q.shown(text)}")

"""Plain data as YAML: mappings in block style, lists of numbers on one line."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")
_WORDS = {"y", "n", "yes", "no", "on", "off", "true", "false", "null"}


def yaml_text(data: Mapping[str, Any], comment: str) -> str:
    """Return data as YAML under a comment; numbers read back as the same floats."""
    lines = [f"# {line}" for line in comment.splitlines()]
    return "\n".join([*lines, *_lines(data, "")]) + "\n"


def _lines(data: Mapping[str, Any], indent: str) -> Iterator[str]:
    for key, value in data.items():
        plain_key = _PLAIN.fullmatch(key) and key.lower() not in _WORDS
        name = f"{indent}{key if plain_key else _scalar(key)}:"
        if isinstance(value, Mapping):
            yield name if value else f"{name} {{}}"
            yield from _lines(value, f"{indent}  ")
            continue
        plain = np.asarray(value).tolist() if isinstance(value, np.ndarray) else value
        if isinstance(plain, list | tuple) and plain and isinstance(plain[0], list):
            yield name
            yield from (f"{indent}  - {_flow(row)}" for row in plain)
            continue
        yield f"{name} {_flow(plain)}"


def _flow(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_flow, value))}]"
    return _scalar(value)


def _scalar(value: Any) -> str:
    if isinstance(value, float):
        text = repr(value + 0.0)
        # YAML 1.1 reads a number with an exponent only behind a decimal point.
        return text if "e" not in text or "." in text else text.replace("e", ".0e")
    return json.dumps(value, ensure_ascii=False)

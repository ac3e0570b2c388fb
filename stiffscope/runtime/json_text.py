"""Readable JSON text: one matrix row per line."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any


def encodable(text: str, encoding: str) -> str:
    """Return JSON text unchanged if the encoding has all its characters, else with escapes."""
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        return re.sub(r"[^\x00-\x7f]", lambda letter: json.dumps(letter[0])[1:-1], text)
    return text


def to_json(value: Any) -> str:
    """Return JSON text with arrays as lists, one matrix row per line; NaN and infinity are null."""
    return _rows(_to_plain(value)) + "\n"


def _to_plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): _to_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_to_plain(item) for item in value]
    if isinstance(value, float):
        return value + 0.0 if math.isfinite(value) else None  # -0.0 + 0.0 is 0.0
    if isinstance(value, Path):
        return value.as_posix()
    return value


def _rows(value: Any, indent: str = "") -> str:
    """Return indented JSON with lists of plain values on one line."""
    inner = indent + "  "
    if isinstance(value, dict) and value:
        items = (f"{_rows(key)}: {_rows(item, inner)}" for key, item in value.items())
        return "{\n" + ",\n".join(inner + item for item in items) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(item, list | dict) for item in value):
        return (
            "[\n"
            + ",\n".join(inner + _rows(item, inner) for item in value)
            + f"\n{indent}]"
        )
    return json.dumps(value, ensure_ascii=False, allow_nan=False)

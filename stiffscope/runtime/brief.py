"""Short representations of objects for a console: sizes instead of thousands of numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

SHORT = 60  # most characters of a value written in full
FEW = 6  # most numbers of an array written in full


def describe_briefly(self: Any) -> str:
    """Return a dataclass's fields in one line: short values, and sizes of arrays and collections.

    Used as ``__repr__`` of such classes. Empty fields are omitted.
    """
    shown = {
        field.name: _describe(getattr(self, field.name))
        for field in fields(self)
        if field.repr
    }
    words = ", ".join(f"{name}={text}" for name, text in shown.items() if text)
    return f"{type(self).__name__}({words})"


def _describe(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return (
            repr(value)
            if value.ndim == 1 and value.size <= FEW
            else f"array{value.shape}"
        )
    many = Mapping, tuple, list
    if value is None or (isinstance(value, many) and not value):
        return ""
    if not isinstance(value, (str, int, float, Mapping, tuple, list)):
        return f"<{type(value).__name__}>"
    names = (
        f"{{{', '.join(map(str, value))}}}"
        if isinstance(value, Mapping)
        else repr(value)
    )
    return (
        f"<{len(value)}>" if len(names) > SHORT and isinstance(value, many) else names
    )

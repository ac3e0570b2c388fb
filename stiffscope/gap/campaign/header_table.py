"""Tables of a campaign.toml with checked values, whose errors name the line and the key."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from stiffscope.robot.file.quantities import (
    LENGTH,
    NUMBER,
    Dimension,
    show_value,
    to_si,
)

if TYPE_CHECKING:
    from stiffscope.errors import InputError, Key
    from stiffscope.robot.file.parse import Source


@dataclass(frozen=True)
class HeaderTable:
    """A table of the file, whose errors name the line and the key."""

    source: Source
    here: Key
    data: dict[str, Any]

    def refuse(self, key: str, message: str) -> InputError:
        """Return an error that names the line and the key."""
        return self.source.refuse((*self.here, key), message)

    def check_keys(self, keys: tuple[str, ...]) -> None:
        """Raise InputError if another key is given."""
        unknown = [key for key in self.data if key not in keys]
        if unknown:
            raise self.refuse(unknown[0], f"expected one of {', '.join(keys)}")

    def refuse_others(self, keys: tuple[str, ...], message: str) -> None:
        """Raise InputError if any of these keys is given."""
        for key in keys:
            if key in self.data:
                raise self.refuse(key, message)

    def text(self, key: str) -> str | None:
        """Return a text, or None if there is none."""
        value = self.data.get(key)
        if key in self.data and (not isinstance(value, str) or not value.strip()):
            raise self.refuse(key, f"expected a text, got {show_value(value)}")
        return value

    def texts(
        self, key: str, default: tuple[str, ...] | None = None
    ) -> tuple[str, ...]:
        """Return a list of texts, or a single one."""
        value = self.data.get(key, default)
        if default is not None and key not in self.data:
            return default
        listed = cast("list[Any]", value) if isinstance(value, list) else [value]
        if not all(isinstance(v, str) and v for v in listed):
            raise self.refuse(key, f"expected a list of texts, got {show_value(value)}")
        return tuple(listed)

    def choice(
        self, key: str, choices: tuple[str, ...], default: str | None = None
    ) -> str:
        """Return one of the choices."""
        value = self.text(key) if key in self.data or default is None else default
        if value is None or value not in choices:
            listed = (
                ", ".join(choices) or f"a name of [{key}s], of which there are none"
            )
            got = "nothing" if value is None else show_value(value)
            raise self.refuse(key, f"expected one of {listed}, got {got}")
        return value

    def body(self) -> str:
        """Return the name of a body."""
        value = self.text("body")
        if value is None:
            raise self.refuse("body", "expected the name of a body, got nothing")
        return value

    def values(
        self,
        key: str,
        dimensions: tuple[Dimension, ...],
        example: str,
        *,
        sign: str = "any",
    ) -> tuple[float, ...]:
        """Return a list of values in SI, one for each dimension."""
        value: Any = self.data.get(key)
        if not isinstance(value, list) or len(cast("list[Any]", value)) != len(
            dimensions
        ):
            raise self.refuse(key, f"{example}, got {show_value(value)}")
        try:
            pairs = zip(cast("list[Any]", value), dimensions, strict=True)
            return tuple(to_si(each, dimension, sign=sign) for each, dimension in pairs)
        except ValueError as error:
            raise self.refuse(key, str(error)) from None

    def value(self, key: str, dimension: Dimension, *, sign: str = "positive") -> float:
        """Return a value in SI."""
        try:
            return to_si(self.data.get(key), dimension, sign=sign)
        except ValueError as error:
            raise self.refuse(key, str(error)) from None

    def point(self, key: str) -> tuple[float, float, float]:
        """Return three lengths, m."""
        example = 'expected three lengths such as ["75 mm", 0, "-15 mm"]'
        x, y, z = self.values(key, (LENGTH,) * 3, example)
        return x, y, z

    def direction(self, key: str) -> tuple[float, float, float]:
        """Return a unit vector."""
        value: Any = self.data.get(key)
        example = "expected three numbers such as [0, 0, 1]"
        given = cast("list[Any]", value) if isinstance(value, list) else []
        if not all(isinstance(v, int | float) for v in given):
            raise self.refuse(key, f"{example}, got {show_value(value)}")
        along = np.array(self.values(key, (NUMBER,) * 3, example))
        size = float(np.linalg.norm(along))
        if not size > 0.0:
            raise self.refuse(key, f"expected a direction, got {show_value(value)}")
        x, y, z = (along / size).tolist()
        return x, y, z

    def table(self, key: str) -> HeaderTable:
        """Return a table, empty if there is none."""
        value = self.data.get(key, {})
        if not isinstance(value, dict):
            raise self.refuse(key, f"expected a table, got {show_value(value)}")
        return HeaderTable(
            self.source, (*self.here, key), cast("dict[str, Any]", value)
        )

    def sections(self, key: str) -> list[tuple[str, HeaderTable]]:
        """Return the tables of a table by name."""
        found = self.table(key)
        for name in found.data:
            if (
                not name.isprintable() or not name or name != name.strip()
            ):  # a terminal would obey it
                expected = (
                    "expected a name of printable characters without blanks around it"
                )
                raise found.refuse(name, f"{expected}, got {show_value(name)}")
        return [(name, found.table(name)) for name in found.data]

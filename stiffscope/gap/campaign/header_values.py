"""Value types of campaign.toml, beside those of robot files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, cast

from pydantic import BeforeValidator

from stiffscope.errors import require
from stiffscope.robot.file.quantities import show_value, to_si
from stiffscope.robot.file.values import Reads

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.robot.file.quantities import Dimension


def _read_text(value: Any) -> str:
    require(isinstance(value, str) and value.strip(), "", "a text", show_value(value))
    return value


def _read_texts(value: Any) -> tuple[str, ...]:
    listed = as_list(value) if isinstance(value, list | tuple) else [value]
    valid = all(isinstance(item, str) and item for item in listed)
    require(valid, "", "a text or a list of texts", show_value(value))
    return tuple(listed)


def as_list(value: Any) -> list[Any]:
    """Return the items of a list; none of anything else."""
    return [*cast("list[Any]", value)] if isinstance(value, list | tuple) else []


Text = Annotated[str, Reads(_read_text, says="a text")]
Texts = Annotated[tuple[str, ...], Reads(_read_texts, says="a text or a list of texts")]


def read_values(dimensions: Sequence[Dimension], what: str, sign: str = "any") -> Reads:
    """Return what reads a list of values in SI, one for each dimension; ``what``: the list in words."""

    def read(value: Any) -> tuple[float, ...]:
        listed = as_list(value)
        require(len(listed) == len(dimensions), "", what, show_value(value))
        pairs = zip(listed, dimensions, strict=True)
        return tuple(to_si(each, dimension, sign=sign) for each, dimension in pairs)

    return Reads(read, says=what)


def as_table(value: object) -> dict[str, Any] | None:
    """Return a table; None of anything else."""
    return cast("dict[str, Any]", value) if isinstance(value, dict) else None


def _check_names(value: object) -> object:
    """Refuse names that no page or terminal shows."""
    for name in as_table(value) or ():
        shown = name.isprintable() and name and name == name.strip()
        what = "a name of printable characters without blanks around it"
        require(shown, f'section."{name}"', what, show_value(name))
    return value


ByName = BeforeValidator(_check_names)
"""Tables by names that can be shown."""

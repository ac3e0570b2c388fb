"""Values of the robot file: what a key may hold, its dimension and its limits, as pydantic types in SI."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict

from stiffscope.fea.settings import MOST_LAYERS
from stiffscope.robot import quantities as q

if TYPE_CHECKING:
    from collections.abc import Callable


def _quantity(dimension: q.Dimension, sign: str = "positive") -> BeforeValidator:
    return BeforeValidator(lambda value: q.to_si(value, dimension, sign=sign))


Length = Annotated[float, _quantity(q.LENGTH)]
LengthOrZero = Annotated[float, _quantity(q.LENGTH, "non-negative")]
Coordinate = Annotated[float, _quantity(q.LENGTH, "any")]
Modulus = Annotated[float, _quantity(q.MODULUS)]
Ratio = Annotated[float, _quantity(q.NUMBER, "any")]
Density = Annotated[float, _quantity(q.DENSITY)]
Expansion = Annotated[float, _quantity(q.EXPANSION, "any")]
Mass = Annotated[float, _quantity(q.MASS)]
Stiffness = Annotated[float, _quantity(q.STIFFNESS)]
Acceleration = Annotated[float, _quantity(q.ACCELERATION)]
Duration = Annotated[float, _quantity(q.DURATION)]
Point = tuple[Coordinate, Coordinate, Coordinate]
Vector = tuple[Ratio, Ratio, Ratio]


def whole(value: Any) -> int:
    """A whole number from 0 on; ValueError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ValueError(f"expected a whole number such as 4, got {q.shown(value)}")
    return value


def _layers(value: Any) -> int:
    if not 1 <= whole(value) <= MOST_LAYERS:
        raise ValueError(f"expected 1 to {MOST_LAYERS} thin layers of elements, got {value}")
    return value


def _mass_or_cad(value: Any) -> float | str:
    if value == "cad":
        return "cad"
    try:
        return q.to_si(value, q.MASS)
    except ValueError as error:
        raise ValueError(f'{error} (or "cad": the volume of the solid times its density)') from error


def _or_word(read: Callable[[Any], float], word: str, meaning: str) -> BeforeValidator:
    """What `read` makes of a value, or None for a word and for nothing."""

    def read_or_none(value: Any) -> float | None:
        if value is None or value == word:
            return None
        try:
            return read(value)
        except ValueError as error:
            raise ValueError(f'{error} (or "{word}": {meaning})') from error

    return BeforeValidator(read_or_none)


def _length(value: Any) -> float:
    return q.to_si(value, q.LENGTH)


def _foundation(value: Any) -> float:
    return q.to_si(value, q.FOUNDATION)


def _tolerance(value: Any) -> float:
    share = q.to_si(value, q.SHARE)
    if not 1e-6 <= share < 1:  # below, rounding counts
        raise ValueError(f'expected a share from 1e-6 to below 1 such as "{q.SHARE.example}", got {q.shown(value)}')
    return share


def _positive(value: Any) -> int:
    if not isinstance(value, int) or not whole(value):
        raise ValueError(f"expected a positive whole number such as 2000000, got {q.shown(value)}")
    return value


LengthOrAuto = Annotated[float | None, _or_word(_length, "auto", "what suits the part")]
Foundation = Annotated[float | None, _or_word(_foundation, "rigid", "a clamp that does not give")]
Tolerance = Annotated[float | None, _or_word(_tolerance, "auto", "what one mesh gives")]
Count = Annotated[int, BeforeValidator(whole)]
Layers = Annotated[int, BeforeValidator(_layers)]
Positive = Annotated[int, BeforeValidator(_positive)]
MassOrCad = Annotated[float | Literal["cad"], BeforeValidator(_mass_or_cad)]


class Section(BaseModel):
    """A table of the robot file: nothing unknown is let in, nothing changes afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True)

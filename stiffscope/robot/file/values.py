"""Value types of the robot file, with dimensions and limits, as pydantic types in SI.

Importing this module imports pydantic; the reader imports it on use.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    model_validator,
)

from stiffscope.errors import require
from stiffscope.fea.settings import MOST_LAYERS
from stiffscope.robot.file import quantities as q

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


class Says(str):
    """Description of the expected value, for messages on a missing one; annotates its type."""

    __slots__ = ()


def any_quantity(value: Any) -> float:
    """A number, or a text with a unit of any of the dimensions above, in SI. Raises ValueError."""
    return read_any(value)[0] if isinstance(value, str) else _any(value)[0]


def measured_quantity(value: Any) -> float:
    """The same, which knows what it measures where it is a text with a unit. Raises ValueError."""
    if not isinstance(value, str):
        return any_quantity(value)
    si, dimension = read_any(value)
    return q.Measured(si, q.powers_of(dimension.unit))


@cache
def read_any(text: str) -> tuple[float, q.Dimension]:
    """A text's value, SI, and what it measures. Raises ValueError."""
    return _any(text)


def _any(value: Any) -> tuple[float, q.Dimension]:
    for dimension in (q.NUMBER, q.TORSION, *q.NAMED):
        with suppress(ValueError):
            return q.to_si(value, dimension, sign="any"), dimension
    try:
        return q.to_si(value, q.LENGTH, sign="any"), q.LENGTH
    except ValueError as error:
        why = str(error).partition(", got ")[2]
        what = 'a quantity such as "220 mm" or "25 deg", or an expression'
        raise ValueError(f"expected {what}, got {why}") from error


def unit_of(value: Any) -> str:
    """SI unit of what a text with a unit measures, "1" for a number or an angle."""
    with suppress(ValueError):
        if isinstance(value, str):
            dimension = read_any(value.partition("±")[0].strip())[1]
            return "1" if dimension is q.ANGLE else dimension.unit or "1"
    return "1"


def _ratio_or_angle(value: Any) -> float:
    with suppress(ValueError):
        return q.to_si(value, q.ANGLE, sign="any")
    return q.to_si(value, q.NUMBER, sign="any")


@dataclass(frozen=True)
class Reads(BeforeValidator):
    """Reader of a value, and description of the expected value if it is missing."""

    says: str = ""

    def read(self, value: Any) -> Any:
        """Return the value as read; raise ValueError if it is invalid."""
        read: Any = self.func
        return read(value)


def _quantity(dimension: q.Dimension, sign: str = "positive") -> Reads:
    description = f'{dimension.noun} such as "{dimension.example}"'
    return Reads(lambda value: q.to_si(value, dimension, sign=sign), says=description)


def parse_whole(value: Any) -> int:
    """Return a non-negative integer, also from an expression's float; ValueError otherwise."""
    if isinstance(value, float) and value.is_integer() and value < 2**53:
        value = int(value)
    whole = isinstance(value, int) and not isinstance(value, bool) and value >= 0
    require(whole, "", "a whole number such as 4", q.show_value(value))
    return int(value)


def _flag(value: Any) -> bool:
    require(isinstance(value, bool), "", "true or false", q.show_value(value))
    return value


MOST_ELEMENTS = 1000  # rolling elements of a row, carriages, rails


def _whole(
    expected: str, most: float = math.inf, says: str = "a whole number above 0"
) -> Reads:
    """What reads a whole number from 1 on."""

    def read(value: Any) -> int:
        require(1 <= parse_whole(value) <= most, "", expected, q.show_value(value))
        return parse_whole(value)

    return Reads(read, says=says)


def _own_mass(value: Any) -> float:
    require(value != "cad", "", 'a mass such as "80 g"', '"cad", which is for solids')
    return q.to_si(value, q.MASS, sign="non-negative")


def _or_word(
    read: Callable[[Any], float],
    word: str,
    meaning: str,
    description: str,
    stays: str | None = None,
) -> Reads:
    """Return what reads a value by ``read``, and gives ``stays`` for a word or no value."""

    def read_or_word(value: Any) -> float | str | None:
        if value is None or value == word:
            return stays
        try:
            return read(value)
        except ValueError as error:
            raise ValueError(f'{error} (or "{word}": {meaning})') from error

    return Reads(read_or_word, says=f'{description}, or "{word}": {meaning}')


def _tolerance(value: Any) -> float:
    share = q.to_si(value, q.SHARE)
    # below 1e-6 rounding dominates
    require(
        1e-6 <= share < 1,
        "",
        f'a share from 1e-6 to below 1 such as "{q.SHARE.example}"',
        q.show_value(value),
    )
    return share


def _list_of(count: int, what: str) -> BeforeValidator:
    """Return a validator of a list's length, applied before its items are validated."""

    def check(value: Any) -> Any:
        listed = isinstance(value, list | tuple) and len(value) == count
        require(listed, "", what, q.show_value(value))
        return value

    return BeforeValidator(check)


def _rising(value: tuple[float, float]) -> tuple[float, float]:
    low, high = value
    require(low < high, "", "a lower and a higher value", f"{low:g} and {high:g}")
    return value


_POINT = 'three lengths such as ["180 mm", 0, "35 mm"]'
_VECTOR = "three numbers such as [0, 0, 1]"
_SIX = "six numbers: three along and three about the axes"


def _direction(value: Any) -> Any:
    if isinstance(value, list | tuple) and len(value) == 3:
        numbers = [q.to_si(item, q.NUMBER, sign="any") for item in value]
        length = math.hypot(*numbers)
        require(
            1e-9 < length < 1e9,
            "",
            "a direction such as [0, 0, 1]",
            f"one of length {length:g}, {q.show_value(value)}",
        )
    return value


Length = Annotated[float, _quantity(q.LENGTH)]
LengthOrZero = Annotated[float, _quantity(q.LENGTH, "non-negative")]
Coordinate = Annotated[float, _quantity(q.LENGTH, "any")]
Angle = Annotated[float, _quantity(q.ANGLE, "any")]
Turn = Annotated[
    float,
    _quantity(
        q.Dimension("an angle within a turn", "rad", "120 deg", most=6.29), "any"
    ),
]
Modulus = Annotated[float, _quantity(q.MODULUS)]
Ratio = Annotated[float, _quantity(q.NUMBER, "any")]
RatioOrAngle = Annotated[float, Reads(_ratio_or_angle, says="a number")]
Density = Annotated[float, _quantity(q.DENSITY)]
Expansion = Annotated[float, _quantity(q.EXPANSION, "any")]
Mass = Annotated[float, _quantity(q.MASS, "non-negative")]
Stiffness = Annotated[float, _quantity(q.STIFFNESS)]
Torsion = Annotated[float, _quantity(q.TORSION)]
Force = Annotated[float, _quantity(q.FORCE, "any")]
Preload = Annotated[float, _quantity(q.FORCE, "non-negative")]
Acceleration = Annotated[float, _quantity(q.ACCELERATION, "non-negative")]
Duration = Annotated[float, _quantity(q.DURATION)]
Frequency = Annotated[float, _quantity(q.FREQUENCY)]
Compliance = Annotated[float, _quantity(q.COMPLIANCE, "non-negative")]
Tilting = Annotated[float, _quantity(q.TILTING, "non-negative")]
_Inertia = Annotated[float, _quantity(q.INERTIA, "any")]

Point = Annotated[
    tuple[Coordinate, Coordinate, Coordinate], _list_of(3, _POINT), Says(_POINT)
]
Vector = Annotated[tuple[Ratio, Ratio, Ratio], _list_of(3, _VECTOR), Says(_VECTOR)]
Direction = Annotated[Vector, BeforeValidator(_direction)]
Inertia = Annotated[
    tuple[_Inertia, _Inertia, _Inertia, _Inertia, _Inertia, _Inertia],
    _list_of(6, "six moments of inertia, Ixx Iyy Izz Ixy Ixz Iyz"),
]
_Six = tuple[Compliance, Compliance, Compliance, Tilting, Tilting, Tilting]
Diagonal = Annotated[_Six, _list_of(6, _SIX)]
ForceAbove = Annotated[float, _quantity(q.FORCE)]
MomentAbove = Annotated[float, _quantity(q.MOMENT)]
AngleAbove = Annotated[float, _quantity(q.ANGLE)]
AngleOrZero = Annotated[float, _quantity(q.ANGLE, "non-negative")]
LinearCurve = Annotated[
    tuple[
        Annotated[tuple[Length, ForceAbove], _list_of(2, "a deflection and a force")],
        ...,
    ],
    Says('deflections and forces such as [["2 um", "20 N"], ["8 um", "140 N"]]'),
]
RotaryCurve = Annotated[
    tuple[
        Annotated[
            tuple[AngleAbove, MomentAbove], _list_of(2, "a deflection and a torque")
        ],
        ...,
    ],
    Says(
        'deflections and torques such as [["0.1 mrad", "1 N*m"], ["0.5 mrad", "9 N*m"]]'
    ),
]
_LENGTHS = 'two lengths such as ["-150 mm", "150 mm"]'
_ANGLES = 'two angles such as ["-60 deg", "80 deg"]'
Lengths = Annotated[
    tuple[Coordinate, Coordinate], _list_of(2, _LENGTHS), AfterValidator(_rising)
]
Angles = Annotated[tuple[Angle, Angle], _list_of(2, _ANGLES), AfterValidator(_rising)]

_SIZE = _or_word(
    _quantity(q.LENGTH).read, "auto", "a size that suits the part", "a length"
)
LengthOrAuto = Annotated[float | None, _SIZE]
_GROUND = _or_word(
    _quantity(q.FOUNDATION).read, "rigid", "a clamp that does not give", "N/m³"
)
Foundation = Annotated[float | None, _GROUND]
_SHARE = _or_word(_tolerance, "auto", "whatever one mesh reaches", "a share")
Tolerance = Annotated[float | None, _SHARE]
Count = Annotated[int, Reads(parse_whole, says="a whole number")]
Layers = Annotated[
    int, _whole(f"1 to {MOST_LAYERS} layers", MOST_LAYERS, f"1 to {MOST_LAYERS}")
]
Some = Annotated[int, _whole(f"1 to {MOST_ELEMENTS}", MOST_ELEMENTS)]
Flag = Annotated[bool, Reads(_flag, says="true or false")]
Counted = Annotated[int, _whole("a whole number of at least 1")]
Positive = Annotated[int, _whole("a positive whole number such as 2000000")]
OwnMass = Annotated[float, Reads(_own_mass, says='a mass such as "1.95 kg"')]
_MASS = _quantity(q.MASS, "non-negative")
_BY_CAD = "the volume of the solid times its density"
MassOrCad = Annotated[
    float | Literal["cad"], _or_word(_MASS.read, "cad", _BY_CAD, "a mass", "cad")
]


class Section(BaseModel):
    """A table of a file: immutable, without unknown keys.

    What holds of several keys together stands beside them, and is checked for every section alike.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    exactly_one: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """Groups of keys of which one is given."""
    excludes: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Keys that cannot stand beside another one."""

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        there = self.model_fields_set
        for keys in self.exactly_one:
            got = [key for key in keys if key in there]
            where = f"section.{[keys[0], *got][-1]}"
            words = " and ".join(got) or "none of them"
            require(len(got) == 1, where, f"one of {', '.join(keys)}", words)
        for key, others in self.excludes.items():
            for other in others if key in there else ():
                default = type(self).model_fields[other].default
                unsaid = other not in there or getattr(self, other) == default == 0.0
                require(unsaid, f"section.{other}", f"none beside {key}", "one")
        return self

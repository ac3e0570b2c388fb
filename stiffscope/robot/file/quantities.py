"""Numbers with units ("500 mm"), checked and converted to SI floats.

A string includes its unit; a bare number is SI. Errors state what was expected, with an example.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from stiffscope import data
from stiffscope.errors import require
from stiffscope.robot.file.expressions import PLAIN, Powers, fits, parse

if TYPE_CHECKING:
    import pint

_NUMBER = re.compile(
    r"\s*([+-]?(?:\d+(?:_\d+)*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$", re.DOTALL
)
_MOST_CHARACTERS = 200
_POWER = re.compile(
    r"(?<=[\w°])\s*(?:\*\*|\^)\s*(?:[+-]?[1-9]|\([+-]?[1-9]\))(?!\s*(?:\*\*|\^|[\d.]))"
)
_PRODUCT = re.compile(r"(?:[\s*/·()%°⁻]|(?<!\w)1(?!\w)|(?<!\w)[^\W\d]\w*)*")


@dataclass(frozen=True)
class Dimension:
    """Dimension of a quantity: noun for messages, SI unit, example, and physical limits.

    The limits, in SI, are far beyond any machine's: larger values are typing or unit errors, and
    could overflow. `most` bounds the magnitude; `least` bounds nonzero magnitudes from below.
    """

    noun: str
    unit: str
    example: str = ""
    least: float = 0.0
    most: float = 1e30

    def refusal(self, value: float) -> str:
        """Return the reason why a value, SI, is beyond the limits; empty if it is not."""
        unit = f" {self.unit}" if self.unit else ""
        if not abs(value) <= self.most:
            return f"beyond {self.most:g}{unit}"
        return f"below {self.least:g}{unit}" if 0.0 < abs(value) < self.least else ""


LENGTH = Dimension("a length", "m", "20 mm", most=1e4)
MODULUS = Dimension("an elastic modulus", "Pa", "211 GPa", 1e2, 1e14)
DENSITY = Dimension("a density", "kg/m^3", "7850 kg/m^3", 1e-3, 1e6)
EXPANSION = Dimension("a thermal expansion", "1/K", "11.7e-6 1/K", most=1.0)
MASS = Dimension("a mass", "kg", "1.95 kg", 1e-12, 1e9)
STIFFNESS = Dimension("a stiffness", "N/m", "12.7 N/um", 1e-6, 1e18)
ACCELERATION = Dimension("an acceleration", "m/s^2", "9.81 m/s^2", most=1e6)
DURATION = Dimension("a duration", "s", "120 s", 1e-3, 1e7)
FREQUENCY = Dimension("a frequency", "Hz", "2 kHz", 1e-6, 1e12)
FOUNDATION = Dimension("a stiffness per area", "N/m^3", "5000 N/mm^3", 1e-3, 1e24)
FORCE = Dimension("a force", "N", "100 N", most=1e12)
MOMENT = Dimension("a moment", "N*m", "5 N*m", most=1e12)
NUMBER = Dimension("a number", "", "0.3")
SHARE = Dimension("a share", "", "0.1 %")
ANGLE = Dimension("an angle", "rad", "25 deg", most=1e4)
TORSION = Dimension("a torsional stiffness", "N*m/rad", "24 kN*m/rad", 1e-9, 1e18)
INERTIA = Dimension("a moment of inertia", "kg*m^2", "0.012 kg*m^2", most=1e12)
COMPLIANCE = Dimension("a compliance", "m/N", "0.01 um/N", 1e-24, 1e6)
TILTING = Dimension(
    "a rotational compliance", "rad/(N*m)", "2e-6 rad/(N*m)", 1e-24, 1e9
)

NAMED = (
    *(
        LENGTH,
        MASS,
        STIFFNESS,
        MOMENT,
        TORSION,
        MODULUS,
        DENSITY,
        EXPANSION,
        ACCELERATION,
    ),
    *(FOUNDATION, DURATION, FREQUENCY, INERTIA, COMPLIANCE, TILTING, FORCE, ANGLE),
    *(Dimension("an area", "m^2", "3 mm^2"), Dimension("a volume", "m^3", "3 mm^3")),
    Dimension("a temperature", "K", "20 K"),
)


class Measured(float):
    """The value, SI, of an expression or parameter that knows what it measures."""

    powers: Powers | None

    def __new__(cls, value: float, powers: Powers | None = None) -> Self:
        """A number with the powers of its units; None where they are not known."""
        number = super().__new__(cls, value)
        number.powers = powers
        return number


_UNITS = dict(
    zip(("m", "kg", "s", "K", "rad"), map(tuple, np.eye(5).tolist()), strict=True)
) | {
    "N": (1.0, 1.0, -2.0, 0.0, 0.0),
    "Pa": (-1.0, 1.0, -2.0, 0.0, 0.0),
    "Hz": (0.0, 0.0, -1.0, 0.0, 0.0),
}


@cache
def powers_of(unit: str) -> Powers | None:
    """What an SI unit of a `Dimension` measures, such as "N*m/rad"."""
    return parse(unit.replace("^", "**") or "1").powers(_UNITS)


# What pint answers for usual units: importing it takes as long as a robot's stiffness.
SI = ("", *(dimension.unit for dimension in NAMED))
USUAL = {si: (si, 1.0) for si in SI[1:]} | {
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "g": ("kg", 1e-3),
    "deg": ("rad", math.pi / 180),
    "GPa": ("Pa", 1e9),
    "MPa": ("Pa", 1e6),
    "N/um": ("N/m", 1e6),
    "N/mm": ("N/m", 1e3),
    "N/mm^3": ("N/m^3", 1e9),
    "um/N": ("m/N", 1e-6),
    "kN*m/rad": ("N*m/rad", 1e3),
}


@cache
def _registry() -> pint.UnitRegistry:
    import pint

    return pint.UnitRegistry(
        str(data.FOLDER / "units.txt")
    )  # pint's own list is ten times slower


def to_si(value: Any, dimension: Dimension, *, sign: str = "positive") -> float:
    """Convert a number (SI) or a string with a unit to an SI float.

    Parameters
    ----------
    value
        Value in the file or on the command line.
    dimension
        Required dimension.
    sign
        "positive", "non-negative" or "any".

    Raises
    ------
    ValueError
        If the value is invalid: one line with what was expected, what was found and an example.
    """
    message = expected(f'{dimension.noun} such as "{dimension.example}"', value)
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(message)
    powers = value.powers if isinstance(value, Measured) and dimension.unit else None
    if powers and not fits(powers, powers_of(dimension.unit)):
        raise ValueError(f"{message}, which is {_name_powers(powers)}")
    try:
        si = (
            _parse(value, dimension, message)
            if isinstance(value, str)
            else float(value)
        )
    except OverflowError:
        si = math.inf
    fault = _find_fault(si, dimension, sign)
    if fault:
        raise ValueError(message + fault)
    return si


def _find_fault(si: float, dimension: Dimension, sign: str) -> str:
    """Return the end of the message that refuses a number; "" if it is valid."""
    beyond = "not a finite number" if not math.isfinite(si) else dimension.refusal(si)
    if beyond:
        return f", which is {beyond}"
    if si <= 0 and sign == "positive":
        return ": it must be greater than zero"
    return ": it must not be negative" if si < 0 and sign != "any" else ""


def several(text: str, *dimensions: Dimension) -> tuple[float, ...]:
    """Return SI floats of a list such as "0, 0, 350 mm", one per dimension; bare numbers are SI.

    Raises
    ------
    ValueError
        If the length of the list or one of its values is wrong (one line).
    """
    words = text.split(",")
    count = len(dimensions)
    got = len(words)
    require(got == count, "", f"{count} values with commas between them", got)
    matches = map(_NUMBER.match, words)
    pairs = zip(words, matches, strict=True)
    values = [
        float(word) if match and not match[2] else word.strip() for word, match in pairs
    ]
    return tuple(
        to_si(v, d, sign="any") for v, d in zip(values, dimensions, strict=True)
    )


def _parse(text: str, dimension: Dimension, message: str) -> float:
    match = _NUMBER.match(text) if len(text) <= _MOST_CHARACTERS else None
    if match is None:
        raise ValueError(f"{message}, which does not begin with a number")
    number = float(match[1])
    unit = match[2]
    if not unit and dimension.unit:
        bare = f"a bare number without quotes is {dimension.unit}"
        raise ValueError(f"{message}, which has no unit ({bare})")
    try:
        factor = _factor(unit, dimension.unit) if unit else 1.0
    except Exception as error:
        raise ValueError(
            f"{message}{_why(unit)}{weight_of(unit, dimension)}"
        ) from error
    # "7 mm" is 0.007 m: results are found by their inputs
    return float(f"{number * factor:.15g}") if unit else number


@cache
def _factor(unit: str, si: str) -> float:
    """What one of a unit is in SI. Raises whatever pint does for what is no such unit."""
    if unit in USUAL and si in SI:
        base, factor = USUAL[unit]
        powers = powers_of(base) or PLAIN
        wanted = powers_of(si) or PLAIN
        if powers[:-1] != wanted[:-1] or powers[-1] not in {0.0, wanted[-1]}:
            raise ValueError(f"{unit} is no {si}")
        return factor
    _check_unit(unit)
    one = _registry().Quantity(
        1.0, _registry().parse_units(unit.removeprefix("*").strip())
    )
    names = dict(one.unit_items())
    share = si == "rad" and names.keys() & {"percent", "ppm"}
    if (
        names.get("percent", 1) != 1
        or share
        or _radians(unit) not in {0.0, _radians(si)}
    ):
        raise ValueError(f"{unit} is not a unit")
    return float(one.to(si or "dimensionless").magnitude)


def _radians(unit: str) -> float:
    """Return the power of radians in a unit."""
    one: Any = _registry().Quantity(
        1.0, _registry().parse_units(unit.removeprefix("*").strip())
    )
    return float(dict(one.to_root_units().unit_items()).get("radian", 0.0))


def _check_unit(text: str) -> None:
    """Raise ValueError unless it is a product of unit powers up to 9: pint evaluates arithmetic."""
    product = _POWER.sub("", text)
    if "**" in product or not _PRODUCT.fullmatch(product):
        raise ValueError(f"{text} is not a unit")


def weight_of(unit: str, dimension: Dimension) -> str:
    """End of a message: the unit of force whose mass was given for it, if one was."""
    try:
        _check_unit(unit)
        mass = _registry().parse_units(unit).dimensionality
        force = _registry().parse_units(dimension.unit).dimensionality
    except Exception:  # noqa: BLE001 (pint raises a dozen kinds, even ZeroDivisionError)
        return ""
    acceleration = _registry().parse_units("m/s**2").dimensionality
    if force != mass * acceleration:
        return ""
    weight = re.sub(r"\b(kg|lb)\b", r"\1f", unit)
    return f'; for its weight write "{weight if weight != unit else "kgf"}"'


def _why(unit: str) -> str:
    """Return a note on the actual dimension of a unit, if known."""
    nothing = f', and "{unit}" is not a unit'
    if re.match(r",\d", unit):
        return ", which has a decimal comma; write a point"
    if unit in USUAL:
        return f", which is {_name_powers(powers_of(USUAL[unit][0]))}"
    try:
        _check_unit(unit)
        units = _registry().parse_units(unit)
    except Exception:  # noqa: BLE001 (pint raises a dozen kinds, even ZeroDivisionError)
        return nothing
    if units.dimensionless and ("%" in unit or "ppm" in unit):
        return nothing
    measured = units.dimensionality
    read = _registry().parse_units
    turns = _radians(unit)
    same = [other for other in NAMED if measured == read(other.unit).dimensionality]
    noun = next((other.noun for other in same if _radians(other.unit) == turns), None)
    if noun:
        return f", which is {noun}"
    return (
        f", which has radians to the power {turns:g}"
        if same
        else f", which measures {measured}"
    )


def _name_powers(powers: Powers | None) -> str:
    """What a quantity is called; its units where it has no name."""
    named = sorted(
        NAMED, key=lambda each: powers_of(each.unit) != powers
    )  # what differs by radians comes later
    alike = next(
        (
            dimension.noun
            for dimension in named
            if fits(powers, powers_of(dimension.unit))
        ),
        None,
    )
    return alike or f"in {show_powers(powers or PLAIN)}"


def show_powers(powers: Powers) -> str:
    """What is measured, in base units such as "m^2 kg^1"."""
    shown = (
        f"{base}^{power:g}"
        for base, power in zip(_UNITS, powers, strict=False)
        if power
    )
    return " ".join(shown) or "a plain number"


def shown_unit(coordinate: str) -> tuple[float, str]:
    """Return factor from SI and unit to show a tool coordinate; drives (`q:JOINT`) are SI."""
    special = {"r": (math.degrees(1.0), "deg"), "q": (1.0, "m or rad")}
    return special.get(coordinate[0], (1e3, "mm"))


def expected(what: str, value: Any) -> str:
    """Return the message on a value in place of what was expected."""
    return f"expected {what}, got {show_value(value)}"


def show_value(value: Any) -> str:
    """Format a value for messages: text is quoted, long values are cut, None is "nothing"."""
    if value is None:
        return "nothing"
    text = f'"{value}"' if isinstance(value, str) else repr(value)
    text = text.lower() if isinstance(value, bool) else text
    return text if len(text) <= 60 else f"{text[:57]}..."

"""Value types of jobs: forces, speeds, cutting data; as pydantic types in SI."""

from __future__ import annotations

from contextlib import suppress
from typing import Annotated, Any

import numpy as np

from stiffscope.path.cutting import cutting_materials
from stiffscope.path.toolpath import MOST_LOAD
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.tables import one_of
from stiffscope.robot.file.values import Reads

_FORCE = q.Dimension("a force of a process", "N", "100 N", most=MOST_LOAD)
_SPEED = q.Dimension("a speed", "m/s", "600 mm/min", 1e-9, 1e3)
_TURNS = q.Dimension("a rotational speed", "Hz", "9000 rpm", 1e-6, 1e5)
_STRENGTH = q.Dimension("a yield strength", "Pa", "355 MPa", 1e3, 1e12)
_STRESS = q.Dimension("a specific cutting force", "Pa", "2220 N/mm^2", 1e6, 1e12)
_RATIO = q.Dimension("a ratio of forces", "", "0.3", most=10.0)
_ENTERING = q.Dimension("an entering angle", "rad", "90 deg", most=np.pi / 2 + 1e-9)
_POINT = q.Dimension("a point angle", "rad", "118 deg", most=np.pi)

# 1 rev/s in each unit of rotational speed
_A_SECOND = {
    "rpm": 60.0,
    "1/min": 60.0,
    "rev/min": 60.0,
    "Hz": 1.0,
    "1/s": 1.0,
    "rev/s": 1.0,
}


def _speed(value: Any) -> float:
    """Return a rotational speed in rev/s from a number in rev/s or a text with a unit."""
    if not isinstance(value, str):
        return q.to_si(value, _TURNS)
    number, _, unit = value.strip().partition(" ")
    a_second = _A_SECOND.get(unit.strip())
    turns = None
    with suppress(ValueError):
        turns = float(number)
    if a_second is None or turns is None:
        units = ", ".join(_A_SECOND)
        raise ValueError(
            f'expected a rotational speed such as "9000 rpm" ({units}), got "{value}"'
        )
    return q.to_si(turns / a_second, _TURNS)


def read_as(dimension: q.Dimension, says: str, sign: str = "positive") -> Reads:
    """Return a reader of a quantity; ``says``: what is expected if it is missing."""
    return Reads(lambda value: q.to_si(value, dimension, sign=sign), says=says)


Force = Annotated[float, read_as(_FORCE, 'a force such as "100 N"', "any")]
Feed = Annotated[float, read_as(_SPEED, 'a speed such as "600 mm/min"')]
Turns = Annotated[float, Reads(_speed, says='a rotational speed such as "9000 rpm"')]
Stress = Annotated[float, read_as(_STRESS, 'such as "2220 N/mm^2"')]
Cut = Annotated[
    str,
    Reads(
        lambda name: one_of(name, cutting_materials(), "a material"),
        says='a name such as "C45E"',
    ),
]
Strength = Annotated[float, read_as(_STRENGTH, 'a strength such as "355 MPa"')]
Share = Annotated[float, read_as(q.NUMBER, "a number", "non-negative")]
Ratio = Annotated[float, read_as(_RATIO, "a ratio of forces", "non-negative")]
EnteringAngle = Annotated[float, read_as(_ENTERING, 'an angle such as "90 deg"')]
PointAngle = Annotated[float, read_as(_POINT, 'an angle such as "118 deg"')]

"""Sections ``[responses.NAME]`` of a campaign.toml: how a file of frequency responses was measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from stiffscope.errors import require, require_given
from stiffscope.gap.campaign.header_values import ByName, Text, as_list, read_values
from stiffscope.responses.files import is_universal
from stiffscope.responses.tables import Channel, read_direction
from stiffscope.responses.units import read_unit
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file import values as v
from stiffscope.robot.file.parse import naming_key
from stiffscope.robot.file.values import Reads, Says, Section
from stiffscope.vjm.vibration.pencil import Drives

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stiffscope.responses.model import Direction, Quantity

_OF_TABLES = ("quantity", "units", "channels")
_UNKNOWN = "unknown"
_DECAY = q.Dimension("a duration", "s", "0.2 s", 1e-6, 1e7)
_BAND = 'two frequencies such as ["20 Hz", "900 Hz"]'
_AXES = 'three angles, a rotation vector, such as [0, 0, "90 deg"]'
_POINTS = 'points such as { 1 = { body = "platform", at = [0, 0, "135 mm"] } }'


def _read_mass(value: Any) -> float | None:
    return None if value == _UNKNOWN else q.to_si(value, q.MASS)


def _read_pose(value: Any) -> str | tuple[Any, ...]:
    valid = isinstance(value, list | tuple) or (
        isinstance(value, str) and value.strip()
    )
    require(valid, "", "the name of a pose or its coordinates", q.show_value(value))
    return value if isinstance(value, str) else tuple(as_list(value))


def _read_way(value: Any) -> Direction:
    return read_direction(value if isinstance(value, str) else "")


class PointSection(Section):
    """A point of the robot that was hit or listened to."""

    body: Annotated[Text, Says("the name of a body")]
    at: v.Point | None = None
    mass: Annotated[float | None, Reads(_read_mass, says='"3 g", or "unknown"')] = 0.0


class ChannelSection(Section):
    """Where a column of a table was hit, and where it listened."""

    force: Annotated[Any, Reads(_read_way, says='a point and a direction: "1:+z"')]
    motion: Annotated[Any, Reads(_read_way, says='a point and a direction: "7:-x"')]


class ResponseSection(Section):
    """A file of frequency responses."""

    exactly_one = (("pose", "joints"),)

    file: Annotated[Text, Says("the file of the responses")]
    pose: Annotated[
        Any, Reads(_read_pose, says="the name of a pose or its coordinates")
    ] = None
    joints: Annotated[dict[str, Any], Says("positions of drives by name")] = {}  # noqa: RUF012
    drives: Drives = "held"
    points: Annotated[dict[str, PointSection], ByName, Says(_POINTS)]
    averages: v.Counted = 1
    band: Annotated[
        tuple[v.Frequency, v.Frequency] | None,
        read_values((q.FREQUENCY,) * 2, _BAND, "positive"),
    ] = None
    exponential: Annotated[
        float | None, Reads(lambda value: q.to_si(value, _DECAY), says='"0.2 s"')
    ] = None
    axes: Annotated[tuple[float, float, float], read_values((q.ANGLE,) * 3, _AXES)] = (
        0.0,
        0.0,
        0.0,
    )
    quantity: Literal["receptance", "mobility", "accelerance"] | None = None
    units: Text | None = None
    channels: Annotated[dict[str, ChannelSection], ByName] = {}  # noqa: RUF012


@dataclass(frozen=True)
class MeasuredPoint:
    """A point of the robot that was hit or listened to."""

    name: str
    """Number of a node of the file, as text, or its name."""
    body: str
    """A rigid body, or an end of an elastic one."""
    at: tuple[float, float, float] | None
    """Home coordinates, m; None: the file's, or the end of the elastic body."""
    mass: float | None
    """Mass of the sensor, kg; None: unknown."""


@dataclass(frozen=True)
class ResponseSetup:
    """How the responses of one file were measured, SI."""

    name: str
    file: str
    pose: str | tuple[Any, ...] | None
    """Name of a pose, or its coordinates as written; None with `joints`."""
    joints: Mapping[str, Any]
    """Positions of drives, as written."""
    drives: Drives
    points: tuple[MeasuredPoint, ...]
    averages: int
    band: tuple[float, float] | None
    """Lowest and highest frequency used, Hz."""
    exponential: float | None
    """Time constant of an exponential window, s."""
    axes: tuple[float, float, float]
    """Rotation vector of the file's axes in {O}, rad."""
    quantity: Quantity
    factor: float
    """SI value of the unit of a table's values."""
    channels: Mapping[str, Channel]


def read_setup(name: str, section: ResponseSection) -> ResponseSetup:
    """Return a set-up of responses. Raises FieldError for what does not fit together."""
    key = ("responses", name)
    require(section.points, (*key, "points"), _POINTS, "none")
    if section.band is not None:
        low, high = section.band
        require(
            low < high,
            (*key, "band"),
            f"{_BAND}, the lower first",
            f"{low:g}, {high:g}",
        )
    quantity, factor = _read_quantity(key, section)
    return ResponseSetup(
        name=name,
        file=section.file,
        pose=section.pose,
        joints=section.joints,
        drives=section.drives,
        points=tuple(
            MeasuredPoint(point, each.body, each.at, each.mass)
            for point, each in section.points.items()
        ),
        averages=section.averages,
        band=section.band,
        exponential=section.exponential,
        axes=section.axes,
        quantity=quantity,
        factor=factor,
        channels={
            column: Channel(each.force, each.motion)
            for column, each in section.channels.items()
        },
    )


def _read_quantity(
    key: tuple[str, str], section: ResponseSection
) -> tuple[Quantity, float]:
    """Return the quantity and the SI value of the unit of a table; SI of a universal file."""
    if is_universal(Path(section.file)):
        stated = f"none: the universal file {section.file} states it"
        for word in _OF_TABLES:
            require(word not in section.model_fields_set, (*key, word), stated, "one")
        return "receptance", 1.0
    what = "one of receptance, mobility, accelerance for a table"
    given: Quantity | None = section.quantity
    quantity: Quantity = require_given(given, (*key, "quantity"), what)
    if section.units is None:
        return quantity, 1.0
    with naming_key(*key, "units", inner=True):
        return quantity, read_unit(section.units, quantity)

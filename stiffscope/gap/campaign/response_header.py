"""Sections ``[responses.NAME]`` of a campaign.toml: how a file of frequency responses was measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

from stiffscope.errors import InputError
from stiffscope.responses.files import is_universal
from stiffscope.responses.model import DERIVATIVES
from stiffscope.responses.tables import Channel, read_direction
from stiffscope.responses.units import read_unit
from stiffscope.robot.file.quantities import (
    ANGLE,
    FREQUENCY,
    MASS,
    Dimension,
    show_value,
)
from stiffscope.vjm.vibration.pencil import Drives

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stiffscope.gap.campaign.header_table import HeaderTable
    from stiffscope.responses.model import Quantity

RESPONSE_KEYS = (
    "file",
    "pose",
    "joints",
    "drives",
    "points",
    "averages",
    "band",
    "exponential",
    "axes",
    "quantity",
    "units",
    "channels",
)
POINT_KEYS = ("body", "at", "mass")
CHANNEL_KEYS = ("force", "motion")
_OF_TABLES = ("quantity", "units", "channels")
_UNKNOWN = "unknown"
_DECAY = Dimension("a duration", "s", "0.2 s", 1e-6, 1e7)


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


def read_setup(name: str, section: HeaderTable) -> ResponseSetup:
    """Return a set-up of responses. Raises InputError that names the line and the key."""
    section.check_keys(RESPONSE_KEYS)
    file = section.text("file")
    if file is None:
        raise section.refuse("file", "expected the file of the responses, got nothing")
    if ("pose" in section.data) == ("joints" in section.data):
        raise section.refuse("pose", "expected either pose or joints, one of the two")
    drives = cast(
        "Drives", section.choice("drives", get_args(Drives), get_args(Drives)[0])
    )
    averages = section.data.get("averages", 1)
    if not isinstance(averages, int) or isinstance(averages, bool) or averages < 1:
        expected = "expected a whole number of at least 1"
        raise section.refuse("averages", f"{expected}, got {show_value(averages)}")
    band = None
    if "band" in section.data:
        example = 'expected two frequencies such as ["20 Hz", "900 Hz"]'
        low, high = section.values("band", (FREQUENCY,) * 2, example, sign="positive")
        if low >= high:
            raise section.refuse("band", f"{example}, the lower first")
        band = (low, high)
    exponential = None
    if "exponential" in section.data:
        exponential = section.value("exponential", _DECAY)
    axes = (0.0, 0.0, 0.0)
    if "axes" in section.data:
        example = 'expected three angles, a rotation vector, such as [0, 0, "90 deg"]'
        x, y, z = section.values("axes", (ANGLE,) * 3, example)
        axes = (x, y, z)
    quantity, factor = _read_quantity(file, section)
    return ResponseSetup(
        name=name,
        file=file,
        pose=_read_pose(section),
        joints=section.table("joints").data,
        drives=drives,
        points=_read_points(section),
        averages=averages,
        band=band,
        exponential=exponential,
        axes=axes,
        quantity=quantity,
        factor=factor,
        channels=_read_channels(section),
    )


def _read_pose(section: HeaderTable) -> str | tuple[Any, ...] | None:
    value = section.data.get("pose")
    if isinstance(value, list):
        return tuple(cast("list[Any]", value))
    return section.text("pose")


def _read_points(section: HeaderTable) -> tuple[MeasuredPoint, ...]:
    points = list[MeasuredPoint]()
    for name, table in section.sections("points"):
        table.check_keys(POINT_KEYS)
        mass: float | None = 0.0
        if table.data.get("mass") == _UNKNOWN:
            mass = None
        elif "mass" in table.data:
            mass = table.value("mass", MASS)
        at = table.point("at") if "at" in table.data else None
        points.append(MeasuredPoint(name, table.body(), at, mass))
    if not points:
        example = '{ 1 = { body = "platform", at = [0, 0, "135 mm"] } }'
        raise section.refuse("points", f"expected points such as {example}, got none")
    return tuple(points)


def _read_quantity(file: str, section: HeaderTable) -> tuple[Quantity, float]:
    """Return the quantity and the SI value of the unit of a table; SI of a universal file."""
    if is_universal(Path(file)):
        message = f"expected none: the universal file {file} states it"
        section.refuse_others(_OF_TABLES, message)
        return "receptance", 1.0
    quantity = cast("Quantity", section.choice("quantity", tuple(DERIVATIVES)))
    unit = section.text("units")
    if unit is None:
        return quantity, 1.0
    try:
        return quantity, read_unit(unit, quantity)
    except InputError as error:
        message = str(error).partition(": ")[2]
        raise section.refuse("units", message) from None


def _read_channels(section: HeaderTable) -> dict[str, Channel]:
    """Return the channels of a table by column."""
    channels = dict[str, Channel]()
    for name, table in section.sections("channels"):
        table.check_keys(CHANNEL_KEYS)
        ends = list[Any]()
        for key in CHANNEL_KEYS:
            try:
                ends.append(read_direction(table.text(key) or ""))
            except ValueError as error:
                raise table.refuse(key, str(error)) from None
        channels[name] = Channel(*ends)
    return channels

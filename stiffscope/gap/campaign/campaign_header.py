"""Schema of campaign.toml, and what it says in SI."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Tag

from stiffscope.errors import naming, require, suggest
from stiffscope.gap.campaign.campaign import InstrumentFrame, LoadPoint, Sensor
from stiffscope.gap.campaign.header_values import (
    ByName,
    Text,
    Texts,
    as_table,
    read_values,
)
from stiffscope.gap.campaign.quantities import AXES, JOINT, QUANTITIES, WRENCH
from stiffscope.gap.campaign.response_header import (
    ChannelSection,
    PointSection,
    ResponseSection,
    ResponseSetup,
    read_setup,
)
from stiffscope.gap.effects.instruments import INSTRUMENT, ROTATION, TRANSLATION
from stiffscope.gap.effects.vocabulary import EFFECTS
from stiffscope.robot.file import values as v
from stiffscope.robot.file.description import ENDS
from stiffscope.robot.file.parse import Source, naming_key, parse_text
from stiffscope.robot.file.quantities import ANGLE, LENGTH, show_value
from stiffscope.robot.file.tables import one_of, read_table
from stiffscope.robot.file.values import Reads, Says, Section
from stiffscope.runtime.reading import read_text

if TYPE_CHECKING:
    from collections.abc import Mapping


NAME = "campaign.toml"
COLUMNS = (
    *AXES,
    "pose",
    "load",
    *WRENCH,
    "sensor",
    "quantity",
    "kind",
    "value",
    "sigma",
    "session",
)
"""Columns of a table of readings, beside q:JOINT."""
_INSIDE = re.compile(r"(?P<body>.+):(?P<share>\d*\.?\d+)")
_RESERVED = {INSTRUMENT, TRANSLATION, ROTATION, "f", *AXES, *QUANTITIES}
_SHOWN = f"{INSTRUMENT}, {TRANSLATION}, {ROTATION}, {' '.join(AXES)} f and quantities such as dx, kx or f1"
_POSE = (*(LENGTH,) * 3, *(ANGLE,) * 3)
_SIX = '"unknown" or six values such as ["2 m", 0, "1 m", 0, 0, "90 deg"]'
_read_six = read_values(_POSE, _SIX)


def _read_pose(value: Any) -> tuple[float, ...] | None:
    return None if value == "unknown" else _read_six.read(value)


class FrameSection(Section):
    """Axes of an instrument that is placed freely, such as a laser tracker."""

    pose: Annotated[tuple[float, ...] | None, Reads(_read_pose, says=_SIX)]
    sigma: Annotated[
        tuple[float, ...] | None,
        read_values(_POSE, "six standard uncertainties", "non-negative"),
    ] = None
    per: Literal["campaign", "session"] = "campaign"


class _SensorSection(Section):
    body: Annotated[Text, Says("the name of a body")]
    zero: Literal["none", "session"] = "none"


class RotationSection(_SensorSection):
    """An instrument that reads the rotation of a body about an axis."""

    measures: Literal["rotation"]
    direction: v.Direction
    against: Text = "ground"


class DisplacementSection(_SensorSection):
    """An instrument, such as a dial gauge, that reads the displacement of a point along a direction."""

    measures: Literal["displacement"]
    at: v.Point
    direction: v.Direction
    against: Text = "ground"


class TargetSection(_SensorSection):
    """A target that an instrument sees in its frame: its position, or its distance from the origin."""

    measures: Literal["position", "distance"]
    at: v.Point
    at_sigma: v.LengthOrZero = 0.0
    frame: Annotated[Text, Says("a name of [frames]")]


class LoadSection(Section):
    """A point of application of a load."""

    body: Annotated[Text, Says("the name of a body")]
    at: v.Point


_SENSORS = {
    "displacement": DisplacementSection,
    "rotation": RotationSection,
    "position": TargetSection,
    "distance": TargetSection,
}


def _check_measures(value: object) -> object:
    table = as_table(value)
    if table is not None:
        with naming("sensor.measures"):
            one_of(table.get("measures"), _SENSORS, "a kind of reading")
    return value


def _tag(value: object) -> str:
    table = as_table(value) or {}
    return f"tagged-{_SENSORS[table.get('measures', 'displacement')].__name__}"


AnySensor = Annotated[
    Annotated[
        Annotated[DisplacementSection, Tag("tagged-DisplacementSection")]
        | Annotated[RotationSection, Tag("tagged-RotationSection")]
        | Annotated[TargetSection, Tag("tagged-TargetSection")],
        Discriminator(_tag),
    ],
    BeforeValidator(_check_measures),
]


class CampaignSection(Section):
    """The whole of a campaign.toml."""

    exactly_one = (("robot", "predictions"),)

    robot: Text | None = None
    predictions: Text | None = None
    modelled: Texts | None = None
    components: Literal["fea", "beam", "published"] | None = None
    readings: Texts = ()
    units: dict[str, Text] = {}  # noqa: RUF012 (pydantic copies it)
    columns: dict[str, Text] = {}  # noqa: RUF012
    ignore: Texts = ()
    frames: Annotated[dict[str, FrameSection], ByName] = {}  # noqa: RUF012
    sensors: Annotated[dict[str, AnySensor], ByName] = {}  # noqa: RUF012
    loads: Annotated[dict[str, LoadSection], ByName] = {}  # noqa: RUF012
    responses: Annotated[dict[str, ResponseSection], ByName] = {}  # noqa: RUF012


SECTIONS = (
    ("campaign.toml", CampaignSection),
    ("[frames.NAME]", FrameSection),
    ('[sensors.NAME], measures = "displacement"', DisplacementSection),
    ('[sensors.NAME], measures = "rotation"', RotationSection),
    ('[sensors.NAME], measures = "position" or "distance"', TargetSection),
    ("[loads.NAME]", LoadSection),
    ("[responses.NAME]", ResponseSection),
    ("points of [responses.NAME]", PointSection),
    ("channels of [responses.NAME]", ChannelSection),
)


@dataclass(frozen=True)
class Header:
    """Contents of a campaign.toml."""

    robot: str | None
    modelled: tuple[str, ...] | None
    """Effects that the nominal model carries; None: own weight where the robot has it."""
    components: str | None
    """Source of the matrices of rods and plates; None: as in the robot file."""
    readings: tuple[str, ...]
    predictions: str | None
    source: Source
    """Its text, used to give line numbers in errors."""
    units: Mapping[str, str]
    """Units of columns that are not in SI."""
    columns: Mapping[str, str]
    """Headings of the tables, by the column that they stand for, where they are others."""
    ignore: tuple[str, ...]
    frames: tuple[InstrumentFrame, ...]
    sensors: tuple[Sensor, ...]
    loads: tuple[LoadPoint, ...]
    responses: tuple[ResponseSetup, ...]


def load_header(folder: Path) -> Header:
    """Load the campaign.toml of a folder. Raises InputError that names the line and the key."""
    require(folder.is_dir(), folder, "a campaign folder with a campaign.toml")
    text = read_text(folder / NAME, "a campaign.toml")
    source = Source(Path(NAME), text)
    data = parse_text(source.path, text, "a campaign.toml")
    with source.refusing():
        return _make_header(read_table(CampaignSection, data, ()), source)


def _make_header(top: CampaignSection, source: Source) -> Header:
    """Return the contents of a valid file. Raises FieldError for what does not fit together."""
    _check_names(top)
    sensors: list[Sensor] = []
    for name, section in top.sensors.items():
        sensors_of = _make_sensors(name, section, tuple(top.frames))
        for sensor in sensors_of:
            taken = _SHOWN if sensor.name in _RESERVED else "those of other sensors"
            twice = sensor.name in {other.name for other in sensors}
            require(
                not twice and sensor.name not in _RESERVED,
                ("sensors", name),
                f"another name than {taken}",
                show_value(sensor.name),
            )
        sensors += sensors_of
    frames = tuple(
        InstrumentFrame(name, frame.pose, frame.sigma, frame.per)
        for name, frame in top.frames.items()
    )
    loads = (LoadPoint(name, each.body, each.at) for name, each in top.loads.items())
    setups = (read_setup(name, each) for name, each in top.responses.items())
    return Header(
        robot=top.robot,
        modelled=top.modelled,
        components=top.components,
        readings=top.readings,
        predictions=top.predictions,
        source=source,
        units=top.units,
        columns=_read_headings(top.columns),
        ignore=top.ignore,
        frames=frames,
        sensors=tuple(sensors),
        loads=tuple(loads),
        responses=tuple(setups),
    )


def _check_names(top: CampaignSection) -> None:
    """Raise FieldError for names of effects, tables and columns that cannot be."""
    modelled = top.modelled or ()
    for number, effect in enumerate(modelled):
        require(
            effect in EFFECTS and effect not in modelled[:number],
            ("modelled",),
            f"effects among {', '.join(EFFECTS)}, each once",
            show_value(effect),
        )
    responses = ("responses",)
    described = not top.responses or top.robot is not None
    require(described, responses, "a robot, which predicts them", "none")
    names = top.readings
    require(
        (names or top.responses) and len(set(names)) == len(names),
        ("readings",),
        "one file name or a list of different ones",
        show_value(list(names)),
    )
    for name in ("value",):
        needed = "columns that are not needed"
        require(name not in top.ignore, ("ignore",), needed, f'"{name}"')
    for name, frame in top.frames.items():
        known = frame.pose is not None or frame.sigma is None
        require(
            known, ("frames", name, "sigma"), "none for a pose that is unknown", "six"
        )


def _read_headings(columns: Mapping[str, str]) -> dict[str, str]:
    """Return the tables' own headings by column."""
    headings: dict[str, str] = {}
    listed = ", ".join(COLUMNS)
    for column, heading in columns.items():
        key = ("columns", column)
        known = column in COLUMNS or column.startswith(JOINT)
        guess = "" if known else suggest(column, COLUMNS)
        require(known, key, f"one of {listed}, q:JOINT", f"{show_value(column)}{guess}")
        is_new = heading.strip() not in headings.values()
        require(
            is_new, key, "another heading than that of another column", repr(heading)
        )
        headings[column] = heading.strip()
    return headings


def _make_sensors(
    name: str,
    section: DisplacementSection | RotationSection | TargetSection,
    frames: tuple[str, ...],
) -> tuple[Sensor, ...]:
    """Return the channels of an instrument: three for a position, else one."""
    if isinstance(section, TargetSection):
        return _make_target(name, section, frames)
    size = math.hypot(*section.direction)
    x, y, z = section.direction
    sensor = Sensor(
        name,
        section.body,
        (x / size, y / size, z / size),
        (0.0, 0.0, 0.0) if isinstance(section, RotationSection) else section.at,
        section.measures,
        section.against,
        section.zero,
    )
    inside = _INSIDE.fullmatch(section.body)
    if inside is None:
        return (sensor,)
    share = float(inside["share"])
    require(
        0.0 < share < 1.0,
        ("sensors", name, "body"),
        'a place within a body such as "leg1.arm:0.5"',
        show_value(section.body),
    )
    return (replace(sensor, body=f"{inside['body']}.{ENDS[0]}", inside=share),)


def _make_target(
    name: str, section: TargetSection, frames: tuple[str, ...]
) -> tuple[Sensor, ...]:
    """Return the channels of a target."""
    with naming_key("sensors", name, "frame"):
        one_of(section.frame, frames, "a name of [frames]")
    x = (1.0, 0.0, 0.0)
    y = (0.0, 1.0, 0.0)
    z = (0.0, 0.0, 1.0)
    along = {f"{name}.x": x, f"{name}.y": y, f"{name}.z": z}
    if section.measures == "distance":
        along = {name: x}
    return tuple(
        Sensor(
            channel,
            section.body,
            way,
            section.at,
            section.measures,
            "ground",
            section.zero,
            section.frame,
            name,
            section.at_sigma,
        )
        for channel, way in along.items()
    )

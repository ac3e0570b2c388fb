"""Parsing and validation of campaign.toml."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from stiffscope.errors import meant, require
from stiffscope.gap.campaign.campaign import InstrumentFrame, LoadPoint, Sensor
from stiffscope.gap.campaign.header_table import HeaderTable
from stiffscope.gap.campaign.quantities import AXES, JOINT, QUANTITIES, WRENCH
from stiffscope.gap.campaign.response_header import ResponseSetup, read_setup
from stiffscope.gap.effects.instruments import INSTRUMENT, ROTATION, TRANSLATION
from stiffscope.gap.effects.vocabulary import EFFECTS
from stiffscope.robot.file.description import ENDS
from stiffscope.robot.file.parse import Source, parse_text
from stiffscope.robot.file.quantities import (
    LENGTH,
    Dimension,
    show_value,
    to_si,
)
from stiffscope.runtime.reading import read_text

if TYPE_CHECKING:
    from collections.abc import Mapping


NAME = "campaign.toml"
COMPONENTS = ("fea", "beam", "published")
MEASURES = ("displacement", "rotation", "position", "distance")
KEYS = (
    "robot",
    "modelled",
    "components",
    "readings",
    "predictions",
    "units",
    "columns",
    "ignore",
    "frames",
    "sensors",
    "loads",
    "responses",
)
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
ZEROS = ("none", "session")
SENSOR_KEYS = (
    "measures",
    "body",
    "at",
    "at_sigma",
    "direction",
    "against",
    "frame",
    "zero",
)
_INSIDE = re.compile(r"(?P<body>.+):(?P<share>\d*\.?\d+)")
FRAME_KEYS = ("pose", "sigma", "per")
LOAD_KEYS = ("body", "at")
_RESERVED = {INSTRUMENT, TRANSLATION, ROTATION, "f", *AXES, *QUANTITIES}
_SHOWN = f"{INSTRUMENT}, {TRANSLATION}, {ROTATION}, {' '.join(AXES)} f and quantities such as dx, kx or f1"
_ANGLE = Dimension("an angle", "rad", "90 deg", most=1e4)
_POSE = (*(LENGTH,) * 3, *(_ANGLE,) * 3)


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
    top = HeaderTable(source, (), parse_text(source.path, text, "a campaign.toml"))
    top.check_keys(KEYS)
    robot = top.text("robot")
    predictions = top.text("predictions")
    if (robot is None) == (predictions is None):
        key = "predictions" if robot else "robot"
        raise top.refuse(key, "expected either robot or predictions, one of the two")
    modelled = top.texts("modelled", ()) if "modelled" in top.data else None
    strange = [
        name
        for k, name in enumerate(modelled or ())
        if name not in EFFECTS or name in (modelled or ())[:k]
    ]
    if strange:
        message = f"expected effects among {', '.join(EFFECTS)}, each once, got {show_value(strange[0])}"
        raise top.refuse("modelled", message)
    setups = _read_setups(top)
    readings = _read_names(top, optional=bool(setups))
    ignore = top.texts("ignore", ())
    needed = [name for name in ("value",) if name in ignore]
    if needed:
        raise top.refuse(
            "ignore", f'expected columns that are not needed, got "{needed[0]}"'
        )
    units = top.table("units")
    frames = tuple(
        _read_frame(name, section) for name, section in top.sections("frames")
    )
    known = tuple(frame.name for frame in frames)
    sensors: list[Sensor] = []
    for name, section in top.sections("sensors"):
        sensors += _read_sensor(name, section, known)
    names = [sensor.name for sensor in sensors]
    for sensor in sensors:
        if names.count(sensor.name) > 1 or sensor.name in _RESERVED:
            taken = _SHOWN if sensor.name in _RESERVED else "those of other sensors"
            message = (
                f"expected another name than {taken}, got {show_value(sensor.name)}"
            )
            raise top.table("sensors").refuse(sensor.target or sensor.name, message)
    loads: list[LoadPoint] = []
    for name, section in top.sections("loads"):
        section.check_keys(LOAD_KEYS)
        loads.append(LoadPoint(name, section.body(), section.point("at")))
    components = (
        top.choice("components", COMPONENTS) if "components" in top.data else None
    )
    return Header(
        robot=robot,
        modelled=modelled,
        components=components,
        readings=readings,
        predictions=predictions,
        source=source,
        units={column: unit for column in units.data if (unit := units.text(column))},
        columns=_read_headings(top),
        ignore=ignore,
        frames=frames,
        sensors=tuple(sensors),
        loads=tuple(loads),
        responses=setups,
    )


def _read_setups(top: HeaderTable) -> tuple[ResponseSetup, ...]:
    sections = top.sections("responses")
    if sections and "robot" not in top.data:
        raise top.refuse("responses", "expected a robot, which predicts them, got none")
    return tuple(read_setup(name, section) for name, section in sections)


def _read_names(top: HeaderTable, *, optional: bool) -> tuple[str, ...]:
    """Return the names of the tables of readings."""
    readings = top.texts("readings", () if optional else None)
    if not (readings or optional) or len(set(readings)) < len(readings):
        raise top.refuse(
            "readings", "expected one file name or a list of different ones"
        )
    return readings


def _read_headings(top: HeaderTable) -> dict[str, str]:
    """Return the tables' own headings by column."""
    section = top.table("columns")
    headings: dict[str, str] = {}
    for column in section.data:
        if column not in COLUMNS and not column.startswith(JOINT):
            expected = f"expected one of {', '.join(COLUMNS)}, q:JOINT"
            raise section.refuse(column, f"{expected}{meant(column, COLUMNS)}")
        heading = section.text(column) or ""
        if heading.strip() in headings.values():
            raise section.refuse(column, f"expected another heading than {heading!a}")
        headings[column] = heading.strip()
    return headings


def _read_frame(name: str, section: HeaderTable) -> InstrumentFrame:
    section.check_keys(FRAME_KEYS)
    per = section.choice("per", ("campaign", "session"), "campaign")
    if section.data.get("pose") == "unknown":
        if "sigma" in section.data:
            raise section.refuse("sigma", "expected none for a pose that is unknown")
        return InstrumentFrame(name, per=per)
    example = (
        'expected "unknown" or six values such as ["2 m", 0, "1 m", 0, 0, "90 deg"]'
    )
    pose = section.values("pose", _POSE, example)
    sigma = None
    if "sigma" in section.data:
        example = "expected six standard uncertainties"
        sigma = section.values("sigma", _POSE, example, sign="non-negative")
    return InstrumentFrame(name, pose, sigma, per)


def _read_sensor(
    name: str, section: HeaderTable, frames: tuple[str, ...]
) -> tuple[Sensor, ...]:
    """Return the channels of an instrument: three for a position, else one."""
    section.check_keys(SENSOR_KEYS)
    measures = section.choice("measures", MEASURES)
    if measures in {"position", "distance"}:
        return _read_target(name, section, frames)
    section.refuse_others(("frame", "at_sigma"), f"expected none for a {measures}")
    body = section.body()
    direction = section.direction("direction")
    against = section.text("against") or "ground"
    zero = section.choice("zero", ZEROS, "none")
    at = (0.0, 0.0, 0.0)
    if measures == "rotation":
        message = "expected no point for a rotation, which is the whole body's"
        section.refuse_others(("at",), message)
    else:
        at = section.point("at")
    inside = _INSIDE.fullmatch(body)
    if inside is None:
        return (Sensor(name, body, direction, at, measures, against, zero),)
    share = float(inside["share"])
    if not 0.0 < share < 1.0:
        expected = 'expected a place within a body such as "leg1.arm:0.5"'
        raise section.refuse("body", f"{expected}, got {show_value(body)}")
    base = f"{inside['body']}.{ENDS[0]}"
    return (Sensor(name, base, direction, at, measures, against, zero, inside=share),)


def _read_target(
    name: str, section: HeaderTable, frames: tuple[str, ...]
) -> tuple[Sensor, ...]:
    """Return the channels of a target."""
    measures = section.text("measures") or ""
    message = f"expected none for a {measures}, which a frame sees"
    section.refuse_others(("direction", "against"), message)
    sigma = 0.0
    if "at_sigma" in section.data:
        try:
            sigma = to_si(section.data["at_sigma"], LENGTH, sign="non-negative")
        except ValueError as error:
            raise section.refuse("at_sigma", str(error)) from None
    body = section.body()
    at = section.point("at")
    frame = section.choice("frame", frames)
    zero = section.choice("zero", ZEROS, "none")
    x = (1.0, 0.0, 0.0)
    y = (0.0, 1.0, 0.0)
    z = (0.0, 0.0, 1.0)
    along = {f"{name}.x": x, f"{name}.y": y, f"{name}.z": z}
    if measures == "distance":
        along = {name: x}
    return tuple(
        Sensor(channel, body, way, at, measures, "ground", zero, frame, name, sigma)
        for channel, way in along.items()
    )

"""The campaign.toml of a campaign, checked key by key."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.campaign import LoadPoint, Sensor
from stiffscope.robot.file.quantities import LENGTH, shown, to_si
from stiffscope.robot.file.source import Source, parse_text
from stiffscope.robot.vocabulary import EFFECTS
from stiffscope.runtime.reading import read_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stiffscope.robot.file.positions import Key

NAME = "campaign.toml"
COMPONENTS = ("fea", "beam", "published")
MEASURES = ("displacement", "rotation")
ZEROS = ("none", "session")
_KEYS = (
    *("robot", "modelled", "components", "readings", "predictions"),
    *("units", "ignore", "sensors", "loads"),
)
_SENSOR = ("measures", "body", "at", "direction", "against", "zero")
_LOAD = ("body", "at")


@dataclass(frozen=True)
class Header:
    """What a campaign.toml says."""

    robot: str | None
    modelled: tuple[str, ...]
    components: str
    readings: tuple[str, ...]
    predictions: str | None
    source: Source
    """Its text, by which refusals name the line of a key."""
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    """Unit of each column that is not SI."""
    ignore: tuple[str, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    loads: tuple[LoadPoint, ...] = ()


def load_header(folder: Path) -> Header:
    """Return what a campaign folder's campaign.toml says. Raises InputError that names line and key."""
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a campaign folder with a campaign.toml")
    text = read_text(folder / NAME, "a campaign.toml")
    source = Source(Path(NAME), text)
    top = _Table(source, (), parse_text(source.path, text, "a campaign.toml"))
    top.check_keys(_KEYS)
    robot, predictions = top.text("robot"), top.text("predictions")
    if (robot is None) == (predictions is None):
        raise top.refuse("predictions" if robot else "robot", "expected either robot or predictions, one of the two")
    components = top.choice("components", COMPONENTS, "fea")
    modelled = top.texts("modelled", ())
    strange = [name for name in modelled if name not in EFFECTS]
    if strange:
        raise top.refuse("modelled", f"expected effects among {', '.join(EFFECTS)}, got {shown(strange[0])}")
    readings = top.texts("readings")
    if not readings or len(set(readings)) < len(readings):
        raise top.refuse("readings", "expected one file name or a list of different ones")
    units = {column: unit for column in top.table("units").data if (unit := top.table("units").text(column))}
    sensors = tuple(_sensor(name, section) for name, section in top.sections("sensors"))
    loads = tuple(_load(name, section) for name, section in top.sections("loads"))
    return Header(
        robot, modelled, components, readings, predictions, source, units, top.texts("ignore", ()), sensors, loads
    )


def _sensor(name: str, section: _Table) -> Sensor:
    section.check_keys(_SENSOR)
    measures = section.choice("measures", MEASURES)
    body = section.body()
    direction = np.array(section.three("direction", lengths=False))
    size = float(np.linalg.norm(direction))
    if not size > 0.0:
        raise section.refuse("direction", f"expected a direction, got {shown(section.data['direction'])}")
    unit = tuple(float(v) for v in direction / size)
    if measures == "rotation" and "at" in section.data:
        raise section.refuse("at", "expected no point for a rotation, which is the whole body's")
    at = (0.0, 0.0, 0.0) if measures == "rotation" else section.three("at")
    against = section.text("against") or "ground"
    zero = section.choice("zero", ZEROS, "none")
    return Sensor(name, body, (unit[0], unit[1], unit[2]), at, measures, against, zero)


def _load(name: str, section: _Table) -> LoadPoint:
    section.check_keys(_LOAD)
    return LoadPoint(name, section.body(), section.three("at"))


@dataclass(frozen=True)
class _Table:
    """A table of the file, whose refusals name line and key."""

    source: Source
    here: Key
    data: dict[str, Any]

    def refuse(self, key: str, message: str) -> InputError:
        return self.source.refuse((*self.here, key), message)

    def check_keys(self, keys: tuple[str, ...]) -> None:
        unknown = [key for key in self.data if key not in keys]
        if unknown:
            raise self.refuse(unknown[0], f"expected one of {', '.join(keys)}")

    def text(self, key: str) -> str | None:
        value = self.data.get(key)
        if key in self.data and (not isinstance(value, str) or not value.strip()):
            raise self.refuse(key, f"expected a text, got {shown(value)}")
        return value

    def texts(self, key: str, default: tuple[str, ...] | None = None) -> tuple[str, ...]:
        """A list of texts, or a single one."""
        value = self.data.get(key, default)
        if default is not None and key not in self.data:
            return default
        listed = cast("list[Any]", value) if isinstance(value, list) else [value]
        if not all(isinstance(v, str) and v for v in listed):
            raise self.refuse(key, f"expected a list of texts, got {shown(value)}")
        return tuple(listed)

    def choice(self, key: str, choices: tuple[str, ...], default: str | None = None) -> str:
        value = self.text(key) if key in self.data or default is None else default
        if value not in choices:
            raise self.refuse(key, f"expected one of {', '.join(choices)}, got {shown(value)}")
        return value

    def body(self) -> str:
        value = self.text("body")
        if value is None:
            raise self.refuse("body", "expected the name of a body, got nothing")
        return value

    def three(self, key: str, *, lengths: bool = True) -> tuple[float, float, float]:
        value: Any = self.data.get(key)
        what = 'three lengths such as ["75 mm", 0, "-15 mm"]' if lengths else "three numbers such as [0, 0, 1]"
        if not isinstance(value, list) or len(cast("list[Any]", value)) != 3:
            raise self.refuse(key, f"expected {what}, got {shown(value)}")
        out: list[float] = []
        for each in cast("list[Any]", value):
            if not lengths and not isinstance(each, int | float):
                raise self.refuse(key, f"expected {what}, got {shown(value)}")
            try:
                out.append(to_si(each, LENGTH, sign="any"))
            except ValueError as error:
                raise self.refuse(key, str(error)) from None
        return out[0], out[1], out[2]

    def table(self, key: str) -> _Table:
        value = self.data.get(key, {})
        if not isinstance(value, dict):
            raise self.refuse(key, f"expected a table, got {shown(value)}")
        return _Table(self.source, (*self.here, key), cast("dict[str, Any]", value))

    def sections(self, key: str) -> list[tuple[str, _Table]]:
        found = self.table(key)
        return [(name, found.table(name)) for name in found.data]

"""The campaign.toml of a campaign, checked key by key."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign import LoadPoint, Sensor
from stiffscope.robot.quantities import LENGTH, shown, to_si
from stiffscope.robot.vocabulary import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

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
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    """Unit of each column that is not SI."""
    ignore: tuple[str, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    loads: tuple[LoadPoint, ...] = ()


def load_header(folder: Path) -> Header:
    """Return what a campaign folder's campaign.toml says. Raises InputError that names the key."""
    path = folder / "campaign.toml"
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a campaign folder with a campaign.toml")
    try:
        data = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError:
        raise InputError(f"{folder}: expected a campaign.toml in this folder") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"campaign.toml: expected TOML, got {error}") from None
    _known(data, _KEYS, "")
    robot, predictions = _text(data, "robot"), _text(data, "predictions")
    if (robot is None) == (predictions is None):
        raise InputError("campaign.toml: expected either robot or predictions, one of the two")
    components = _text(data, "components") or "fea"
    if components not in COMPONENTS:
        raise InputError(f"campaign.toml: components: expected one of {', '.join(COMPONENTS)}, got {components!r}")
    modelled = _texts(data.get("modelled", []), "modelled")
    strange = [name for name in modelled if name not in EFFECTS]
    if strange:
        valid = ", ".join(EFFECTS)
        raise InputError(f"campaign.toml: modelled: expected effects among {valid}, got {strange[0]!r}")
    listed = data.get("readings")
    readings = _texts([listed] if isinstance(listed, str) else listed, "readings")
    if not readings or len(set(readings)) < len(readings):
        raise InputError("campaign.toml: readings: expected one file name or a list of different ones")
    units = {key: _text(_table(data, "units"), key, "units.") or "" for key in _table(data, "units")}
    sensors = tuple(_sensor(name, section) for name, section in _sections(data, "sensors"))
    loads = tuple(_load(name, section) for name, section in _sections(data, "loads"))
    ignore = _texts(data.get("ignore", []), "ignore")
    return Header(robot, modelled, components, readings, predictions, units, ignore, sensors, loads)


def _sensor(name: str, section: dict[str, Any]) -> Sensor:
    here = f"sensors.{name}."
    _known(section, _SENSOR, here)
    measures = _choice(section, "measures", MEASURES, here)
    body = _needed(section, "body", here)
    direction = np.array(_three(section, "direction", here, lengths=False))
    size = float(np.linalg.norm(direction))
    if not size > 0.0:
        raise InputError(f"campaign.toml: {here}direction: expected a direction, got {shown(section['direction'])}")
    unit = tuple(float(v) for v in direction / size)
    if measures == "rotation" and "at" in section:
        raise InputError(f"campaign.toml: {here}at: expected no point for a rotation, which is the whole body's")
    at = (0.0, 0.0, 0.0) if measures == "rotation" else _three(section, "at", here)
    against = _text(section, "against", here) or "ground"
    zero = _choice(section, "zero", ZEROS, here) if "zero" in section else "none"
    return Sensor(name, body, (unit[0], unit[1], unit[2]), at, measures, against, zero)


def _load(name: str, section: dict[str, Any]) -> LoadPoint:
    here = f"loads.{name}."
    _known(section, _LOAD, here)
    return LoadPoint(name, _needed(section, "body", here), _three(section, "at", here))


def _three(section: dict[str, Any], key: str, here: str, *, lengths: bool = True) -> tuple[float, float, float]:
    value = section.get(key)
    what = 'three lengths such as ["75 mm", 0, "-15 mm"]' if lengths else "three numbers such as [0, 0, 1]"
    if not isinstance(value, list) or len(cast("list[Any]", value)) != 3:
        raise InputError(f"campaign.toml: {here}{key}: expected {what}, got {shown(value)}")
    out: list[float] = []
    for each in cast("list[Any]", value):
        if not lengths and not isinstance(each, int | float):
            raise InputError(f"campaign.toml: {here}{key}: expected {what}, got {shown(value)}")
        try:
            out.append(to_si(each, LENGTH, sign="any"))
        except ValueError as error:
            raise InputError(f"campaign.toml: {here}{key}: {error}") from None
    return out[0], out[1], out[2]


def _sections(data: dict[str, Any], key: str) -> list[tuple[str, dict[str, Any]]]:
    found = _table(data, key)
    return [(name, _table(found, name, f"{key}.")) for name in found]


def _table(data: dict[str, Any], key: str, here: str = "") -> dict[str, Any]:
    value = data.get(key, {})
    if not isinstance(value, dict):
        raise InputError(f"campaign.toml: {here}{key}: expected a table, got {shown(value)}")
    return cast("dict[str, Any]", value)


def _known(data: dict[str, Any], keys: tuple[str, ...], here: str) -> None:
    unknown = [key for key in data if key not in keys]
    if unknown:
        raise InputError(f"campaign.toml: {here}{unknown[0]}: expected one of {', '.join(keys)}")


def _choice(data: dict[str, Any], key: str, choices: tuple[str, ...], here: str) -> str:
    value = _text(data, key, here)
    if value not in choices:
        raise InputError(f"campaign.toml: {here}{key}: expected one of {', '.join(choices)}, got {shown(value)}")
    return value


def _needed(data: dict[str, Any], key: str, here: str) -> str:
    value = _text(data, key, here)
    if value is None:
        raise InputError(f"campaign.toml: {here}{key}: expected the name of a body, got nothing")
    return value


def _text(data: dict[str, Any], key: str, here: str = "") -> str | None:
    value = data.get(key)
    if key in data and (not isinstance(value, str) or not value.strip()):
        raise InputError(f"campaign.toml: {here}{key}: expected a text, got {value!r}")
    return value


def _texts(value: Any, key: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(v, str) and v for v in cast("list[Any]", value)):
        raise InputError(f"campaign.toml: {key}: expected a list of texts, got {value!r}")
    return tuple(cast("list[str]", value))

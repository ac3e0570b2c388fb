"""The campaign.toml of a campaign, checked key by key."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from stiffscope.errors import InputError
from stiffscope.robot.vocabulary import VOCABULARY

if TYPE_CHECKING:
    from pathlib import Path

COMPONENTS = ("fea", "beam", "published")
_KEYS = ("robot", "modelled", "components", "readings", "predictions")


@dataclass(frozen=True)
class Header:
    """What a campaign.toml says."""

    robot: str | None
    modelled: tuple[str, ...]
    components: str
    readings: tuple[str, ...]
    predictions: str | None


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
    unknown = [key for key in data if key not in _KEYS]
    if unknown:
        raise InputError(f"campaign.toml: {unknown[0]}: expected one of {', '.join(_KEYS)}")
    robot, predictions = _text(data, "robot"), _text(data, "predictions")
    if (robot is None) == (predictions is None):
        raise InputError("campaign.toml: expected either robot or predictions, one of the two")
    components = _text(data, "components") or "fea"
    if components not in COMPONENTS:
        raise InputError(f"campaign.toml: components: expected one of {', '.join(COMPONENTS)}, got {components!r}")
    modelled = _texts(data.get("modelled", []), "modelled")
    strange = [name for name in modelled if name not in VOCABULARY]
    if strange:
        valid = ", ".join(VOCABULARY)
        raise InputError(f"campaign.toml: modelled: expected effects among {valid}, got {strange[0]!r}")
    listed = data.get("readings")
    readings = _texts([listed] if isinstance(listed, str) else listed, "readings")
    if not readings or len(set(readings)) < len(readings):
        raise InputError("campaign.toml: readings: expected one file name or a list of different ones")
    return Header(robot, modelled, components, readings, predictions)


def _text(data: dict[str, Any], key: str) -> str | None:
    value = data.get(key)
    if key in data and (not isinstance(value, str) or not value.strip()):
        raise InputError(f"campaign.toml: {key}: expected a text, got {value!r}")
    return value


def _texts(value: Any, key: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(v, str) and v for v in cast("list[Any]", value)):
        raise InputError(f"campaign.toml: {key}: expected a list of texts, got {value!r}")
    return tuple(cast("list[str]", value))

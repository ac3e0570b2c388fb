"""`--set NAME.KEY=VALUE`: which value of a robot file a name with dots means, and putting it there."""

from __future__ import annotations

import difflib
import tomllib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

NAMED = ("parts", "joints", "bodies")  # sections whose names may be given alone
TABLES = (*NAMED, "parameters", "tool", "gravity", "poses", "map", "materials", "groups")
_NESTED = (*NAMED, "materials", "poses", "groups", "parameters")  # sections that hold names
MOST_CHARACTERS = 5_000  # a matrix takes a thousand
_EXAMPLE = "slider.thickness=25mm"


@dataclass(frozen=True)
class Override:
    """A value for a key, and the text that asked for it."""

    key: tuple[str, ...]
    value: Any
    text: str


def split(text: str) -> tuple[str, Any]:
    """Split "slider.thickness=25mm"; the value is TOML where it reads as such, else a string. Raises InputError."""
    if len(text) > MOST_CHARACTERS:
        raise InputError(f"--set {text[:60]}…: expected at most {MOST_CHARACTERS:,} characters, got {len(text):,}")
    name, equals, value = text.partition("=")
    name = name.strip().replace('"', "")
    if not equals or not value.strip() or not all(name.split(".")) or "." not in name:
        raise InputError(f'--set {text}: expected NAME.KEY=VALUE such as {_EXAMPLE}, got "{text}"')
    try:
        return name, tomllib.loads(f"value = {value.strip()}")["value"]
    except (KeyError, ValueError, RecursionError):  # a text without quotes, most often
        return name, value.strip()


def located(text: str, names: Mapping[str, Iterable[str]], keys: Mapping[str, Collection[str]]) -> Override:
    """Find what an override means.

    Parameters
    ----------
    text
        As `--set` takes it.
    names
        Names that each section of the file holds, copies included.
    keys
        Keys that a table of each section of `NAMED` may have: they decide where two sections share a name.

    Raises
    ------
    InputError
        Nothing has such a name; the message says what has.

    """
    name, value = split(text)
    found: list[tuple[str, ...]] = [
        (section, *rest) for section in NAMED for rest in _ways(name, names.get(section, ()))
    ]
    section, _, rest = name.partition(".")
    if section in TABLES:
        inside = next(iter(_ways(rest, names.get(section, ()))), None) if section in _NESTED else None
        found.append((section, *(inside or rest.split("."))))
    if not found:
        known = [each for section in NAMED for each in names.get(section, ())]
        close = difflib.get_close_matches(section, [*known, *TABLES], n=1, cutoff=0.6)
        guess = f'; did you mean "{close[0]}"?' if close else ""
        shown = ", ".join(known[:12]) + (", …" if len(known) > 12 else "")
        raise InputError(
            f'--set {text}: expected NAME.KEY=VALUE with a NAME of {shown} or {", ".join(TABLES)}, got "{name}"{guess}'
        )
    fitting = [key for key in found if len(key) > 2 and key[2] in keys.get(key[0], ())]
    return Override((fitting or found)[0], value, f"--set {text}")


def _ways(name: str, known: Iterable[str]) -> list[tuple[str, ...]]:
    """A known name and the keys after it, longest name first."""
    fitting = sorted((each for each in known if name.startswith(f"{each}.")), key=len, reverse=True)
    return [(each, *name[len(each) + 1 :].split(".")) for each in fitting]


def assign(data: dict[str, Any], override: Override) -> None:
    """Put a value where an override wants it. Raises InputError where a value stands in its way."""
    table: Any = data
    for part in override.key[:-1]:
        if not isinstance(table, dict):
            break
        table = table.setdefault(part, {})
    last = override.key[-1]
    if isinstance(table, list) and str(last).isdigit() and int(last) < len(table):
        table[int(last)] = override.value
    elif isinstance(table, dict):
        table[last] = override.value
    else:
        raise InputError(f'{override.text}: expected a key of a table, got "{last}" of a value that is none')

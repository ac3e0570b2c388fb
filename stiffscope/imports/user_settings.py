"""User settings of an import, which override findings: by option, in Python or `assembly.toml`."""

from __future__ import annotations

import fnmatch
from collections import defaultdict
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError, require
from stiffscope.imports.contact_joints import measure_size
from stiffscope.imports.import_record import SETTINGS
from stiffscope.imports.part_motions import Freedom, joint_freedom
from stiffscope.robot.file.parse import Source, Text, parse_text, place_of
from stiffscope.robot.file.tables import list_some
from stiffscope.runtime.reading import read_text, show_path
from stiffscope.vjm.model.joints import FREE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from stiffscope.cad.assembly import Instance
    from stiffscope.cad.contacts import Contact


_SINGLE = {"ground", "tool"}


@dataclass(frozen=True)
class ImportSettings:
    """User settings; names are patterns such as "leg*", joints are "A/B=KIND" or "A/B=none"."""

    ground: str | None = None
    tool: str | None = None
    joint: tuple[str, ...] = ()
    weld: tuple[str, ...] = ()
    part: tuple[str, ...] = ()
    rigid: tuple[str, ...] = ()
    material: tuple[str, ...] = ()
    drive: tuple[str, ...] = ()


def settings_beside(path: Path, settings: ImportSettings) -> ImportSettings:
    """Return the settings of `assembly.toml` beside a file; ``settings`` takes precedence. InputError if invalid."""
    file = path.with_name(SETTINGS)
    if not file.is_file():
        return settings
    what = "what is said of an assembly"
    source = Source(file, read_text(file, what))
    table = parse_text(file, source.text, what)
    held = read_settings(
        table, lambda *key: f"{show_path(file)}:{source.line(key)}: {key[0]}"
    )
    lists = {
        field.name: (*getattr(held, field.name), *getattr(settings, field.name))
        for field in fields(ImportSettings)
        if field.name not in _SINGLE
    }
    return ImportSettings(
        settings.ground or held.ground, settings.tool or held.tool, **lists
    )


def read_settings(
    table: Mapping[str, Any], place: Callable[..., str] | None = None
) -> ImportSettings:
    """Read settings: texts, lists of texts, or tables such as ``material = {"*": "steel"}``.

    Raises InputError if invalid; the message begins with the key's ``place``, if given.
    """
    known = [field.name for field in fields(ImportSettings)]
    values: dict[str, Any] = {}
    for key, value in table.items():
        where = key if place is None else place(key)
        require(key in known, where, f"one of {', '.join(known)}", f'"{key}"')
        tables = isinstance(value, dict) and key in {"joint", "material", "drive"}
        texts: Any = (
            [f"{name}={each}" for name, each in value.items()] if tables else value
        )
        texts = [texts] if isinstance(texts, str) else texts
        listed = isinstance(texts, (list, tuple)) and all(
            isinstance(text, str) for text in texts
        )
        valid = listed and (key not in _SINGLE or len(texts) == 1)
        expected = "a name" if key in _SINGLE else "a list of texts"
        require(valid, where, expected, repr(value))
        if place is not None:
            keys = value if tables else range(len(texts))
            texts = [
                Text(text, place(key, each))
                for text, each in zip(texts, keys, strict=True)
            ]
        values[key] = texts[0] if key in _SINGLE else tuple(texts)
    return ImportSettings(**values)


def match_solids(
    solids: Sequence[Instance], patterns: Iterable[str], option: str
) -> set[int]:
    """Return the solids that match patterns; raise InputError if a pattern matches none."""
    matching = set[int]()
    for pattern in patterns:
        names = enumerate(solid.name.lower() for solid in solids)
        here = {n for n, name in names if fnmatch.fnmatch(name, pattern.lower())}
        if not here:
            known = list_some([solid.name for solid in solids])
            where = place_of(option, pattern)
            raise InputError(
                f'{where}: expected the name of a solid ({known}), got "{pattern}"'
            )
        matching |= here
    return matching


def apply_stated_joints(
    joints: Sequence[Freedom],
    texts: Sequence[str],
    solids: Sequence[Instance],
    contacts: Sequence[Contact],
) -> tuple[list[Freedom], set[frozenset[int]]]:
    """Replace the joints found by the user's, "A/B=KIND" or "A/B=none", where A, B are patterns.

    Also returns the pairs of solids that were named.

    Raises InputError if no two solids in contact match, or the kind of joint is unknown.
    """
    remaining = list(joints)
    named = set[frozenset[int]]()
    scale = measure_size(solids)
    for text in texts:
        pair, _, kind = (piece.strip() for piece in text.rpartition("="))
        where = place_of("--joint", text)
        first, _, second = (piece.strip() for piece in pair.partition("/"))
        valid = kind in {*FREE, "none"} and first and second
        kinds = ", ".join((*FREE, "none"))
        require(valid, where, f"A/B=KIND with one of {kinds}", f'"{text}"')
        ones, others = (
            match_solids(solids, (name,), f"{where}: solid") for name in (first, second)
        )
        pairs = {frozenset(each) for each in product(ones, others)}
        here = defaultdict[frozenset[int], list[Any]](list)
        for contact in (*remaining, *contacts):
            both = frozenset((contact.first, contact.second))
            if both in pairs:
                here[both].append(contact)
        got = f'"{first}" and "{second}", which do not'
        require(here, where, "two solids that touch", got)
        named |= here.keys()
        remaining = [joint for joint in remaining if frozenset(joint.ends) not in here]
        if kind != "none":
            remaining += [_as_kind(kind, touching, scale) for touching in here.values()]
    return remaining, named


def _as_kind(kind: str, here: Sequence[Freedom | Contact], scale: float) -> Freedom:
    """Return a joint of a kind between two solids, at the joint found or at the largest contact."""
    joint: Any = next((link for link in here if isinstance(link, Freedom)), None)
    touching = [link for link in here if not isinstance(link, Freedom)]
    if touching and (joint is None or joint.axis is None):
        best = max(touching, key=lambda c: (c.kind != "plane", c.size))
        ends = best.first, best.second
        one, other = (tuple(sorted({c.face_of(n) for c in touching})) for n in ends)
        place = (best.point, best.axis)
        none = np.zeros((6, 0))
        new = Freedom(
            *ends, kind, *place, None, "", (one, other), none, tuple(touching)
        )
        joint = replace(joint or new, at=best.point, axis=best.axis)
    free = joint_freedom(kind, joint.at / scale, joint.axis, joint.axis2)
    return replace(joint, kind=kind, reason="as said", freedom=free)

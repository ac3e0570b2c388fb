"""`[[copies]]`: sets of bodies and joints copied and rotated about an axis through the origin."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import FieldError, require
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.description import Turned
from stiffscope.robot.file.sections import Copies
from stiffscope.robot.file.tables import list_some, read_table
from stiffscope.vjm.model.screws import rotation

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

MOST = 2_000  # bodies and joints of a robot: repeated copies multiply them beyond any memory
SIX = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)  # rows, columns of Ixx Iyy Izz Ixy Ixz Iyz
_VECTORS = {
    **dict.fromkeys(("base", "tip", "centre", "at"), q.LENGTH),
    **dict.fromkeys(("x", "y", "axis", "axis2"), q.NUMBER),
}


def make_copies(data: dict[str, Any]) -> dict[str, Turned]:
    """Add the copies to the tables of bodies and joints.

    Parameters
    ----------
    data
        Content of the file, expressions evaluated; changed in place.

    Returns
    -------
    dict
        Originals of the copies, by the copy's name.

    Raises
    ------
    FieldError
        If a set does not exist, a name is taken, or there are too many copies.
    """
    tables: list[dict[str, Any]] = [
        data.setdefault(key, {}) for key in ("bodies", "joints")
    ]
    listed = data.get("copies", [])
    require(
        len(listed) <= MOST,
        ("copies", MOST),
        f"at most {MOST:,} copies",
        f"{len(listed):,}",
    )
    entries = [read_table(Copies, each, ("copies", i)) for i, each in enumerate(listed)]
    copied: dict[str, Turned] = {}
    for number in _order(entries):
        entry = entries[number]
        _check(tables, entry, number)
        originals = [
            _find_within(table, entry.of) for table in tables
        ]  # without the copies
        for new, angle in zip(entry.as_, entry.angles, strict=True):
            turn = rotation(np.array(entry.axis) / np.linalg.norm(entry.axis), angle)
            for table, names in zip(tables, originals, strict=True):
                for name in names:
                    copied_name = rename(name, entry.of, new)
                    origin = copied.get(name, Turned(name, np.eye(3)))
                    copied[copied_name] = Turned(origin.name, turn @ origin.rotation)
                    table[copied_name] = _turn(table[name], entry.of, new, turn)
    return copied


def copied_names(data: Mapping[str, Any], written: Iterable[str]) -> Iterator[str]:
    """Yield the names that `[[copies]]` will create, from unchecked data."""
    names = list(written)
    sets = dict[str, list[str]]()
    for entry in data.get("copies", []):
        if not isinstance(entry, dict):
            continue
        new = entry.get("as")
        if isinstance(new, list):
            sets.setdefault(str(entry.get("of")), []).extend(map(str, new))
    known = set(names)
    for name in names:  # which grows: copies are copied too
        for end in (at for at, letter in enumerate(f"{name}.") if letter == "."):
            for copied in (new + name[end:] for new in sets.get(name[:end], ())):
                if len(names) > MOST:  # refused later
                    return
                if copied not in known:
                    known.add(copied)
                    names.append(copied)
                    yield copied


def _find_within(names: Iterable[str], of: str) -> list[str]:
    """Return the names in a set: the name itself, and names that begin with it and a dot."""
    return [name for name in names if name == of or name.startswith(f"{of}.")]


def rename(name: str, of: str, new: str) -> str:
    """Rename a name within a set; return any other unchanged."""
    return new + name[len(of) :] if _find_within([name], of) else name


def _order(copies: Sequence[Copies]) -> list[int]:
    """Return the order of the entries: each after those that add to its set."""
    left = dict(enumerate(copies))
    order = []
    while left:
        for number, entry in left.items():
            others = (each for other, each in left.items() if other != number)
            if not any(_find_within(each.as_, entry.of) for each in others):
                break
        else:
            number, entry = next(iter(left.items()))
            message = f'expected a set that is no copy of its copy, got "{entry.of}"'
            raise FieldError(("copies", number, "of"), message)
        order.append(number)
        del left[number]
    return order


def _check(tables: Sequence[Mapping[str, Any]], entry: Copies, number: int) -> None:
    key = ("copies", number)
    names = [name for table in tables for name in table]
    count = len(names) + len(_find_within(names, entry.of)) * len(entry.as_)
    require(
        count <= MOST,
        (*key, "as"),
        f"copies to a robot of at most {MOST:,} bodies and joints",
        f"{count:,}",
    )
    if not _find_within(names, entry.of):
        split = (name.split(".") for name in names)
        sets = dict.fromkeys(
            ".".join(word[: n + 1]) for word in split for n in range(len(word))
        )
        known = list_some([*sets]) or "none"
        message = f'expected a set of bodies and joints ({known}), got "{entry.of}"'
        raise FieldError((*key, "of"), message)
    require(
        len(entry.as_) == len(entry.angles) and entry.as_,
        (*key, "angles"),
        f"an angle for each of {len(entry.as_)} names",
        len(entry.angles),
    )
    for position, new in enumerate(entry.as_):
        taken = _find_within(names, new)
        if new in entry.as_[:position] or taken or not all(new.split(".")):
            why = f', which "{taken[0]}" has' if taken else ""
            message = f'expected a name that is new, got "{new}"{why}'
            raise FieldError((*key, "as", position), message)


def _turn(table: Any, of: str, new: str, turn: np.ndarray) -> Any:
    """Rotate a body's or joint's table; leave invalid values, which are refused later."""
    if not isinstance(table, dict):
        return table
    turned = copy.deepcopy(table)
    if "part" in table and not {"base", "tip"} & set(
        table
    ):  # part with interfaces: default axes
        turned = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0]} | turned
    for key in list(turned):
        try:
            if key in _VECTORS:
                turned[key] = (turn @ _numbers(turned[key], _VECTORS[key], 3)).tolist()
            elif key == "inertia":
                inertia = tensor(_numbers(table[key], q.INERTIA, 6))
                turned[key] = (turn @ inertia @ turn.T)[SIX].tolist()
            elif key == "between":
                turned[key] = [rename(name, of, new) for name in table[key]]
        except (TypeError, ValueError, AttributeError):
            continue
    return turned


def _numbers(values: Any, dimension: q.Dimension, count: int) -> np.ndarray:
    if len(values) != count:
        raise ValueError
    return np.array([q.to_si(value, dimension, sign="any") for value in values])


def tensor(six: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the inertia tensor (3, 3) from its entries Ixx Iyy Izz Ixy Ixz Iyz."""
    xx, yy, zz, xy, xz, yz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

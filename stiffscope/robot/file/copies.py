"""`[[copies]]`: sets of bodies and joints once more under other names, turned about an axis through the origin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.robot.file.description import Turned
from stiffscope.robot.file.evaluate import FieldError
from stiffscope.vjm.screws import rotation

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stiffscope.robot.file.sections import BodySection, Copies, JointSection

MOST = 2_000  # bodies and joints of a robot; copies of copies of copies are soon more than any memory holds
_VECTORS = ("base", "tip", "y", "centre", "at", "axis", "axis2")


@dataclass
class Written:
    """Bodies and joints so far, and where the copies among them come from."""

    bodies: dict[str, BodySection]
    joints: dict[str, JointSection]
    copied: dict[str, Turned]

    def in_set(self, name: str) -> list[str]:
        """Names of a set: the name itself, and all that begin with it and a dot."""
        return [each for each in (*self.bodies, *self.joints) if belongs(each, name)]


def belongs(name: str, of: str) -> bool:
    """Whether a name is of the set."""
    return name == of or name.startswith(f"{of}.")


def ordered(copies: Sequence[Copies]) -> list[int]:
    """Order in which entries can be made: after those that add to their sets. Raises FieldError for a circle."""
    left, order = dict(enumerate(copies)), []
    while left:
        ready = [
            number
            for number, entry in left.items()
            if not any(belongs(new, entry.of) for other, each in left.items() if other != number for new in each.as_)
        ]
        if not ready:
            number = next(iter(left))
            raise FieldError(
                ("copies", number, "of"), f'expected a set that is no copy of its copy, got "{left[number].of}"'
            )
        order.append(ready[0])
        del left[ready[0]]
    return order


def check(written: Written, entry: Copies, number: int) -> None:
    """Raise FieldError for a set that is not there, for names that are taken, and for more copies than a robot has."""
    key = ("copies", number)
    count = len(written.bodies) + len(written.joints) + len(written.in_set(entry.of)) * len(entry.as_)
    if count > MOST:
        raise FieldError(
            (*key, "as"), f"expected copies to a robot of at most {MOST:,} bodies and joints, got {count:,}"
        )
    if not written.in_set(entry.of):
        known = dict.fromkeys(prefix for name in (*written.bodies, *written.joints) for prefix in _prefixes(name))
        shown = ", ".join(list(known)[:12]) + (", …" if len(known) > 12 else "")
        raise FieldError((*key, "of"), f'expected a set of bodies and joints ({shown or "none"}), got "{entry.of}"')
    if len(entry.as_) != len(entry.angles) or not entry.as_:
        raise FieldError(
            (*key, "angles"), f"expected an angle for each of {len(entry.as_)} names, got {len(entry.angles)}"
        )
    for position, new in enumerate(entry.as_):
        if new in entry.as_[:position] or written.in_set(new) or not all(new.split(".")):
            taken = written.in_set(new)
            why = f', which "{taken[0]}" has' if taken else ""
            raise FieldError((*key, "as", position), f'expected a name that is new, got "{new}"{why}')


def _prefixes(name: str) -> Iterable[str]:
    parts = name.split(".")
    return (".".join(parts[:length]) for length in range(1, len(parts) + 1))


def turned(section: BodySection | JointSection, of: str, new: str, turn: np.ndarray) -> dict[str, Any]:
    """A body or joint as a table once more: turned by a rotation (3, 3), names within the set following."""
    table = section.model_dump(exclude_unset=True)
    for key in _VECTORS:
        if table.get(key) is not None:
            table[key] = (turn @ np.array(table[key])).tolist()
    if table.get("inertia") is not None:
        table["inertia"] = _six(turn @ tensor(table["inertia"]) @ turn.T)
    if "between" in table:
        table["between"] = [renamed(name, of, new) for name in table["between"]]
    return table


def renamed(name: str, of: str, new: str) -> str:
    """A name within the set follows, any other stays."""
    return new + name[len(of) :] if belongs(name, of) else name


def turn_of(entry: Copies, position: int) -> np.ndarray:
    """Rotation (3, 3) of one of an entry's copies."""
    axis = np.array(entry.axis) / np.linalg.norm(entry.axis)
    return rotation(axis, entry.angles[position])


def origin(copied: Mapping[str, Turned], name: str, turn: np.ndarray) -> Turned:
    """Where a copy comes from in the end: a copy of a copy is one of what is written, turned by both."""
    before = copied.get(name)
    return Turned(name, turn) if before is None else Turned(before.name, turn @ before.rotation)


def tensor(six: Sequence[float]) -> np.ndarray:
    """Inertia tensor (3, 3) of Ixx Iyy Izz Ixy Ixz Iyz, entries of the tensor itself."""
    xx, yy, zz, xy, xz, yz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _six(matrix: np.ndarray) -> list[float]:
    return [float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]

"""What holds two parts of an assembly together, and what that leaves free."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stiffscope.cad.contacts import Contact
    from stiffscope.runtime.types import Array


@dataclass(frozen=True, eq=False)
class Freedom:
    """A joint's kind, where it is (3,) m, its axes (3,), and why.

    ``kind`` is empty where no joint of a robot file has these freedoms; ``faces`` of either part are in contact.
    """

    first: int
    second: int
    kind: str
    at: Array
    axis: Array | None
    axis2: Array | None
    reason: str
    faces: tuple[tuple[int, ...], tuple[int, ...]]
    freedom: Array = field(repr=False)  # (6, k) at the base origin, translations over the assembly's size


@dataclass(frozen=True, eq=False)
class Bond:
    """Constraints between two solids, as rows (m, 6) on the relative twist at the base origin; the contact it is.

    ``label``: of the joint that the assembly itself has here, and where, (3,) m.
    """

    first: int
    second: int
    rows: Array
    contact: Contact | None
    label: str = ""
    at: Array | None = None

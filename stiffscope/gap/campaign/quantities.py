"""Measured quantities of campaigns, and their codes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stiffscope.gap.campaign import kinds
from stiffscope.robot.file.quantities import shown_unit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.gap.campaign.kinds.kind import Kind
    from stiffscope.runtime.types import Indices

    ShownIn = Mapping[str, tuple[float, str]]

AXES = kinds.AXES
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
JOINT = "q:"
"""Prefix of coordinates that are displacements of driven joints from home."""
QUANTITIES = tuple(quantity.name for quantity in kinds.QUANTITY if quantity.name)
"""Names of the quantities as in tables, in the order of their codes."""
KINDS = tuple(kind.name for kind in kinds.KINDS)
DEFLECTION = kinds.number_of(kinds.DEFLECTION)
DEVIATION = kinds.number_of(kinds.DEVIATION)
STIFFNESS = kinds.number_of(kinds.STIFFNESS)
PUSH = kinds.number_of(kinds.PUSH)
POSITION = kinds.number_of(kinds.POSITION)
FIRST_POSITION = int(kinds.CODE_ALONG[POSITION, 0])
"""Code of a position along x in an instrument's frame, or a distance; only sensors have it."""


def names_of(kind: Kind) -> tuple[str, ...]:
    """Return the names of a kind's quantities as in tables; none if only sensors read it."""
    return tuple(quantity.name for quantity in kind.quantities if quantity.name)


def kind_of(quantity: Indices) -> Indices:
    """Return the indices (n,) into `KINDS` for quantity codes (n,)."""
    return kinds.KIND_OF[quantity]


def label_pose(
    coordinates: Sequence[str], pose: Sequence[float], shown_in: ShownIn | None = None
) -> str:
    """Return a pose as a label: "(100, 300, -1164 mm)", rotations in deg.

    Parameters
    ----------
    coordinates, pose
        Names and values, m and rad, of the k coordinates.
    shown_in
        Factor from SI and unit of drives' coordinates; without it they are in m and rad.
    """
    known = shown_in or {}
    shown: dict[str, list[str]] = {}
    for name, value in zip(coordinates, pose, strict=True):
        factor, unit = known.get(name) or shown_unit(name)
        drive = name.startswith(JOINT)
        end = "" if drive and name not in known else f" {unit}"
        digits = f"{round(factor * value, 2) + 0.0:g}" if drive and end else None
        shown.setdefault(end, []).append(digits or f"{factor * value + 0.0:g}")
    return f"({', '.join(', '.join(values) + unit for unit, values in shown.items())})"

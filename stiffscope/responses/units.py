"""Units of measured responses: by label, by a file's system of units, or SI."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from stiffscope.errors import InputError
from stiffscope.robot.file.quantities import Dimension, to_si

if TYPE_CHECKING:
    from stiffscope.responses.model import Quantity

STANDARD_GRAVITY = 9.80665  # m/s², of a label "g" on an acceleration
_GRAVITIES = {"g", "gn", "g's", "gs"}
MOTIONS: dict[Quantity, tuple[str, str]] = {
    "receptance": ("m", "rad"),
    "mobility": ("m/s", "rad/s"),
    "accelerance": ("m/s^2", "rad/s^2"),
}
_FORCES = ("N", "N*m")


@dataclass(frozen=True)
class UnitSystem:
    """SI value of a file's units of length, m, and force, N."""

    length: float
    force: float


def ordinate_factor(
    quantity: Quantity,
    labels: tuple[str, str],
    turns: tuple[bool, bool],
    system: UnitSystem | None,
    where: str,
) -> tuple[float, str]:
    """Return the factor to SI of a response, and a remark if its units are not sure.

    A label takes precedence over the file's system of units, as the standard says.

    Parameters
    ----------
    quantity
        What the response is.
    labels
        Unit labels of numerator and denominator; empty if there are none.
    turns
        Whether the motion is a rotation and the force a moment.
    system
        Units of the file, if it states them.
    where
        File and line, for the remark.
    """
    motion_unit = MOTIONS[quantity][turns[0]]
    force_unit = _FORCES[turns[1]]
    whole = _read_label(labels[0], f"{motion_unit}/({force_unit})")
    if whole is not None:
        return whole, ""
    motion = _read_label(labels[0], motion_unit)
    if quantity == "accelerance" and labels[0].lower() in _GRAVITIES:
        motion = STANDARD_GRAVITY
    force = _read_label(labels[1], force_unit)
    unsure = []
    if motion is None:
        motion = 1.0 if system is None or turns[0] else system.length
        unsure += [labels[0]] if labels[0] else []
    if force is None:
        force = 1.0 if system is None else system.force
        if turns[1] and system is not None:
            force *= system.length
        unsure += [labels[1]] if labels[1] else []
    if unsure:
        taken = "the file's units" if system is not None else "SI"
        labels_text = " and ".join(f'"{label}"' for label in unsure)
        return (
            motion / force,
            f"{where}: unit {labels_text} is not known: {taken} assumed",
        )
    if system is None and not labels[0] and not labels[1]:
        return motion / force, f"{where}: no units stated: SI assumed"
    return motion / force, ""


def _read_label(label: str, unit: str) -> float | None:
    """Return the SI value of one of a unit; None if it is not of the dimension of `unit`."""
    if not label:
        return None
    try:
        return to_si(f"1 {label}", Dimension("a unit", unit), sign="any")
    except ValueError:
        return None


def read_unit(text: str, quantity: Quantity) -> float:
    """Return the SI value of a unit of a response. Raise InputError if it is none of the quantity."""
    unit = f"{MOTIONS[quantity][0]}/{_FORCES[0]}"
    factor = _read_label(text, unit)
    if factor is None:
        raise InputError(
            f'--unit: expected a unit of {quantity} such as "{unit}", got "{text}"'
        )
    return factor

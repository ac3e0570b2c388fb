"""The target `mjcf`: a robot that MuJoCo loads as it stands."""

from __future__ import annotations

from stiffscope.errors import InputError
from stiffscope.exports.target import Exported, Order, Target


def export_mjcf(order: Order) -> Exported:
    """Return a robot for MuJoCo."""
    raise InputError(f"{order.assembled.robot.name}: not yet")


TARGET = Target(
    name="mjcf",
    help="A model for MuJoCo (4.0 or later).",
    files={"{robot}.xml": "the model"},
    export=export_mjcf,
)

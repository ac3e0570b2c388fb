"""The target `mjcf`: a robot that MuJoCo loads as it stands."""

from __future__ import annotations

from stiffscope.exports.target import Exported, Order, Target


def export_mjcf(order: Order) -> Exported:
    """Return a robot for MuJoCo."""
    from stiffscope.exports.mjcf import export_robot

    return export_robot(order)


TARGET = Target(
    name="mjcf",
    help="A model for MuJoCo (4.0 or later).",
    files={"{robot}.xml": "the model"},
    export=export_mjcf,
)

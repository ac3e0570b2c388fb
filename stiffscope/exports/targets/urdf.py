"""The target `urdf`: a calibrated URDF with its stiffnesses beside it."""

from __future__ import annotations

from stiffscope.exports.target import Exported, Order, Target


def export_urdf(order: Order) -> Exported:
    """Return a robot as URDF."""
    from stiffscope.exports.urdf import export_robot

    return export_robot(order)


TARGET = Target(
    name="urdf",
    help="A URDF with calibrated zeros and axes, and a YAML of stiffnesses.",
    files={"{robot}.urdf": "links and joints", "{robot}.yaml": "stiffnesses, by joint"},
    export=export_urdf,
)

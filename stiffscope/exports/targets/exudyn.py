"""The target `exudyn`: a script of the robot for the multibody code EXUDYN."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stiffscope.exports.exudyn_model import tabulate, write_script
from stiffscope.exports.target import Exported, Order, Target

if TYPE_CHECKING:
    from pathlib import Path


def export_exudyn(order: Order) -> Exported:
    """Return a robot as a script for EXUDYN."""
    robot = order.assembled.robot
    mechanism = order.assembled.mechanism
    names = order.asked.names
    model = tabulate(mechanism, order.asked.configurations, names)
    text = write_script(robot.name, model)
    modal = [n for n, b in model["elastic_bodies"].items() if len(b["mode_squares"])]
    curved = [n for n, j in model["joints"].items() if j["law"] is not None]
    remarks = []
    if not mechanism.gravity.any():
        remarks.append(
            "the robot has no gravity, so that its sag is that of misfits alone"
        )
    if curved:
        remarks.append(
            f"within the backlash of {', '.join(curved)} a millionth of the drive's stiffness is "
            "left, for convergence"
        )
    if order.highest is not None:
        remarks.append("--highest does not apply: the integration is implicit")

    def write(folder: Path) -> None:
        (folder / "model.py").write_text(text, encoding="utf-8")

    return Exported(
        write,
        answer={"files": ["model.py"]},
        rows=(
            ("rigid bodies", str(len(model["rigid_bodies"]))),
            ("elastic bodies", str(len(model["elastic_bodies"]))),
            ("of these with own modes", str(len(modal))),
            ("joints", str(len(model["joints"]))),
            ("poses", str(len(names))),
            ("to run it", "python model.py [POSE]"),
        ),
        remarks=tuple(remarks),
    )


TARGET = Target(
    name="exudyn",
    help="A script for EXUDYN: statics, vibrations, implicit time integration.",
    files={"model.py": "the model: `build(pose)`; run, it prints sag and frequencies"},
    export=export_exudyn,
)

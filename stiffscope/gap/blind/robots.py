"""Robots of a blind check, assembled from their parts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stiffscope.experiments.assembly import assemble_robots
from stiffscope.gap.blind.laboratory import BlindRobot
from stiffscope.robot.nominal import NominalRobot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.workshop import Workshop


def blind_robots(robots: Sequence[RobotFile], components: str | None, shop: Workshop) -> list[BlindRobot]:
    """Return the robots with their parts' matrices.

    Parameters
    ----------
    robots
        Robot files.
    components
        Source of the matrices of rods and plates; None: published if a part names a published
        matrix, else beam theory, neither of which needs a virtual experiment.
    shop
        Workshop that runs experiments if needed.

    """
    out: list[BlindRobot] = []
    for robot in robots:
        source = components or ("published" if _has_published(robot) else "beam")
        made = assemble_robots({robot.name: robot}, source, shop)[robot.name]
        out.append(BlindRobot(NominalRobot(made.mechanism, robot), made.matrices, source))
    return out


def _has_published(robot: RobotFile) -> bool:
    return any(getattr(part, "published", None) for part in robot.parts.values())

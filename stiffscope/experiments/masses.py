"""Mass of a robot's solids."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from stiffscope.robot.file.part_sections import ParametricPart
from stiffscope.robot.file.sections import RigidBody
from stiffscope.robot.part_matrices import known_mass

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from stiffscope.robot.file.description import RobotFile


def mass_of_solids(
    robot: RobotFile, parts: Iterable[str], experiments: Mapping[str, Any]
) -> float:
    """Return the mass of solids and rigid bodies, kg; masses of parts in the file are ignored.

    Parameters
    ----------
    robot
        Robot file.
    parts
        Names of the parts that it uses.
    experiments
        Experiments on them, as far as there are any, by name.
    """
    rigid = sum(
        body.mass for body in robot.bodies.values() if isinstance(body, RigidBody)
    )
    for name in parts:
        part = robot.parts[name]
        material = robot.material(name)
        mass = known_mass(robot, name) or 0.0
        if name in experiments:
            mass = experiments[name].mass
        elif isinstance(part, ParametricPart) and material is not None:
            volume = part.parameters().bare_volume
            mass = mass if volume is None else material.density * volume
        rigid += len(robot.bodies_of(name)) * mass
    return rigid

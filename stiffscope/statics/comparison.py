"""Comparison of two robots or versions: stiffness and sag at common poses, and over a plane."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, require
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.experiments.masses import mass_of_solids
from stiffscope.robot.mechanism_of import configured_poses
from stiffscope.statics.maps import map_robot
from stiffscope.vjm.statics.analysis import analyse

if TYPE_CHECKING:
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.part_matrices import Components
    from stiffscope.runtime.types import Array
    from stiffscope.runtime.workshop import Workshop
    from stiffscope.statics.maps import StiffnessMap

POINTS = 60  # points of the map along each coordinate


@dataclass(frozen=True, eq=False)
class RobotComparison:
    """Two robots at p poses.

    Attributes
    ----------
    names
        Names of the robots; file names for two versions of one robot.
    poses
        Names of the poses.
    stiffness
        Stiffness (2, p, 6, 6) at M without gravity, SI.
    push
        Stiffness 1/C_ii (2, p, 6) of a push along each direction, without gravity, SI; NaN if rigid.
    sag
        Sag (2, p, 6) under own weight, m, rad.
    mass
        Mass (2,) of all moving bodies, kg.
    change
        Map of the first with the second's stiffness as the loaded one; None without a common plane.
    """

    names: tuple[str, str]
    poses: tuple[str, ...]
    stiffness: Array
    push: Array
    sag: Array
    mass: Array
    change: StiffnessMap | None
    robots: dict[str, Assembled]
    places: tuple[tuple[float, ...], ...]
    """Coordinates of the poses, m and rad."""


def compare_robots(
    first: RobotFile, second: RobotFile, components: Components, shop: Workshop
) -> RobotComparison:
    """Compare two robots at the named poses that both reach.

    Parameters
    ----------
    first, second
        Robots whose poses have the same coordinates.
    components, shop
        Source of the parts' matrices, and workshop for experiments, one for a common part.

    Raises
    ------
    InputError
        Their poses have different coordinates, or no named pose is reachable for both.
    """
    require(
        first.tool.pose == second.tool.pose,
        "compare",
        "two robots whose poses have the same coordinates",
        f"{' '.join(first.tool.pose)} and {' '.join(second.tool.pose)}",
    )
    names = (first.name, second.name)
    if names[0] == names[1]:
        names = (first.path.stem, second.path.stem)
    if names[0] == names[1]:
        names = (names[0], f"{names[1]} (second)")
    robots = assemble_robots({"first": first, "second": second}, components, shop)
    poses = {
        **{name: tuple(pose) for name, pose in second.poses.items()},
        **first.poses,
    }
    values = np.array(list(poses.values()), dtype=float)
    reached = np.zeros(len(poses), dtype=bool)
    if poses:
        valid = [
            configured_poses(assembled.robot, assembled.mechanism, values).valid
            for assembled in robots.values()
        ]
        reached = np.all(valid, axis=0)
    require(reached.any(), "compare", "a named pose that both robots reach", "none")
    both = [
        analyse(assembled.mechanism, values[reached], gravity="exact")
        for assembled in robots.values()
    ]
    plain = [
        analyse(assembled.mechanism, values[reached]) for assembled in robots.values()
    ]
    change = None
    if first.map is not None and second.map is not None:
        one = map_robot(first, robots["first"].mechanism, POINTS, "none")
        sweep = replace(second, map=first.map)
        with suppress(InputError):
            other = map_robot(sweep, robots["second"].mechanism, POINTS, "none")
            change = replace(one, loaded=other.stiffness)
    return RobotComparison(
        names=names,
        poses=tuple(name for name, ok in zip(poses, reached, strict=True) if ok),
        stiffness=np.array([state.matrix for state in plain]),
        push=np.array([state.alone for state in plain]),
        sag=np.array([state.sag for state in both]),
        mass=np.array([mass_of(assembled) for assembled in robots.values()]),
        change=change,
        robots=robots,
        places=tuple(map(tuple, values[reached].tolist())),
    )


def mass_of(assembled: Assembled) -> float:
    """Return the mass of a robot's solids and rigid bodies, kg."""
    return mass_of_solids(assembled.robot, assembled.sources, assembled.results)

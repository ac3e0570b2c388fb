"""Two robots, or two versions of one, side by side: stiffness and sag at poses that both reach, and over a plane."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.design.maps import map_robot
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.vjm.kinematics import configure
from stiffscope.vjm.statics import analyse

if TYPE_CHECKING:
    from stiffscope.design.maps import StiffnessMap
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.part_matrices import Components
    from stiffscope.runtime.types import Array
    from stiffscope.runtime.workshop import Workshop

POINTS = 60  # of the map along either coordinate


@dataclass(frozen=True, eq=False)
class RobotComparison:
    """Two robots at p poses.

    Attributes
    ----------
    names
        Of the robots; of two versions of one, their files'.
    poses
        Names of the poses.
    stiffness
        (2, p, 6, 6) at M without gravity, SI.
    sag
        (2, p, 6) under their own weight, m, rad.
    change
        Map of both, the second in the place of what gravity makes of the first; None where they sweep other planes.
    """

    names: tuple[str, str]
    poses: tuple[str, ...]
    stiffness: Array
    sag: Array
    change: StiffnessMap | None
    made: dict[str, Assembled]
    places: tuple[tuple[float, ...], ...]
    """Coordinates of the poses, m and rad."""


def compare_robots(first: RobotFile, second: RobotFile, components: Components, shop: Workshop) -> RobotComparison:
    """Compare two robots at the named poses that both reach.

    Parameters
    ----------
    first, second
        Robots whose poses have the same coordinates.
    components
        Where the parts' matrices come from.
    shop
        Where experiments are made; a part that both have is tested once.

    Raises
    ------
    InputError
        Their poses have other coordinates, or they reach no pose together.

    """
    if first.tool.pose != second.tool.pose:
        got = " and ".join(" ".join(robot.tool.pose) for robot in (first, second))
        raise InputError(f"compare: expected two robots whose poses have the same coordinates, got {got}")
    names = (first.name, second.name)
    if names[0] == names[1]:
        names = (first.path.stem, second.path.stem)
    if names[0] == names[1]:
        names = (names[0], f"{names[1]} (second)")
    made = assemble_robots({"first": first, "second": second}, components, shop)
    poses = {**{name: tuple(pose) for name, pose in second.poses.items()}, **first.poses}
    values = np.array(list(poses.values()), dtype=float)
    reached = np.all([configure(each.mechanism, values).valid for each in made.values()], axis=0) if poses else []
    if not np.any(reached):
        raise InputError("compare: expected a named pose that both robots reach, got none")
    both = [analyse(each.mechanism, values[reached], gravity="exact") for each in made.values()]
    plain = [analyse(each.mechanism, values[reached]) for each in made.values()]
    return RobotComparison(
        names, tuple(name for name, ok in zip(poses, reached, strict=True) if ok),
        np.array([each.matrix for each in plain]), np.array([each.sag for each in both]),
        _map_change(first, second, made), made, tuple(map(tuple, values[reached].tolist())),
    )  # fmt: skip


def _map_change(first: RobotFile, second: RobotFile, made: dict[str, Assembled]) -> StiffnessMap | None:
    """The map of the first, with the stiffness of the second as its loaded one."""
    if first.map is None or second.map is None:
        return None
    one = map_robot(first, made["first"].mechanism, POINTS, "none")
    sweep = replace(second, map=first.map)
    try:
        other = map_robot(sweep, made["second"].mechanism, POINTS, "none")
    except InputError:
        return None
    return replace(one, loaded=other.stiffness)

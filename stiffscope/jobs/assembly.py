"""Robots assembled from their parts: the experiments that they need, the elastic robot, its stiffness with bounds."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from stiffscope.errors import InputError
from stiffscope.jobs.experiments import solve_parts
from stiffscope.jobs.orders import order_part
from stiffscope.jobs.workshop import workshop
from stiffscope.robot import components as parts_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from stiffscope.jobs.orders import PartOrder
    from stiffscope.jobs.results import PartResult
    from stiffscope.jobs.workshop import Workshop
    from stiffscope.robot.effects import NominalRobot
    from stiffscope.robot.schema import PartName, RobotFile
    from stiffscope.vjm.analysis import Stiffness
    from stiffscope.vjm.biglide import Biglide

    Components = str | Mapping[PartName, str | ArrayLike] | None


@dataclass(frozen=True)
class Assembled:
    """A robot file with the sources and matrices of its parts, their experiments, and the elastic robot of them."""

    robot: RobotFile
    sources: dict[PartName, str]
    results: dict[PartName, PartResult]
    matrices: dict[PartName, np.ndarray]
    elastic: Biglide

    @property
    def carrying(self) -> NominalRobot:
        """The elastic robot with what effects need of its file."""
        return parts_of.nominal_robot(self.elastic, self.robot)


def assemble(robot: RobotFile, components: Components = None) -> Biglide:
    """Assemble the elastic robot of a robot file.

    Parameters
    ----------
    robot
        As `load_robot` gives it.
    components
        Where the parts' compliances come from: "fea", "beam" or "published" for all of them, or by part one of these
        words or a matrix (6, 6) in SI and the part's axes; by default what the robot file says. Experiments that "fea"
        needs are made in this process, and kept in the cache.

    Returns
    -------
    Biglide
        What `analyse`, `stiffness`, `deflection` and `sag` take.

    Raises
    ------
    InputError
        There is no such part or source, or a matrix is no compliance.

    """
    with workshop() as shop:
        return assemble_robots({"robot": robot}, components, shop)["robot"].elastic


def assemble_robots(robots: Mapping[str, RobotFile], components: Components, shop: Workshop) -> dict[str, Assembled]:
    """Assemble several robots; the parts that they share are tested once.

    Parameters
    ----------
    robots
        Robot files by label; the label of all but the first stands in messages.
    components
        As for `assemble`.
    shop
        Where the experiments are made.

    Returns
    -------
    dict
        Each label's assembled robot.

    Raises
    ------
    InputError
        A part cannot be tested, or the robot cannot be assembled from the parts.

    """
    orders: dict[tuple[str, PartName], PartOrder] = {}
    for i, (label, robot) in enumerate(robots.items()):
        for name in _tested(robot, sources(robot, components)):
            orders[label, name] = order_part(robot, name, label=name if i == 0 else f"{name} ({label})")
    solved = dict(zip(orders, solve_parts(list(orders.values()), shop), strict=True))
    return {
        label: _assembled(robot, components, {name: solved[at, name] for at, name in solved if at == label})
        for label, robot in robots.items()
    }


def sources(robot: RobotFile, components: Components) -> dict[PartName, str | ArrayLike]:
    """Where each part's matrix comes from, in words or as the matrix itself; see `assemble`."""
    from stiffscope.robot.part_schema import Source
    from stiffscope.robot.schema import PARTS

    chosen = components if isinstance(components, Mapping) else dict.fromkeys(PARTS, components)
    for name, source in chosen.items():
        if name not in PARTS:
            raise InputError(f"components: expected parts among {', '.join(PARTS)}, got {name!r}")
        if isinstance(source, str) and source not in get_args(Source):
            raise InputError(f"components: expected {', '.join(get_args(Source))} or a matrix, got {source!r}")
    given = {name: source for name, source in chosen.items() if source is not None}
    return {name: given.get(name, robot.part(name).compliance) for name in PARTS}


def _tested(robot: RobotFile, chosen: Mapping[PartName, str | ArrayLike]) -> list[PartName]:
    """Parts whose experiment the robot's matrices and masses need."""
    tested = [name for name, source in chosen.items() if isinstance(source, str) and source == "fea"]
    for name in tested:
        check_one_interface(robot, name)
    return ["link", *tested] if robot.link.mass == "cad" and "link" not in tested else tested


def check_one_interface(robot: RobotFile, name: PartName) -> None:
    """Raise InputError where a part has more loaded interfaces, and so more matrices, than one."""
    if robot.part(name).shape().get("pads") == "apart":
        raise InputError(
            f'{robot.path}: {name}.pads: expected "together", which makes one matrix, got "apart" (whose three '
            "interfaces `stiffscope compliance` gives)"
        )


def check_reach(robot: RobotFile, points: Mapping[str, Sequence[float]]) -> None:
    """Raise InputError that names the tool point that is out of reach, before any experiment is made."""
    from stiffscope.vjm.biglide import link_angle

    geometry = parts_of.geometry(robot)
    for name, point in points.items():
        try:
            link_angle(geometry, point)
        except InputError as error:
            raise InputError(f"{name}: {error}") from error


def _assembled(robot: RobotFile, components: Components, results: Mapping[PartName, PartResult]) -> Assembled:
    chosen = sources(robot, components)
    matrices = {name: _matrix(robot, name, source, results) for name, source in chosen.items()}
    link_mass = results["link"].mass if robot.link.mass == "cad" else float(robot.link.mass)
    words = {name: source if isinstance(source, str) else "given" for name, source in chosen.items()}
    return Assembled(robot, words, dict(results), matrices, parts_of.assemble(robot, matrices, link_mass))


def _matrix(
    robot: RobotFile, name: PartName, source: str | ArrayLike, results: Mapping[PartName, PartResult]
) -> np.ndarray:
    """Compliance (6, 6) of a part from its source."""
    if not isinstance(source, str):
        return np.asarray(source, dtype=float)
    if source == "fea":
        return results[name].compliance
    made = parts_of.beam_compliance if source == "beam" else parts_of.published_compliance
    return made(robot, name)


def at_named_poses(assembled: Assembled, poses: Mapping[str, Sequence[float]]) -> Stiffness:
    """Stiffness without gravity and sag with it."""
    from stiffscope.vjm.analysis import analyse, sag

    points = np.array(list(poses.values()))
    found = analyse(assembled.elastic, points)
    return dataclasses.replace(found, sag=sag(assembled.elastic, points, g=assembled.robot.gravity.acceleration))


def stiffness_bars(assembled: Assembled, poses: Any) -> np.ndarray | None:
    """Propagate the bounds of the parts' experiments to the robot's stiffness.

    Parameters
    ----------
    assembled
        The robot with its parts' experiments.
    poses
        Tool points (n, 3), m.

    Returns
    -------
    ndarray or None
        95 % bounds (n, 6, 6) on the stiffness at M, SI; None where no part was tested.

    """
    from stiffscope.vjm.uncertainty import stiffness_error

    made = {name: source == "fea" for name, source in assembled.sources.items()}
    if not any(made.values()):
        return None
    zero = np.zeros((6, 6))
    link, slider = (assembled.results[name].error if made[name] else zero for name in ("link", "slider"))
    return stiffness_error(assembled.elastic, poses, link, slider)


def deflection_bars(assembled: Assembled, poses: Any, twist: np.ndarray) -> np.ndarray | float:
    """95 % bounds (n, 6) on deflections (n, 6) in m, rad, from those on the stiffness; 0 where no part has any."""
    from stiffscope.vjm.analysis import stiffness
    from stiffscope.vjm.uncertainty import deflection_error

    bars = stiffness_bars(assembled, poses)
    return 0.0 if bars is None else deflection_error(stiffness(assembled.elastic, poses), bars, twist)


def stiffness_json(state: Stiffness, error: np.ndarray | None = None) -> dict[str, Any]:
    """What scripts read of the robot."""
    bars = {} if error is None else {"error": error}
    return {"poses": state.poses, "stiffness": state.matrix, "sag": state.sag, "mobility": state.mobility, **bars}

"""Assembly of robots from parts: required experiments, mechanism, stiffness with bounds."""

from __future__ import annotations

import dataclasses
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.cad.checks import mm
from stiffscope.errors import InputError
from stiffscope.experiments.experiments import solve_parts
from stiffscope.experiments.making import describe_solid
from stiffscope.experiments.orders import build_part, name_lines, order_part
from stiffscope.registry import load, slices
from stiffscope.robot.checks import SAME_LENGTH
from stiffscope.robot.file.part_sections import StepPart
from stiffscope.robot.mechanism_of import (
    configured_poses,
    mechanism_of,
    rigid_mechanism,
)
from stiffscope.robot.part_matrices import (
    needed_experiments,
    part_matrices,
    part_sources,
    used_parts,
)
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.model.screws import CONVENTION
from stiffscope.vjm.statics import analysis as statics

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from stiffscope.cad.part import Part
    from stiffscope.experiments.experiments import PartResult
    from stiffscope.experiments.part_order import PartOrder
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.part_matrices import Components, PartMatrix
    from stiffscope.runtime.workshop import Workshop
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.statics.analysis import Stiffness


@dataclass(frozen=True)
class Assembled:
    """A robot file with the sources and matrices of its parts, and the assembled mechanism.

    Attributes
    ----------
    sources : by part: "fea", "beam", "published", "step" (STEP file), "matrix" (in file), "given".
    results : virtual experiments, by part.
    matrices : matrix, bounds and mass of each used part.
    mechanism, bare : with and without the effects adopted in the file.
    """

    robot: RobotFile
    sources: dict[str, str]
    results: dict[str, PartResult]
    matrices: dict[str, PartMatrix]
    mechanism: Mechanism
    bare: Mechanism


def assemble(robot: RobotFile, components: Components = None) -> Mechanism:
    """Assemble the mechanism of a robot file from its parts.

    Parameters
    ----------
    robot
        Robot from `load_robot`.
    components
        Source of the compliances of rods and plates: "fea", "beam" or "published" for all, or by
        part one of these or, for any part, a matrix (6, 6) in SI and the part's axes; by default as
        in the robot file. Experiments for "fea" run in this process and are cached.

    Returns
    -------
    Mechanism
        Input of `configure`, `analyse`, `stiffness`, `deflection` and `sag`.

    Raises
    ------
    InputError
        If a part or source does not exist, or a matrix is not a compliance.

    Examples
    --------
    >>> import stiffscope as ss
    >>> machine = ss.assemble(ss.load_robot("biglide"), "published")  # or "beam", "fea", a matrix
    >>> machine.tool.pose
    ('x', 'y', 'z')
    """
    with workshop() as shop:
        return assemble_robots({"robot": robot}, components, shop)["robot"].mechanism


def assemble_robots(
    robots: Mapping[str, RobotFile],
    components: Components,
    shop: Workshop,
    *,
    whole: bool = True,
    near: Mapping[str, PartResult] | None = None,
) -> dict[str, Assembled]:
    """Assemble robots; parts that several of them share are tested once.

    Parameters
    ----------
    robots
        Robots by label; messages on parts include the label, except for the first robot.
    components
        See `assemble`.
    shop
        Runs the experiments.
    whole, near
        See `solve_parts`, by part; without `whole` modes are omitted, in half the time.
    """
    orders: dict[tuple[str, str], PartOrder] = {}
    for label, robot in robots.items():
        for name in needed_experiments(robot, components):
            check_one_interface(robot, name)
            words = name if label == next(iter(robots)) else f"{name} ({label})"
            orders[label, name] = order_part(robot, name, label=words)
    with name_lines(next(iter(robots.values()))):
        solved = solve_parts(list(orders.values()), shop, whole=whole, near=near)
    results: dict[str, dict[str, PartResult]] = {label: {} for label in robots}
    for (label, name), result in zip(orders, solved, strict=True):
        results[label][name] = result
    return {n: _assemble(robot, components, results[n]) for n, robot in robots.items()}


def check_one_interface(robot: RobotFile, name: str) -> None:
    """Raise InputError if a part of a two-ended body has several loaded interfaces."""
    two_ended = any(body.part == name for body in robot.elastic_bodies().values())
    if getattr(robot.part(name), "pads", None) == "apart" and two_ended:
        expected = 'expected "together" for bodies between a base and a tip'
        got = 'got "apart", whose three interfaces stand apart'
        cure = "(a body with `at` instead of base and tip has them as ends)"
        raise robot.refuse(("parts", name, "pads"), f"{expected}, {got} {cure}")


def check_reach(robot: RobotFile, poses: Mapping[str, Sequence[float]]) -> None:
    """Raise InputError, with the reason, if a pose is out of reach; run no experiment."""
    if not poses:
        return
    configurations = configured_poses(
        robot, rigid_mechanism(robot), list(poses.values())
    )
    for index, name in enumerate(poses):
        if not configurations.valid[index]:
            reason = configurations.refusal(index)
            if name in robot.poses:
                raise robot.refuse(("poses", name), reason)
            raise InputError(f"{name}: {reason}")


def _assemble(
    robot: RobotFile, components: Components, results: dict[str, PartResult]
) -> Assembled:
    given = part_sources(robot, components).items()
    sources = {
        name: source if isinstance(source, str) else "given" for name, source in given
    }
    for name, source in sources.items():
        if source == "step" and not robot.parts[name].interface_names:
            _check_length(robot, name, results[name].length)
    matrices = part_matrices(robot, components, results)
    bare = mechanism_of(robot, matrices)
    mechanism = bare
    for provider in slices().values():
        for section, change in provider.changes:
            if getattr(robot, section):
                mechanism = load(change)(mechanism, robot)
    return Assembled(
        robot=robot,
        sources=sources,
        results=results,
        matrices=matrices,
        mechanism=mechanism,
        bare=bare,
    )


def check_solids(robot: RobotFile) -> dict[str, Part]:
    """Build the parts of STEP files without testing them; raise InputError if one is invalid."""
    built = {}
    for name in used_parts(robot):
        if isinstance(robot.part(name), StepPart):
            part = built[name] = build_part(robot, name)
            clamped = describe_solid(part)["clamped_centre"]
            if robot.parts[name].interface_names:
                continue
            _check_length(
                robot, name, float(part.loaded[0].reference_point[0] - clamped[0])
            )
    return built


def _check_length(robot: RobotFile, name: str, length: float) -> None:
    """Raise InputError if a body's length differs from that of its STEP file's solid."""
    for body in robot.bodies_of(name):
        given = robot.elastic_bodies()[body].length
        file = getattr(robot.part(name), "file", "")
        what = f"as the reference point of {file} is from its clamped faces along x"
        robot.source.require(
            abs(length - given) <= SAME_LENGTH * given,
            ("bodies", body, "tip"),
            f"a tip {mm(length)} from the base, {what}",
            mm(given),
        )


@contextmanager
def name_robot(robot: RobotFile) -> Iterator[None]:
    """Put the robot's file before the message of an InputError of its mechanics."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{robot.path}: {error}") from error


def at_named_poses(
    assembled: Assembled, poses: Mapping[str, Sequence[float]]
) -> Stiffness:
    """Return stiffness without gravity and sag under gravity; NaN if the tool moves freely."""
    with name_robot(assembled.robot):
        state = statics.analyse(assembled.mechanism, np.array(list(poses.values())))
        firm = state.valid & np.isfinite(state.compliance).all(axis=(1, 2))
        sag = np.full_like(state.sag, np.nan)
        sag[firm] = statics.sag(assembled.mechanism, state.configurations[firm])
    return dataclasses.replace(state, sag=sag)


def stiffness_bars(assembled: Assembled, poses: Any) -> np.ndarray | None:
    """Return 95 % bounds (n, 6, 6) on the stiffness; None if no part's matrix has bounds."""
    return (
        statics.stiffness_error(assembled.mechanism, poses)
        if _has_bounds(assembled)
        else None
    )


def compliance_bars(assembled: Assembled, poses: Any) -> np.ndarray | None:
    """Return 95 % bounds (n, 6, 6) on the compliance; None if no part's matrix has bounds."""
    return (
        statics.compliance_error(assembled.mechanism, poses)
        if _has_bounds(assembled)
        else None
    )


def _has_bounds(assembled: Assembled) -> bool:
    return any(part.error is not None for part in assembled.matrices.values())


def deflection_bars(
    assembled: Assembled, poses: Any, twist: np.ndarray
) -> np.ndarray | float:
    """Return bounds ``|δC| |C⁺ t|`` (n, 6) on twists (n, 6) in m, rad; 0 if no part has bounds.

    Parameters
    ----------
    assembled
        Robot with bounds on its parts.
    poses
        Commanded poses (n, k), m and rad.
    twist
        Twists of the tool (n, 6), m and rad.
    """
    bars = compliance_bars(assembled, poses)
    if bars is None:
        return 0.0
    compliance = statics.compliance(assembled.mechanism, poses)
    known = np.isfinite(compliance).all(axis=(1, 2))
    load = np.full((*twist.shape, 1), np.nan)
    load[known] = (
        np.linalg.pinv(compliance[known], hermitian=True) @ twist[known][..., None]
    )
    return (bars @ np.abs(load))[..., 0]


def stiffness_json(state: Stiffness, error: np.ndarray | None = None) -> dict[str, Any]:
    """Return the robot's stiffness, sag and mobility as JSON data."""
    bars = {} if error is None else {"error": error}
    return {
        "poses": state.poses,
        "tool": state.tool,
        "stiffness": [k if np.isfinite(k).all() else None for k in state.matrix],
        "compliance": state.compliance,
        "rigid": state.rigid,
        "sag": state.sag,
        "mobility": state.mobility,
        **bars,
        "convention": CONVENTION,
    }

"""Measured responses of a campaign, with their points and directions on the robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, naming
from stiffscope.responses.checks import find_damping, find_doubts
from stiffscope.responses.files import read_responses
from stiffscope.responses.model import Response
from stiffscope.responses.scatter import find_scatter
from stiffscope.robot.file.description import GROUND
from stiffscope.robot.file.quantities import show_value, to_si
from stiffscope.robot.mechanism_of import configured_poses
from stiffscope.runtime.reading import open_file
from stiffscope.runtime.reading import show_path as shown_path
from stiffscope.vjm.kinematics.configurations import configure_drives
from stiffscope.vjm.model.screws import rotation_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.campaign.response_header import MeasuredPoint, ResponseSetup
    from stiffscope.responses.model import Direction, ResponseFile
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism

DAMPING = 0.01  # ratio where no resonance shows one


@dataclass(frozen=True, eq=False)
class MeasuredResponses:
    """Responses of one set-up within its band, and where they were measured.

    Attributes
    ----------
    setup
        How they were measured.
    responses
        Receptances in SI, in the directions of the file.
    places
        Home coordinates (3,) of each point, m.
    axes
        Axes of the file as columns (3, 3), {O}.
    configuration
        The robot as it stood, one configuration.
    remarks
        Doubts on units and places.
    """

    setup: ResponseSetup
    responses: tuple[Response, ...]
    places: Mapping[str, Array]
    axes: Array
    configuration: Configurations
    remarks: tuple[str, ...]

    @property
    def decay(self) -> float:
        """Decay of the exponential window, 1/s; 0 without one."""
        constant = self.setup.exponential
        return 0.0 if constant is None else 1.0 / constant

    @property
    def doubts(self) -> list[str]:
        """Doubts on the measurement, a line each."""
        return find_doubts(self.responses)

    @cached_property
    def scatter(self) -> dict[Response, Array]:
        """Scatter (n,) of the lines of each response that is not zero at all of them."""
        return {
            response: find_scatter(response, self.setup.averages)
            for response in self.responses
            if response.receptance.any()
        }

    def find_direction(self, direction: Direction) -> Array:
        """Return a direction of the file (6,), force and moment, in {O}, with its sign."""
        out = np.zeros(6)
        half = slice(0, 3) if direction.axis < 3 else slice(3, 6)
        out[half] = direction.sign * self.axes[:, direction.axis % 3]
        return out

    def point(self, name: str) -> MeasuredPoint:
        """Return a point by name."""
        return next(point for point in self.setup.points if point.name == name)

    def find_damping(self) -> float:
        """Return the median damping ratio of the measured resonances, without the window's."""
        ratios = list[float]()
        for response in self.responses:
            for hertz, ratio in find_damping(response):
                ratios.append(ratio - self.decay / (2.0 * np.pi * hertz))
        positive = [ratio for ratio in ratios if ratio > 0.0]
        return float(np.median(positive)) if positive else DAMPING


def load_responses(
    folder: Path, campaign: Campaign, robot: RobotFile, mechanism: Mechanism
) -> tuple[MeasuredResponses, ...]:
    """Read the files of a campaign's responses, and place their points on the robot.

    Parameters
    ----------
    folder
        Folder of the campaign.
    campaign
        Its set-ups are read.
    robot, mechanism
        Robot file, and its mechanism with any matrices.

    Raises
    ------
    InputError
        A file cannot be read, a point has no place on the robot, or a pose is out of reach.
    """
    return tuple(
        _load_setup(folder, campaign, setup, robot, mechanism)
        for setup in campaign.responses
    )


def _load_setup(
    folder: Path,
    campaign: Campaign,
    setup: ResponseSetup,
    robot: RobotFile,
    mechanism: Mechanism,
) -> MeasuredResponses:
    key = ("responses", setup.name)
    path = folder / setup.file
    try:
        open_file(path, "a file of responses").close()
    except InputError as error:
        message = str(error).removeprefix(f"{shown_path(path)}: ")
        message = f"{message} ({shown_path(setup.file)})"
        raise campaign.refuse((*key, "file"), message) from error
    read = read_responses(path, setup.channels, setup.quantity, setup.factor)
    campaign.require(
        read.responses,
        (*key, "file"),
        "frequency responses",
        f"none in {setup.file}",
    )
    _check_points(campaign, setup, read, robot)
    axes = rotation_of(np.array(setup.axes))
    places = dict[str, "Array"]()
    remarks = list(read.remarks)
    ends = {
        node: body.elastic.places[k]
        for body in mechanism.bodies
        if body.elastic is not None
        for k, node in enumerate(body.nodes)
    }
    for point in setup.points:
        if point.at is not None:
            places[point.name] = np.array(point.at)
        elif point.name in read.points:
            places[point.name] = axes @ np.asarray(read.points[point.name], dtype=float)
            where = ", ".join(f"{value:.4g}" for value in places[point.name])
            remarks.append(
                f"point {point.name}: {setup.file} places it at ({where}) m, "
                "taken as home coordinates"
            )
        elif point.body in ends:
            places[point.name] = ends[point.body]
        else:
            expected = "expected a place, as neither its body nor the file tells it"
            raise campaign.refuse((*key, "points", point.name, "at"), expected)
        if point.mass is None:
            remarks.append(
                f"point {point.name}: the sensor's mass is unknown, neglected here"
            )
    return MeasuredResponses(
        setup=setup,
        responses=_select_lines(campaign, setup, read),
        places=places,
        axes=axes,
        configuration=_configure(campaign, setup, robot, mechanism),
        remarks=tuple(remarks),
    )


def _check_points(
    campaign: Campaign, setup: ResponseSetup, read: ResponseFile, robot: RobotFile
) -> None:
    """Raise InputError for points without responses, responses without points, and unknown bodies."""
    key = ("responses", setup.name, "points")
    used = dict.fromkeys(
        end.point
        for response in read.responses
        for end in (response.force, response.motion)
    )
    stated = [point.name for point in setup.points]
    missing = [name for name in used if name not in stated]
    listed = ", ".join(used)
    if missing:
        expected = f"expected all points of {setup.file} ({listed})"
        raise campaign.refuse(key, f"{expected}, {missing[0]} is missing")
    nodes = [node for node in robot.nodes() if node != GROUND]
    for point in setup.points:
        expected = f"a point of {setup.file} ({listed})"
        campaign.require(point.name in used, (*key, point.name), expected, point.name)
        expected = f"a body or an end of one ({', '.join(nodes)})"
        where = (*key, point.name, "body")
        campaign.require(point.body in nodes, where, expected, show_value(point.body))


def _select_lines(
    campaign: Campaign, setup: ResponseSetup, read: ResponseFile
) -> tuple[Response, ...]:
    """Return the responses within the band of the set-up."""
    low, high = setup.band or (0.0, np.inf)
    selected = list[Response]()
    for response in read.responses:
        inside = (response.frequency >= low) & (response.frequency <= high)
        if not inside.any():
            first = response.frequency[0]
            last = response.frequency[-1]
            expected = f"expected lines of {response.source}"
            raise campaign.refuse(
                ("responses", setup.name, "band"),
                f"{expected}, which has {first:.4g} to {last:.4g} Hz",
            )
        coherence = response.coherence
        selected.append(
            replace(
                response,
                frequency=response.frequency[inside],
                receptance=response.receptance[inside],
                coherence=None if coherence is None else coherence[inside],
            )
        )
    return tuple(selected)


def _configure(
    campaign: Campaign, setup: ResponseSetup, robot: RobotFile, mechanism: Mechanism
) -> Configurations:
    """Return the configuration of a set-up. InputError for a pose unlike the robot or out of reach."""
    key = "joints" if setup.pose is None else "pose"
    where = ("responses", setup.name, key)
    if setup.pose is None:
        configurations = configure_drives(
            mechanism, [_read_joints(campaign, setup, robot)]
        )
    else:
        pose = _read_pose(campaign, setup, robot)
        configurations = configured_poses(robot, mechanism, [pose])
    if not configurations.valid[0]:
        raise campaign.refuse(where, configurations.refusal(0))
    return configurations


def _read_pose(
    campaign: Campaign, setup: ResponseSetup, robot: RobotFile
) -> tuple[float, ...]:
    key = ("responses", setup.name, "pose")
    if isinstance(setup.pose, str):
        expected = f"one of {robot.name}'s poses {', '.join(robot.known_poses)}"
        known = setup.pose in robot.known_poses
        campaign.require(known, key, expected, show_value(setup.pose))
        return robot.known_poses[setup.pose]
    given = setup.pose or ()
    names = robot.tool.pose
    expected = f"[{', '.join(names)}]"
    campaign.require(len(given) == len(names), key, expected, f"{len(given)} values")
    with naming(partial(campaign.refuse, key)):
        return tuple(
            to_si(value, robot.dimension_of(name), sign="any")
            for value, name in zip(given, names, strict=True)
        )


def _read_joints(
    campaign: Campaign, setup: ResponseSetup, robot: RobotFile
) -> list[float]:
    """Return the displacements of all drives from home; unnamed drives stay there."""
    drives = robot.drives()
    displacements = dict.fromkeys(drives, 0.0)
    for name, value in setup.joints.items():
        key = ("responses", setup.name, "joints", name)
        campaign.require(name in drives, key, f"drives among {', '.join(drives)}", name)
        with naming(partial(campaign.refuse, key)):
            displacements[name] = to_si(value, robot.dimension_of(name), sign="any")
    return list(displacements.values())

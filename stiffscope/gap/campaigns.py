"""Diagnosis of a campaign folder: find it, assemble its nominal robot, and diagnose."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.data import FOLDER
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.experiments.part_dimensions import tested_dimensions
from stiffscope.gap.campaign.extremes import (
    find_unloaded,
    inspect_extremes,
    inspect_mechanics,
)
from stiffscope.gap.campaign.measured_responses import load_responses
from stiffscope.gap.campaign.readings import load_campaign, match_robot
from stiffscope.gap.campaign.sanity import (
    ReadingRemark,
    inspect_ranges,
    inspect_readings,
)
from stiffscope.gap.diagnose import diagnose_campaign
from stiffscope.gap.forward.misread_frames import find_misread
from stiffscope.gap.forward.response_model import (
    ComparedResponses,
    predict_responses,
)
from stiffscope.gap.forward.robot_at_poses import RobotAtPoses
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.robot.file.quantities import show_value
from stiffscope.robot.library import find_robot, robot_names
from stiffscope.robot.mechanism_of import mechanism_of, rigid_mechanism
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import (
    needed_experiments,
    part_matrices,
    part_sources,
    rigid_part,
)
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.workshop import workshop

if TYPE_CHECKING:
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.gap.campaign.campaign import Array, Campaign
    from stiffscope.gap.inference.diagnosis import Diagnosis
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.workshop import Workshop
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism

SHELVES = ("campaigns", "withheld")
_REFUSED = (
    10.0  # factor on the limits of places and loads beyond which a diagnosis is refused
)


@dataclass(frozen=True)
class Case:
    """A campaign with its nominal robot, or without one if it has its own predictions."""

    name: str
    folder: Path
    campaign: Campaign
    robot: RobotFile | None


def diagnose(campaign: str | Path, robot: str | None = None) -> Diagnosis:
    """Find the effects that explain the gap between a model and the measurements of a campaign.

    Parameters
    ----------
    campaign
        Folder with a campaign.toml and its readings, or a name in `data/`, such as "published".
    robot
        Robot file or name to use instead of the campaign's own, e.g. an adopted one.

    Returns
    -------
    Diagnosis
        Verdict, effects with probabilities and parameters, gap before and after, next measurement.

    Raises
    ------
    InputError
        There is no such campaign, or its files are invalid.

    Examples
    --------
    >>> import stiffscope as ss
    >>> found = ss.diagnose("published")
    >>> effect = found.effects[0]
    >>> found.verdict, effect.effect, round(effect.parameters["factor"].value, 3)
    ('identified', 'scale', 1.1)
    """
    with workshop() as shop:
        case = open_case(campaign, instead=robot)
        return diagnose_case(case, assemble_nominal(case, shop), shop)


def assemble_nominal(case: Case, shop: Workshop) -> Assembled | None:
    """Return the assembled nominal robot of a campaign, or None without a robot."""
    if case.robot is None:
        return None
    return assemble_robots({"nominal": case.robot}, case.campaign.components, shop)[
        "nominal"
    ]


def diagnose_case(case: Case, nominal: Assembled | None, shop: Workshop) -> Diagnosis:
    """Diagnose a campaign with its nominal robot, if there is one.

    Raises InputError for places and loads that are far too large.
    """
    if nominal is None:
        return diagnose_campaign(case.campaign)
    for remark in inspect_extremes(case.campaign, nominal.mechanism, _REFUSED):
        raise InputError(remark.text)
    carrying = NominalRobot(
        nominal.mechanism, nominal.robot, tested_dimensions(nominal, shop)
    )
    loaded = case.campaign.select(np.flatnonzero(~find_unloaded(case.campaign)))
    responses = load_responses(
        case.folder, case.campaign, nominal.robot, nominal.mechanism
    )
    line = shop.open_line("diagnosis")
    diagnosis = diagnose_campaign(loaded, carrying, line, responses)
    doubts = (
        *inspect_extremes(case.campaign, nominal.mechanism),
        *inspect_mechanics(case.campaign),
    )
    return dataclasses.replace(
        diagnosis,
        remarks=(
            *(doubt.text for doubt in doubts),
            *diagnosis.remarks,
        ),
    )


def open_case(
    name: str | Path, *, planned: bool = False, instead: str | None = None
) -> Case:
    """Open a campaign by folder or name in `data/`, with its robot or another one instead.

    ``planned``: values may be missing. Raises InputError for poses, sensors or loads unlike it.
    """
    folder = find_campaign(name)
    campaign = load_campaign(folder, planned=planned)
    if campaign.robot is None:
        if instead:
            raise InputError(
                "--robot: this campaign has predictions instead of a robot"
            )
        return Case(folder.resolve().name, folder, campaign, None)
    robot = load_robot(instead or _robot_of(folder, campaign, campaign.robot))
    campaign = match_robot(campaign, robot)
    if robot.carries("gravity") and not campaign.is_weighed:
        campaign = dataclasses.replace(
            campaign, modelled=(*(campaign.modelled or ()), "gravity")
        )
    return Case(folder.resolve().name, folder, campaign, robot)


def configure_case(
    case: Case, nominal: Assembled | None = None
) -> Configurations | None:
    """Return the robot (default: rigid parts) at the campaign's poses; None without robot or readings.

    Raises InputError for an unreachable pose.
    """
    if case.robot is None or not len(case.campaign):
        return None
    mechanism = nominal.mechanism if nominal else rigid_mechanism(case.robot)
    return RobotAtPoses(
        NominalRobot(mechanism, case.robot), case.campaign
    ).configurations


def inspect_case(
    case: Case, configurations: Configurations | None
) -> tuple[ReadingRemark, ...]:
    """Return remarks on poses, found by `configure_case`, and on readings, without experiments."""
    if not len(case.campaign):
        return ()
    remarks = inspect_readings(case.campaign, predict_roughly(case))
    if case.robot is None or configurations is None:
        return remarks
    mechanism = rigid_mechanism(case.robot)
    misread = find_misread(
        RobotAtPoses(NominalRobot(mechanism, case.robot), case.campaign)
    )
    frames = [ReadingRemark("frame", name, (), str(error)) for name, error in misread]
    ranges = inspect_ranges(case.campaign, mechanism, configurations)
    doubts = (
        *inspect_extremes(case.campaign, mechanism),
        *inspect_mechanics(case.campaign),
    )
    return (*doubts, *frames, *ranges, *remarks)


def predict_roughly(case: Case) -> Array:
    """Predict readings (n,) of the nominal robot without virtual experiments; NaN if not predicted.

    Rods and plates follow beam theory; parts that need an experiment are rigid.
    """
    campaign = case.campaign
    if case.robot is None:
        return campaign.predictions["value"]
    read = np.flatnonzero(~np.isnan(campaign.value))
    sensors = tuple(dataclasses.replace(s, at_sigma=0.0) for s in campaign.sensors)
    out = np.full(len(campaign), np.nan)
    if not len(read):
        return out
    nominal = NominalRobot(rough_mechanism(case.robot), case.robot)
    with contextlib.suppress(
        InputError
    ):  # a diagnosis reports it, with the actual parts
        model = RobotModel(
            dataclasses.replace(campaign.select(read), sensors=sensors), nominal
        )
        expected = model.campaign.expected
        out[read] = model.predict().values + (0.0 if expected is None else expected)
    return out


def compare_responses(case: Case) -> tuple[ComparedResponses, ...]:
    """Read the responses of a campaign and predict them by the robot without virtual experiments.

    Raises InputError for files that cannot be read, and points or poses that are not the robot's.
    """
    if case.robot is None or not case.campaign.responses:
        return ()
    mechanism = rough_mechanism(case.robot, case.campaign.components)
    compared = list[ComparedResponses]()
    for measured in load_responses(case.folder, case.campaign, case.robot, mechanism):
        damping = measured.find_damping()
        predicted = predict_responses(mechanism, measured, damping)
        compared.append(ComparedResponses(measured, predicted, damping))
    return tuple(compared)


def rough_mechanism(robot: RobotFile, components: str | None = None) -> Mechanism:
    """Return a robot without virtual experiments.

    Rods and plates follow beam theory, or are as published; parts that need an experiment are rigid.
    """
    source = "published" if components == "published" else "beam"
    needed = needed_experiments(robot, source)
    sources = part_sources(robot, source)
    rigid: dict[str, Any] = {name: rigid_part(robot, name) for name in needed}
    given = {name: each for name, each in sources.items() if each == source}
    return mechanism_of(robot, part_matrices(robot, given, rigid))


def find_campaign(name: str | Path) -> Path:
    """Return the folder of a campaign given by folder, campaign.toml or name in `data/`."""
    path = Path(name)
    if path.is_dir():
        return path
    if path.name == "campaign.toml" and path.is_file():
        return path.parent
    for shelf in SHELVES:
        known = FOLDER / shelf / path.name
        if path.name == str(name) and (known / "campaign.toml").is_file():
            return known
    valid = f"a folder with a campaign.toml or one of the names {', '.join(campaign_names())}"
    raise InputError(f"{name}: no such campaign; give {valid}")


def campaign_names() -> list[str]:
    """Return the names of the campaigns in `data/`."""
    headers = (
        path for shelf in SHELVES for path in FOLDER.glob(f"{shelf}/*/campaign.toml")
    )
    return sorted(path.parent.name for path in headers)


def _robot_of(folder: Path, campaign: Campaign, robot: str) -> Path:
    """Return the campaign's robot file: relative to its folder, or by name in `data/robots`."""
    if os.path.isfile(folder / robot):  # noqa: PTH113 (Path.is_file raises on some names)
        return folder / robot
    if robot in robot_names():
        return find_robot(robot)
    expected = (
        f"a robot file, seen from its folder, or one of {', '.join(robot_names())}"
    )
    raise campaign.refuse(("robot",), f"expected {expected}, got {show_value(robot)}")

"""`stiffscope diagnose`: a campaign, its nominal robot, the diagnosis, and what is written of it."""

from __future__ import annotations

import dataclasses
import json
import logging
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from stiffscope import files
from stiffscope.cli import adopt as adoption
from stiffscope.cli.run import Assembled, draw_robot, solve_robots, workshop
from stiffscope.errors import InputError
from stiffscope.jobs.cache import file_digest
from stiffscope.jobs.manifest import Manifest
from stiffscope.report import gap_tables as gaptables
from stiffscope.report import tables
from stiffscope.report.pictures import PictureError
from stiffscope.robot.components import nominal_robot
from stiffscope.robot.robot_file import data_folder, find_robot, load_robot, robot_names

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np

    from stiffscope.gap.diagnosis import Diagnosis
    from stiffscope.gap.readings import Campaign
    from stiffscope.robot.effects import NominalRobot
    from stiffscope.robot.schema import RobotFile

    Report = Callable[[str, float], None]

log = logging.getLogger(__name__)

SHELVES = ("campaigns", "withheld")
GROUPS = {
    "joints": tuple(f"limb{i}.link{j}.joint_{end}" for i in (1, 2) for j in (1, 2, 3) for end in "ab"),
    "links": tuple(f"limb{i}.link{j}" for i in (1, 2) for j in (1, 2, 3)),
    "carriages": ("limb1.carriage", "limb2.carriage"),
    "sliders": ("limb1.slider", "limb2.slider"),
    "limbs": ("limb1.actuator", "limb2.actuator"),
}


@dataclass(frozen=True)
class Case:
    """A campaign with its nominal robot; no robot where it brings its own predictions."""

    name: str
    folder: Path
    campaign: Campaign
    robot: RobotFile | None


def diagnose_campaign(name: str, out: Path, *, adopt: Path | None, target: str | None, quiet: bool) -> None:
    """Diagnose a campaign and write a complete folder. Raises InputError for anything a user can get wrong."""
    from stiffscope.gap.diagnosis import to_json

    files.check_output(out, target, adopt)
    case = open_case(name)
    manifest = _manifest(case)
    if adopt is not None:
        adoption.check_target(adopt, case.robot)
    with workshop(quiet=quiet) as (cache, spare, open_line):
        assembled = None
        if case.robot is not None:
            components = case.campaign.components
            robots = {"now": case.robot}
            assembled = solve_robots(robots, components, cache, spare, open_line, pictures=False)["now"]
        report = open_line("diagnosis")
        diagnosis = _diagnosed(case, assembled, report)
        report("pictures", 0.95)
        with files.staged_folder(out) as folder:
            files.write_json(folder / "diagnosis.json", to_json(diagnosis))
            _write_figures(case, assembled, diagnosis, folder)
            manifest.write(folder)
    if target:
        files.write_json(target, to_json(diagnosis))
    loud = not quiet and target != "-"
    if loud:
        gaptables.show_diagnosis(diagnosis, assembled.matrices["slider"] if assembled else None)
        tables.show_line(f"Written to {out}; the page is {out / 'report.html'}")
    if adopt is not None and assembled is not None:
        _adopt(adopt, assembled, diagnosis, case, loud=loud)


def open_case(name: str) -> Case:
    """The campaign in a folder, or by its name in `data/`, with the robot that it names."""
    from stiffscope.gap.readings import load_campaign

    folder = find_campaign(name)
    campaign = load_campaign(folder)
    if campaign.robot is None:
        return Case(folder.resolve().name, folder, campaign, None)
    robot = load_robot(_robot_of(folder, campaign.robot))
    if robot.carries("gravity") and "gravity" not in campaign.modelled:
        campaign = dataclasses.replace(campaign, modelled=(*campaign.modelled, "gravity"))
    return Case(folder.resolve().name, folder, campaign, robot)


def find_campaign(name: str) -> Path:
    """Folder of a campaign given as a folder, its campaign.toml, or a name in `data/`."""
    path = Path(name)
    if path.is_dir():
        return path
    if path.name == "campaign.toml" and path.is_file():
        return path.parent
    for shelf in SHELVES:
        known = data_folder() / shelf / name
        if path.name == name and (known / "campaign.toml").is_file():
            return known
    listed = ", ".join(campaign_names()) or "(none)"
    raise InputError(f"{name}: no such campaign; give a folder with a campaign.toml or one of the names {listed}")


def campaign_names() -> list[str]:
    """Names of the campaigns that `data/` knows."""
    return sorted(p.parent.name for shelf in SHELVES for p in (data_folder() / shelf).glob("*/campaign.toml"))


def _robot_of(folder: Path, robot: str) -> Path:
    """The campaign's robot file: beside the campaign, or by its name in `data/`."""
    if (folder / robot).is_file():
        return folder / robot
    if robot in robot_names():
        return find_robot(data_folder() / f"{robot}.toml")
    names = ", ".join(robot_names())
    where = folder / "campaign.toml"
    expected = f"a robot file, seen from its folder, or one of {names}"
    raise InputError(f"{where}, robot: expected {expected}, found {json.dumps(robot)}")


def _diagnosed(case: Case, assembled: Assembled | None, report: Report) -> Diagnosis:
    from stiffscope.gap.diagnose import diagnose

    return diagnose(case.campaign, _nominal(assembled) if assembled else None, report)


def _nominal(assembled: Assembled) -> NominalRobot:
    return nominal_robot(assembled.elastic, assembled.robot)


def _write_figures(case: Case, assembled: Assembled | None, diagnosis: Diagnosis, folder: Path) -> None:
    from stiffscope.report.gap_figures import draw_figures
    from stiffscope.report.html import write_page

    figures = draw_figures(diagnosis, folder)
    slider = None
    facts = [f"{len(case.campaign):,} readings at {len(case.campaign.pose_names)} poses"]
    if assembled is None:
        facts.append("the model under test is the campaign's own predictions")
    else:
        slider = assembled.matrices["slider"]
        made_of = ", ".join(f"{part} {source}" for part, source in assembled.sources.items())
        facts.append(f"nominal robot {assembled.robot.name} ({made_of}; modelled: {_modelled(case)})")
        _draw_shares(assembled, diagnosis, case.campaign.poses, folder)
    write_page(
        folder / "report.html", diagnosis, title=f"Where is the gap? {case.name}", facts=facts, folder=folder,
        figures=figures, slider=slider,
    )  # fmt: skip


def _modelled(case: Case) -> str:
    return ", ".join(case.campaign.modelled) or "no effect"


def _draw_shares(assembled: Assembled, diagnosis: Diagnosis, poses: np.ndarray, folder: Path) -> None:
    """The robot at the pose of the greatest misfit, its components coloured by their share of the gap."""
    import numpy as np

    where = diagnosis.where
    if not where.component:
        return
    worst = int(np.argmax([np.nansum(np.square(row)) for row in np.array(where.pose, dtype=float)]))
    place = ", ".join(f"{1e3 * c:.4g}" for c in poses[worst])
    title = f"Share of the gap by component, at the pose of the greatest misfit, M = ({place}) mm"
    picture = {"file": "robot.png", "title": title, "pose": poses[worst]}
    try:
        draw_robot(assembled, folder, [picture], shares=shares(diagnosis), scale="share of the gap")
    except PictureError as error:
        log.warning("%s", error)


def shares(diagnosis: Diagnosis) -> dict[str, float]:
    """Share of the gap by body of the drawing: a group's share is shown on each of its members."""
    out: dict[str, float] = {}
    for component, share in diagnosis.where.component.items():
        for body in GROUPS.get(component, (component,)):
            out[body] = out.get(body, 0.0) + share
    return out


def _manifest(case: Case) -> Manifest:
    names = ("campaign.toml", *case.campaign.files)
    inputs = {name: file_digest(case.folder / name) for name in names}
    robot = case.robot
    if robot is None:
        return Manifest(sys.argv[1:], inputs=inputs)
    return Manifest(sys.argv[1:], str(robot.path), file_digest(robot.path), inputs=inputs)


def _adopt(target: Path, assembled: Assembled, diagnosis: Diagnosis, case: Case, *, loud: bool) -> None:
    left = adoption.adopt(
        target, assembled.robot, _nominal(assembled), diagnosis, campaign=case.name, components=case.campaign.components
    )
    if loud:
        for reason in left:
            tables.show_line(f"Not adopted: {reason}")
        tables.show_line(f"Adopted in {target}, with the parts' matrices of the diagnosis ({case.campaign.components})")

"""Commands for measurements: diagnosis, campaigns, blind check, audit of the published model."""

from __future__ import annotations

import logging
import os
from contextlib import ExitStack, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.cli.output import emit, open_workshop
from stiffscope.errors import InputError, say_count
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.experiments.manifest import manifest_of
from stiffscope.gap.adoption import adopt as adopt_effects
from stiffscope.gap.adoption import check_target, name_of, what_is_sure
from stiffscope.gap.campaign.campaign_header import load_header
from stiffscope.gap.campaign.measured_responses import load_responses
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.campaign.template import write_template
from stiffscope.gap.campaigns import (
    assemble_nominal,
    compare_responses,
    configure_case,
    diagnose_case,
    inspect_case,
    open_case,
)
from stiffscope.gap.inference.diagnosis import to_json
from stiffscope.gap.inference.posterior_samples import write_posterior, write_readings
from stiffscope.gap.planning.candidates import propose_plan
from stiffscope.gap.planning.hits import propose_hits, write_hits
from stiffscope.gap.show import campaign as campaign_check
from stiffscope.gap.show import tables as gap_tables
from stiffscope.gap.show.page import share_view, write_diagnosis_report
from stiffscope.gap.show.pictures import order_figures, order_shares, shares_ahead
from stiffscope.gap.show.responses import draw_compared
from stiffscope.report import tables
from stiffscope.report.kept_pictures import write_pictures
from stiffscope.report.pictures import open_drawing
from stiffscope.robot.library import robot_names
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.output import staged_folder

if TYPE_CHECKING:
    from stiffscope.cli.output import Output
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.experiments.manifest import Manifest
    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.campaign.campaign_header import Header
    from stiffscope.gap.campaign.measured_responses import MeasuredResponses
    from stiffscope.gap.campaigns import Case
    from stiffscope.gap.inference.diagnosis import Diagnosis
    from stiffscope.report.run_report import Draft
    from stiffscope.robot.file.description import RobotFile

log = logging.getLogger(__name__)
_HAMMER = Path("hammer")


@click.command()
@takes(click.argument("name", metavar="CAMPAIGN"), options.out, options.json)
@click.option(
    "--robot", metavar="FILE", help="An adopted robot to diagnose, not the campaign's."
)
@click.option(
    "--adopt",
    metavar="FILE",
    type=options.PATH,
    help="Write a robot file that carries the effects that were found.",
)
def diagnose(
    name: str, *, robot: str | None, adopt: Path | None, output: Output
) -> None:
    """Find the effects that explain the gap between model and measurements.

    CAMPAIGN is a folder with a campaign.toml and its readings, or a bundled one: gauges, knock or published.
    """
    output.check_folder(output.folder, adopt)
    case = open_case(name, instead=robot)
    manifest = _manifest_of(case)
    if adopt is not None:
        check_target(adopt, case.robot)
    with open_workshop(output) as shop, ExitStack() as stack:
        nominal = assemble_nominal(case, shop)
        files = manifest.sources["inputs"]
        ahead = nominal and stack.enter_context(
            shares_ahead(nominal, files, shop.cache)
        )
        diagnosis = diagnose_case(case, nominal, shop)

        def fill(folder: Path) -> None:
            if diagnosis.samples is not None:
                write_posterior(folder / "posterior.nc", diagnosis.samples)
                write_readings(folder / "readings.csv", diagnosis.samples)
            if diagnosis.responses:
                gap_tables.write_modes(folder / "modes.csv", diagnosis)
            orders = [order_figures(diagnosis, folder)]
            if nominal and ahead and (found := configure_case(case, nominal)):
                orders += order_shares(nominal, diagnosis, found, folder, ahead)
            write_pictures(orders, shop.cache, shop.executor, manifest)

        def carry() -> None:
            if adopt is None or nominal is None:
                return
            c = case.campaign
            robot = NominalRobot(nominal.mechanism, nominal.robot)
            about = {
                "campaign": case.name,
                "components": c.components,
                "modelled": c.modelled or (),
            }
            adopt_effects(adopt, nominal.robot, robot, diagnosis, **about)

        show = gap_tables.show_diagnosis
        page = partial(_write_page, case, nominal, diagnosis)
        emit(
            output,
            to_json(diagnosis),
            partial(show, diagnosis),
            manifest=manifest,
            fill=fill,
            page=page,
            kept="diagnosis.json",
            also=carry,
        )
        if adopt and nominal and output.loud:
            parts = (
                f"with the parts' matrices of the diagnosis ({tables.sources(nominal)})"
            )
            tables.show_line(f"Adopted in {adopt}, {parts}")
            uncertain = what_is_sure(diagnosis).left_out
            if uncertain:
                each = (f"{name_of(e)} ({e.probability:.2g})" for e in uncertain)
                tables.show_line(f"Not adopted, as not certain: {', '.join(each)}")


def _manifest_of(case: Case) -> Manifest:
    responses = (setup.file for setup in case.campaign.responses)
    files = ("campaign.toml", *case.campaign.files, *responses)
    return manifest_of(case.robot, *(case.folder / file for file in files))


def _write_page(
    case: Case, nominal: Assembled | None, diagnosis: Diagnosis, report: Draft
) -> None:
    view = None
    facts = _count_measured(case, diagnosis)
    if nominal is None:
        facts.append("the model under test is the campaign's own predictions")
    else:
        modelled = f"modelled: {', '.join(case.campaign.modelled or ()) or 'no effect'}"
        facts.append(
            f"nominal robot {nominal.robot.name} ({tables.sources(nominal)}; {modelled})"
        )
        found = configure_case(case, nominal)
        view = share_view(report, nominal, diagnosis, found) if found else None
    title = f"Where is the gap? {case.name}"
    write_diagnosis_report(report, diagnosis, title=title, facts=facts, view=view)


def _count_measured(case: Case, diagnosis: Diagnosis) -> list[str]:
    """Return numbers of readings and poses, and of responses by set-up."""
    poses = say_count(len(case.campaign.pose_names), "pose")
    facts = [f"{say_count(len(case.campaign), 'reading')} at {poses}"]
    if diagnosis.responses and not len(case.campaign):
        facts = []
    facts += [
        f"{say_count(len(setup.lines), 'response')} of {name}"
        for name, setup in diagnosis.responses.items()
    ]
    return facts


@click.group()
def campaign() -> None:
    """Create or check a campaign of measurements."""


@campaign.command("new")
@takes(
    options.robot,
    options.json,
    click.option(
        "--out",
        "goal",
        required=True,
        metavar="DIR",
        type=options.PATH,
        help=options.OUT,
    ),
)
@click.option(
    "--ask",
    metavar="QUESTION",
    help='Plan the fewest readings that distinguish causes: "base-compliance from J1", effects, '
    'places or patterns of "effect @ place", several divided by commas; or "all".',
)
@click.option(
    "--with",
    "given",
    metavar="CAMPAIGN|hammer",
    type=options.PATH,
    help="With --ask: plan with the sensors and loads of this campaign alone, and the forces of its readings, "
    "or with its responses; "
    "or, with a hammer, where to hit and where to listen.",
)
def new_campaign(
    name: str, goal: Path, *, ask: str | None, given: Path | None, output: Output
) -> None:
    """Write a campaign folder to fill in: examples of sensors and loads, and a plan of readings."""
    robot = load_robot(name)
    named = (
        name
        if name in robot_names()
        else Path(os.path.relpath(robot.path, goal)).as_posix()
    )
    proposal = None
    plan = {}
    if given is not None and ask is None:
        raise InputError("--with: expected a question, --ask, too")
    hammered = given is not None and given == _HAMMER and not given.is_dir()
    if ask is not None and hammered:
        _plan_hits(robot, named, goal, ask, output)
        return
    if ask is not None and given is not None and _is_hammered(given):
        _plan_hits(robot, named, goal, ask, output, given)
        return
    if ask is not None:
        own = None if given is None else _load_own(given, robot)
        with open_workshop(output) as shop:
            made = assemble_robots({"nominal": robot}, "beam", shop)["nominal"]
        nominal = NominalRobot(made.mechanism, robot)
        proposal = propose_plan(nominal, ask, own)
        plan = {"plan": campaign_check.plan_json(proposal)}
    poses, readings = write_template(robot, named, goal, proposal and proposal.plan)

    def show() -> None:
        if proposal is not None:
            campaign_check.show_plan(proposal, robot.tool.pose)
        tables.show_line(
            f"Written: {goal}, {say_count(readings, 'reading')} at "
            f"{say_count(poses, 'pose')} to fill in."
        )
        tables.show_line(f"Next: stiffscope campaign check {goal}")

    emit(
        output,
        {"folder": str(goal), "readings": readings, "poses": poses, **plan},
        show,
    )


def _is_hammered(folder: Path) -> bool:
    """Return whether a campaign has responses alone."""
    header = load_header(folder)
    return bool(header.responses) and not (header.readings or header.sensors)


def _plan_hits(
    robot: RobotFile,
    named: str,
    goal: Path,
    ask: str,
    output: Output,
    given: Path | None = None,
) -> None:
    """Write and show a planned hammer test, with the hits and channels of a campaign alone if given."""
    stated = None if given is None else load_header(given).components
    with open_workshop(output) as shop:
        made = assemble_robots({"nominal": robot}, stated or "beam", shop)["nominal"]
    own: tuple[MeasuredResponses, ...] = ()
    if given is not None:
        tests = load_campaign(given, robot, planned=True)
        own = load_responses(given, tests, robot, made.mechanism)
    proposal = propose_hits(NominalRobot(made.mechanism, robot), ask, own)
    with staged_folder(goal, new=True) as aside:
        write_hits(aside, named, proposal)

    def show() -> None:
        campaign_check.show_hits(proposal)
        tables.show_line(f"Written: {goal}, {say_count(len(proposal.taps), 'hit')}.")
        tables.show_line(f"Next: measure, then stiffscope campaign check {goal}")

    hits = len(proposal.taps)
    plan = campaign_check.hits_json(proposal)
    emit(output, {"folder": str(goal), "hits": hits, "plan": plan}, show)


def _load_own(folder: Path, robot: RobotFile) -> Campaign | Header:
    """Load the instruments and loads of a campaign, with its readings if it has any yet."""
    header = load_header(folder)
    if all((folder / name).is_file() for name in header.readings):
        return load_campaign(folder, robot, planned=True)
    return header


@campaign.command("check")
@takes(
    click.argument("name", metavar="CAMPAIGN"),
    options.json,
    options.folder(
        "--out", "report, pictures of the sensors on the robot, and check.json."
    ),
)
def check_campaign(name: str, *, output: Output) -> None:
    """Report how a campaign was read, without experiments: counts, units, sensors, loads, doubt."""
    case = open_case(name, planned=True)
    with (
        open_drawing(ahead=True)
        if output.folder and case.robot
        else nullcontext() as draw
    ):
        found = configure_case(case)
        remarks = inspect_case(case, found)
        compared = compare_responses(case)
        facts = campaign_check.campaign_json(case.campaign, remarks, compared)

        def fill(folder: Path) -> None:
            if case.robot is not None:
                draw_compared(draw, case.robot, compared, folder)
            if case.robot is not None and found is not None and draw is not None:
                campaign_check.draw_sensors(
                    draw, case.robot, found, case.campaign, folder
                )

        emit(
            output,
            facts,
            lambda: campaign_check.show_campaign(facts, case.name),
            fill=fill,
            manifest=_manifest_of(case),
            page=partial(campaign_check.write_page, case.name, facts),
            kept="check.json",
        )

"""The commands on measurements: diagnosis of a campaign, its blind check, the audit of the published model."""

from __future__ import annotations

import dataclasses
import logging
import os
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.experiments.manifest import manifest_of
from stiffscope.runtime import files
from stiffscope.runtime.processors import processors

if TYPE_CHECKING:
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.experiments.manifest import Manifest
    from stiffscope.gap.campaigns import Case
    from stiffscope.gap.inference.diagnosis import Diagnosis
    from stiffscope.report.kept_pictures import SharesPicture
    from stiffscope.runtime.cache import Cache

log = logging.getLogger(__name__)

GROUPS = {
    "Eq. (29)": "Eq. (29): compliance of the slidable platform",
    "Eq. (30a)": "Eq. (30a): stiffness at P1 with gravity",
    "Eq. (30b)": "Eq. (30b): stiffness at P2 with gravity",
    "Table 5": "Table 5: stiffness (diagonal of K) at Q1",
    "Table 6": "Table 6: stiffness (diagonal of K) at Q2",
    "text": "RMS figures of the text, %",
}


@click.command()
@takes(click.argument("name", metavar="CAMPAIGN"), options.out, options.target)
@click.option(
    "--adopt",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Write a robot file that carries the effects that were found.",
)
def diagnose(name: str, out: Path, *, target: str | None, adopt: Path | None, quiet: bool) -> None:
    """Where model and machine differ, and which effect causes it.

    CAMPAIGN is a folder with a campaign.toml and its readings, or the name of a campaign that comes along: published.
    """
    from stiffscope.cli.showing import shown_workshop
    from stiffscope.gap.adoption import check_target
    from stiffscope.gap.campaigns import assemble_nominal, diagnose_case, open_case
    from stiffscope.gap.inference.diagnosis import to_json
    from stiffscope.gap.inference.posterior_samples import write_posterior
    from stiffscope.report import gap_tables, tables
    from stiffscope.report.kept_pictures import shares_ahead

    files.check_output(out, target, adopt)
    case = open_case(name)
    manifest = manifest_of(case.robot, *(case.folder / file for file in ("campaign.toml", *case.campaign.files)))
    if adopt is not None:
        check_target(adopt, case.robot)
    with shown_workshop(quiet=quiet) as shop, ExitStack() as stack:
        nominal = assemble_nominal(case, shop)
        ahead = nominal and stack.enter_context(shares_ahead(nominal, manifest.sources["inputs"], shop.cache))
        diagnosis = diagnose_case(case, nominal, shop)
        with files.staged_folder(out) as folder:
            files.write_json(folder / "diagnosis.json", to_json(diagnosis))
            if diagnosis.samples is not None:
                write_posterior(folder / "posterior.nc", diagnosis.samples)
            _write_report(case, nominal, diagnosis, folder, manifest, shop.cache, ahead)
    if target:
        files.write_json(target, to_json(diagnosis))
    loud = not quiet and target != "-"
    if loud:
        gap_tables.show_diagnosis(diagnosis)
        tables.show_line(f"Written to {out}; the report is {out / 'report.html'}")
    if adopt is not None and nominal is not None:
        _adopt(adopt, nominal, diagnosis, case, loud=loud)


def _write_report(
    case: Case, nominal: Assembled | None, diagnosis: Diagnosis, folder: Path, manifest: Manifest, cache: Cache,
    ahead: SharesPicture | None,
) -> None:  # fmt: skip
    """Figures, manifest, and the report that shows them."""
    from stiffscope.gap.campaigns import configure_case
    from stiffscope.report.diagnosis_report import share_view, write_diagnosis_report
    from stiffscope.report.kept_pictures import order_shares, write_diagnosis_pictures

    view = None
    facts = [f"{len(case.campaign):,} readings at {len(case.campaign.pose_names)} poses"]
    if nominal is None:
        facts.append("the model under test is the campaign's own predictions")
        write_diagnosis_pictures(diagnosis, folder, cache, manifest)
    else:
        made_of = ", ".join(f"{part} {source}" for part, source in nominal.sources.items())
        modelled = ", ".join(case.campaign.modelled) or "no effect"
        facts.append(f"nominal robot {nominal.robot.name} ({made_of}; modelled: {modelled})")
        found = configure_case(case, nominal)
        robot = order_shares(nominal, diagnosis, found, folder, ahead) if found and ahead else None
        write_diagnosis_pictures(diagnosis, folder, cache, manifest, robot)
        view = share_view(folder, nominal, diagnosis, found) if found else None
    manifest.write(folder)
    write_diagnosis_report(folder, diagnosis, title=f"Where is the gap? {case.name}", facts=facts, view=view)


def _adopt(target: Path, nominal: Assembled, diagnosis: Diagnosis, case: Case, *, loud: bool) -> None:
    from stiffscope.gap.adoption import adopt
    from stiffscope.report import tables
    from stiffscope.robot.effects import NominalRobot

    components, carrying = case.campaign.components, NominalRobot(nominal.mechanism, nominal.robot)
    left = adopt(target, nominal.robot, carrying, diagnosis, campaign=case.name, components=components)
    if loud:
        for reason in left:
            tables.show_line(f"Not adopted: {reason}")
        tables.show_line(f"Adopted in {target}, with the parts' matrices of the diagnosis ({components})")


@click.group()
def campaign() -> None:
    """A campaign of measurements: a template folder to fill in, and what was understood of one."""


@campaign.command("new")
@takes(options.robot, options.out, options.target)
def new_campaign(name: str, out: Path, *, target: str | None, quiet: bool) -> None:
    """Write a campaign folder for a robot, to fill in: sensors and loads as examples, a plan of readings."""
    from stiffscope.gap.campaign.template import write_template
    from stiffscope.report import tables
    from stiffscope.robot.library import robot_names
    from stiffscope.robot.reader import load_robot

    robot = load_robot(name)
    named = name if name in robot_names() else Path(os.path.relpath(robot.path, out)).as_posix()
    poses, readings = write_template(robot, named, out)
    if target:
        files.write_json(target, {"folder": str(out), "readings": readings, "poses": poses})
    if not quiet and target != "-":
        tables.show_line(f"Written: {out}, {readings} readings at {poses} poses to fill in.")
        tables.show_line(f"Next: stiffscope campaign check {out}")


@campaign.command("check")
@takes(
    click.argument("name", metavar="CAMPAIGN"),
    options.folder("--out", "Folder to write: report, pictures of the sensors on the robot, and check.json."),
    options.target,
)
def check_campaign(name: str, out: Path | None, *, target: str | None, quiet: bool) -> None:
    """What was understood of a campaign: counts, units, poses, sensors and loads; no experiment is made."""
    from stiffscope.gap.campaigns import configure_case, open_case
    from stiffscope.report.campaign_check import campaign_json, draw_sensors, show_campaign, write_page
    from stiffscope.report.pictures import PictureError

    if out is not None:
        files.check_output(out, target)
    case = open_case(name, planned=True)
    found, facts = configure_case(case), campaign_json(case.campaign)
    if not quiet and target != "-":
        show_campaign(facts, case.name)
    if out is not None:
        manifest = manifest_of(case.robot, *(case.folder / file for file in ("campaign.toml", *case.campaign.files)))
        with files.staged_folder(out) as folder:
            files.write_json(folder / "check.json", facts)
            if case.robot is not None and found is not None:
                try:
                    draw_sensors(case.robot, found.mechanism, found, case.campaign, folder)
                except PictureError as error:
                    log.warning("%s", error)
            manifest.write(folder)
            write_page(facts, case.name, folder)
    if target is not None:
        files.write_json(target, facts)


@click.command()
@takes(
    click.argument("names", metavar="[ROBOT]...", nargs=-1),
    options.out,
    options.target,
    options.components,
)
@click.option("--campaigns", default=100, show_default=True, type=click.IntRange(1, 100000), help="How many a robot.")
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="What decides which are drawn.")
@options.scheduler
def blind(
    names: tuple[str, ...], out: Path, *, target: str | None, components: str | None, campaigns: int, seed: int,
    scheduler: str | None, quiet: bool,
) -> None:  # fmt: skip
    """The check of the diagnosis on campaigns whose effects are withheld.

    Draws campaigns of each ROBOT (by default biglide), seals what is in them, diagnoses them, and scores the answers.
    Finished cases are kept in DIR.cases until all are: the same command goes on where it was interrupted.
    """
    from stiffscope.cli.showing import shown_workshop
    from stiffscope.gap.blind.check import case_files, check_cases, run_blind
    from stiffscope.gap.blind.robots import blind_robots
    from stiffscope.report import tables
    from stiffscope.report.blind_scores import draw_scores, scores_json, show_scores, write_blind_report
    from stiffscope.robot.reader import load_robot

    files.check_output(out, target)
    cases = out.with_name(f"{out.name}.cases")
    check_cases(cases)
    robots = [load_robot(name) for name in names or ("biglide",)]
    manifest = manifest_of(robots[0], *(robot.path for robot in robots[1:]))
    with shown_workshop(quiet=quiet) as shop:
        drawn = blind_robots(robots, components, shop)
        report = shop.open_line("blind")
        scores = run_blind(cases, drawn, campaigns, seed, report, workers=processors(), scheduler=scheduler)
        report("figures", 1.0)
        found = scores_json(scores, campaigns, seed, manifest.elapsed())
        with files.staged_folder(out) as folder:
            files.copy_files(cases, folder, case_files(cases, drawn, campaigns, seed))
            files.write_json(folder / "scores.json", found)
            draw_scores(scores, folder)
            manifest.write(folder)
            write_blind_report(scores, folder, f"Blind check of the diagnosis, {campaigns} campaigns a robot")
    if not files.remove_copied(cases, out):
        log.warning("%s: holds files that are no cases of this check; they stay there", cases)
    if target:
        files.write_json(target, found)
    if not quiet and target != "-":
        show_scores(scores)
        tables.show_line(f"{campaigns} campaigns a robot in {manifest.elapsed():.0f} s; written to {out}")


@click.command()
@takes(options.target)
def audit(*, target: str | None, quiet: bool) -> None:
    """The paper's numbers recomputed, each with a verdict."""
    from stiffscope.biglide.audit import findings_on_paper
    from stiffscope.cli.showing import shown_workshop
    from stiffscope.experiments.experiments import solve_parts
    from stiffscope.experiments.orders import order_part
    from stiffscope.report import tables
    from stiffscope.robot.reader import load_robot

    robot = load_robot("biglide")
    with shown_workshop(quiet=quiet) as shop:
        (slider,) = solve_parts([order_part(robot, "slider")], shop)
    findings = findings_on_paper(robot, slider.compliance)
    if target:
        files.write_json(target, [dataclasses.asdict(finding) for finding in findings])
    if not quiet and target != "-":
        for source, title in GROUPS.items():
            tables.show_findings(title, [finding for finding in findings if finding.source == source])

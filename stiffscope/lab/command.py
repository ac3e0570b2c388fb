"""The command `blind`."""

from __future__ import annotations

import logging
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit, open_workshop
from stiffscope.errors import InputError
from stiffscope.experiments.manifest import manifest_of
from stiffscope.lab import show as blind_scores
from stiffscope.lab.blind.check import case_files, check_cases, run_blind
from stiffscope.lab.blind.laboratory import blind_robots
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.output import copy_files, remove_copied
from stiffscope.runtime.processors import processors

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.cli.output import Output
    from stiffscope.lab.measuring import Mechanics


log = logging.getLogger(__name__)


@click.command()
@takes(
    click.argument("names", metavar="[ROBOT]...", nargs=-1),
    options.out,
    options.json,
    options.components,
)
@options.count("--campaigns", 100, "How many a robot.", 1, 100000)
@options.count("--seed", 1, "What decides which are drawn.", 0)
@click.option(
    "--machine",
    "mechanics",
    type=click.Choice(("own", "exudyn")),
    default="own",
    show_default=True,
    help="Whose mechanics the simulated machine has: our own laboratory's, or EXUDYN's.",
)
@click.option(
    "--with",
    "instrument",
    type=click.Choice(("hammer",)),
    help="Hammer tests alone, as universal files; by default gauges, trackers and others in turn.",
)
@options.scheduler
def blind(
    names: Texts,
    *,
    components: str | None,
    campaigns: int,
    seed: int,
    mechanics: Mechanics,
    instrument: str | None,
    scheduler: str | None,
    output: Output,
) -> None:
    """Test the diagnosis on campaigns whose effects are withheld.

    Simulates campaigns of each ROBOT (by default biglide), seals their effects, diagnoses them, and
    scores the answers. Finished cases are stored in DIR.cases until all are done: the same command
    resumes an interrupted check.
    """
    out = output.required_folder()
    if mechanics == "exudyn" and find_spec("exudyn") is None:
        raise InputError(
            "--machine exudyn: expected the package exudyn; `pip install stiffscope[exudyn]`"
        )
    if mechanics == "exudyn" and instrument is not None:
        raise InputError("--with hammer: expected --machine own, got exudyn")
    cases = out.with_name(f"{out.name}.cases")
    check_cases(cases)
    robots = [load_robot(name) for name in names or ("biglide",)]
    manifest = manifest_of(robots[0], *(robot.path for robot in robots[1:]))
    with open_workshop(output) as shop:
        drawn = blind_robots(
            robots, components, shop, mechanics, hammered=instrument == "hammer"
        )
        report = shop.open_line("blind")
        scores = run_blind(
            cases,
            drawn,
            campaigns,
            seed,
            report,
            workers=processors(),
            scheduler=scheduler,
        )
        report("figures", 1.0)

    def fill(folder: Path) -> None:
        copy_files(cases, folder, case_files(cases, drawn, campaigns, seed))
        blind_scores.draw_scores(scores, folder)

    about = {
        "campaigns": campaigns,
        "seed": seed,
        "machine": mechanics,
        "with": instrument,
        "seconds": round(manifest.measure_elapsed(), 1),
    }
    emit(
        output,
        about | blind_scores.scores_json(scores),
        lambda: blind_scores.show_scores(scores),
        manifest=manifest,
        fill=fill,
        page=partial(blind_scores.write_blind_report, scores),
        kept="scores.json",
    )
    if not remove_copied(cases, out):
        log.warning(
            "%s: holds files that are no cases of this check; they stay there", cases
        )

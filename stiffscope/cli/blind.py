"""`stiffscope blind`: withheld campaigns are drawn, diagnosed and scored, and the score is shown."""

from __future__ import annotations

import os
import sys
import time
from typing import TYPE_CHECKING

from stiffscope import files
from stiffscope.cli.run import solve_robots, workshop
from stiffscope.jobs.cache import file_digest
from stiffscope.jobs.manifest import Manifest
from stiffscope.report import tables
from stiffscope.report.blind_scores import draw_scores, scores_json, show_scores
from stiffscope.robot.robot_file import load_robot

if TYPE_CHECKING:
    from pathlib import Path


def blind(out: Path, *, campaigns: int, seed: int, quiet: bool, target: str | None) -> None:
    """Run the blind check and write a complete folder: campaigns, seal, answers, scores, figures."""
    from stiffscope.gap.blind import run_blind

    files.check_output(out, target)
    begun = time.perf_counter()
    robot = load_robot("biglide")
    manifest = Manifest(sys.argv[1:], str(robot.path), file_digest(robot.path))
    with workshop(quiet=quiet) as (cache, spare, open_line), files.staged_folder(out) as folder:
        made = solve_robots({"now": robot}, "published", cache, spare, open_line, pictures=False)["now"]
        report = open_line("blind")
        scores = run_blind(folder, made.elastic, campaigns, seed, report, os.cpu_count() or 1)
        report("figures", 1.0)
        found = scores_json(scores, campaigns, seed, time.perf_counter() - begun)
        files.write_json(folder / "scores.json", found)
        draw_scores(scores, folder)
        manifest.write(folder)
    if target:
        files.write_json(target, found)
    if not quiet and target != "-":
        show_scores(scores)
        tables.show_line(f"{campaigns} campaigns in {time.perf_counter() - begun:.0f} s; written to {out}")

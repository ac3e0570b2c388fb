"""`stiffscope blind`: withheld campaigns are drawn, diagnosed and scored, and the score is shown."""

from __future__ import annotations

import os
import sys
import time
from typing import TYPE_CHECKING, Any

from stiffscope import files
from stiffscope.cli.run import solve_robots, workshop
from stiffscope.jobs.cache import file_digest
from stiffscope.jobs.manifest import Manifest
from stiffscope.report import tables
from stiffscope.report.blind import MEASURES, draw_scores, show_scores
from stiffscope.robot.robot_file import load_robot

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.gap.blind import Scores


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


def scores_json(scores: Scores, campaigns: int, seed: int, seconds: float) -> dict[str, Any]:
    """What scripts read of a blind check; a share of nothing is null."""
    planted, answered, counts = scores.confusion()
    outcomes = [
        {
            "campaign": o.number,
            "kind": o.kind,
            "truth": list(o.truth),
            "left_out": o.left_out or None,
            "verdict": o.verdict,
            "named": list(o.named),
            "confused_with": [list(group) for group in o.groups],
            "right": o.right,
            "evidence": o.evidence,
            "gap": dict(zip(("nominal", "explained", "held_out", "noise"), o.gap, strict=True)),
            "covered": list(o.covered),
        }
        for o in scores.outcomes
    ]
    return {
        "campaigns": campaigns,
        "seed": seed,
        "seconds": round(seconds, 1),
        **{key: getattr(scores, key) for key, *_ in MEASURES},
        "held_out_over_noise": scores.held_out,
        "confusion": {"planted": planted, "answered": answered, "counts": counts},
        "outcomes": outcomes,
    }

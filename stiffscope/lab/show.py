"""Scores of a blind check as JSON, tables and figures."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import say_count
from stiffscope.report.figures import (
    AFTER,
    BEFORE,
    EFFECT,
    name_columns,
    name_rows,
    new_figure,
    save_figures,
)
from stiffscope.report.page import Section
from stiffscope.report.terminal import show_table

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from stiffscope.lab.blind.scores import Scores
    from stiffscope.report.run_report import Draft

MEASURES = (
    ("singles", "single effects with ln-odds above 10: correct", "≥ 97 %", 0.97, 1.0),
    ("pairs", "pairs: right", "≥ 92 %", 0.92, 1.0),
    ("triples", "triples: right", "≥ 85 %", 0.85, 1.0),
    ("false_alarms", "no effect: false alarms", "≤ 2 %", 0.0, 0.02),
    (
        "outside",
        "effects outside the library: identified as a library effect",
        "≤ 3 %",
        0.0,
        0.03,
    ),
    (
        "distinguishable",
        "of these, not reproduced by a few library effects: identified",
        "≤ 3 %",
        0.0,
        0.03,
    ),
    (
        "left_out",
        "effect removed from the library: no confident misidentification",
        "",
        0.0,
        1.0,
    ),
    (
        "coverage",
        "95 % intervals that contain the true value",
        "92 to 98 %",
        0.92,
        0.98,
    ),
)
FIGURES = {
    "confusion": (
        "Planted and diagnosed effects",
        "matrix of planted and diagnosed effects",
    ),
    "gaps": (
        "Gap over noise of each campaign: before, after, held out",
        "points of the gaps",
    ),
    "calibration": ("Reliability of stated probabilities", "reliability diagram"),
}
HELD_OUT = 1.2
ENOUGH = 50  # minimum number of intervals for judging their coverage


def scores_json(scores: Scores) -> dict[str, Any]:
    """Return the scores of a blind check for JSON output; the share of an empty set is null."""
    planted, answered, counts = scores.confusion()
    outcomes = []
    for o in scores.outcomes:
        gap = dict(
            zip(("nominal", "explained", "held_out", "noise"), o.gap, strict=True)
        )
        outcomes.append(
            {
                "robot": o.robot,
                "campaign": o.number,
                "kind": o.kind,
                "measured": o.style,
                "truth": list(o.truth),
                "left_out": o.left_out or None,
                "imitated": o.imitated,
                "redrawn": o.redrawn,
                "verdict": o.verdict,
                "named": list(o.named),
                "confused_with": list(map(list, o.groups)),
                "right": o.right,
                "evidence": o.evidence,
                "gap": gap,
                "covered": list(o.covered),
            }
        )
    rates = ("stated", "true", "count")
    every = {"": scores, **scores.by_robot()}
    keys = [key for key, *_ in MEASURES]
    measured = {
        name: {key: getattr(own, key) for key in keys} for name, own in every.items()
    }
    return {
        **measured.pop(""),
        "held_out_over_noise": scores.held_out,
        "calibration": [
            dict(zip(rates, row, strict=True)) for row in scores.calibration()
        ],
        "robots": measured,
        "confusion": {"planted": planted, "answered": answered, "counts": counts},
        "outcomes": outcomes,
    }


def show_scores(scores: Scores) -> None:
    """Show scores with targets, gaps by kind of campaign, the confusion and the wrong answers."""
    intervals = sum(len(o.covered) for o in scores.outcomes)
    rows = []
    for key, words, target, low, high in MEASURES:
        value = getattr(scores, key)
        share = "none drawn" if value is None else f"{100 * value:.1f} %"
        few = key == "coverage" and intervals < ENOUGH
        met = (
            ""
            if value is None or not target or few
            else "yes"
            if low <= value <= high
            else "no"
        )
        rows.append(
            (
                words + (f" ({intervals})" if key == "coverage" else ""),
                share,
                target,
                met,
            )
        )
    if scores.held_out is not None:
        met = "yes" if scores.held_out <= HELD_OUT else "no"
        words = "correctly identified: largest held-out gap over noise"
        rows.append((words, f"{scores.held_out:.3f}", f"≤ {HELD_OUT}", met))
    groups = (("measure",), ("measured", "target", "met"))
    show_table("Blind check", groups, rows, prose=("measure",))
    own = scores.by_robot()
    keys = [key for key, *_ in MEASURES]
    rows = [
        (name, *(_percent(getattr(each, key)) for key in keys))
        for name, each in own.items()
    ]
    if len(own) > 1:
        show_table(
            "Each robot, %", (("robot",), [key.replace("_", " ") for key in keys]), rows
        )
    rates = scores.calibration()
    rows = [
        (_percent(stated), _percent(true), str(count)) for stated, true, count in rates
    ]
    if rows:
        show_table("Stated probabilities, %", (("stated",), ("true", "effects")), rows)
    _show_gaps(scores)
    planted, answered, counts = scores.confusion()
    confusion = [
        (
            word,
            ", ".join(
                f"{name} {n}" for name, n in zip(answered, row, strict=True) if n
            ),
        )
        for word, row in zip(planted, counts, strict=True)
    ]
    if confusion:
        show_table(
            "Single effects",
            (("planted",), ("answered",)),
            confusion,
            prose=("answered",),
        )
    _show_wrong(scores)


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.1f}"


def _show_gaps(scores: Scores) -> None:
    rows = []
    for kind in dict.fromkeys(o.kind for o in scores.outcomes):
        here = [o for o in scores.outcomes if o.kind == kind and not o.left_out]
        medians = np.nanmedian([o.gap for o in here], axis=0)
        right = str(sum(o.right for o in here))
        rows.append(
            (kind, str(len(here)), right, *(f"{value:.3g}" for value in medians))
        )
    groups = (("",), ("campaigns", "right"), ("before", "after", "held out", "noise"))
    show_table("Gap, % rms, median", groups, rows)


def _show_wrong(scores: Scores) -> None:
    rows = []
    for o in (o for o in scores.outcomes if not o.right):
        kind = f"{o.kind}, without {o.left_out}" if o.left_out else o.kind
        answer = f"{o.verdict}: {' + '.join(o.named) or 'no effect'}"
        place = f"{o.robot} {o.number:03d}".strip()
        rows.append((place, kind, " + ".join(o.truth), answer, f"{o.evidence:.1f}"))
    if rows:
        groups = (("campaign",), ("kind", "planted", "answered", "ln-odds"))
        show_table("Not right", groups, rows, prose=("kind", "planted", "answered"))


def draw_scores(scores: Scores, folder: Path) -> None:
    """Write the figures "confusion", "gaps" and "calibration" as SVG and PNG."""
    figures = {"confusion": confusion, "gaps": gaps, "calibration": calibration}
    save_figures(
        folder, {stem: partial(draw, scores) for stem, draw in figures.items()}
    )


def write_blind_report(scores: Scores, report: Draft) -> None:
    """Write ``report.html`` of a blind check: tables shown, the folder's figures, the manifest."""
    robots = scores.by_robot()
    figures = report.figures({f"{stem}.svg": words for stem, words in FIGURES.items()})
    facts = [
        f"robots: {', '.join(robots) or 'none'}",
        say_count(len(scores.outcomes), "campaign"),
    ]
    count = len(scores.outcomes) // max(len(robots), 1)
    title = f"Blind check of the diagnosis, {say_count(count, 'campaign')} a robot"
    report.write(
        title, facts, [Section("Scores", report.shown), Section("Figures", (), figures)]
    )


def confusion(scores: Scores) -> Figure:
    """Draw the confusion matrix: single effects, no effect and effects outside the library."""
    planted, answered, counts = scores.confusion()
    size = 4.2 + 0.34 * len(answered), 3.4 + 0.27 * len(planted)
    figure = new_figure(*size, "Planted (rows), diagnosed (columns)")
    axes = figure.subplots()
    grid = np.array(counts, dtype=float).reshape(len(planted), len(answered))
    most = max(grid.max(initial=1.0) * 1.4, 2.0)
    axes.imshow(np.where(grid > 0, grid, np.nan), cmap="Purples", vmin=0, vmax=most)
    name_columns(axes, answered)
    name_rows(axes, planted)
    for i, j in np.argwhere(grid > 0):
        axes.text(j, i, f"{grid[i, j]:.0f}", ha="center", va="center", fontsize=8)
    return figure


def gaps(scores: Scores) -> Figure:
    """Draw each campaign's gap before, after and at held-out poses, divided by its noise."""
    from matplotlib.ticker import LogFormatter

    shown = [o for o in scores.outcomes if not o.left_out]
    shown.sort(key=lambda o: (o.kind, o.gap[0] / o.gap[3]))
    figure = new_figure(9.5, 4.2, "Gap over noise, each campaign")
    axes = figure.subplots()
    over_noise = np.array([o.gap for o in shown]) / np.array(
        [[o.gap[3]] for o in shown]
    )
    marks = (
        (0, "before", BEFORE, "o"),
        (1, "after", EFFECT, "D"),
        (2, "held out", AFTER, "x"),
    )
    for k, word, colour, mark in marks:
        axes.plot(over_noise[:, k], mark, color=colour, markersize=4, label=word)
    axes.axhline(1.0, color=BEFORE, lw=0.8, ls=":")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(LogFormatter())
    axes.yaxis.set_minor_formatter(LogFormatter(labelOnlyBase=False))
    axes.set_ylabel("gap / noise")
    kinds = [o.kind for o in shown]
    starts = [k for k in range(len(kinds)) if k == 0 or kinds[k] != kinds[k - 1]]
    axes.set_xticks(starts, [kinds[k] for k in starts], ha="left")
    for start in starts[1:]:
        axes.axvline(start - 0.5, color="#c9d0d6", lw=0.8)
    axes.legend(frameon=False, ncols=3)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def calibration(scores: Scores) -> Figure:
    """Draw a reliability diagram of the stated probabilities, in tenths, with bars of 2 σ."""
    figure = new_figure(4.6, 4.4, "How often a stated probability is true")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color=BEFORE, lw=0.8, ls=":")
    for stated, true, count in scores.calibration():
        error = 2 * np.sqrt(max(stated * (1 - stated), 0.25 / count) / count)
        axes.errorbar(
            stated, true, error, fmt="o", color=EFFECT, ecolor=BEFORE, elinewidth=1
        )
        above = axes.get_xaxis_transform()
        axes.text(stated, 1.01, str(count), transform=above, ha="center", fontsize=7)
    axes.set(
        xlabel="stated probability (number of cases above)", ylabel="observed frequency"
    )
    axes.set(xlim=(-0.03, 1.05), ylim=(-0.03, 1.05))
    axes.spines[["top", "right"]].set_visible(False)
    return figure

"""The score of a blind check: as JSON, as tables, as figures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report import tables
from stiffscope.report.gap_figures import AFTER, BEFORE, EFFECT, STYLE, new_figure

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from stiffscope.gap.blind import Scores

MEASURES = (
    ("singles", "single effects, evidence beyond ln-odds 10: right", "≥ 95 %", 0.95, 1.0),
    ("pairs", "pairs: right", "≥ 85 %", 0.85, 1.0),
    ("false_alarms", "no effect: false alarms", "≤ 2 %", 0.0, 0.02),
    ("abstentions", "outside effects: not named with confidence", "≥ 90 %", 0.9, 1.0),
    ("left_out", "effect taken out of the library: no confident wrong name", "", 0.0, 1.0),
    ("coverage", "95 % intervals that hold the truth", "90 to 98 %", 0.9, 0.98),
)
HELD_OUT = 1.2
ENOUGH = 50  # intervals below which a share of them says little


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


def show_scores(scores: Scores) -> None:
    """The score beside what is wanted, what went wrong, and the gap by kind."""
    table = tables.new_table("Blind check", "", "share", "wanted", "")
    intervals = sum(len(o.covered) for o in scores.outcomes)
    for key, words, wanted, low, high in MEASURES:
        value = getattr(scores, key)
        share = "none drawn" if value is None else f"{100 * value:.1f} %"
        few = key == "coverage" and intervals < ENOUGH
        good = "" if value is None or not wanted or few else "yes" if low <= value <= high else "no"
        count = f" ({intervals})" if key == "coverage" else ""
        table.add_row(words + count, share, wanted, good)
    if scores.held_out is not None:
        good = "yes" if scores.held_out <= HELD_OUT else "no"
        table.add_row("identified rightly: greatest held-out gap over noise", f"{scores.held_out:.3f}", "≤ 1.2", good)
    tables.console().print(table)
    gaps = tables.new_table("Gap, % rms, median", "", "campaigns", "right", "before", "after", "held out", "noise")
    for kind in dict.fromkeys(o.kind for o in scores.outcomes):
        here = [o for o in scores.outcomes if o.kind == kind and not o.left_out]
        middle = np.nanmedian([o.gap for o in here], axis=0)
        gaps.add_row(kind, str(len(here)), str(sum(o.right for o in here)), *(f"{v:.3g}" for v in middle))
    tables.console().print(gaps)
    _show_confusion(scores)
    wrong = [o for o in scores.outcomes if not o.right]
    if wrong:
        told = tables.new_table("Not right", "campaign", "kind", "planted", "answered", "ln-odds")
        for o in wrong:
            kind = f"{o.kind}, without {o.left_out}" if o.left_out else o.kind
            answer = " + ".join(o.named) or "no effect"
            told.add_row(f"{o.number:03d}", kind, " + ".join(o.truth), f"{o.verdict}: {answer}", f"{o.evidence:.1f}")
        tables.console().print(told)


def _show_confusion(scores: Scores) -> None:
    """What was planted alone, and what was answered: one line for each planted effect."""
    planted, answered, counts = scores.confusion()
    table = tables.new_table("Planted alone", "planted")
    table.add_column("answered", justify="left", overflow="fold")
    for word, row in zip(planted, counts, strict=True):
        said = [f"{name} {n}" for name, n in zip(answered, row, strict=True) if n]
        table.add_row(word, ", ".join(said))
    tables.console().print(table)


def draw_scores(scores: Scores, folder: Path) -> None:
    """Write the two figures as SVG and PNG."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        for stem, figure in (("confusion", _confusion(scores)), ("gaps", _gaps(scores))):
            figure.savefig(folder / f"{stem}.svg", metadata={"Date": None})
            figure.savefig(folder / f"{stem}.png", dpi=110)


def _confusion(scores: Scores) -> Figure:
    """Planted against answered, single effects, none and outside ones."""
    planted, answered, counts = scores.confusion()
    figure = new_figure(4.2 + 0.34 * len(answered), 3.4 + 0.27 * len(planted), "Planted (rows) and answered (columns)")
    axes = figure.subplots()
    grid = np.array(counts, dtype=float).reshape(len(planted), len(answered))
    axes.imshow(np.where(grid > 0, grid, np.nan), cmap="Purples", vmin=0, vmax=max(grid.max(initial=1.0) * 1.4, 2.0))
    axes.set_xticks(range(len(answered)), answered, rotation=60, ha="right", rotation_mode="anchor", fontsize=8)
    axes.set_yticks(range(len(planted)), planted, fontsize=8)
    axes.tick_params(length=0)
    for i, j in np.argwhere(grid > 0):
        axes.text(j, i, f"{grid[i, j]:.0f}", ha="center", va="center", fontsize=8)
    return figure


def _gaps(scores: Scores) -> Figure:
    """Gap before, after, held out of each campaign, in units of its noise."""
    shown = sorted((o for o in scores.outcomes if not o.left_out), key=lambda o: (o.kind, o.gap[0] / o.gap[3]))
    figure = new_figure(9.5, 4.2, "Gap over noise, each campaign")
    axes = figure.subplots()
    gaps = np.array([o.gap for o in shown]) / np.array([[o.gap[3]] for o in shown])
    marks = ((0, "before", BEFORE, "o"), (1, "after", EFFECT, "D"), (2, "held out", AFTER, "x"))
    for k, word, colour, mark in marks:
        axes.plot(gaps[:, k], mark, color=colour, markersize=4, label=word)
    axes.axhline(1.0, color=BEFORE, lw=0.8, ls=":")
    axes.set_yscale("log")
    axes.set_ylabel("gap / noise")
    kinds = [o.kind for o in shown]
    starts = [k for k in range(len(kinds)) if k == 0 or kinds[k] != kinds[k - 1]]
    axes.set_xticks(starts, [kinds[k] for k in starts], ha="left")
    for start in starts[1:]:
        axes.axvline(start - 0.5, color="#c9d0d6", lw=0.8)
    axes.legend(frameon=False, ncols=3)
    axes.spines[["top", "right"]].set_visible(False)
    return figure

"""Figure of measured responses beside those before and after a diagnosis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report.figures import AFTER, BEFORE, NOISE, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stiffscope.gap.inference.diagnosis import ResponseLines, SetupModes

COLUMNS = 4
_LINE = 0.9  # width


def name_lines(index: int) -> str:
    """Return the stem of the figure of a set-up."""
    return f"responses_{index + 1}"


def draw_lines(name: str, setup: SetupModes) -> Figure | None:
    """Draw all responses of a set-up: levels, and below them residuals over the noise."""
    from matplotlib.lines import Line2D

    lines = setup.lines
    if not lines:
        return None
    columns = min(COLUMNS, len(lines))
    bands = -(-len(lines) // columns)
    figure = new_figure(3.1 * columns, 2.7 * bands + 0.8, f"{name}: responses, m/N")
    key = {
        "measured": {"color": NOISE, "lw": 1.6},
        "nominal model": {"color": BEFORE, "ls": "--", "lw": _LINE},
        "with the effects found": {"color": AFTER, "lw": _LINE},
    }
    shown = [Line2D([], [], label=label, **style) for label, style in key.items()]
    figure.legend(
        handles=shown, loc="outside upper right", ncols=3, frameon=False, fontsize=8
    )
    panels = figure.subplots(
        2 * bands,
        columns,
        squeeze=False,
        sharex="col",
        height_ratios=np.tile([2.2, 1.0], bands).tolist(),
    )
    for k in range(columns * bands):
        pair = panels[2 * (k // columns) : 2 * (k // columns) + 2, k % columns]
        if k < len(lines):
            _draw_one(pair, lines[k])
        else:
            for axes in pair:
                axes.set_visible(False)
    return figure


def _draw_one(panels: Any, line: ResponseLines) -> None:
    upper, lower = panels
    size = np.abs(line.measured)
    upper.semilogy(line.hertz, size, color=NOISE, lw=1.6)
    upper.semilogy(line.hertz, np.abs(line.before), "--", color=BEFORE, lw=_LINE)
    upper.semilogy(line.hertz, np.abs(line.after), color=AFTER, lw=_LINE)
    floor = 0.1 * size[size > 0.0].min(initial=size.max())
    if floor > 0.0:  # a prediction far below the noise would flatten all else
        upper.set_ylim(bottom=max(floor, upper.get_ylim()[0]))
    upper.set_title(line.name, fontsize=8, parse_math=False, loc="left")
    upper.tick_params(labelsize=7)
    noise = np.sqrt(2.0) * np.where(line.noise > 0.0, line.noise, np.inf)
    for model, color in ((line.before, BEFORE), (line.after, AFTER)):
        rest = np.abs(line.measured - model) / noise
        lower.semilogy(line.hertz, rest.clip(min=0.1), color=color, lw=0.7)
    lower.axhline(1.0, color=NOISE, lw=0.8)
    lower.tick_params(labelsize=7)
    lower.set_xlabel("Hz", fontsize=7)
    lower.set_ylabel("off, σ", fontsize=7)
    lower.tick_params(labelbottom=True)
    for axes in panels:
        axes.grid(which="major", color="#e3e7eb", lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)

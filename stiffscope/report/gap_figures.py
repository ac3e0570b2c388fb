"""Figures of a diagnosis: waterfall of the gap, residuals by pose and direction, likeness of signatures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report.text import DIRECTIONS, name, steps

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from stiffscope.gap.diagnosis import Diagnosis

BEFORE, EFFECT, AFTER, NOISE = "#4b5560", "#e4b04a", "#2f7d6b", "#b4bcc5"
NAMED = 40  # poses that a map has room to name
STYLE: Any = {"svg.fonttype": "none", "svg.hashsalt": "stiffscope", "font.family": "sans-serif", "font.size": 10}


def draw_figures(diagnosis: Diagnosis, folder: Path) -> list[str]:
    """Write what there is to show of a diagnosis as SVG and PNG; returns the figures' stems."""
    import matplotlib as mpl

    drawn: list[str] = []
    with mpl.rc_context(STYLE):
        for stem, draw in (("waterfall", waterfall), ("residuals", residual_map), ("likeness", likeness)):
            figure = draw(diagnosis)
            if figure is not None:
                figure.savefig(folder / f"{stem}.svg", metadata={"Date": None})
                figure.savefig(folder / f"{stem}.png", dpi=110)
                drawn.append(stem)
    return drawn


def waterfall(diagnosis: Diagnosis) -> Figure:
    """The gap before, with each effect alone, with all, at poses held out, and the noise."""
    shown = [(label, value) for label, value in steps(diagnosis) if np.isfinite(value)]
    colours = {"nominal": BEFORE, "together": AFTER, "held out": AFTER, "noise": NOISE}
    words = {"nominal": "the model as it is", "held out": "at poses held out", "noise": "noise alone"}
    figure = new_figure(8.6, 0.9 + 0.42 * len(shown), "The gap, % rms")
    axes = figure.subplots()
    values = [value for _, value in shown]
    axes.barh(range(len(shown)), values, color=[colours.get(label, EFFECT) for label, _ in shown], height=0.66)
    labels = [words.get(label) or f"with {_said(label)}" for label, _ in shown]
    axes.set_yticks(range(len(shown)), labels)
    for k, value in enumerate(values):
        axes.annotate(f"{value:.3g}", (value, k), (5, 0), textcoords="offset points", va="center", fontsize=10)
    axes.axvline(diagnosis.gap.noise, color=BEFORE, lw=0.9, ls=":")
    axes.invert_yaxis()
    axes.set_xlim(0, 1.12 * max(values, default=1.0) or 1.0)
    axes.tick_params(left=False)
    axes.spines[["top", "right", "left"]].set_visible(False)
    return figure


def _said(label: str) -> str:
    return name(*label.split(" @ ", 1)) if label.count(" @ ") == 1 else "all of them" if label == "together" else label


def residual_map(diagnosis: Diagnosis) -> Figure | None:
    """Misfit of each pose and direction in standard deviations, before and after."""
    from matplotlib.colors import LogNorm

    where = diagnosis.where
    if not where.pose:
        return None
    grids = [np.array(grid, dtype=float) for grid in (where.pose, where.unexplained) if grid]
    greatest = max((float(np.nanmax(grid)) for grid in grids if np.isfinite(grid).any()), default=1.0)
    norm = LogNorm(0.5, max(2.0 * greatest / 1.9, 4.0), clip=True)
    rows = len(where.pose)
    figure = new_figure(
        4.6 * len(grids) + 1.6, float(np.clip(1.4 + 0.27 * rows, 2.4, 14.0)), "Misfit over noise (rms of residual / σ)"
    )
    panels = np.atleast_1d(figure.subplots(1, len(grids), sharey=True))
    image: Any = None
    for axes, grid, title in zip(panels, grids, ("the model as it is", "with the answer's effects"), strict=False):
        image = axes.imshow(grid, aspect="auto", cmap="magma_r", norm=norm, interpolation="nearest")
        axes.set_xticks(range(6), DIRECTIONS)
        axes.set_title(title, fontsize=10)
        axes.tick_params(length=0)
        if rows <= NAMED:
            _numbers(axes, grid, "{:.3g}", norm)
    if rows <= NAMED:
        panels[0].set_yticks(range(rows), where.pose_names, fontsize=8)
    else:
        panels[0].set_ylabel("pose, in the order of the readings")
    bar = figure.colorbar(image, ax=list(panels), pad=0.015, fraction=0.05)
    ticks = [t for t in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000) if t <= norm.vmax]  # type: ignore[operator]
    bar.set_ticks(ticks, labels=[str(t) for t in ticks], minor=False)
    bar.minorticks_off()
    return figure


def likeness(diagnosis: Diagnosis) -> Figure | None:
    """|cosine| between the effects' signatures in these readings; the alike stand together."""
    names, rows = diagnosis.signature_correlation
    if len(names) < 2:
        return None
    matrix = np.array(rows, dtype=float)
    order = _alike(matrix)
    matrix, labels = matrix[np.ix_(order, order)], [name(*names[k].split(" @ ", 1)) for k in order]
    size = 2.6 + 0.29 * len(names)
    figure = new_figure(size + 1.2, size, "Likeness of signatures: 1 cannot be told apart by these readings")
    axes = figure.subplots()
    image = axes.imshow(matrix, cmap="Purples", vmin=0, vmax=1)
    axes.set_xticks(range(len(labels)), labels, rotation=60, ha="right", rotation_mode="anchor", fontsize=8)
    axes.set_yticks(range(len(labels)), labels, fontsize=8)
    axes.tick_params(length=0)
    from matplotlib.colors import Normalize

    _numbers(axes, np.where(matrix >= 0.3, matrix, np.nan), "{:.2f}", Normalize(0, 1.4), size=6)
    figure.colorbar(image, ax=axes, pad=0.015, fraction=0.04, label="|cosine|")
    return figure


def _alike(matrix: np.ndarray) -> list[int]:
    """An order in which neighbours are alike."""
    from scipy.cluster.hierarchy import leaves_list, linkage, optimal_leaf_ordering
    from scipy.spatial.distance import squareform

    distance = np.clip(1.0 - np.nan_to_num(matrix), 0.0, 1.0)
    distance = 0.5 * (distance + distance.T)
    np.fill_diagonal(distance, 0.0)
    apart = squareform(distance, checks=False)
    return [int(k) for k in leaves_list(optimal_leaf_ordering(linkage(apart, "average"), apart))]


def _numbers(axes: Axes, grid: np.ndarray, form: str, norm: object, size: int = 7) -> None:
    for i, j in np.argwhere(np.isfinite(grid)):
        dark = float(norm(grid[i, j])) > 0.45  # type: ignore[operator]
        colour = "white" if dark else "#20252b"
        axes.text(j, i, form.format(grid[i, j]), ha="center", va="center", fontsize=size, color=colour)


def new_figure(width: float, height: float, title: str) -> Figure:
    """An empty figure under a heading."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold")
    return figure

"""Figures of a diagnosis: waterfall, posterior, residuals, predictive check, signatures."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.cluster.hierarchy import leaves_list, linkage
from scipy.spatial.distance import squareform

from stiffscope.gap.show.response_lines import draw_lines, name_lines
from stiffscope.gap.show.text import DIRECTIONS, label, steps
from stiffscope.report.figures import (
    AFTER,
    BEFORE,
    EFFECT,
    NOISE,
    name_columns,
    name_rows,
    new_figure,
    save_figures,
    write_cells,
)
from stiffscope.report.numbers import choose_unit
from stiffscope.report.page import Chart, Series

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from stiffscope.gap.inference.diagnosis import Diagnosis
    from stiffscope.gap.inference.posterior_samples import Samples
    from stiffscope.report.page import Figure as PageFigure

CORNERS = 10  # most parameters in a corner plot
NAMED = 40  # most poses named in a map
NUMBERED = 24  # most rows with legible numbers
ALIKE = (0.3, 0.9)  # smallest correlation written for few effects, and for many
EXCEEDS = (
    "A bar longer than the first: an effect alone can enlarge the gap where it offsets another;\n"
    "at poses held out, the gap also contains the error of parameters fitted elsewhere."
)
PREDICTIONS = {"the nominal model": BEFORE, "with the effects found": AFTER}
STEPS = {
    "nominal": ("the nominal model", BEFORE),
    "together": ("with all of them", AFTER),
    "held out": ("at poses held out", AFTER),
    "noise": ("noise alone", NOISE),
}


def draw_figures(diagnosis: Diagnosis, folder: Path) -> list[str]:
    """Write the available figures of a diagnosis as SVG and PNG; return their names."""
    figures = {
        "waterfall": waterfall,
        "corner": corner,
        "residuals": residual_map,
        "readings": draw_readings,
        "predictive": predictive_check,
        "signatures": signature_correlation,
    }
    draws = {stem: partial(draw, diagnosis) for stem, draw in figures.items()}
    for k, (name, setup) in enumerate(diagnosis.responses.items()):
        draws[name_lines(k)] = partial(draw_lines, name, setup)
    return save_figures(folder, draws)


def waterfall(diagnosis: Diagnosis) -> Figure:
    """Draw the gap before, with each effect alone, with all, at held-out poses, and the noise."""
    shown = [(key, value) for key, value in steps(diagnosis) if np.isfinite(value)]
    figure = new_figure(8.6, 0.9 + 0.42 * len(shown), "The gap, % rms")
    axes = figure.subplots()
    bars = [STEPS.get(key, (f"with {label(key)}", EFFECT)) for key, _ in shown]
    words, colours = zip(*bars, strict=True)
    values = [value for _, value in shown]
    drawn = axes.barh(range(len(shown)), values, color=colours, height=0.66)
    axes.set_yticks(range(len(shown)), words, parse_math=False)
    axes.axvline(diagnosis.gap.noise, color=BEFORE, lw=0.9, ls=":")
    for text in axes.bar_label(drawn, [f"{value:.3g}" for value in values], padding=5):
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 1})
    axes.invert_yaxis()
    axes.set_xlim(0, 1.12 * max(values, default=1.0) or 1.0)
    axes.tick_params(left=False)
    axes.spines[["top", "right", "left"]].set_visible(False)
    if any(value > 1.001 * diagnosis.gap.nominal for value in values):
        figure.supxlabel(EXCEEDS, x=0.01, ha="left", fontsize=8, color=BEFORE)
    return figure


def residual_map(diagnosis: Diagnosis) -> Figure | None:
    """Draw the rms residual over σ by pose and direction, before and after; None without poses."""
    from matplotlib.colors import LogNorm

    where = diagnosis.where
    if not where.pose:
        return None
    grids = np.array(
        [grid for grid in (where.pose, where.unexplained) if grid], dtype=float
    )
    read = np.flatnonzero(
        np.isfinite(grids[0]).any(axis=0)
    )  # directions that were measured
    grids = grids[:, :, read]
    greatest = np.nanmax(grids) if len(read) else 1.0
    shade = LogNorm(0.5, max(2.0 * greatest / 1.9, 4.0), clip=True)
    rows = len(where.pose)
    width = 4.6 * len(grids) + 1.6
    most = 14.0 if rows <= NAMED else 8.0
    height = float(np.clip(1.4 + 0.27 * rows, 2.4, most))
    figure = new_figure(width, height, "Residuals over noise (rms of residual / σ)")
    panels = np.atleast_1d(figure.subplots(1, len(grids), sharey=True))
    style: Any = {
        "aspect": "auto",
        "cmap": "magma_r",
        "norm": shade,
        "interpolation": "nearest",
    }
    image: Any = None
    for axes, grid, title in zip(panels, grids, PREDICTIONS, strict=False):
        image = axes.imshow(grid, **style)
        axes.set_xticks(range(len(read)), [DIRECTIONS[k] for k in read])
        axes.set_title(title, fontsize=10)
        axes.tick_params(length=0)
        if rows <= NUMBERED:
            write_cells(axes, grid, "{:.3g}", shade)
    if rows <= NAMED:
        name_rows(panels[0], where.pose_names)
    else:
        panels[0].set_ylabel("pose, in the order of the readings")
    bar = figure.colorbar(image, ax=list(panels), pad=0.015, fraction=0.05)
    ticks = [
        k * 10**n
        for n in range(4)
        for k in (1, 2, 5)
        if k * 10**n <= float(shade.vmax or 0)
    ]
    bar.set_ticks(ticks, labels=[str(t) for t in ticks], minor=False)
    bar.minorticks_off()
    return figure


def draw_readings(diagnosis: Diagnosis) -> Figure | None:
    """Draw predicted over measured readings, one panel per kind; None without predictions."""
    samples = diagnosis.samples
    if samples is None:
        return None
    count = len(samples.kinds)
    figure = new_figure(
        min(4.2 * count + 0.4, 13.0), 4.2, "Readings against their prediction"
    )
    panels = np.atleast_1d(figure.subplots(1, count))
    for axes, (kind, (si, mine)) in zip(panels, samples.kinds.items(), strict=True):
        measured = samples.observed[mine]
        factor, unit = choose_unit(si, measured)
        for name, colour, predicted in _predictions(samples):
            style: Any = {"color": colour, "alpha": 0.7, "label": name}
            axes.plot(measured / factor, predicted[mine] / factor, ".", ms=4, **style)
        axes.axline((0.0, 0.0), slope=1.0, color=NOISE, lw=0.9, zorder=0)
        axes.set_xlabel(f"measured {kind}, {unit}")
        axes.set_ylabel(f"predicted, {unit}")
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].legend(frameon=False, fontsize=8)
    return figure


def _predictions(samples: Samples) -> list[tuple[str, str, np.ndarray]]:
    """Return name, colour and values (n,) of the predictions."""
    (nominal, grey), (with_effects, green) = PREDICTIONS.items()
    return [(nominal, grey, samples.before), (with_effects, green, samples.after)]


def chart_readings(diagnosis: Diagnosis, still: PageFigure | None) -> list[Chart]:
    """Return interactive charts, one per kind of reading; the first has the still picture."""
    samples = diagnosis.samples
    if samples is None:
        return []
    charts: list[Chart] = []
    for kind, (si, mine) in samples.kinds.items():
        rows = np.flatnonzero(mine)
        measured = samples.observed[rows]
        sigma = samples.sigma[rows]
        factor, unit = choose_unit(si, measured)
        series = []
        texts = {
            "reading": samples.where,
            "pose": samples.pose,
            "quantity": samples.quantity,
        }
        words = {name: [column[k] for k in rows] for name, column in texts.items()}
        for name, colour, predicted in _predictions(samples):
            error = predicted[rows] - measured
            numbers = {
                f"measured, {unit}": measured / factor,
                f"predicted, {unit}": predicted[rows] / factor,
                f"predicted − measured, {unit}": error / factor,
                "(predicted − measured) / σ": error / sigma,
            }
            series.append(Series(name, colour, words | numbers))
        x, *y = list(series[0].columns)[3:]
        caption = f"{kind.capitalize()}: every reading against its prediction."
        charts.append(
            Chart(series, [x], y, caption, None if charts else still, equal=True)
        )
    return charts


def signature_correlation(diagnosis: Diagnosis) -> Figure | None:
    """Draw |cosine| between effect signatures, clustered by similarity; None below two effects."""
    from matplotlib.colors import Normalize

    names, rows = diagnosis.signature_correlation
    if len(names) < 2:
        return None
    matrix = np.array(rows, dtype=float)
    order = _cluster_rows(matrix)
    matrix = matrix[np.ix_(order, order)]
    labels = [label(names[k]) for k in order]
    size = 0.6 + 0.29 * len(names) + 0.065 * max(map(len, labels))
    figure = new_figure(size + 1.2, size, "Signature correlation")
    figure.set_layout_engine("compressed")  # the map stays square
    axes = figure.subplots()
    image = axes.imshow(matrix, cmap="Purples", vmin=0, vmax=1)
    name_columns(axes, labels)
    name_rows(axes, labels)
    written = np.tril(matrix) >= ALIKE[len(names) > NUMBERED]
    write_cells(
        axes, np.where(written, matrix, np.nan), "{:.2f}", Normalize(0, 1.4), size=6
    )
    key = "|cosine|; 1: indistinguishable"
    figure.colorbar(image, ax=axes, pad=0.015, fraction=0.04, label=key)
    return figure


def _cluster_rows(correlation: np.ndarray) -> list[int]:
    """Return an order of the rows in which neighbours are similar."""
    distance = np.clip(1.0 - np.nan_to_num(correlation), 0.0, 1.0)
    distance = 0.5 * (distance + distance.T)
    np.fill_diagonal(distance, 0.0)
    condensed = squareform(distance, checks=False)
    return leaves_list(linkage(condensed, "average", optimal_ordering=True)).tolist()


def corner(diagnosis: Diagnosis) -> Figure | None:
    """Draw the joint posterior of the effects' parameters; None if there are none or too many."""
    if diagnosis.samples is None:
        return None
    units = diagnosis.samples.units
    sampled = diagnosis.samples.parameters.items()
    draws = {
        name: v.ravel() for name, v in sampled if " @ " in name and np.ptp(v) > 0.0
    }
    if not 0 < len(draws) <= CORNERS:
        return None
    n = len(draws)
    width, height = (5.6, 3.4) if n == 1 else (2.2 * n + 1.2, 2.0 * n + 0.9)
    figure = new_figure(width, height, "Posterior of the parameters")
    figure.set_layout_engine("none")  # slow and unnecessary for a regular grid
    small = max(7.0, 0.7 * width)  # legible where a page shrinks a wide figure
    grid = figure.add_gridspec(
        n,
        n,
        left=0.85 / width,
        right=0.98,
        bottom=0.75 / height,
        top=1 - 0.55 / height,
        wspace=0.12,
        hspace=0.12,
    )
    names = list(draws)
    for i, row in enumerate(names):
        for j, column in enumerate(names[: i + 1]):
            axes = figure.add_subplot(grid[i, j])
            axes.tick_params(
                labelsize=small, labelbottom=i == n - 1, labelleft=0 == j < i
            )
            axes.locator_params(nbins=4)
            axes.xaxis.offsetText.set_fontsize(small)
            axes.yaxis.offsetText.set_fontsize(small)
            axes.ticklabel_format(style="sci", scilimits=(-2, 3), useMathText=False)
            axes.margins(x=0)
            if i == j:
                axes.hist(draws[row], bins=40, color=EFFECT, histtype="stepfilled")
                axes.set_yticks([])
            else:
                _contours(axes, draws[column], draws[row])
                axes.margins(y=0)
            if i < n - 1:
                axes.xaxis.offsetText.set_visible(False)
            else:
                axes.set_xlabel(
                    _axis_label(column, units[column]), fontsize=small, parse_math=False
                )
            if j or not i:
                axes.yaxis.offsetText.set_visible(False)
            else:
                axes.set_ylabel(
                    _axis_label(row, units[row]), fontsize=small, parse_math=False
                )
    return figure


def _axis_label(name: str, unit: str) -> str:
    key, parameter = name.rsplit(": ", 1)
    return f"{label(key)}\n{parameter}" + (f", {unit}" if unit != "1" else "")


def _contours(axes: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Draw the contours that contain 50 % and 95 % of the draws."""
    counts, x_edges, y_edges = np.histogram2d(x, y, bins=24)
    order = np.sort(counts.ravel())[::-1]
    held = np.cumsum(order) / order.sum()
    levels = sorted(
        {float(order[np.searchsorted(held, part)]) for part in (0.95, 0.5)} - {0.0}
    )
    axes.plot(x[::4], y[::4], ",", color=NOISE)
    if levels:
        middle_x, middle_y = (
            0.5 * (edges[1:] + edges[:-1]) for edges in (x_edges, y_edges)
        )
        axes.contour(
            middle_x, middle_y, counts.T, levels=levels, colors=AFTER, linewidths=1.0
        )


def predictive_check(diagnosis: Diagnosis) -> Figure | None:
    """Draw held-out residuals over their predictive standard deviation with the standard normal."""
    samples = diagnosis.samples
    if samples is None or not np.isfinite(samples.held_out).any():
        return None
    z = samples.held_out[np.isfinite(samples.held_out)]
    figure = new_figure(6.4, 3.0, "Readings at poses held out against their prediction")
    axes = figure.subplots()
    edges = np.linspace(-5.0, 5.0, 51)
    style: Any = {"color": NOISE, "label": "readings", "histtype": "stepfilled"}
    axes.hist(z.clip(-5.0, 5.0), bins=edges.tolist(), density=True, **style)
    axes.plot(
        edges,
        np.exp(-0.5 * edges**2) / np.sqrt(2.0 * np.pi),
        color=AFTER,
        label="predicted",
    )
    axes.set_xlabel("residual / predictive standard deviation")
    axes.set_yticks([])
    axes.legend(frameon=False, fontsize=8)
    axes.spines[["top", "right", "left"]].set_visible(False)
    return figure

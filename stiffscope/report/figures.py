"""Shared parts of matplotlib figures: colours, style, heading, and text without math parsing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE = "#4b5560"
EFFECT = "#e4b04a"
AFTER = "#2f7d6b"
NOISE = "#b4bcc5"
STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "stiffscope",
    "font.family": "sans-serif",
}
STYLE["font.size"] = 10


def new_figure(width: float, height: float, title: str) -> Figure:
    """Return an empty figure with a heading; width and height in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    figure.suptitle(
        title, x=0.01, ha="left", fontsize=12, fontweight="bold", parse_math=False
    )
    return figure


def save_figure(figure: Figure, *targets: Path, dpi: int = 110) -> None:
    """Write a figure as SVG or PNG, according to the suffix of each target.

    The canvas writes it, because ``Figure.savefig`` would draw everything once more. So would
    asking for the extent of a text in a figure without a canvas.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    with mpl.rc_context(STYLE):
        for target in targets:
            figure.set_dpi(dpi)
            if target.suffix == ".svg":
                FigureCanvasSVG(figure).print_svg(target, metadata={"Date": None})
            else:
                FigureCanvasAgg(figure).print_png(target)
            figure.set_layout_engine("none")  # the layout is computed only once


def save_figures(
    folder: Path, figures: dict[str, Callable[[], Figure | None]]
) -> list[str]:
    """Draw figures and write each as SVG and PNG; return the names of those that exist."""
    import matplotlib as mpl

    drawn: list[str] = []
    with mpl.rc_context(STYLE):
        for stem, draw in figures.items():
            figure = draw()
            if figure is not None:
                save_figure(figure, folder / f"{stem}.png", folder / f"{stem}.svg")
                drawn.append(stem)
    return drawn


def name_rows(axes: Axes, names: Sequence[str]) -> None:
    """Label the rows of an image."""
    axes.set_yticks(range(len(names)), names, fontsize=8, parse_math=False)
    axes.tick_params(length=0)


def name_columns(axes: Axes, names: Sequence[str]) -> None:
    """Label the columns of an image with slanted text."""
    slanted: Any = {"rotation": 60, "ha": "right", "rotation_mode": "anchor"}
    axes.set_xticks(range(len(names)), names, fontsize=8, parse_math=False, **slanted)
    axes.tick_params(length=0)


def write_cells(
    axes: Axes,
    grid: np.ndarray,
    form: str,
    shade: Callable[[Any], Any],
    size: float = 7,
) -> None:
    """Write the finite numbers of a grid into the cells of its image.

    Parameters
    ----------
    axes, grid
        Axes with the image, and numbers (rows, columns).
    form, size
        Format of a number, such as ``"{:.2g}"``, and font size (points).
    shade
        Function returning the darkness (0 to 1) of each cell; dark cells get white text.
    """
    dark = np.ma.filled(shade(grid), 0.0) > 0.45
    style: Any = {"ha": "center", "va": "center", "fontsize": size, "parse_math": False}
    for i, j in np.argwhere(np.isfinite(grid)):
        colour = "white" if dark[i, j] else "#20252b"
        cell = axes.text(j, i, form.format(grid[i, j]), color=colour, **style)
        cell.set_in_layout(False)  # inside the image, so irrelevant to the layout

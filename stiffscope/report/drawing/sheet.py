"""Sheets of renderings: cells with headings, colour scales, legends."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stiffscope.runtime.types import Array

PREFIXES = [
    (10.0 ** (9 - 3 * k), name) for k, name in enumerate(["G", "M", "k", "", *"mµnp"])
]
WIDTH = 6.2  # of a cell, inches
GREY = "#5a6570"


def sheet_of(
    rows: int, columns: int, size: tuple[int, int], title: str
) -> tuple[Figure, list[Axes]]:
    """Return a titled figure and its cells, row by row, for renderings of a size in pixels.

    Parameters
    ----------
    rows, columns
        Numbers of cells.
    size
        Width and height of a rendering, pixels.
    title
        Heading of the figure.
    """
    height = WIDTH * size[1] / size[0] + 0.78
    whole = rows * height + 0.5
    figure = Figure(figsize=(columns * WIDTH, whole), facecolor="white")
    style: Any = {"fontsize": 15, "fontweight": "bold", "parse_math": False}
    figure.suptitle(title, x=0.01, y=1 - 0.15 / whole, ha="left", **style)
    edges = {"left": 0.01, "right": 0.99, "bottom": 0.4 / whole, "top": 1 - 0.8 / whole}
    edges |= {"wspace": 0.03, "hspace": 0.1}
    return figure, list(
        figure.subplots(rows, columns, squeeze=False, gridspec_kw=edges).flat
    )


def fill(axes: Axes, image: Array, heading: str, remark: str = "") -> None:
    """Put a rendering into a cell, with a heading on the left and a remark on the right."""
    axes.imshow(image, interpolation="antialiased")
    axes.set_axis_off()
    axes.set_anchor("N")
    axes.set_title(
        heading, loc="left", fontsize=11, color="#14181c", y=1.0
    )  # else a slow search
    axes.set_title(remark, loc="right", fontsize=10, color=GREY, y=1.0)


def scale_bar(
    axes: Axes, limit: float, largest: float, unit: str, colours: str
) -> None:
    """Draw the colour scale below a rendering, with the largest value.

    Parameters
    ----------
    axes, colours
        Cell with the rendering, and name of the colour map.
    limit, largest, unit
        Upper end of the colours and largest value, which may exceed it; SI unit without a prefix.
    """
    factor, prefix = next(
        (f, p) for f, p in PREFIXES if limit >= f or f == PREFIXES[-1][0]
    )
    scale = ScalarMappable(Normalize(0, limit / factor), colours)
    extend = "max" if largest > 1.001 * limit else "neither"
    place: Any = {
        "location": "bottom",
        "shrink": 0.6,
        "aspect": 40,
        "pad": 0.02,
        "fraction": 0.05,
    }
    bar = axes.figure.colorbar(scale, ax=axes, extend=extend, **place)
    bar.ax.tick_params(labelsize=9, length=2, pad=2)
    bar.outline.set_linewidth(0.4)
    text = f"{prefix}{unit}, max. {largest / factor:.3g}"
    style: Any = {"fontsize": 9, "va": "center", "color": "#14181c"}
    bar.ax.annotate(text, (1.06, 0.5), xycoords="axes fraction", **style)

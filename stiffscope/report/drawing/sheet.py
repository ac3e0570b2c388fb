"""The sheet around renderings: cells, headings, scales, legends."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from stiffscope.report.drawing.camera import View

    Floats = NDArray[np.float64]

PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))


def sheet_of(rows: int, columns: int, view: View) -> tuple[Figure, list[list[tuple[float, float, float, float]]]]:
    """A figure at 100 dpi with room for rows × columns renderings; cells as (left, bottom, width, height) in pixels."""
    from matplotlib.figure import Figure

    width, height = 620, int(620 * view.size[1] / view.size[0]) + 78
    top = 52
    figure = Figure(figsize=(columns * width / 100, (rows * height + top) / 100), facecolor="white")
    cells = [[(c * width, (rows - 1 - r) * height, width, height) for c in range(columns)] for r in range(rows)]
    return figure, [[_relative(figure, cell) for cell in line] for line in cells]


def _relative(figure: Figure, cell: tuple[float, ...]) -> tuple[float, float, float, float]:
    w, h = figure.get_size_inches() * 100
    return cell[0] / w, cell[1] / h, cell[2] / w, cell[3] / h


def fill(figure: Figure, cell: tuple[float, float, float, float], image: Floats, heading: str, remark: str) -> None:
    """Put a rendering into a cell, with a heading on the left and a remark on the right."""
    left, bottom, width, height = cell
    pixel = 1 / (figure.get_size_inches()[1] * 100)
    axes = figure.add_axes((left, bottom + 48 * pixel, width, height - 78 * pixel))
    axes.imshow(image, aspect="auto", interpolation="antialiased")
    axes.set_axis_off()
    top = bottom + height - 10 * pixel
    figure.text(left + 0.02 * width, top, heading, fontsize=11, va="top", color="#14181c")
    figure.text(left + 0.98 * width, top, remark, fontsize=10, va="top", ha="right", color="#5a6570")


def scale_bar(
    figure: Figure, cell: tuple[float, float, float, float], limit: float, largest: float, unit: str, colours: str
) -> None:
    """The colour scale below a rendering, with the largest value."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    left, bottom, width, _ = cell
    pixel = 1 / (figure.get_size_inches()[1] * 100)
    factor, prefix = next((f, p) for f, p in PREFIXES if limit >= f or f == PREFIXES[-1][0])
    axes = figure.add_axes((left + 0.06 * width, bottom + 34 * pixel, 0.6 * width, 9 * pixel))
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, limit / factor), colours), cax=axes, orientation="horizontal",
        extend="max" if largest > 1.001 * limit else "neither",
    )  # fmt: skip
    bar.ax.tick_params(labelsize=9, length=2, pad=2)
    bar.outline.set_linewidth(0.4)
    text = f"{prefix}{unit}, max. {largest / factor:.3g}"
    figure.text(left + 0.70 * width, bottom + 38 * pixel, text, fontsize=9, va="center", color="#14181c")


def write_title(figure: Figure, title: str) -> None:
    """Write the heading of the sheet; names of robots and parts in it are never read as mathematics."""
    width, height = figure.get_size_inches() * 100
    figure.text(12 / width, 1 - 14 / height, title, fontsize=15, va="top", fontweight="bold", parse_math=False)


def power(number: float, decimals: int = 1) -> str:
    """2.3e6 as 2.3·10⁶, in matplotlib's notation; numbers of up to three digits as they are."""
    mantissa, exponent = f"{number:.{decimals}e}".split("e")
    return f"{number:.3g}" if abs(int(exponent)) < 3 else rf"${mantissa}\cdot10^{{{int(exponent)}}}$"


def legend(figure: Figure, entries: tuple[tuple[str, str], ...]) -> None:
    """Colours and what they stand for, below left."""
    from matplotlib.patches import Patch

    handles = [Patch(facecolor=colour, edgecolor="#3c4650", label=label) for colour, label in entries]
    figure.legend(handles=handles, loc="lower left", ncols=len(handles), frameon=False, fontsize=11)

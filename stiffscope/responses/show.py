"""Table, figure and page of measured responses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import say_count
from stiffscope.report.figures import AFTER, BEFORE, EFFECT, new_figure, save_figures
from stiffscope.report.page import Section
from stiffscope.report.terminal import show_line, show_list, show_table
from stiffscope.responses.checks import (
    find_doubts,
    find_resonances,
    find_static_stiffness,
    name_response,
)
from stiffscope.responses.model import AXES

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from stiffscope.report.run_report import Draft
    from stiffscope.responses.model import Direction, Response, ResponseFile

MOST_DRAWN = 12  # panels of the figure
MOST_LISTED = 6  # resonances in the table


def responses_json(read: ResponseFile) -> dict[str, Any]:
    """Return what a file holds, in SI units."""
    rows = [
        {
            "force": direction_json(response.force),
            "motion": direction_json(response.motion),
            "quantity": response.quantity,
            "band": [float(response.frequency[0]), float(response.frequency[-1])],
            "lines": len(response.frequency),
            "resonances": response.frequency[find_resonances(response)].tolist(),
            "static_stiffness": static_json(response),
            "source": response.source,
        }
        for response in read.responses
    ]
    return {
        "file": str(read.path),
        "points": {name: list(map(float, at)) for name, at in read.points.items()},
        "lines": [list(trace) for trace in read.lines],
        "responses": rows,
        "modes": [
            {
                "frequency": shape.frequency,
                "damping": None if np.isnan(shape.damping) else shape.damping,
                "points": sorted(shape.displacement),
            }
            for shape in read.shapes
        ],
        "doubts": find_doubts(read.responses),
        "remarks": list(read.remarks),
    }


def direction_json(direction: Direction) -> dict[str, Any]:
    """Return a direction as plain data."""
    return {
        "point": direction.point,
        "axis": AXES[direction.axis],
        "sign": direction.sign,
    }


def show_responses(read: ResponseFile) -> None:
    """Print the responses with their resonances, the static stiffness, and doubts."""
    rows = []
    for response in read.responses:
        peaks = response.frequency[find_resonances(response)]
        more = (
            f" and {len(peaks) - MOST_LISTED} more" if len(peaks) > MOST_LISTED else ""
        )
        shown = ", ".join(f"{hertz:.4g}" for hertz in peaks[:MOST_LISTED])
        coherence = (
            "" if response.coherence is None else f"{np.median(response.coherence):.3f}"
        )
        rows.append(
            (
                name_response(response),
                response.quantity,
                f"{response.frequency[0]:.4g} to {response.frequency[-1]:.4g}",
                str(len(response.frequency)),
                coherence,
                f"{shown}{more}" or "none",
            )
        )
    columns = (
        ("motion / force",),
        ("quantity", "band Hz", "lines", "coherence"),
        ("resonances Hz",),
    )
    show_table(
        f"Responses of {read.path.name}", columns, rows, prose=("resonances Hz",)
    )
    show_static(
        [
            (str(each.force), AXES[each.force.axis], static_json(each))
            for each in read.responses
        ]
    )
    if read.shapes:
        modes = [
            (
                f"{shape.frequency:.5g}",
                "" if np.isnan(shape.damping) else f"{100 * shape.damping:.2f}",
                str(len(shape.displacement)),
            )
            for shape in read.shapes
        ]
        show_table("Mode shapes", (("Hz",), ("damping %", "points")), modes)
    doubts = find_doubts(read.responses)
    if doubts:
        show_list("Doubts", doubts)
    for remark in read.remarks:
        show_line(remark)


def static_json(response: Response) -> dict[str, Any] | None:
    """Return the static stiffness that a driving point shows, SI; None if none."""
    static = find_static_stiffness(response)
    if static is None:
        return None
    return {
        "value": static.stiffness,
        "spread": static.spread,
        "band": list(static.band),
    }


def show_static(found: Sequence[tuple[str, str, dict[str, Any] | None]]) -> None:
    """Print the static stiffnesses of driving points: name, axis, and what `static_json` returns."""
    rows = []
    for force, axis, static in found:
        if static is None:
            continue
        turns = axis.startswith("r")
        unit = "N·m/rad" if turns else "N/µm"
        factor = 1.0 if turns else 1e-6
        low, high = static["band"]
        rows.append(
            (
                force,
                f"{factor * static['value']:.4g}",
                f"{factor * static['spread']:.2g}",
                unit,
                f"{low:.4g} to {high:.4g}",
            )
        )
    if rows:
        groups = (("driving point",), ("stiffness", "± 95 %", "unit", "from lines, Hz"))
        show_table("Static stiffness below the first resonance", groups, rows)


def write_figure(read: ResponseFile, folder: Path) -> None:
    """Write responses.png and responses.svg."""
    title = f"{read.path.name}: measured receptances"
    save_figures(folder, {"responses": lambda: draw_responses(title, read.responses)})


def write_page(read: ResponseFile, report: Draft) -> None:
    """Write ``report.html`` with the figure from the folder."""
    caption = (
        "Receptance (m/N) of each response, its phase and coherence; dots: resonances"
    )
    words = "magnitude, phase and coherence over frequency, a column for each response"
    drawn = report.figures({"responses.svg": (caption, words)})
    facts = [
        say_count(len(read.responses), "response"),
        say_count(len(read.points), "point"),
        "SI units",
    ]
    sections = [Section("Responses", tuple(report.shown), drawn)]
    report.write(f"{read.path.name}: measured responses", facts, sections)


def draw_responses(
    title: str,
    responses: Sequence[Response],
    predicted: Sequence[NDArray[np.complex128]] = (),
) -> Figure | None:
    """Draw magnitude, phase and coherence of responses; None without any.

    Parameters
    ----------
    title
        Title of the figure.
    responses
        Measured responses; the first `MOST_DRAWN` are drawn.
    predicted
        Predicted receptance of each response at its lines; none by default.
    """
    if not responses:
        return None
    shown = responses[:MOST_DRAWN]
    columns = min(int(np.ceil(np.sqrt(len(shown)))), 3)
    bands = -(-len(shown) // columns)
    more = len(responses) - len(shown)
    if more:
        title += f" (the first {len(shown)}, {more} more in the table)"
    figure = new_figure(4.2 * columns, 3.9 * bands + 0.4, title)
    panels = figure.subplots(
        3 * bands,
        columns,
        squeeze=False,
        sharex="col",
        height_ratios=np.tile([2.4, 1.0, 0.6], bands).tolist(),
    )
    for k in range(columns * bands):
        block = panels[3 * (k // columns) : 3 * (k // columns) + 3, k % columns]
        if k < len(shown):
            _draw_response(block, shown[k], predicted[k] if predicted else None)
        else:
            for axes in block:
                axes.set_visible(False)
    return figure


def _draw_response(
    panels: Any, response: Response, predicted: NDArray[np.complex128] | None
) -> None:
    upper, middle, lower = panels
    hertz = response.frequency
    size = np.abs(response.receptance)
    peaks = find_resonances(response)
    unit = "m/N" if max(response.force.axis, response.motion.axis) < 3 else "SI"
    upper.semilogy(hertz, size, color=BEFORE, lw=1.1, label="measured")
    upper.plot(hertz[peaks], size[peaks], "o", ms=4, color=EFFECT, zorder=3)
    upper.set_title(name_response(response), fontsize=10, parse_math=False, loc="left")
    upper.set_ylabel(f"|H| ({unit})")
    # of motion and force along the positive axes; dots, as the phase jumps at 180°
    sign = response.force.sign * response.motion.sign
    phase = np.angle(sign * response.receptance, deg=True)
    middle.plot(hertz, phase, ".", ms=1.6, color=BEFORE)
    if predicted is not None:
        upper.semilogy(
            hertz, np.abs(predicted), "--", color=AFTER, lw=1.3, label="predicted"
        )
        floor = 0.1 * size[size > 0.0].min(initial=size.max())
        if floor > 0.0:  # a prediction far below the noise would flatten all else
            upper.set_ylim(bottom=max(floor, upper.get_ylim()[0]))
        turned = np.angle(sign * predicted, deg=True)
        middle.plot(hertz, turned, ".", ms=1.2, color=AFTER)
        upper.legend(fontsize=8, frameon=False)
    middle.set(ylim=(-185, 185), ylabel="deg")
    middle.set_yticks([-180, 0, 180])
    if response.coherence is None:
        lower.text(
            0.5,
            0.5,
            "no coherence in the file",
            ha="center",
            va="center",
            fontsize=8,
            transform=lower.transAxes,
        )
        lower.set_yticks([])
    else:
        lower.plot(hertz, response.coherence, color=AFTER, lw=0.9)
        lower.set(ylim=(0, 1.05), ylabel="γ²")
    lower.set_xlabel("frequency (Hz)")
    lower.tick_params(labelbottom=True)
    for axes in panels:
        axes.grid(which="major", color="#e3e7eb", lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)

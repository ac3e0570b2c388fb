"""Three pictures of what was found on measured machines, drawn from the figures of that page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from docutils.parsers.rst import Directive
from inline_pictures import embed_svg

from stiffscope.report.figures import AFTER, BEFORE, EFFECT, STYLE, new_figure

if TYPE_CHECKING:
    from docutils import nodes
    from matplotlib.axes import Axes
    from sphinx.application import Sphinx

ARMS = {
    "tracker alone": (0.1330, 0.1435),
    "and zeros": (0.0615, 0.0791),
    "and axes": (0.0470, 0.0407),
    "and compliance": (0.0457, 0.0392),
    "stiffscope": (0.048, 0.041),
}
"""What is left of held-out postures, mm rms a coordinate: left arm, right arm."""
DRIVES = {
    "J1": (41.6, 2.8, 41),
    "J2": (72.0, 4.6, 70),
    "J3": (90, 22, 104),
    "J5": (5.9, 1.2, 5.3),
}
"""Stiffness of a drive, its 95 % half width, and that of least squares, kN·m/rad."""
BEAM = {
    "as modelled": 2.93,
    "modulus": 0.63,
    "roller's place": 0.38,
    "place and travel": 0.13,
}
"""What is left of the first frequency, %."""


def _draw_arms(axes: Axes) -> None:
    for k, (name, colour) in enumerate((("left", BEFORE), ("right", AFTER))):
        places = [row + 0.36 * k for row in range(len(ARMS))]
        left = [each[k] for each in ARMS.values()]
        axes.barh(places, left, 0.34, color=colour, label=f"{name} arm")
    axes.set_yticks([row + 0.18 for row in range(len(ARMS))], list(ARMS))
    axes.set(xlabel="left of postures held out, mm", title="Motoman: geometry")
    axes.invert_yaxis()
    axes.legend(frameon=False)


def _draw_drives(axes: Axes) -> None:
    values, widths, theirs = zip(*DRIVES.values(), strict=True)
    rows = range(len(DRIVES))
    bars = {"fmt": "o", "color": AFTER, "capsize": 3, "label": "found, 95 %"}
    axes.errorbar(values, rows, xerr=widths, **bars)
    axes.plot(theirs, rows, "x", color=EFFECT, label="least squares")
    axes.set_yticks(rows, list(DRIVES))
    axes.set(xlabel="kN·m/rad", title="KUKA under load: drives", xlim=(0, None))
    axes.invert_yaxis()
    axes.legend(frameon=False)


def _draw_beam(axes: Axes) -> None:
    bars = axes.barh(range(len(BEAM)), list(BEAM.values()), color=AFTER)
    axes.bar_label(bars, padding=3)
    axes.set_yticks(range(len(BEAM)), list(BEAM))
    axes.set(xlabel="left of the first frequency, %", title="A beam: the roller")
    axes.margins(x=0.15)
    axes.invert_yaxis()


class MeasuredMachines(Directive):
    """One picture a machine: what is left, what was found."""

    def run(self) -> list[nodes.Node]:
        """Draw the pictures."""
        import matplotlib as mpl

        found: list[nodes.Node] = []
        for draw, words in (
            (_draw_arms, "Held-out error of the Motoman arms as more is free"),
            (_draw_drives, "Stiffness of the KUKA's drives with intervals"),
            (_draw_beam, "What is left of the beam's first frequency by cause"),
        ):
            with mpl.rc_context(STYLE):
                figure = new_figure(4.6, 2.9, "")
                draw(figure.subplots())
                found.append(embed_svg(figure, words))
        return found


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directive."""
    app.add_directive("measured-machines", MeasuredMachines)
    return {"parallel_read_safe": True}

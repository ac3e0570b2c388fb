"""Figure and report of `stiffscope interfaces`: a sketch of each choice above its changes."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report.figures import AFTER, BEFORE, EFFECT, new_figure, save_figure
from stiffscope.report.numbers import power, relative
from stiffscope.report.page import Section
from stiffscope.report.terminal import show_line, show_table

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

    from stiffscope.parts.interfaces import Comparison, Tested
    from stiffscope.report.run_report import Draft

PLATE = "#dfe4e8"
LINEAR = 10.0  # %; the scale of changes is linear below it
CAPTION = (
    "Sketches from above: clamped at the top, loaded at the bottom. Yellow: the entry grows, green: "
    f"it shrinks. Whiskers: 95 % bounds. The scale is linear up to {LINEAR:g} %, logarithmic beyond."
)
SLENDER = (
    0.16,
    0.4,
)  # sketched width and depth of a link or a STEP solid, not to scale


def draw(compared: Comparison, target: Path) -> None:
    """Draw the entries for the robot file's interface and their changes for the others, as PNG."""
    count = len(compared.others)
    title = _title(compared)
    figure = new_figure(3.6 + 2.75 * count, 2.9 + 0.42 * len(compared.entries), title)
    grid = figure.subplots(2, count + 1, height_ratios=[1.3, 2.9], squeeze=False)
    for axes, tested in zip(grid[0], (compared.own, *compared.others), strict=True):
        _sketch(axes, tested)
    _values(grid[1, 0], compared)
    for k, axes in enumerate(grid[1, 1:]):
        _changes(axes, compared, k)
    figure.supxlabel(textwrap.fill(CAPTION, 42 * (count + 1)), fontsize=9, color=BEFORE)
    save_figure(figure, target, dpi=130)


def _title(compared: Comparison) -> str:
    return f"{compared.robot}: effect of the interfaces on the {compared.part}'s compliance"


def write_page(compared: Comparison, report: Draft) -> None:
    """Write ``report.html`` with the shown tables and the folder's figure."""
    words = "a sketch of each choice of interface, below it each entry's change, with its bound"
    drawn = report.figures({"interfaces.png": (CAPTION, words)})
    about = f"the {compared.part}'s 6×6 compliance, SI"
    where = "at the reference point of the robot file's own choice"
    sections = [Section("Compliance by interface", report.shown, drawn)]
    report.write(_title(compared), [f"{about}, {where}", "95 % bounds"], sections)


def _values(axes: Axes, compared: Comparison) -> None:
    """Write the entries for the robot file's interface as text."""
    axes.set_xlim(0, 1)
    axes.set_ylim(len(compared.entries) - 0.4, -0.6)
    axes.axis("off")
    for row, entry in enumerate(compared.entries):
        percent = 100 * entry.error / abs(entry.own)
        where, _, name = entry.name.rpartition("C")
        style: Any = {"va": "center", "ha": "right"}
        axes.text(0.0, row, f"{where}$C_{{{name}}}$", va="center", fontsize=11)
        axes.text(
            0.70, row, f"{power(entry.own, 3)} {entry.unit}", fontsize=9.5, **style
        )
        axes.text(1.0, row, f"± {percent:.2g} %", fontsize=9, color=BEFORE, **style)


def _changes(axes: Axes, compared: Comparison, k: int) -> None:
    """Draw bars of the change in % with bounds, on a symmetric logarithmic scale."""
    every = 100 * np.array([entry.changes for entry in compared.entries])
    changes = every[:, k]
    bars = 100 * np.array([entry.bars[k] for entry in compared.entries])
    rows = np.arange(len(changes))
    colours = np.where(changes > 0, EFFECT, AFTER)
    axes.barh(rows, changes, 0.62, xerr=bars, color=colours, ecolor=BEFORE, capsize=2.5)
    for row, (change, bar) in enumerate(zip(changes, bars, strict=True)):
        end, side, ha = (
            (change + bar, 5, "left") if change > 0 else (change - bar, -5, "right")
        )
        text = f"{change:+z.{0 if abs(change) >= 99.95 else 1}f}".replace("-", "−")
        place: Any = {"textcoords": "offset points", "va": "center", "ha": ha}
        axes.annotate(text, (end, row), (side, 0), fontsize=9, **place)
    axes.set_xscale("symlog", linthresh=LINEAR, linscale=0.7)
    low = 6 * min(float(every.min()), -LINEAR)
    high = 6 * max(float(every.max()), LINEAR)
    ticks = [t for t in (-100, -10, 0, 10, 100, 1000, 10000, 100000) if low < t < high]
    axes.set_xticks(ticks, [f"{t:+d}".replace("-", "−") if t else "0" for t in ticks])
    axes.set_xticks([], minor=True)
    axes.set_xlim(low, high)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_yticks([])
    axes.axvline(0, color=BEFORE, lw=0.9)
    axes.grid(axis="x", color=PLATE, lw=0.7)
    axes.set_axisbelow(True)
    axes.set_xlabel("change of the entry, %")
    axes.spines[["top", "right", "left"]].set_visible(False)


def _sketch(axes: Axes, tested: Tested) -> None:
    """Sketch the part from above, clamped at the top, loaded at the bottom; unit: part width."""
    from matplotlib.patches import Rectangle

    shape: Any = None if tested.result.order.step else tested.result.order.solid
    unit = getattr(shape, "width", 1.0)
    width, depth = (1.0, shape.depth / unit) if hasattr(shape, "depth") else SLENDER
    axes.set_title(tested.choice.name, fontsize=11, fontweight="bold", pad=4)
    look: Any = {"facecolor": PLATE, "edgecolor": BEFORE, "lw": 1.0}
    axes.add_patch(Rectangle((-width / 2, 0), width, depth, **look))
    settings = tested.result.order.settings
    if getattr(shape, "clamp", "face") == "holes":
        row = depth - shape.hole_offset / unit
        for y in shape.hole_positions:
            axes.plot(y / unit, row, "o", ms=6, mfc=BEFORE, mec="white", mew=0.8)
    else:
        _clamp(axes, width, depth, springs=settings.foundation is not None)
    pads = getattr(shape, "pad_height", 0.0)
    rigid = settings.interface == "rigid"
    places = shape.pad_positions if pads else ()
    faces = [(y / unit, shape.pad_width / unit) for y in places] or [(0.0, width)]
    bottom = -max(pads / unit, 0.03) if pads else 0.0
    for middle, across in faces:
        if pads:
            axes.add_patch(
                Rectangle((middle - across / 2, bottom), across, -bottom, **look)
            )
        _load(axes, middle, across, bottom, rigid=rigid)
    if pads and rigid:
        _load(
            axes, 0.0, abs(faces[1][0] - faces[2][0]) + faces[0][1], bottom, rigid=rigid
        )
    words: Any = {
        "s": textwrap.fill(tested.choice.words, 40),
        "fontsize": 8.5,
        "linespacing": 1.3,
    }
    axes.text(0, -0.15, ha="center", va="top", color=BEFORE, parse_math=False, **words)
    axes.set(xlim=(-0.58, 0.58), ylim=(-0.34, depth + 0.16), aspect="equal")
    axes.axis("off")


def _clamp(axes: Axes, width: float, depth: float, *, springs: bool) -> None:
    """Draw the ground above the part, touching it or a spring's length away."""
    from matplotlib.patches import Rectangle

    ground = depth + (0.09 if springs else 0.0)
    look: Any = {"facecolor": "none", "edgecolor": BEFORE, "hatch": "//////", "lw": 0}
    axes.add_patch(Rectangle((-width / 2, ground), width, 0.05, **look))
    axes.plot([-width / 2, width / 2], [ground] * 2, color=BEFORE, lw=1.6)
    if springs:
        heights = np.linspace(depth, ground, 8)
        zigzag = 0.022 * np.array([0, 0, 1, -1, 1, -1, 0, 0])
        for middle in np.linspace(
            -0.44 * width, 0.44 * width, max(3, round(9 * width))
        ):
            axes.plot(middle + zigzag, heights, color=BEFORE, lw=0.9)


def _load(
    axes: Axes, middle: float, width: float, bottom: float, *, rigid: bool
) -> None:
    """Draw a bar for a rigid face, or arrows for a uniform traction."""
    left = middle - width / 2
    right = middle + width / 2
    if rigid:
        axes.plot(
            [left, right],
            [bottom - 0.012] * 2,
            color=EFFECT,
            lw=4,
            solid_capstyle="butt",
        )
        return
    arrow: Any = {"arrowstyle": "-|>", "color": EFFECT, "lw": 1.2}
    for x in np.linspace(left, right, max(2, round(13 * width))):
        axes.annotate("", (x, bottom - 0.005), (x, bottom - 0.12), arrowprops=arrow)


def show_interfaces(compared: Comparison) -> None:
    """Show how each choice of interface changes each entry, and describe the choices."""
    base_choice = compared.own.choice
    names = ((tested.choice.name,) for tested in compared.others)
    groups = [("entry", "unit"), ("value", "± 95 %"), *names]
    rows = []
    for e in compared.entries:
        pairs = zip(e.changes, e.bars, strict=True)
        changes = (f"{100 * c:+z.1f} ± {100 * b:.2g} %" for c, b in pairs)
        rows.append(
            (e.name, e.unit, f"{e.own:.6g}", relative(e.error, e.own), *changes)
        )
    title = f"Compliance of the {compared.part} ({base_choice.name}), and its change with other interfaces"
    show_table(title, groups, rows)
    for tested in compared.others:
        choice = tested.choice
        overrides = " ".join(
            f"--set '{o}'" if " " in o else f"--set {o}" for o in choice.overrides
        )
        show_line(f"  {choice.name}: {choice.words} ({overrides})")
    for line in compared.left_out:
        show_line(f"  {line}")

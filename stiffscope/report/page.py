"""A report as one HTML file: contents, tables as the terminal shows them, figures, charts, a robot that turns.

Nothing is requested when it is opened: pictures, style and viewer are inside. The viewer, ``templates/view.js``, is
plain WebGL of a few hundred lines; BokehJS draws the charts of pages that have some. A picture stands in the
place of either in print and without scripts.
"""

from __future__ import annotations

import base64
import functools
import io
import re
from dataclasses import dataclass, field
from importlib.metadata import distribution
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from PIL import Image, WebPImagePlugin  # noqa: F401 (else saving imports all of its seventy formats)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.report.terminal import Shown

QUALITY = 86  # of pictures inside a page, WebP
WIDE = 1000  # pixels, from which a picture scrolls on a phone
BUTTONS = (
    ("left", "◀", "Turn left"), ("right", "▶", "Turn right"), ("up", "▲", "Tilt up"), ("down", "▼", "Tilt down"),
    ("nearer", "+", "Zoom in"), ("farther", "−", "Zoom out"), ("reset", "↺", "Initial view"),
)  # fmt: skip
MOST_POINTS = 5000  # of a series; more are thinned evenly
HOW = "Drag to turn, or use the arrow keys; with Shift or the right button to move; + and − to zoom."
FACTOR = (
    "Displacements are multiplied by the factor at the slider, and interpolated between the ends of elastic bodies "
    "as a beam bends."
)


@dataclass(frozen=True)
class Figure:
    """A picture inside the page: its data address, size in pixels, caption, and what to say where it is not seen."""

    source: str
    size: tuple[int, int]
    caption: str
    words: str
    files: tuple[str, ...] = ()
    """Names of the files beside the page that hold it and its data."""

    @property
    def wide(self) -> bool:
        """Whether it scrolls on a phone."""
        return self.size[0] >= WIDE


@dataclass(frozen=True)
class RobotView:
    """The robot that turns: data of `stiffscope.report.robot_view.robot_view`, and the picture in its place.

    The picture has the same caption unless it brings its own.
    """

    data: Mapping[str, Any]
    caption: str
    words: str
    still: Figure | None = None
    start: int = 100
    """Deformation at first, in percent of what is well seen."""

    buttons = BUTTONS

    @property
    def how(self) -> str:
        """What to do with it."""
        return f"{HOW} {FACTOR}" if any(pose["cases"] for pose in self.data["poses"]) else HOW


@dataclass(frozen=True)
class Series:
    """Points of one colour: columns of equal length by name, numbers or words; the first is a row of a table."""

    name: str
    colour: str
    columns: Mapping[str, Sequence[Any] | np.ndarray]
    size: float = 6
    """Diameter of a point, pixels."""


@dataclass(frozen=True)
class Chart:
    """Series that share their columns' names, and what of them x and y may be, the first at first."""

    series: Sequence[Series]
    x: Sequence[str]
    y: Sequence[str]
    caption: str
    still: Figure | None = None
    equal: bool = False
    """Whether a line is drawn on which x equals y."""
    joined: bool = False
    """Whether lines join the points of a series."""
    log: bool = False
    """Whether the axis of x is logarithmic."""

    @property
    def data(self) -> dict[str, Any]:
        """The chart as JSON knows it."""
        series = [
            {"name": s.name, "colour": s.colour, "size": s.size,
             "columns": {name: _round_column(values) for name, values in s.columns.items()}}
            for s in self.series
        ]  # fmt: skip
        return {"series": series, "x": list(self.x), "y": list(self.y),
                "equal": self.equal, "joined": self.joined, "log": self.log}  # fmt: skip


def _round_column(values: Sequence[Any] | np.ndarray) -> list[Any]:
    """Return a column with six digits of its numbers, null where there is none, thinned where it is long."""
    some = values[:: max(1, -(-len(values) // MOST_POINTS))]
    return [
        value if isinstance(value, str) else float(f"{value:.6g}") if np.isfinite(value) else None for value in some
    ]


@dataclass(frozen=True)
class Section:
    """What stands under one heading, in this order."""

    heading: str
    tables: Sequence[Shown] = ()
    figures: Sequence[Figure] = ()
    view: RobotView | None = field(default=None, kw_only=True)
    charts: Sequence[Chart] = field(default=(), kw_only=True)
    files: Sequence[str] = field(default=(), kw_only=True)
    """Names of the files beside the page that hold the tables' numbers."""

    def __bool__(self) -> bool:
        """Whether anything stands below the heading."""
        return bool(self.tables or self.figures or self.view or self.charts)


@dataclass(frozen=True)
class Lead:
    """What a page says first, with what it is: a verdict of a diagnosis, which has a colour."""

    words: str
    kind: str = ""


def figure(image: Path, caption: str, words: str, folder: Path | None = None) -> Figure:
    """Take a picture file, PNG or SVG, into a page, with links to the files of its name beside it.

    Parameters
    ----------
    image
        PNG or SVG file.
    caption
        Caption.
    words
        Text alternative.
    folder
        Folder of the page; default: the picture's own.

    """
    files = tuple(
        sorted(f.relative_to(folder or image.parent).as_posix() for f in image.parent.glob(f"{image.stem}.*"))
    )
    if image.suffix == ".svg":
        return _drawing(image.read_bytes(), caption, words, files)
    out = io.BytesIO()
    with Image.open(image) as picture:
        picture.convert("RGB").save(out, "WEBP", quality=QUALITY, method=0)
        size = picture.size
    return Figure(f"data:image/webp;base64,{base64.b64encode(out.getvalue()).decode()}", size, caption, words, files)


def figures(folder: Path, captions: Mapping[str, tuple[str, str]]) -> list[Figure]:
    """Take into a page the pictures that there are in a folder, each with its caption and text alternative."""
    return [figure(folder / name, *words, folder) for name, words in captions.items() if (folder / name).exists()]


def _drawing(svg: bytes, caption: str, words: str, files: tuple[str, ...]) -> Figure:
    """A drawing of matplotlib's: its size stands at its head, in points."""
    found = re.search(rb'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg)
    wide, high = (round(float(size) * 4 / 3) for size in (found.groups() if found else (b"640", b"480")))
    return Figure(f"data:image/svg+xml;base64,{base64.b64encode(svg).decode()}", (wide, high), caption, words, files)


def write_page(
    target: Path,
    title: str,
    facts: Sequence[str],
    sections: Sequence[Section],
    lead: Lead | None = None,
    *,
    watched: str = "",
) -> None:
    """Write a page to a file: facts in a line below the title, what it says first, sections that hold anything.

    With ``watched``, a name of this state, the page loads itself anew as soon as a page of another name takes its
    place: it asks the file ``state.html`` beside it, once a second.

    Parameters
    ----------
    target
        File to write.
    title
        Title.
    facts
        Facts below the title.
    sections
        Sections in order.
    lead
        What the page says first.
    watched
        Name of this state of a page that reloads; empty for one that does not.

    """
    filled = [section for section in sections if section]
    given = {"title": title, "facts": facts, "sections": filled, "lead": lead, "watched": watched}
    given["repeated"] = {view.still.source for section in filled if (view := section.view) and view.still}
    given["charts"] = read_library() if any(section.charts for section in filled) else ""
    target.write_text(templates().get_template("report.html").render(given).lstrip(), encoding="utf-8")
    if watched:
        state = templates().get_template("state.html").render(watched=watched)
        target.with_name("state.html").write_text(state, encoding="utf-8")


@functools.cache
def templates() -> Environment:
    """Return the templates beside this file, which escape all text."""
    return Environment(
        loader=PackageLoader("stiffscope.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )


@functools.cache
def read_library() -> Markup:
    """Return BokehJS as the package holds it; importing the package itself would take most of a second."""
    folder = Path(str(distribution("bokeh").locate_file("bokeh/server/static/js")))
    return Markup("\n".join((folder / f"{name}.min.js").read_text("utf-8") for name in ("bokeh", "bokeh-api")))  # noqa: S704

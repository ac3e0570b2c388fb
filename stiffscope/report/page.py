"""A report as one HTML file: contents, terminal tables, figures, charts, a rotatable robot.

The file is self-contained: pictures, style and viewer are embedded. The viewer,
``templates/view.js``, is plain WebGL of a few hundred lines; BokehJS draws the charts, if any.
In print and without scripts, a still picture replaces either.
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

QUALITY = 86  # WebP quality of embedded pictures
WIDE = 1000  # pixels; wider pictures scroll on a phone
BUTTONS = (
    ("left", "◀", "Turn left"),
    ("right", "▶", "Turn right"),
    ("up", "▲", "Tilt up"),
    ("down", "▼", "Tilt down"),
    ("nearer", "+", "Zoom in"),
    ("farther", "−", "Zoom out"),
    ("reset", "↺", "Initial view"),
)
MOST_POINTS = 5000  # per series; longer ones are thinned evenly
HOW = "Drag or use the arrow keys to turn, with Shift or the right button to move; + and − to zoom."
FACTOR = (
    "Displacements are multiplied by the factor at the slider, and interpolated between the ends of "
    "elastic bodies as a beam bends."
)


@dataclass(frozen=True)
class Figure:
    """An embedded picture: data URL, size in pixels, caption and text alternative."""

    source: str
    size: tuple[int, int]
    caption: str
    words: str
    files: tuple[str, ...] = ()
    """Files next to the page that contain the picture and its data."""

    @property
    def wide(self) -> bool:
        """Whether the picture scrolls on a phone."""
        return self.size[0] >= WIDE


@dataclass(frozen=True)
class RobotView:
    """A rotatable robot: data from `stiffscope.report.robot_view.robot_view`, and a still picture.

    The still picture has the same caption unless it has its own.
    """

    data: Mapping[str, Any]
    caption: str
    words: str
    still: Figure | None = None
    start: int = 100
    """Initial deformation, in percent of the default exaggeration."""

    buttons = BUTTONS

    @property
    def how(self) -> str:
        """Instructions for the reader."""
        return (
            f"{HOW} {FACTOR}"
            if any(pose["cases"] for pose in self.data["poses"])
            else HOW
        )


@dataclass(frozen=True)
class Series:
    """Points of one colour in equally long columns of numbers or text; the first is a table row."""

    name: str
    colour: str
    columns: Mapping[str, Sequence[Any] | np.ndarray]
    size: float = 6
    """Diameter of a point in pixels."""


@dataclass(frozen=True)
class Chart:
    """Series with the same column names; the columns selectable as x and y, the default first."""

    series: Sequence[Series]
    x: Sequence[str]
    y: Sequence[str]
    caption: str
    still: Figure | None = None
    equal: bool = False
    """Whether the line x = y is drawn."""
    joined: bool = False
    """Whether lines join the points of a series."""
    log: bool = False
    """Whether the x axis is logarithmic."""

    @property
    def data(self) -> dict[str, Any]:
        """The chart as JSON-compatible data."""
        series = [
            {
                "name": s.name,
                "colour": s.colour,
                "size": s.size,
                "columns": {
                    name: _round_column(values) for name, values in s.columns.items()
                },
            }
            for s in self.series
        ]
        return {
            "series": series,
            "x": list(self.x),
            "y": list(self.y),
            "equal": self.equal,
            "joined": self.joined,
            "log": self.log,
        }


def _round_column(values: Sequence[Any] | np.ndarray) -> list[Any]:
    """Return a column, thinned if long, with numbers to six digits and None for missing ones."""
    thinned = values[:: max(1, -(-len(values) // MOST_POINTS))]
    return [
        v if isinstance(v, str) else float(f"{v:.6g}") if np.isfinite(v) else None
        for v in thinned
    ]


@dataclass(frozen=True)
class Section:
    """The content under one heading, in this order."""

    heading: str
    tables: Sequence[Shown] = ()
    figures: Sequence[Figure] = ()
    view: RobotView | None = field(default=None, kw_only=True)
    charts: Sequence[Chart] = field(default=(), kw_only=True)
    files: Sequence[str] = field(default=(), kw_only=True)
    """Files next to the page that contain the tables' numbers."""

    def __bool__(self) -> bool:
        """Return whether the section has any content."""
        return bool(self.tables or self.figures or self.view or self.charts)


@dataclass(frozen=True)
class Lead:
    """The leading sentence of a page, and its kind: a diagnosis verdict, which sets the colour."""

    words: str
    kind: str = ""
    warning: str = ""
    """What must be read before any number of the page."""


def figures(folder: Path, captions: Mapping[str, tuple[str, str]]) -> list[Figure]:
    """Embed the existing pictures of a page's folder, each with its caption and text alternative.

    Each has links to the files of the same stem.
    """
    known = (
        (name, words) for name, words in captions.items() if (folder / name).exists()
    )
    return [_embed(folder, name, *words) for name, words in known]


def _embed(folder: Path, name: str, caption: str, words: str) -> Figure:
    """Embed a PNG, or an SVG by matplotlib, whose header states the size in points."""
    image = folder / name
    alike = image.parent.glob(f"{image.stem}.*")
    files = tuple(sorted(file.relative_to(folder).as_posix() for file in alike))
    if image.suffix == ".svg":
        content = image.read_bytes()
        kind = "svg+xml"
        match = re.search(rb'viewBox="0 0 ([\d.]+) ([\d.]+)"', content)
        points = match.groups() if match else (b"640", b"480")
        wide, high = (round(float(size) * 4 / 3) for size in points)
    else:
        out = io.BytesIO()
        kind = "webp"
        with Image.open(image) as picture:
            picture.convert("RGB").save(out, "WEBP", quality=QUALITY, method=0)
            wide, high = picture.size
        content = out.getvalue()
    source = f"data:image/{kind};base64,{base64.b64encode(content).decode()}"
    return Figure(source, (wide, high), caption, words, files)


def write_page(
    target: Path,
    title: str,
    facts: Sequence[str],
    sections: Sequence[Section],
    lead: Lead | None = None,
    *,
    watched: str = "",
) -> None:
    """Write a page to a file: title, one line of facts, lead and all nonempty sections.

    With ``watched``, a name of this state, the page checks ``state.html`` next to it once a second
    and reloads as soon as the name changes.

    Parameters
    ----------
    target
        File to write.
    title, facts, lead, sections
        Title, facts below it, leading sentence, and sections in order.
    watched
        Name of this state of a reloading page; empty for a static page.
    """
    filled = [section for section in sections if section]
    given = {
        "title": title,
        "facts": facts,
        "sections": filled,
        "lead": lead,
        "watched": watched,
    }
    views = [section.view for section in filled if section.view]
    given["repeated"] = {view.still.source for view in views if view.still}
    given["charts"] = (
        read_library() if any(section.charts for section in filled) else ""
    )
    text = templates().get_template("report.html").render(given).lstrip()
    target.write_text(text, encoding="utf-8", errors="backslashreplace")
    if watched:
        state = templates().get_template("state.html").render(watched=watched)
        target.with_name("state.html").write_text(state, encoding="utf-8")


@functools.cache
def templates() -> Environment:
    """Return the environment of the page templates, which escapes all text."""
    loader: Any = PackageLoader("stiffscope.report")
    return Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )


@functools.cache
def read_library() -> Markup:
    """Return BokehJS from the installed package, without its slow import."""
    folder = Path(str(distribution("bokeh").locate_file("bokeh/server/static/js")))
    texts = (
        (folder / f"{name}.min.js").read_text("utf-8")
        for name in ("bokeh", "bokeh-api")
    )
    return Markup("\n".join(texts))  # noqa: S704

"""Charts of a page that answer when they are touched: hover, zoom, choice of the axes, export as a picture.

BokehJS draws them; a page that has any holds it, so that nothing is requested when the page is opened. A still picture
stands in their place in print and without scripts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.metadata import distribution
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.report.page import Figure

MOST_POINTS = 5000  # of a series; more are thinned evenly


@dataclass(frozen=True)
class Series:
    """Points or a line of one colour: columns of equal length by name, numbers or words."""

    name: str
    colour: str
    columns: Mapping[str, Sequence[Any] | np.ndarray]
    line: bool = False
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
    key: str = ""
    """Column that says which row of the page's tables a point is; empty: the first."""
    equal: bool = False
    """Whether a line is drawn on which x equals y."""

    @property
    def data(self) -> dict[str, Any]:
        """The chart as JSON knows it."""
        series = [
            {"name": s.name, "colour": s.colour, "line": s.line, "size": s.size,
             "columns": {name: _to_plain(values) for name, values in s.columns.items()}}
            for s in self.series
        ]  # fmt: skip
        key = self.key or next(iter(self.series[0].columns))
        return {"series": series, "x": list(self.x), "y": list(self.y), "key": key, "equal": self.equal}


def _to_plain(values: Sequence[Any] | np.ndarray) -> list[Any]:
    """Return a column with six digits of its numbers, null where there is none, thinned where it is long."""
    some = values[:: max(1, -(-len(values) // MOST_POINTS))]
    return [
        value if isinstance(value, str) else float(f"{value:.6g}") if np.isfinite(value) else None for value in some
    ]


@cache
def read_library() -> Markup:
    """Return BokehJS as the package holds it; importing the package itself would take most of a second."""
    folder = Path(str(distribution("bokeh").locate_file("bokeh/server/static/js")))
    return Markup("\n".join((folder / f"{name}.min.js").read_text("utf-8") for name in ("bokeh", "bokeh-api")))  # noqa: S704

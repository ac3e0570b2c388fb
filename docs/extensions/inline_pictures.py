"""Figures that stand in a page itself."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING

from docutils import nodes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def embed_svg(figure: Figure, words: str) -> nodes.raw:
    """Return a figure as a picture within the page, with words for those who cannot see it."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="svg", metadata={"Date": None})
    data = base64.b64encode(drawn.getvalue()).decode()
    source = f"data:image/svg+xml;base64,{data}"
    return nodes.raw("", f'<img alt="{words}" src="{source}">', format="html")

"""What the drawing process does: pyvista renders the solids off-screen, matplotlib sets titles and scales around them.

Every picture is a function that is called by name through `stiffscope.report.pictures.draw`. Lengths in m.
"""

from __future__ import annotations

import json
import os
from pathlib import Path


def main(order_file: str) -> None:
    """Draw what an order file of `stiffscope.report.pictures.draw` asks for."""
    from stiffscope.report.drawing.part import part_pictures
    from stiffscope.report.drawing.robot import robot

    order = json.loads(Path(order_file).read_text())
    pictures = {f.__name__: f for f in (part_pictures, robot)}
    pictures[order["picture"]](Path(order["target"]), **order["arguments"])
    os._exit(0)  # VTK's own end has been seen to crash after the picture was there

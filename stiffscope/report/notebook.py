"""For a notebook: pictures that show themselves in a cell."""

from __future__ import annotations

import dataclasses
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from stiffscope import files
from stiffscope.report.pictures import draw

if TYPE_CHECKING:
    from stiffscope.fea.experiment import Experiment
    from stiffscope.vjm.biglide import Biglide


@dataclass(frozen=True)
class Picture:
    """A PNG that a notebook shows; `save` writes it to a file."""

    png: bytes = dataclasses.field(repr=False)

    def _repr_png_(self) -> bytes:
        return self.png

    def save(self, path: str | Path) -> None:
        """Write the PNG to a file."""
        files.write_bytes(Path(path), self.png)


def deformed(experiment: Experiment) -> Picture:
    """A part under each of its six unit wrenches. Raises PictureError where this machine cannot draw."""
    with tempfile.TemporaryDirectory(prefix="stiffscope-") as folder:
        held = Path(folder) / "experiment.npz"
        experiment.save(held)
        title, sheet = experiment.part, "loads.png"
        draw("part_pictures", Path(folder), experiment=held, title=title, clamped=[], loaded=[], sheet=sheet)
        return Picture((Path(folder) / sheet).read_bytes())


def stiffness_map(robot: Biglide, points: int = 121) -> Picture:
    """Principal stiffness in six directions over all that the robot reaches, at y = 0."""
    from stiffscope.report import maps
    from stiffscope.vjm.gravity import STANDARD

    found = maps.robot_maps(robot, {}, points, "none", STANDARD)
    with tempfile.TemporaryDirectory(prefix="stiffscope-") as folder:
        target = Path(folder) / "map.png"
        maps.draw_stiffness(found, {}, "principal stiffness at M, y = 0", target)
        return Picture(target.read_bytes())

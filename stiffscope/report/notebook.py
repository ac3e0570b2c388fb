"""For a notebook: pictures that show themselves in a cell, and how it displays the objects of other rooms."""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from stiffscope import files
from stiffscope.files import scratch_folder
from stiffscope.report.pictures import draw

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.fea.experiment import Experiment
    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.statics import Stiffness


@dataclass(frozen=True)
class Picture:
    """A PNG that a notebook shows; `save` writes it to a file."""

    png: bytes = dataclasses.field(repr=False)

    def _repr_png_(self) -> bytes:
        return self.png

    def save(self, path: str | Path) -> None:
        """Write the PNG to a file."""
        files.write_bytes(Path(path), self.png)


def register() -> None:
    """Make a running IPython show experiments and stiffnesses as tables; without one, do nothing.

    The objects know nothing of HTML: their classes are found by name when the first of them is shown.
    """
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is None:
        return
    html = shell.display_formatter.formatters["text/html"]
    html.for_type_by_name("stiffscope.fea.experiment", "Experiment", _experiment)
    html.for_type_by_name("stiffscope.vjm.statics", "Stiffness", _stiffness)


def _experiment(experiment: Experiment) -> str:
    from stiffscope.report.html import experiment_html

    return experiment_html(experiment)


def _stiffness(state: Stiffness) -> str:
    from stiffscope.report.html import stiffness_html

    return stiffness_html(state)


def deformed(experiment: Experiment) -> Picture:
    """Draw a part under each of its six unit wrenches.

    Raises
    ------
    PictureError
        This machine cannot draw; the message names what is missing.

    """
    with scratch_folder() as folder:
        held = folder / "experiment.npz"
        experiment.save(held)
        title, sheet = experiment.part, "loads.png"
        draw("part_pictures", folder, experiment=held, title=title, clamped=[], loaded=[], sheet=sheet)
        return Picture((folder / sheet).read_bytes())


def stiffness_map(
    mechanism: Mechanism,
    ranges: Mapping[str, tuple[float, float]],
    points: int = 61,
    at: Sequence[float] | None = None,
) -> Picture:
    """Draw the stiffness (diagonal of K) over two coordinates of the tool, without gravity.

    Parameters
    ----------
    mechanism
        Any mechanism.
    ranges
        Two coordinates of its tool pose and the ends of each, m and rad: ``{"x": (-0.1, 0.1), "z": (0.3, 0.5)}``, or
        ``robot.map.ranges()`` of a robot file.
    points
        Poses along either.
    at : (k,)
        Pose that gives the other coordinates, by default home.

    Raises
    ------
    InputError
        Not two coordinates of the tool, or no pose is within reach.

    """
    from stiffscope.report import maps

    found = maps.stiffness_map(mechanism, ranges, points, at=at)
    with scratch_folder() as folder:
        target = folder / "map.png"
        held = maps.held_text(found)
        maps.draw_stiffness(found, {}, "stiffness at M (diagonal of K)" + (held and f", {held}"), target)
        return Picture(target.read_bytes())

"""Fixed cameras with parallel projection, and their screenshots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pyvista as pv

if TYPE_CHECKING:
    from stiffscope.runtime.types import Array


DOWN_Z = (0.0, 0.0, -1.0)  # up if z points down, as in the parts


@dataclass(frozen=True)
class View:
    """A fixed camera: direction towards it, focus, half the height of its view."""

    towards: tuple[float, float, float]
    focus: Array
    half_height: float
    size: tuple[int, int]
    up: tuple[float, float, float] = DOWN_Z

    @property
    def direction(self) -> Array:
        """Unit vector towards the camera."""
        return np.array(self.towards) / np.linalg.norm(self.towards)

    @property
    def lift(self) -> Array:
        """Offset of lines in front of their surface, invisible in parallel projection."""
        return 4e-3 * self.half_height * self.direction

    def pixel(self, point: Array) -> tuple[float, float]:
        """Return the position of a point (3,) in pixels from the left and from the bottom."""
        right = np.cross(-self.direction, self.up)
        right /= np.linalg.norm(right)
        across, above = np.array([right, np.cross(right, -self.direction)]) @ (
            point - self.focus
        )
        width, height = self.size
        scale = height / (2 * self.half_height)
        return width / 2 + scale * across, height / 2 + scale * above


def view_of(
    points: Array,
    towards: tuple[float, float, float],
    width: int,
    up: tuple[float, float, float] = DOWN_Z,
) -> View:
    """Return a camera that fits all points; the aspect ratio of the picture follows them.

    Parameters
    ----------
    points
        Points to show (n, 3), m.
    towards, up
        Direction towards the camera, and upward direction in the picture.
    width
        Width of the picture (pixels).
    """
    direction = np.array(towards) / np.linalg.norm(towards)
    right = np.cross(-direction, up)
    right /= np.linalg.norm(right)
    plane = np.array([right, np.cross(right, -direction)])
    flat = points @ plane.T
    low = flat.min(axis=0)
    high = flat.max(axis=0)
    extent = 1.06 * (high - low)
    height = int(np.clip(width * extent[1] / extent[0], 0.34 * width, 0.8 * width))
    half_height = max(extent[1], extent[0] * height / width) / 2
    focus = (low + high) / 2 @ plane + float((points @ direction).mean()) * direction
    return View(towards, focus, half_height, (width, height), up)


def new_plotter(view: View) -> pv.Plotter:
    """Return a plotter with a white background and this camera."""
    plotter = pv.Plotter(
        off_screen=True, window_size=list(view.size), lighting="light kit"
    )
    plotter.set_background("white")  # type: ignore[call-arg, arg-type]
    plotter.enable_anti_aliasing("ssaa")
    plotter.enable_parallel_projection()  # type: ignore[call-arg]
    plotter.camera.focal_point = view.focus
    plotter.camera.position = view.focus + 20.0 * view.half_height * view.direction
    plotter.camera.up = view.up
    plotter.camera.parallel_scale = view.half_height
    plotter.camera.clipping_range = (0.1 * view.half_height, 40.0 * view.half_height)
    return plotter


def shot(plotter: pv.Plotter) -> Array:
    """Return the picture (height, width, 3) and close the plotter."""
    try:
        return snap(plotter)
    finally:
        plotter.close()


def snap(plotter: pv.Plotter) -> Array:
    """Return the picture (height, width, 3) of a plotter that stays open."""
    plotter.render()  # what changed since the last picture; before the first, nothing
    image = plotter.screenshot(return_img=True)
    if image is None:
        raise RuntimeError("the OpenGL window gave no picture")
    return image

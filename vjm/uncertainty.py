"""What the error bars of component matrices make of the robot's stiffness."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.analysis import stiffness
from stiffscope.vjm.biglide import LINKS, SIDES
from stiffscope.vjm.checks import checked_poses
from stiffscope.vjm.response import respond

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from stiffscope.vjm.biglide import Biglide
    from stiffscope.vjm.screws import Array


def stiffness_error(robot: Biglide, poses: ArrayLike, link: Array, slider: Array) -> Array:
    """Bound (n, 6, 6) on the error of the stiffness at M from bounds (6, 6) on those of link and slider compliances.

    To first order ``δK = -Σ (A K)ᵀ δC (A K)`` with A the wrench on a component under unit wrenches at M. All links are
    one part, and both sliders, so their errors act together: absolute values add.
    """
    points = checked_poses(poses)
    matrix = stiffness(robot, points)
    bars = {f"limb{i}.slider": slider for i in SIDES}  # half a turn changes signs alone
    bars |= {f"limb{i}.link{j}": link for i in SIDES for j in LINKS}
    elements = respond(robot.tree(points), matrix).elements
    error = np.zeros_like(matrix)
    for name, bar in bars.items():
        carried = np.abs(elements[name].wrench)
        error = error + np.swapaxes(carried, -1, -2) @ bar @ carried
    return error


def deflection_error(stiffness: Array, error: Array, twist: Array) -> Array:
    """Bound (n, 6) on twists (n, 6) in m, rad from the bounds (n, 6, 6) on stiffnesses (n, 6, 6): |K⁻¹| |δK| |t|."""
    return (np.abs(np.linalg.inv(stiffness)) @ np.abs(error) @ np.abs(twist)[..., None])[..., 0]

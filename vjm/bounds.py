"""What no machine of this mechanism can exceed: more compliance only lowers these."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.analysis import stiffness

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from stiffscope.vjm.biglide import Biglide
    from stiffscope.vjm.screws import Array

_NEAR_SINGULAR = 1e-6  # rad; links along the rail or across it


def stiffness_bounds(robot: Biglide, q: ArrayLike) -> Array:
    """Upper bounds (n, 6) on the diagonal of the stiffness at M for link angles q (n,) in rad; SI.

    Only what every path must cross yields: drives along x and y, links along their axis and sideways. K_ry has that of
    the same robot with rigid sliders; K_rx and K_rz have the bound of their sum, see ``rotational_bound``.
    """
    q = np.atleast_1d(np.asarray(q, dtype=float))
    link, drive = robot.link, robot.drive
    axial = 3.0 / link[0, 0]
    sideways = 1.0 / (link[1, 1] - link[1, 5] ** 2 / link[5, 5])  # 12 E I / L³: the end held against rotation
    bounds = np.empty((len(q), 6))
    bounds[:, 0] = 2.0 * drive
    bounds[:, 1] = 1.0 / (1.0 / (6.0 * sideways) + 1.0 / drive)
    bounds[:, 2] = 2.0 * np.sin(q) ** 2 / (1.0 / axial + np.cos(q) ** 2 / drive)
    bounds[:, 4] = _with_rigid_sliders(robot, q)[:, 4, 4]
    bounds[:, [3, 5]] = rotational_bound(robot)
    return bounds


def rotational_bound(robot: Biglide, steps: int = 200) -> float:
    """Upper bound in N·m/rad on ``K_rx + K_rz``: its largest value over the reachable angles with rigid sliders."""
    geometry = robot.geometry
    most, least = (min(max(a - geometry.l, 0.0) / geometry.L, 1.0) for a in (geometry.a_max, geometry.a_min))
    angles = np.arccos(np.linspace(most, least, steps)).clip(_NEAR_SINGULAR, np.pi / 2.0 - _NEAR_SINGULAR)
    matrix = _with_rigid_sliders(robot, angles)
    return float((matrix[:, 3, 3] + matrix[:, 5, 5]).max())


def _with_rigid_sliders(robot: Biglide, q: Array) -> Array:
    rigid = replace(robot, slider=np.zeros((6, 6)), edits=())
    poses = np.zeros((len(q), 3))
    poses[:, 2] = robot.geometry.l1 + robot.geometry.l2 + robot.geometry.L * np.sin(q)
    return stiffness(rigid, poses)

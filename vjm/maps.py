"""Principal stiffness and sag over the workspace, as Figs. 5 and 6 show them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.analysis import stiffness, under_weight
from stiffscope.vjm.biglide import pose_at, reachable
from stiffscope.vjm.gravity import STANDARD

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.vjm.analysis import Gravity
    from stiffscope.vjm.biglide import Biglide, Geometry
    from stiffscope.vjm.screws import Array

DIAGONAL = ("K_tx", "K_ty", "K_tz", "K_rx", "K_ry", "K_rz")
UNITS = ("N/m", "N/m", "N/m", "N·m/rad", "N·m/rad", "N·m/rad")


@dataclass(frozen=True)
class Rectangle:
    """Tool positions in the x-z plane, m."""

    x_min: float
    x_max: float
    z_min: float
    z_max: float


@dataclass(frozen=True)
class WorkspaceMap:
    """Maps over a grid of tool points at one y; NaN where the robot cannot reach or weights find no equilibrium.

    ``x`` (nx,), ``z`` (nz,) in m; ``stiffness`` and ``loaded`` (nz, nx, 6): diagonals of the stiffness at M without and
    with the robot's own weight, N/m and N·m/rad; ``sag`` (nz, nx, 6) in m, rad.
    """

    x: Array
    y: float
    z: Array
    stiffness: Array
    loaded: Array
    sag: Array
    main: Rectangle


def main_workspace(geometry: Geometry, q1: float, q2: float) -> Rectangle:
    """The main workspace W1 to W4: between the heights of Q1 and Q2, the widest rectangle about x = 0 within reach.

    Fig. 4 gives no coordinates: inferred from Q1 and Q2 halving its upper and lower edges, and from its being a
    rectangle of tool positions inside the reachable area. ``q1``, ``q2``: link angles at Q1 and Q2 in rad.
    """
    reach = geometry.L * np.cos([q1, q2]) + geometry.l
    half = float(np.minimum(reach - geometry.a_min, geometry.a_max - reach).min())
    if half <= 0.0:
        msg = f"main workspace: the drives cannot reach x = 0 between link angles of {q1:.4g} and {q2:.4g} rad"
        raise InputError(msg)
    return Rectangle(-half, half, float(pose_at(geometry, q1)[2]), float(pose_at(geometry, q2)[2]))


def reachable_box(geometry: Geometry) -> Rectangle:
    """Smallest rectangle that holds all reachable tool points of the x-z plane."""
    most = min(geometry.a_max, geometry.l + geometry.L)
    least = max(geometry.a_min, geometry.l)
    if least >= most:
        msg = (
            f"geometry: links of {geometry.L:g} m reach with drives at {geometry.l:g} to {geometry.l + geometry.L:g} m,"
            f" which their range of {geometry.a_min:g} to {geometry.a_max:g} m leaves out"
        )
        raise InputError(msg)
    top, bottom = np.arccos((np.array([most, least]) - geometry.l) / geometry.L)
    half = 0.5 * (geometry.a_max - geometry.a_min)
    return Rectangle(-half, half, float(pose_at(geometry, top)[2]), float(pose_at(geometry, bottom)[2]))


def workspace_map(
    robot: Biglide,
    q: tuple[float, float],
    *,
    size: tuple[int, int] = (121, 121),
    y: float = 0.0,
    area: Rectangle | None = None,
    gravity: Gravity = "exact",
    g: float = STANDARD,
) -> WorkspaceMap:
    """Maps of a robot over ``size`` = (nx, nz) tool points of ``area``, by default all that it reaches.

    ``q``: link angles at Q1 and Q2 in rad, which bound the main workspace. Raises InputError where nothing is in reach.
    """
    box = area or reachable_box(robot.geometry)
    x, z = np.linspace(box.x_min, box.x_max, size[0]), np.linspace(box.z_min, box.z_max, size[1])
    grid = np.stack([*np.meshgrid(x, y, z, indexing="ij")], axis=-1)[:, 0].transpose(1, 0, 2)
    inside = reachable(robot.geometry, grid.reshape(-1, 3)).reshape(grid.shape[:2])
    if not inside.any():
        msg = f"map: no reachable tool point in x [{x[0]:.4g}, {x[-1]:.4g}] m, z [{z[0]:.4g}, {z[-1]:.4g}] m"
        raise InputError(msg)
    points = grid[inside]
    plain = loaded = stiffness(robot, points)
    droop = np.zeros((len(points), 6))
    if gravity != "none":
        loaded, droop = under_weight(robot, points, plain, gravity=gravity, g=g)
    q1, q2 = q
    return WorkspaceMap(
        x,
        y,
        z,
        _spread(inside, np.diagonal(plain, axis1=1, axis2=2)),
        _spread(inside, np.diagonal(loaded, axis1=1, axis2=2)),
        _spread(inside, droop),
        main_workspace(robot.geometry, q1, q2),
    )


def _spread(inside: NDArray[np.bool_], values: Array) -> Array:
    out = np.full((*inside.shape, 6), np.nan)
    out[inside] = values
    return out

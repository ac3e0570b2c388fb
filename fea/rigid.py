"""Rigid motions of points and interfaces: small twists (v, ω) about a reference point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats


def rigid_modes(points: Floats, reference: Floats) -> Floats:
    """Return displacements (n, 3, 6) of points per unit twist component at the reference point."""
    r = points - reference
    modes = np.zeros((len(points), 3, 6))
    modes[:, :, :3] = np.eye(3)
    modes[:, 0, 4] = r[:, 2]
    modes[:, 0, 5] = -r[:, 1]
    modes[:, 1, 5] = r[:, 0]
    modes[:, 1, 3] = -r[:, 2]
    modes[:, 2, 3] = r[:, 1]
    modes[:, 2, 4] = -r[:, 0]
    return modes


def rigid_twists(points: Floats, origin: Floats) -> Floats:
    """Return the twists (6n, 6) of n body points (n, 3) for unit twists at the origin (3,)."""
    twists = np.zeros((len(points), 6, 6))
    twists[:, :3], twists[:, 3:, 3:] = rigid_modes(points, origin), np.eye(3)
    return twists.reshape(-1, 6)


def relative_twists(points: Floats, origin: Floats) -> Floats:
    """Return twists (6n, 6(1+n)) of points relative to a body at the origin, per twist of all."""
    return np.hstack([-rigid_twists(points, origin), np.eye(6 * len(points))])

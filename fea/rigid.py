"""Rigid motions of points and interfaces: small twists (v, ω) about a reference point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats


def rigid_modes(points: Floats, reference: Floats) -> Floats:
    """Return (n, 3, 6) the displacement of each point for each unit twist component at the reference point."""
    r = points - reference
    modes = np.zeros((len(points), 3, 6))
    modes[:, :, :3] = np.eye(3)
    modes[:, 0, 4], modes[:, 0, 5] = r[:, 2], -r[:, 1]
    modes[:, 1, 5], modes[:, 1, 3] = r[:, 0], -r[:, 2]
    modes[:, 2, 3], modes[:, 2, 4] = r[:, 1], -r[:, 0]
    return modes


def rigid_twists(points: Floats, origin: Floats) -> Floats:
    """Return (6n, 6) the twists at n points (n, 3) of a rigid body for its unit twists at the origin (3,)."""
    twists = np.zeros((len(points), 6, 6))
    twists[:, :3], twists[:, 3:, 3:] = rigid_modes(points, origin), np.eye(3)
    return twists.reshape(-1, 6)


def relative_twists(points: Floats, origin: Floats) -> Floats:
    """Return (6n, 6(1+n)) the twists at n points (n, 3), seen from a body at the origin (3,), for its and their own."""
    return np.hstack([-rigid_twists(points, origin), np.eye(6 * len(points))])

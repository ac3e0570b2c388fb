"""Semi-discretization of milling with one mode along the feed, written from the reference alone.

T. Insperger, G. Stépán, Updated semi-discretization method for periodic delay-differential equations
with discrete delay, Int. J. Numer. Meth. Engng 61, 2004, 117-141. The delay is the period. Nothing of
the package is used.
"""

import numpy as np
from scipy.linalg import expm


def largest_multiplier(
    frequency,
    damping,
    mass,
    *,
    teeth,
    start,
    end,
    tangential,
    normal,
    speed,
    depth,
    steps=500,
):
    """Return the largest modulus of the multipliers over one tooth period.

    Parameters
    ----------
    frequency, damping, mass
        Mode: Hz, ratio, kg.
    teeth, start, end
        Teeth, and angles of entry and exit, rad, from the normal of the feed.
    tangential, normal
        Cutting coefficients, N/m².
    speed, depth
        Spindle speed, rev/s, and depth of cut, m.
    steps
        Of the tooth period.
    """
    rate = 2.0 * np.pi * frequency
    period = 1.0 / (teeth * speed)
    step = period / steps
    size = 2 + steps
    whole = np.eye(size)
    for k in range(steps):
        # mean of the directional factor over the step
        factor = 0.0
        fine = (k + (np.arange(40) + 0.5) / 40.0) * step
        for tooth in range(teeth):
            angle = np.mod(2.0 * np.pi * (speed * fine + tooth / teeth), 2.0 * np.pi)
            inside = (angle > start) & (angle < end)
            part = np.sin(angle) * (tangential * np.cos(angle) + normal * np.sin(angle))
            factor += np.where(inside, part, 0.0).mean()
        force = depth * factor / mass
        system = np.array([[0.0, 1.0], [-(rate**2) - force, -2.0 * damping * rate]])
        move = expm(system * step)
        drive = (move - np.eye(2)) @ np.linalg.solve(system, np.array([0.0, force]))
        delayed = 0.5 * (whole[-1] + whole[-2])
        now = move @ whole[:2] + np.outer(drive, delayed)
        whole = np.concatenate([now, whole[:1], whole[2:-1]])
    return np.abs(np.linalg.eigvals(whole)).max()

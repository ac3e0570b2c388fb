"""A second robot in twenty lines: the Gough-Stewart platform of cubic architecture.

Six struts of axial stiffness k, each between a universal and a spherical joint, along edges of a cube whose diagonal
is vertical. At the cube's centre the stiffness is diag(2k, 2k, 2k, 1.5kH², 1.5kH², 6kH²) with H the height of a strut,
which is the cube's edge over √3 (tdehaeze, stewart-simscape, where H is called the cube's size).
"""

import numpy as np

from stiffscope.vjm.elastic import HERE, Parallel, Passive, Series, drive, spherical
from stiffscope.vjm.reduction import as_stiffness
from stiffscope.vjm.screws import Frame


def strut(name, base, tip, stiffness):
    """A strut from ``base`` to ``tip`` (3,): universal joint, axial spring, spherical joint; axes with x along it."""
    x = (tip - base) / np.linalg.norm(tip - base)
    y = np.linalg.svd(x[None])[2][1]
    frame = Frame(np.column_stack([x, y, np.cross(x, y)]), tip)
    root = Frame(translation=np.array([-np.linalg.norm(tip - base), 0.0, 0.0]))
    universal = Passive(f"{name}.universal", np.eye(6)[:, 4:], root)
    return Series(name, (universal, drive(f"{name}.axial", stiffness, np.eye(6)[0]), spherical(f"{name}.ball")), frame)


def cubic_platform(size, stiffness, height=0.0):
    """The platform seen from a point at ``height`` in m above the cube's centre; its struts are ``size`` in m high."""
    corners = np.sqrt(3.0) * size * (np.array([[0, 0, 1], [0, 1, 1], [0, 1, 0], [1, 1, 0], [1, 0, 0], [1, 0, 1]]) - 0.5)
    x, y = np.array([1, -1, 0]) / np.sqrt(2), np.array([1, 1, -2]) / np.sqrt(6)
    upright = np.stack([x, y, np.cross(x, y)])  # the cube's diagonal along z
    points = corners @ upright.T
    down = [(0, 1), (2, 1), (2, 3), (4, 3), (4, 5), (0, 5)]  # edges that join the lower three corners to the upper
    struts = []
    for k, (a, b) in enumerate(down):
        base, tip = sorted((points[a], points[b]), key=lambda p: p[2])
        struts.append(strut(f"strut{k + 1}", base, tip, stiffness))
    return Parallel("platform", tuple(struts), HERE if not height else Frame(translation=np.array([0, 0, -height])))


if __name__ == "__main__":
    np.set_printoptions(precision=6, suppress=True)
    k, size = 1e6, 0.2
    stiffness = as_stiffness(cubic_platform(size, k))
    closed = np.diag([2 * k] * 3 + [1.5 * k * size**2] * 2 + [6 * k * size**2])
    print(f"Cubic Gough-Stewart platform, struts of {k:g} N/m, {size} m high: stiffness at its centre, N/m, N·m/rad")
    print(np.round(stiffness, 6) + 0.0)
    print("Closed form")
    print(closed)
    print(f"Largest difference {np.abs(stiffness - closed).max() / k:.0e} of a strut's stiffness")

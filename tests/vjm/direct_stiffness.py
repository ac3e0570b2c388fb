"""The Biglide by direct stiffness: 33 explicit freedoms, every element's strain energy, then static condensation."""

import numpy as np


def skew(r):
    return np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])


def carry(r):
    """Twist of a rigid body from one point to another at r from it."""
    out = np.eye(6)
    out[:3, 3:] = -skew(r)
    return out


def biglide(geometry, link, slider, drive, pose):
    """Stiffness (6, 6) at M. Freedoms: stage, two drives, A_1, A_2 (6 each), 12 revolutes, platform (6)."""
    g = geometry
    n = 33
    x, y, z = np.eye(3)
    s = (pose[2] - g.l1 - g.l2) / g.L
    q = np.arcsin(s)
    k = np.zeros((n, n))
    for freedom in range(3):
        k[freedom, freedom] = drive
    platform = np.eye(n)[27:]
    turn = np.diag([-1.0, -1.0, 1.0, -1.0, -1.0, 1.0])
    for i, side in ((0, 1.0), (1, -1.0)):
        carriage = np.zeros((6, n))
        carriage[1, 0] = 1.0
        carriage[0, 1 + i] = 1.0
        end = np.eye(n)[3 + 6 * i : 9 + 6 * i]
        stretch = end - carriage
        k += (
            stretch.T
            @ np.linalg.inv(slider if i == 0 else turn @ slider @ turn)
            @ stretch
        )
        along = np.array([side * np.cos(q), 0, s])
        axes = np.column_stack([along, y, np.cross(along, y)])
        a_i = -side * g.l * x - g.l2 * z - g.L * along
        for j, foot in enumerate(
            [-side * g.h * x, side * g.h * x + g.d * y, side * g.h * x - g.d * y]
        ):
            b_ij = -side * g.l * x - g.l2 * z + foot
            hinge_a = np.zeros((6, n))
            hinge_b = np.zeros((6, n))
            hinge_a[4, 15 + 6 * i + 2 * j] = hinge_b[4, 16 + 6 * i + 2 * j] = 1.0
            at_a = carry(foot) @ end + hinge_a
            at_b = carry(b_ij) @ platform + hinge_b
            assert np.allclose(a_i + foot, b_ij - g.L * along)
            stretch = np.kron(np.eye(2), axes.T) @ (at_b - carry(g.L * along) @ at_a)
            k += stretch.T @ np.linalg.inv(link) @ stretch
    inner = slice(0, 27)
    tool = slice(27, n)
    return k[tool, tool] - k[tool, inner] @ np.linalg.solve(
        k[inner, inner], k[inner, tool]
    )

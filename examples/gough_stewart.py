"""A robot in Python: the Gough-Stewart platform of cubic architecture.

Six struts of axial stiffness k, each between a universal and a spherical joint, lie along edges of
a cube with vertical diagonal. At its centre the stiffness is diag(2k, 2k, 2k, 1.5kH², 1.5kH², 6kH²)
with H the height of a strut, the cube's edge over √3 (tdehaeze, stewart-simscape: the cube's size).
"""

import numpy as np

import stiffscope as ss


def cubic_platform(size, stiffness, height=0.0):
    """Return the platform with struts of height ``size``, M at ``height`` above the centre, m."""
    corners = (
        np.sqrt(3.0)
        * size
        * (
            np.array([[0, 0, 1], [0, 1, 1], [0, 1, 0], [1, 1, 0], [1, 0, 0], [1, 0, 1]])
            - 0.5
        )
    )
    x = np.array([1, -1, 0]) / np.sqrt(2)
    y = np.array([1, 1, -2]) / np.sqrt(6)
    points = corners @ np.stack([x, y, np.cross(x, y)]).T  # the cube's diagonal along z
    bodies = [ss.Body("platform")]
    joints = []
    for k, edge in enumerate([(0, 1), (2, 1), (2, 3), (4, 3), (4, 5), (0, 5)], start=1):
        base, tip = sorted(points[list(edge)], key=lambda point: point[2])
        across = np.linalg.svd((tip - base)[None])[2][1:]
        rod = f"strut{k}.rod"
        sleeve = f"strut{k}.sleeve"
        bodies += [ss.Body(rod), ss.Body(sleeve)]
        joints += [
            ss.Joint(
                f"strut{k}.universal", "ground", sleeve, "universal", base, *across
            ),
            ss.Joint(
                f"strut{k}.drive",
                sleeve,
                rod,
                "prismatic",
                base,
                tip - base,
                drive=ss.Drive(stiffness),
            ),
            ss.Joint(f"strut{k}.ball", rod, "platform", "spherical", tip),
        ]
    tool = ss.Tool(
        "platform", np.array([0.0, 0.0, height]), ("x", "y", "z", "rx", "ry", "rz")
    )
    return ss.Mechanism(bodies, joints, tool)


if __name__ == "__main__":
    np.set_printoptions(precision=6, suppress=True)
    k = 1e6
    size = 0.2
    robot = cubic_platform(size, k)
    stiffness = ss.stiffness(robot, robot.tool.home)[0]
    closed = np.diag([2 * k] * 3 + [1.5 * k * size**2] * 2 + [6 * k * size**2])
    print(
        f"Cubic Gough-Stewart platform, struts of {k:g} N/m, {size} m high: stiffness at its centre, N/m, N·m/rad"
    )
    print(np.round(stiffness, 6) + 0.0)
    print("Closed form")
    print(closed)
    print(
        f"Largest difference {np.abs(stiffness - closed).max() / k:.0e} of a strut's stiffness"
    )

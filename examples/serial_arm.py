"""A robot in Python, in ten lines: a planar arm of two rigid links with rotary drives.

Its compliance in the plane is J diag(1/k) Jᵀ (Salisbury, 1980) with the Jacobian J of the tool with
respect to the drives' angles; at home, links at right angles, J = [[-l₂, -l₂], [l₁, 0]].
"""

import numpy as np

import stiffscope as ss


def planar_arm(l1, l2, k1, k2):
    """Return links ``l1`` along x, then ``l2`` along y, m, with drives ``k1``, ``k2``, N·m/rad."""
    elbow = np.array([l1, 0.0, 0.0])
    z = np.array([0.0, 0.0, 1.0])
    joints = [
        ss.Joint(
            "shoulder",
            "ground",
            "upper",
            "revolute",
            np.zeros(3),
            z,
            drive=ss.Drive(k1),
        ),
        ss.Joint("elbow", "upper", "fore", "revolute", elbow, z, drive=ss.Drive(k2)),
    ]
    return ss.Mechanism(
        [ss.Body("upper"), ss.Body("fore")],
        joints,
        ss.Tool("fore", np.array([l1, l2, 0]), ("x", "y")),
    )


if __name__ == "__main__":
    robot = planar_arm(0.4, 0.3, 2e4, 1e4)
    load = [100.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    jacobian = np.array([[-0.3, -0.3], [0.4, 0.0]])
    closed = jacobian @ np.diag([1 / 2e4, 1 / 1e4]) @ jacobian.T @ load[:2]
    twist = ss.deflection(robot, robot.tool.home, load).twist[0]
    print(
        f"Planar arm under 100 N: moves {1e6 * twist[:2]} µm; J C Jᵀ f gives {1e6 * closed} µm"
    )

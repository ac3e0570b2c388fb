"""A robot in Python: a Delta with three rotary arms, two rods with ball joints on each; z down.

With rigid arms, only drives and rods are elastic. At a centred pose all three legs are equal, and
the vertical stiffness follows from virtual work: 1/K_zz = 1/(6 k s²) + 1/(3 D (∂θ/∂z)²) with the
rods' axial stiffness k, the cosine s of a rod to the vertical, drive stiffness D and arm angle θ.
"""

import numpy as np

import stiffscope as ss
from stiffscope.vjm.model.screws import rotation

BASE = 0.2
PLATFORM = 0.05
ARM = 0.25
ROD = 0.55
SPACING = 0.08
DRIVE = 2e4
AXIAL = 5e-9  # m, N·m/rad, m/N


def delta(arm=None, angle=0.35):
    """Return a desk-sized Delta at home, arms at an angle in rad below the horizontal.

    ``arm`` (6, 6): compliance of an arm at its elbow, axes along and across it; None if rigid.
    """
    rod = np.diag([AXIAL, 1e-6, 1e-6, 1e-4, 1e-4, 1e-4])
    bodies = [ss.Body("platform")]
    joints = []
    out = BASE + ARM * np.cos(angle)
    drop = ARM * np.sin(angle)  # of an elbow
    height = drop + np.sqrt(ROD**2 - (out - PLATFORM) ** 2)
    for k in range(3):
        turn = rotation([0.0, 0.0, 1.0], 2.0 * np.pi * k / 3.0)
        shoulder = turn @ [BASE, 0.0, 0.0]
        elbow = turn @ [out, 0.0, drop]
        compliance = np.zeros((6, 6)) if arm is None else arm
        bodies.append(
            ss.member(f"leg{k}.arm", shoulder, elbow, compliance, y=turn[:, 1])
        )
        motor = ss.Drive(DRIVE)
        joints.append(
            ss.Joint(
                f"leg{k}.motor",
                "ground",
                f"leg{k}.arm.base",
                "revolute",
                shoulder,
                turn[:, 1],
                drive=motor,
            )
        )
        for j, side in enumerate((-0.5 * SPACING, 0.5 * SPACING)):
            name = f"leg{k}.rod{j}"
            top = turn @ [out, side, drop]
            low = turn @ [PLATFORM, side, height]
            bodies.append(ss.member(name, top, low, rod, y=turn[:, 1]))
            joints.append(
                ss.Joint(
                    f"{name}.top", f"leg{k}.arm.tip", f"{name}.base", "spherical", top
                )
            )
            joints.append(
                ss.Joint(f"{name}.end", f"{name}.tip", "platform", "spherical", low)
            )
    tool = ss.Tool("platform", np.array([0.0, 0.0, height]), ("x", "y", "z"))
    return ss.Mechanism(bodies, joints, tool, np.array([0.0, 0.0, 9.81]))


def vertical_stiffness(angle=0.35):
    """Return K_zz in N/m with rigid arms by virtual work, and the platform's height in m."""
    run = BASE + ARM * np.cos(angle) - PLATFORM
    drop = ARM * np.sin(angle)
    fall = np.sqrt(ROD**2 - run**2)
    rate = fall / (ARM * (np.cos(angle) * fall + np.sin(angle) * run))  # ∂θ/∂z
    return 1.0 / (
        AXIAL / (6.0 * (fall / ROD) ** 2) + 1.0 / (3.0 * DRIVE * rate**2)
    ), drop + fall


if __name__ == "__main__":
    robot = delta()
    matrix = ss.stiffness(robot, robot.tool.home)[0]
    closed, height = vertical_stiffness()
    print(
        f"Delta, z = {height:.4f} m: K_zz {matrix[2, 2]:.6g} N/m, by virtual work {closed:.6g} N/m"
    )
    arms = delta(np.diag([1e-9, 5e-7, 5e-7, 2e-5, 2e-5, 2e-5]))
    away = np.add(arms.tool.home, [0.1, 0.05, -0.05])
    print("With elastic arms, at home and away from it, diagonal of K (N/m, N·m/rad):")
    print(
        np.array2string(
            np.diagonal(
                ss.analyse(arms, [arms.tool.home, away]).matrix, axis1=1, axis2=2
            ),
            precision=4,
        )
    )

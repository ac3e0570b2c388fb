"""A Delta robot: three arms on revolute drives, each with a parallelogram of two ball-jointed rods.

Poses are the platform's positions (n, 3) in m, z down; the tree is the same algebra as the Biglide's.
"""

from dataclasses import dataclass, replace

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.analysis import analyse
from stiffscope.vjm.checks import checked_poses
from stiffscope.vjm.elastic import Parallel, Series, Spring, drive, spherical
from stiffscope.vjm.screws import Frame, rotation

Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Delta:
    """Radii of base and platform, lengths of arm and rod, rod spacing in m; drive in N·m/rad; (6, 6) compliances."""

    base: float
    platform: float
    arm: float
    rod: float
    spacing: float
    drive: float
    arm_compliance: np.ndarray  # at the elbow, axes along and across the arm
    rod_compliance: np.ndarray  # at the lower ball, axes along and across the rod

    def tree(self, poses):
        """The robot seen from its platform's centre; InputError where an arm cannot reach."""
        points = checked_poses(poses)
        return Parallel("delta", tuple(self._leg(k, points) for k in range(3)))

    def stance(self, poses):
        """All of the pose matters."""
        return checked_poses(poses)

    def _leg(self, k, points):
        turn = rotation(Z, 2.0 * np.pi * k / 3.0)
        out, side = turn[:, 0], turn[:, 1]
        shoulder = self.base * out - points
        wrist = self.platform * out
        elbow = self._elbow(shoulder, wrist, out)
        axes = frame_along(elbow - shoulder, side)
        about = np.concatenate([np.zeros(3), side])
        motor = replace(drive(f"leg{k}.drive", self.drive, about), frame=Frame(translation=shoulder))
        arm = Spring(f"leg{k}.arm", self.arm_compliance, Frame(axes, elbow))
        rods = []
        for j, sign in enumerate((-0.5, 0.5)):
            lower, top = wrist + sign * self.spacing * side, elbow + sign * self.spacing * side
            along = frame_along(lower - top, side)
            rods.append(
                Series(
                    f"leg{k}.rod{j}.chain",
                    (
                        spherical(f"leg{k}.rod{j}.upper", Frame(translation=np.array([-self.rod, 0.0, 0.0]))),
                        Spring(f"leg{k}.rod{j}", self.rod_compliance),
                        spherical(f"leg{k}.rod{j}.lower"),
                    ),
                    Frame(along, lower),
                )
            )
        return Series(f"leg{k}", (motor, arm, Parallel(f"leg{k}.rods", tuple(rods))))

    def _elbow(self, shoulder, wrist, out):
        """Outer intersection of the arm's circle, in the plane of ``out`` and z, with the rod's sphere."""
        to = wrist - shoulder
        r, z = to @ out, to[:, 2]
        across2 = np.sum(to**2, axis=1) - r**2 - z**2
        reach = (self.arm**2 + r**2 + z**2 + across2 - self.rod**2) / 2.0
        size = np.hypot(r, z)
        if not (np.abs(reach) < self.arm * size).all():
            message = "delta: the platform is out of reach of an arm"
            raise InputError(message)
        angle = np.arctan2(z, r) - np.arccos(reach / (self.arm * size))
        return shoulder + self.arm * (np.cos(angle)[:, None] * out + np.sin(angle)[:, None] * Z)


def frame_along(direction, side):
    """Axes (..., 3, 3) with x along ``direction`` (..., 3) and y as near to ``side`` as can be."""
    x = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    z = np.cross(x, side)
    z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def example():
    """A desk-sized Delta with carbon arms and rods."""
    arm = np.diag([1e-9, 5e-7, 5e-7, 2e-5, 2e-5, 2e-5])
    rod = np.diag([5e-9, 1e-6, 1e-6, 1e-4, 1e-4, 1e-4])
    return Delta(0.2, 0.05, 0.25, 0.55, 0.08, 2e4, arm, rod)


if __name__ == "__main__":
    print(np.array2string(analyse(example(), [[0.0, 0.0, 0.55], [0.1, 0.05, 0.5]]).matrix, precision=3))

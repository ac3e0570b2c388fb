"""Published arms: robot files from Denavit-Hartenberg rows, campaigns from tracked positions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import tomlkit

from stiffscope.gap.campaign.writing import number_cells, write_campaign

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Row = tuple[float, float, float, float]


def transform(row: Row, angle: float = 0.0) -> Array:
    """Return the matrix (4, 4) of a standard row (a, d, α, θ₀) at a joint angle, rad."""
    a, d, alpha, start = row
    c = np.cos(start + angle)
    s = np.sin(start + angle)
    ca = np.cos(alpha)
    sa = np.sin(alpha)
    return np.array(
        [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0, sa, ca, d],
            [0, 0, 0, 1.0],
        ]
    )


@dataclass(frozen=True)
class Arm:
    """An arm of n revolute joints; SI, base axes {O} with z up."""

    name: str
    base: Row
    """Fixed row before the first joint."""
    rows: tuple[Row, ...]
    """Row (a, d, α, θ₀) after each joint, which rotates about z of the frame before its row."""
    target: Row
    """Row from the last frame to the measured target."""
    masses: tuple[float, ...]
    drives: tuple[float, ...]
    """Stiffness of the drives, N·m/rad."""
    source: str = ""
    """Source of the data."""
    gravity: tuple[float, float, float] = field(default=(0.0, 0.0, -1.0))

    def frames(self, angles: Array) -> Array:
        """Return frames (n + 1, 4, 4) before each joint and after the last, at angles (n,)."""
        out = [transform(self.base)]
        for row, angle in zip(self.rows, angles, strict=True):
            out.append(out[-1] @ transform(row, angle))
        return np.array(out)

    def target_at(self, angles: Array) -> Array:
        """Return the position (3,) of the target at joint angles (n,)."""
        return (self.frames(angles)[-1] @ transform(self.target))[:3, 3]


def write_robot(arm: Arm, home: Array, path: Path) -> None:
    """Write an arm as a robot file.

    Parameters
    ----------
    arm
        Nominal geometry, masses and drives.
    home
        Joint angles (n,) of the home configuration, rad, away from a straight wrist.
    path
        Robot file to write.

    """
    frames = arm.frames(home)
    points = [[round(float(v), 9) for v in frame[:3, 3]] for frame in frames]
    data: dict[str, Any] = {"name": arm.name, "bodies": {}, "joints": {}}
    for k, (mass, drive) in enumerate(zip(arm.masses, arm.drives, strict=True)):
        centre = np.mean([points[k], points[k + 1]], axis=0).round(6).tolist()
        data["bodies"][f"link{k + 1}"] = {"mass": mass, "centre": centre}
        data["joints"][f"J{k + 1}"] = {
            "between": [f"link{k}" if k else "ground", f"link{k + 1}"],
            "type": "revolute",
            "at": points[k],
            "axis": [round(float(v), 12) for v in frames[k][:3, 2]],
            "drive": {"stiffness": drive},
        }
    data["tool"] = {
        "body": f"link{len(arm.rows)}",
        "at": points[-1],
        "pose": ["x", "y", "z", "rx", "ry", "rz"],
    }
    data["gravity"] = {"acceleration": 9.81, "direction": list(arm.gravity)}
    head = "".join(f"# {line}\n" for line in arm.source.splitlines())
    path.write_text(head + tomlkit.dumps(data), encoding="utf-8")


def write_positions(
    arm: Arm,
    folder: Path,
    home: Array,
    angles: Array,
    positions: Array,
    *,
    sigma: float,
    at_sigma: float,
) -> None:
    """Write tracked positions as a campaign with its robot file.

    Parameters
    ----------
    arm
        Nominal arm.
    folder
        Folder to write to; created if absent.
    home
        Joint angles (n,) of the home configuration, rad.
    angles
        Joint angles (p, n) of each posture, rad.
    positions
        Positions (p, 3) of the target in axes of the instrument, which may stand anywhere, m.
    sigma
        Standard uncertainty of a coordinate, m; a larger value leaves more unexplained.
    at_sigma
        Standard uncertainty of the target's place on the arm, m; a larger value frees the fit.

    """
    folder.mkdir(parents=True, exist_ok=True)
    write_robot(arm, home, folder / "robot.toml")
    target = {
        "measures": "position",
        "frame": "tracker",
        "body": f"link{len(arm.rows)}",
        "at": arm.target_at(home).round(9).tolist(),
        "at_sigma": at_sigma,
    }
    header = {
        "robot": "robot.toml",
        "modelled": ["gravity"],
        "frames": {"tracker": {"pose": "unknown"}},
        "sensors": {"target": target},
    }
    each = np.repeat(angles - home, 3, axis=0)
    columns = {f"q:J{k + 1}": number_cells(each[:, k]) for k in range(each.shape[1])}
    columns["sensor"] = [f"target.{axis}" for _ in positions for axis in "xyz"]
    columns |= {
        "value": number_cells(positions.ravel()),
        "sigma": number_cells([sigma] * positions.size),
    }
    write_campaign(folder, header, columns, comment=arm.source)


def split_postures(count: int, every: int = 5) -> tuple[Sequence[int], Sequence[int]]:
    """Return the postures to fit, and every ``every``-th one as held out."""
    numbers = range(count)
    return [k for k in numbers if k % every != every - 1], [
        k for k in numbers if k % every == every - 1
    ]

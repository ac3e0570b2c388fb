"""Free motions of a process: rotation about the tool's axis, turntable or slide."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from stiffscope.runtime.types import Array


@dataclass(frozen=True)
class Motion:
    """A free coordinate, rad or m.

    Attributes
    ----------
    axis
        Axis in base axes, for a spindle at home.
    at
        Point of a turntable's axis, m.
    ends
        Smallest and largest value.
    rate
        Largest change per metre of path.
    """

    name: Literal["spindle", "table", "slide"]
    axis: tuple[float, ...]
    at: tuple[float, ...]
    ends: tuple[float, float]
    rate: float

    @property
    def start(self) -> float:
        """Allowed value nearest to 0."""
        return float(np.clip(0.0, *self.ends))

    def grid(self, turns: int) -> Array:
        """Return values over the range: ``turns`` per full turn, or for a slide in total."""
        low, high = self.ends
        share = 1.0 if self.name == "slide" else min(1.0, (high - low) / (2.0 * np.pi))
        whole = self.name != "slide" and high - low >= 2.0 * np.pi - 1e-9
        return np.linspace(low, high, max(2, round(share * turns) + 1))[: -1 if whole else None]

    def place(self, tool: Array, values: Array) -> tuple[Array, Array]:
        """Return tool poses (n, 6) and workpiece rotations (n, 3, 3) for values (n,)."""
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        out, still = tool.copy(), np.broadcast_to(np.eye(3), (len(tool), 3, 3))
        if self.name == "slide":
            out[:, :3] += values[:, None] * axis
            return out, still
        turn, turned = Rotation.from_rotvec(values[:, None] * axis), Rotation.from_rotvec(tool[:, 3:])
        if self.name == "spindle":
            out[:, 3:] = (turned * turn).as_rotvec()
            return out, still
        out[:, :3] = self.at + turn.apply(tool[:, :3] - self.at)
        out[:, 3:] = (turn * turned).as_rotvec()
        return out, turn.as_matrix()

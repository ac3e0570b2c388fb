"""Motions that a process leaves free: turns about the tool's axis, a turntable or a slide under the workpiece."""

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
        In base axes; a spindle's at home.
    at
        Point of a turntable's axis, m.
    ends
        Least and greatest value.
    rate
        Most change a metre of path.
    """

    name: Literal["spindle", "table", "slide"]
    axis: tuple[float, ...]
    at: tuple[float, ...]
    ends: tuple[float, float]
    rate: float

    @property
    def start(self) -> float:
        """The value next to 0 that is allowed."""
        return float(np.clip(0.0, *self.ends))

    def grid(self, turns: int) -> Array:
        """Values over the range: a turn has ``turns``, so has a slide."""
        low, high = self.ends
        share = 1.0 if self.name == "slide" else min(1.0, (high - low) / (2.0 * np.pi))
        whole = self.name != "slide" and high - low >= 2.0 * np.pi - 1e-9
        return np.linspace(low, high, max(2, round(share * turns) + 1))[: -1 if whole else None]

    def place(self, tool: Array, values: Array) -> tuple[Array, Array]:
        """Poses (n, 6) of the tool with values (n,) of the motion, and how (n, 3, 3) it turns the workpiece."""
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

"""Description of a study: robot, variables, responses, limits and goals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import repeat
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.robot.file.override import write_override
from stiffscope.robot.reader import read_robot

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from stiffscope.design.responses import Response
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.types import Array

Value = float | str
Values = tuple[Value, ...]
Pose = str | tuple[float, ...]


@dataclass(frozen=True)
class Variable:
    """A number (SI) or word of the robot file varied by the study.

    ``levels``: the possible values, or the grid points of the range from ``low`` to ``high``.
    """

    name: str
    unit: str
    levels: tuple[Value, ...]
    low: float | None = None
    high: float | None = None

    @property
    def column(self) -> str:
        """Name, with the unit if it is a number."""
        words = any(isinstance(level, str) for level in self.levels)
        return self.name if words else f"{self.name} [{self.unit}]"

    def find_value(self, share: float) -> Value:
        """Return the value at a fraction from 0 to 1 of the range or of the values."""
        if self.low is None or self.high is None:
            return self.levels[self.find_level(share)]
        return round_off(self.low + share * (self.high - self.low))

    def find_level(self, share: float) -> int:
        """Return the index of the value at a fraction from 0 to 1 of the values."""
        return min(int(share * len(self.levels)), len(self.levels) - 1)


def round_off(value: float) -> float:
    """Round a number to twelve digits for robot files."""
    return float(f"{value:.12g}")


@dataclass(frozen=True)
class Limit:
    """A bound on a response, SI."""

    response: str
    at_most: bool
    value: float
    text: str

    def violation(self, value: Array) -> Array:
        """Return the relative violation (n,) by a response (n,); negative if the limit is met."""
        sign = 1.0 if self.at_most else -1.0
        return sign * (value - self.value) / (abs(self.value) or 1.0)


@dataclass(frozen=True)
class Goal:
    """A response to minimize (``sign`` 1) or maximize (-1)."""

    response: str
    sign: float


@dataclass(frozen=True, eq=False)
class StudyFile:
    """A checked study file; ``poses`` are those of all responses, numbers in m and rad.

    A named pose is taken from each design's robot file; numbers are the same for all designs.
    """

    path: Path
    robot: RobotFile
    components: str | None
    tolerance: str | None
    method: str
    designs: int
    seed: int
    variables: tuple[Variable, ...]
    responses: tuple[Response, ...]
    limits: tuple[Limit, ...]
    goals: tuple[Goal, ...]
    poses: tuple[Pose, ...]

    @property
    def no_responses(self) -> tuple[float, ...]:
        """Return NaN for each response: those of an infeasible design."""
        return tuple(repeat(math.nan, len(self.responses)))

    def poses_of(self, robot: RobotFile) -> np.ndarray:
        """Return all poses (n, k) of a design, m and rad."""
        return np.array(
            [robot.known_poses[p] if isinstance(p, str) else p for p in self.poses]
        )

    def design(self, values: Iterable[Value]) -> RobotFile:
        """Return the robot with these values. Raise InputError if they are invalid."""
        pairs = zip(self.variables, values, strict=True)
        source = self.robot.source
        changes = [write_override(v.name, value) for v, value in pairs]
        return read_robot(
            source.path, source.text, [*source.overrides, *changes], self.tolerance
        )

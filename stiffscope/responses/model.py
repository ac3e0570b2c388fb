"""Measured frequency responses and mode shapes in SI units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from stiffscope.runtime.types import Array

AXES = ("x", "y", "z", "rx", "ry", "rz")
Quantity = Literal["receptance", "mobility", "accelerance"]
DERIVATIVES: dict[Quantity, int] = {"receptance": 0, "mobility": 1, "accelerance": 2}
"""How many times the motion is differentiated with respect to time."""


@dataclass(frozen=True)
class Direction:
    """A signed direction at a measured point.

    Attributes
    ----------
    point
        Number of a node of the file, as text, or its name.
    axis
        Index into `AXES`: 0 to 2 along, 3 to 5 about x, y, z.
    sign
        1 or -1.
    """

    point: str
    axis: int
    sign: int = 1

    def __str__(self) -> str:
        return f"{self.point}:{'-' if self.sign < 0 else '+'}{AXES[self.axis]}"

    @property
    def channel(self) -> str:
        """Name of the channel that measures along it, whatever its sign: `2.x`."""
        return f"{self.point}.{AXES[self.axis]}"


@dataclass(frozen=True, eq=False)
class Response:
    """One measured frequency response.

    Attributes
    ----------
    force, motion
        Where and along what the force acts and the motion is measured.
    frequency : (n,)
        Hz, above zero, ascending.
    receptance : (n,)
        Complex displacement per force, m/N (rad/N, m/(N·m), rad/(N·m) of rotations and moments).
    coherence : (n,)
        Ordinary coherence, 0 to 1; None if unknown.
    quantity
        What the file holds.
    source
        File and line, for messages.
    """

    force: Direction
    motion: Direction
    frequency: Array
    receptance: NDArray[np.complex128]
    coherence: Array | None
    quantity: Quantity
    source: str

    @property
    def is_driving_point(self) -> bool:
        """Whether force and motion share point and axis."""
        return self.force.point == self.motion.point and (
            self.force.axis == self.motion.axis
        )


@dataclass(frozen=True, eq=False)
class Shape:
    """A measured mode shape.

    Attributes
    ----------
    frequency
        Hz.
    damping
        Ratio; nan if the file states none.
    displacement
        Complex translations (3,), or translations and rotations (6,), by point.
    """

    frequency: float
    damping: float
    displacement: Mapping[str, NDArray[np.complex128]]
    source: str


@dataclass(frozen=True, eq=False)
class ResponseFile:
    """Content of a file of measured responses.

    Attributes
    ----------
    responses, shapes
        Measured responses and mode shapes, in the order of the file.
    points
        Place (3,) of each point, m, in the axes of the file.
    lines
        Points to connect in a drawing.
    remarks
        Doubts on units and axes, and contents that were not read.
    """

    path: Path
    responses: tuple[Response, ...] = ()
    shapes: tuple[Shape, ...] = ()
    points: Mapping[str, Array] = field(default_factory=dict[str, "Array"])
    lines: tuple[tuple[str, ...], ...] = ()
    remarks: tuple[str, ...] = ()


# Sizes of measured values in any unit. Bytes in the wrong order give numbers of all sizes.
_LEAST, _MOST = 1e-30, 1e30


def find_impossible(values: NDArray[Any]) -> int | None:
    """Return the index of the first value that no instrument measures; None if all may be.

    It is not finite, or beyond 1e30; or the least of all, if most of those that are not zero are
    below 1e-30.
    """
    size = np.abs(values)
    wrong = ~(size < _MOST)
    if wrong.any():
        return int(wrong.argmax())
    some = np.flatnonzero(size)
    if len(some) and np.median(size[some]) < _LEAST:
        return int(some[size[some].argmin()])
    return None


def integrate_motion(
    values: NDArray[np.complex128], frequency: Array, quantity: Quantity
) -> NDArray[np.complex128]:
    """Return the receptance from a mobility or accelerance: division by ``(i ω)^k``.

    Parameters
    ----------
    values, frequency : (n,)
        Response, SI, and frequencies above zero, Hz.
    quantity
        What the values are.

    References
    ----------
    D. J. Ewins, Modal Testing, 2nd ed., Research Studies Press 2000, table 2.1.
    """
    return values / (2j * np.pi * frequency) ** DERIVATIVES[quantity]

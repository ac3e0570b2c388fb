"""What a kind of readings is: its quantities, how it is written and checked, and its prediction."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.gap.effects.effect import Payload
    from stiffscope.gap.forward.robot_readings import RobotReadings
    from stiffscope.robot.file.quantities import Dimension
    from stiffscope.runtime.types import Array, Indices

AXES = ("x", "y", "z", "rx", "ry", "rz")
NO_MODE = -1
"""Mode of quantities that are no facts of a mode of vibration."""


@dataclass(frozen=True)
class Quantity:
    """One quantity of a kind: a number that a reading may state."""

    name: str
    """As in the column `quantity`; empty if only sensors read it."""
    direction: int
    """Index into x y z rx ry rz; 0 if it has none."""
    mode: int
    """Mode of vibration from 0 that it is a fact of, or `NO_MODE`."""


class Predictor(ABC):
    """How readings follow from the robot's forward model; one object serves kinds that are alike.

    All methods take the prediction, which knows the robot with its effects and the campaign, and
    rows (m,) of the campaign that are of these kinds. A change δC of an element's compliance
    changes a reading by ``a · δC b``, with the wrenches ``W a`` and ``W b`` in the element under
    the terminal loads a (sense) and b (drive).
    """

    @abstractmethod
    def read(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the readings (m,) due to robot, loads and instruments."""

    @abstractmethod
    def find_sense(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the sensed terminal directions a (m, cases)."""

    @abstractmethod
    def find_drive(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the applied terminal loads b (m, cases)."""

    @abstractmethod
    def find_modal_pair(
        self, prediction: RobotReadings, rows: Indices, sway: Callable[[], Array]
    ) -> tuple[Array, Array] | None:
        """Return ``W a`` and ``W b`` (m, k) in an element from its share (s, k, c) in modes.

        None if sense and drive give them. ``sway()`` returns the wrench or motion in the
        element by pose with readings of modes and by mode of 1 kg modal mass.
        """

    @abstractmethod
    def weigh(self, prediction: RobotReadings, rows: Indices) -> Array:
        """Return the changes (m,) by the robot's own weight, except unknown zeros."""

    @abstractmethod
    def load(
        self,
        prediction: RobotReadings,
        rows: Indices,
        payload: Payload,
        work: Array,
    ) -> Array:
        """Return the derivatives (m,) by a payload; work (m,) of its weight along the sense."""

    @abstractmethod
    def turn(self, prediction: RobotReadings, rows: Indices, turn: Array) -> Array:
        """Return the derivatives (m,) by a small rotation (6, 6) of their instrument."""


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of readings with all that is asked of it. No fact has a default: all must be said."""

    name: str
    """As in the column `kind` and in outputs."""
    plural: str
    called: str
    """Name in messages of which it is a variety, such as "stiffness" of pushes."""
    quantities: tuple[Quantity, ...]
    instrument: str
    """Name of the instrument that reads it; empty if the axes at M or sensors do."""
    dimensions: tuple[Dimension, Dimension]
    """Dimensions along and about axes: unit, and limits of what is plausible."""
    gaps: tuple[str, str, str]
    """Groups of the absolute gap: along axes, about axes, and of distances."""
    by_column: bool
    """Whether the column `kind` says it of a sensor's row."""
    wrench: Literal["applied", "zero", "none"]
    """Wrench of its rows: any that acts, zero, or empty cells."""
    is_difference: bool
    """Whether it is the difference that its wrench alone makes, so that it needs one."""
    is_displacement: bool
    """Whether gauges read it, which may be reversed, in another unit, or shift."""
    is_motion: bool
    """Whether it is a motion of a point or body, under loads of the terminals."""
    is_relative: bool
    """Whether its errors are relative to its size."""
    is_positive: bool
    """Whether values must be positive."""
    is_absolute: bool
    """Whether instruments with frames read it: the place of a target, not its displacement."""
    is_steady: bool
    """Whether equal values at all poses are plausible."""
    shows_rest: bool
    """Whether it shows weight and geometric errors of the robot without applied loads."""
    spare_modes: int
    """Modes of vibration to compute above the highest one read, where the robot has them, as a
    derivative may be a sum over all modes."""
    noise_group: str
    """Readings of one instrument and group have noise in common."""
    gain_sign: float
    """Exponent with which it follows the gain of its instrument."""
    force_sign: float
    """Exponent with which it follows the scale of applied forces; 0 for positions, of which
    only a part follows."""
    predictor: Predictor | None
    """None: it is predicted in blocks of readings, not by terminals."""

    def unit(self, *, turns: bool) -> str:
        """Return the SI unit as shown, along or about axes."""
        return self.dimensions[turns].unit.replace("**", "^").replace("*", "·")


def along_axes(letter: str) -> tuple[Quantity, ...]:
    """Return quantities of all six directions, such as dx to drz."""
    return tuple(
        Quantity(f"{letter}{axis}", direction, NO_MODE)
        for direction, axis in enumerate(AXES)
    )

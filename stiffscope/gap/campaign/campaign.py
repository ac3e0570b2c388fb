"""A campaign: readings with their poses and wrenches, and the effects in the nominal model."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign import quantities as of
from stiffscope.gap.campaign.quantities import AXES, DEVIATION, kind_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stiffscope.robot.file.parse import Source
    from stiffscope.runtime.types import Array, Flags, Indices


_CODES = ("quantity", "session", "file", "line", "sensor", "load")
AT_TOOL = -1
"""Code for no sensor (a quantity at M), and for no load point (a wrench at M)."""


def _no_codes() -> Indices:
    return np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class InstrumentFrame:
    """Axes of a freely placed instrument, such as a laser tracker or cameras."""

    name: str
    pose: tuple[float, ...] | None = None
    """(x, y, z, rx, ry, rz) in {O}, m and rad (rotation vector); None: unknown and estimated."""
    sigma: tuple[float, ...] | None = None
    """Standard uncertainty of each component of `pose`; None: the pose is exact or unknown."""
    per: str = "campaign"
    """"session": set up again for each session."""


@dataclass(frozen=True)
class Sensor:
    """One channel of an instrument that is mounted on one body and measures another; base axes, SI.

    A target of a position has three channels, `smr.x`, `smr.y`, `smr.z`, along its frame's axes.
    """

    name: str
    body: str
    direction: tuple[float, float, float]
    """Unit vector: sensitive direction or axis of rotation; for a position in its frame's axes."""
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Point of contact or target, home coordinates, m."""
    measures: str = "displacement"
    """"displacement", "rotation", "position" or "distance" (from the origin of its frame)."""
    against: str = "ground"
    zero: str = "none"
    """"session": one unknown constant per session."""
    frame: str = ""
    """Name of the `InstrumentFrame` of a position or distance."""
    target: str = ""
    """Name of the target, common to the channels of one position."""
    at_sigma: float = 0.0
    """Standard uncertainty of each component of `at`, m; 0 if known."""

    @property
    def rotates(self) -> bool:
        """Whether it measures a rotation."""
        return self.measures == "rotation"

    @property
    def absolute(self) -> bool:
        """Whether it reads the absolute position of a target, not a displacement."""
        return self.measures in {"position", "distance"}

    @property
    def along(self) -> Array:
        """Direction (6,) of the motion that it measures."""
        none = (0.0, 0.0, 0.0)
        return np.array(
            (*none, *self.direction) if self.rotates else (*self.direction, *none)
        )

    @property
    def axis(self) -> int:
        """Index 0 to 5 of the nearest of x y z rx ry rz."""
        return int(np.argmax(np.abs(self.direction))) + 3 * self.rotates


@dataclass(frozen=True)
class LoadPoint:
    """Point of application of a load, fixed to a body, home coordinates, m."""

    name: str
    body: str
    at: tuple[float, float, float]


@dataclass(frozen=True)
class Campaign:
    """Measurements of a lab: n readings at p poses, SI, axes of {O}. All arrays are read-only."""

    robot: str | None
    """Name of a bundled robot, or path of a robot file as written; None with predictions."""
    modelled: tuple[str, ...] | None
    """Effects that the nominal model carries; None: own weight where the robot has it,
    until the robot is known (`match_robot`)."""
    components: str | None
    """Source of the matrices of rods and plates; None: as in the robot file."""
    pose_names: tuple[str, ...]
    poses: Array
    """Commanded coordinates (p, k); NaN if poses are labels."""
    pose: Indices
    """Index (n,) of the pose."""
    wrench: Array
    """Stated wrench (n, 6) at M or a load's point, 0 if unloaded; NaN for stiffness, frequency."""
    quantity: Indices
    """Index (n,) into `QUANTITIES`; for sensors that of their kind and nearest axis."""
    value: Array
    sigma: Array
    """Standard uncertainty (n,); NaN if unknown."""
    session_names: tuple[str, ...]
    session: Indices
    """Index (n,) of the session."""
    files: tuple[str, ...]
    file: Indices
    """Index (n,) of each reading's file."""
    line: Indices
    """Line number (n,) of each reading in its file."""
    predictions: dict[str, Array] = field(default_factory=dict[str, "Array"])
    """Predicted values (n,): `value` for the model under test, rivals by column name."""
    coordinates: tuple[str, ...] = AXES[:3]
    """Names of the k commanded coordinates: tool pose or `q:JOINT`."""
    sensors: tuple[Sensor, ...] = field(default_factory=tuple[Sensor, ...])
    sensor: Indices = field(default_factory=_no_codes)
    """Index (n,) into `sensors`; `AT_TOOL` for quantities at M."""
    loads: tuple[LoadPoint, ...] = field(default_factory=tuple[LoadPoint, ...])
    load: Indices = field(default_factory=_no_codes)
    """Index (n,) into `loads`; `AT_TOOL` for a wrench at M."""
    frames: tuple[InstrumentFrame, ...] = field(
        default_factory=tuple[InstrumentFrame, ...]
    )
    """Frames named by the sensors."""
    expected: Array | None = None
    """Offset (n,) subtracted from ``value`` once the robot is known: position or distance of the
    rigid robot as commanded, zero for other readings; None: values are as read."""
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    """Units of columns that were not in SI."""
    source: Source | None = None
    """Text of the campaign.toml, used to give line numbers in errors; None if nothing was read."""

    def __post_init__(self) -> None:
        """Replace every array by a read-only copy."""
        for name, known in (("sensor", self.sensors), ("load", self.loads)):
            if not known:
                object.__setattr__(self, name, np.full(len(self.value), AT_TOOL))
        numbers = ("poses", "wrench", "value", "sigma")
        codes = ("pose", *_CODES)
        arrays: dict[str, Any] = {
            n: np.array(getattr(self, n), dtype=float) for n in numbers
        }
        arrays |= {n: np.array(getattr(self, n), dtype=np.int64) for n in codes}
        models = {name: np.array(values) for name, values in self.predictions.items()}
        for array in (*arrays.values(), *models.values()):
            array.setflags(write=False)
        for name, value in {**arrays, "predictions": models}.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        """Return the number of readings."""
        return len(self.value)

    @property
    def is_weighed(self) -> bool:
        """Whether the nominal model carries the robot's own weight."""
        return "gravity" in (self.modelled or ())

    def select(self, rows: Indices) -> Campaign:
        """Return the campaign with some of its readings (r,)."""
        each = ("pose", *_CODES, "wrench", "value", "sigma")
        predictions = {name: values[rows] for name, values in self.predictions.items()}
        expected = None if self.expected is None else self.expected[rows]
        chosen = {name: getattr(self, name)[rows] for name in each}
        return replace(self, predictions=predictions, expected=expected, **chosen)

    @property
    def kind(self) -> Indices:
        """Index (n,) into `KINDS`."""
        return kind_of(self.quantity)

    @property
    def direction(self) -> Indices:
        """Index (n,) into x y z rx ry rz, the nearest for sensors; 0 for frequencies."""
        return np.where(self.kind == of.FREQUENCY, 0, self.quantity % 6)

    @property
    def relative(self) -> Flags:
        """Flags (n,) of readings with relative errors: stiffnesses, pushes and frequencies."""
        return (self.kind >= of.STIFFNESS) & (self.kind < of.POSITION)

    @property
    def is_motion(self) -> Flags:
        """Flags (n,) of readings of motions: deflections, deviations and positions."""
        return (self.kind <= DEVIATION) | (self.kind == of.POSITION)

    @property
    def shows_rest(self) -> Flags:
        """Flags (n,) of readings that show weight and geometric errors: deviations, positions."""
        return (self.kind == DEVIATION) | (self.kind == of.POSITION)

    @property
    def kind_numbers(self) -> Indices:
        """Group numbers (n,) of readings of the same kind and instrument."""
        plain = 2 * self.kind + self.direction // 3  # the direction of frequencies is 0
        key = np.where(self.sensor >= 0, 10 + 2 * self.sensor + self.shows_rest, plain)
        return np.unique(key, return_inverse=True)[1].ravel()

    def what(self, reading: int) -> str:
        """Return the name of a reading's sensor or quantity, as in the file."""
        if self.sensor[reading] >= 0:
            return self.sensors[int(self.sensor[reading])].name
        return of.QUANTITIES[int(self.quantity[reading])]

    def refuse(self, key: tuple[str, ...], message: str) -> InputError:
        """Return an error for a key of the campaign.toml."""
        if self.source is None:
            return InputError(f"campaign: {'.'.join(key)}: {message}")
        return self.source.refuse(key, message)

    def where(self, reading: int) -> str:
        """Return the file and line of one reading."""
        return f"{self.files[self.file[reading]]}:{self.line[reading]}"

    @property
    def instruments(self) -> tuple[str, ...]:
        """Names of instruments by `channel`: sensors, axes at M, and frequencies."""
        return (*(sensor.name for sensor in self.sensors), *AXES, "f")

    @property
    def channel(self) -> Indices:
        """Index (n,) into `instruments`."""
        at_tool = len(self.sensors) + np.where(
            self.kind == of.FREQUENCY, len(AXES), self.direction
        )
        return np.where(self.sensor >= 0, self.sensor, at_tool)

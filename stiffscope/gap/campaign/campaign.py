"""A campaign: readings with their poses and wrenches, and the effects in the nominal model."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import repeat
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.kinds import (
    CHANNEL_OF,
    DIRECTION_OF,
    INSTRUMENTS,
    NOISE_GROUP_OF,
    QUANTITY,
    UNIT_OF,
    by_code,
)
from stiffscope.gap.campaign.quantities import AXES, kind_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stiffscope.gap.campaign.quantities import ShownIn
    from stiffscope.gap.campaign.response_header import ResponseSetup
    from stiffscope.robot.file.parse import Source
    from stiffscope.runtime.types import Array, Flags, Indices


_CODES = ("quantity", "session", "file", "line", "sensor", "load")
_IS_RELATIVE = by_code(lambda kind: kind.is_relative)
_IS_MOTION = by_code(lambda kind: kind.is_motion)
_IS_DISPLACEMENT = by_code(lambda kind: kind.is_displacement)
_IS_DIFFERENCE = by_code(lambda kind: kind.is_difference)
_IS_ABSOLUTE = by_code(lambda kind: kind.is_absolute)
_SHOWS_REST = by_code(lambda kind: kind.shows_rest)
_IS_LOADED = by_code(lambda kind: kind.wrench == "applied")
_AT_AXES = by_code(lambda kind: not kind.instrument)
_IN_BLOCKS = by_code(lambda kind: kind.predictor is None)
AT_TOOL = -1
"""Code for no sensor (a quantity at M), and for no load point (a wrench at M)."""
NO_LINE = 0
"""Line number of what a file holds on no line of its own."""


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
    inside: float | None = None
    """Place within an elastic body, whose base is then `body`, over its length; None: on `body` itself."""

    @property
    def place(self) -> str:
        """The measured body, as in a campaign.toml."""
        if self.inside is None:
            return self.body
        return f"{self.body.rpartition('.')[0]}:{self.inside:g}"

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
    """Code (n,) of the quantity (`kinds.QUANTITY`); for sensors that of their kind and nearest axis."""
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
    """Line number (n,) of each reading in its file, from 1; `NO_LINE` for lines of responses."""
    predictions: dict[str, Array] = field(default_factory=dict[str, "Array"])
    """Predicted values (n,): `value` for the model under test, rivals by column name."""
    coordinates: tuple[str, ...] = AXES[:3]
    """Names of the k commanded coordinates: tool pose or `q:JOINT`."""
    shown_in: ShownIn = field(default_factory=dict[str, tuple[float, str]])
    """Factor from SI and unit in which drives' coordinates are shown, once the robot is known."""
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
    responses: tuple[ResponseSetup, ...] = ()
    """Set-ups of frequency responses, whose files are read by `load_responses`."""
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

    @classmethod
    def without_readings(
        cls,
        robot: str | None,
        modelled: tuple[str, ...] | None = None,
        components: str | None = None,
        *,
        coordinates: tuple[str, ...] = AXES[:3],
        **more: Any,
    ) -> Campaign:
        """Return a campaign of no readings; ``more``: fields that have a default."""
        return cls(
            robot=robot,
            modelled=modelled,
            components=components,
            pose_names=(),
            poses=np.zeros((0, len(coordinates))),
            pose=_no_codes(),
            wrench=np.zeros((0, 6)),
            quantity=_no_codes(),
            value=np.zeros(0),
            sigma=np.zeros(0),
            session_names=(),
            session=_no_codes(),
            files=(),
            file=_no_codes(),
            line=_no_codes(),
            coordinates=coordinates,
            **more,
        )

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
        """Index (n,) into x y z rx ry rz, the nearest for sensors; 0 if they have none."""
        return DIRECTION_OF[self.quantity]

    @property
    def relative(self) -> Flags:
        """Flags (n,) of readings with relative errors: stiffnesses, pushes and frequencies."""
        return _IS_RELATIVE[self.quantity]

    @property
    def is_motion(self) -> Flags:
        """Flags (n,) of readings of motions: deflections, deviations and positions."""
        return _IS_MOTION[self.quantity]

    @property
    def is_displacement(self) -> Flags:
        """Flags (n,) of displacements read by gauges: deflections and deviations."""
        return _IS_DISPLACEMENT[self.quantity]

    @property
    def is_difference(self) -> Flags:
        """Flags (n,) of differences that an applied wrench alone makes: deflections."""
        return _IS_DIFFERENCE[self.quantity]

    @property
    def is_absolute(self) -> Flags:
        """Flags (n,) of places of targets in an instrument's frame: positions, distances."""
        return _IS_ABSOLUTE[self.quantity]

    @property
    def is_loaded(self) -> Flags:
        """Flags (n,) of readings under their applied wrench: deflections and positions."""
        return _IS_LOADED[self.quantity]

    @property
    def at_tool(self) -> Flags:
        """Flags (n,) of readings of motions or stiffnesses at M."""
        return (self.sensor < 0) & _AT_AXES[self.quantity]

    @property
    def shows_rest(self) -> Flags:
        """Flags (n,) of readings that show weight and geometric errors: deviations, positions."""
        return _SHOWS_REST[self.quantity]

    @property
    def in_blocks(self) -> Flags:
        """Flags (n,) of readings that are predicted in blocks: lines of responses."""
        return _IN_BLOCKS[self.quantity]

    @property
    def kind_numbers(self) -> Indices:
        """Group numbers (n,) of readings of the same kind and instrument."""
        group = NOISE_GROUP_OF[self.quantity]
        turns = self.direction >= 3  # never where there is no direction
        count = int(NOISE_GROUP_OF.max()) + 1
        plain = 2 * group + turns
        by_sensor = count * (2 + self.sensor) + group
        key = np.where(self.sensor >= 0, by_sensor, plain)
        return np.unique(key, return_inverse=True)[1].ravel()

    @property
    def unit_numbers(self) -> Indices:
        """Numbers (n,) of the units of errors: m, rad, ..., and one of all relative ones."""
        return UNIT_OF[self.quantity]

    def what(self, reading: int) -> str:
        """Return the name of a reading's sensor or quantity, as in the file."""
        if self.sensor[reading] >= 0:
            return self.sensors[int(self.sensor[reading])].name
        return QUANTITY[int(self.quantity[reading])].name

    def refuse(self, key: tuple[str, ...], message: str) -> InputError:
        """Return an error for a key of the campaign.toml."""
        if self.source is None:
            return InputError(f"campaign: {'.'.join(key)}: {message}")
        return self.source.refuse(key, message)

    def require(
        self, valid: object, key: tuple[str, ...], expected: str, got: object
    ) -> None:
        """Raise an error for a key of the campaign.toml unless what it needs is valid."""
        if not valid:
            raise self.refuse(key, f"expected {expected}, got {got}")

    def where(self, reading: int) -> str:
        """Return the file and line of one reading; the file alone if it has none, "plan" without both."""
        if not self.files:
            return "plan"
        file = self.files[int(self.file[reading])]
        line = int(self.line[reading])
        return file if line == NO_LINE else f"{file}:{line}"

    def find_pose_rows(self) -> tuple[str, ...]:
        """Return file and line of the first reading at each pose; "" at one without readings."""
        rows = list(repeat("", len(self.pose_names)))
        poses, first = np.unique(self.pose, return_index=True)
        for pose, reading in zip(poses.tolist(), first.tolist(), strict=True):
            rows[pose] = self.where(reading)
        return tuple(rows)

    @property
    def instruments(self) -> tuple[str, ...]:
        """Names of instruments by `channel`: sensors, axes at M, and frequencies."""
        return (*(sensor.name for sensor in self.sensors), *AXES, *INSTRUMENTS)

    @property
    def channel(self) -> Indices:
        """Index (n,) into `instruments`."""
        at_tool = len(self.sensors) + CHANNEL_OF[self.quantity]
        return np.where(self.sensor >= 0, self.sensor, at_tool)

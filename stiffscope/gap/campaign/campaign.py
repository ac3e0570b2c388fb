"""A campaign: readings, the poses and wrenches they were taken at, and what the nominal model is said to carry."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.quantities import (
    AXES,
    DEVIATION,
    FREQUENCY,
    POSITION,
    QUANTITIES,
    STIFFNESS,
    kind_of,
)

if TYPE_CHECKING:
    from stiffscope.robot.file.parse import Source
    from stiffscope.runtime.types import Array, Flags, Indices


AT_TOOL = -1
"""Code of no sensor, a quantity at M; and of no load point, a wrench at M."""


def _read_only(array: Any) -> Any:
    array.setflags(write=False)
    return array


def _no_codes() -> Indices:
    return np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class InstrumentFrame:
    """Axes of an instrument that stands anywhere, such as a laser tracker or cameras."""

    name: str
    pose: tuple[float, ...] | None = None
    """(x, y, z, rx, ry, rz) in {O}, m and rad (rotation vector); None: unknown, found with everything else."""
    sigma: tuple[float, ...] | None = None
    """Standard uncertainty of each component of `pose`; None: the pose is exact, or unknown."""
    per: str = "campaign"
    """"session": set up anew with each session."""


@dataclass(frozen=True)
class Sensor:
    """One channel of an instrument that stands on one body and looks at another; base axes, SI.

    A target whose position is measured has three of them: `smr.x`, `smr.y`, `smr.z`, along the axes of its frame.
    """

    name: str
    body: str
    direction: tuple[float, float, float]
    """Unit vector: sensitive direction, or axis of rotation; of a position in the axes of its frame."""
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where it touches, or the target sits, home coordinates, m."""
    measures: str = "displacement"
    """"displacement", "rotation", "position" or "distance" (from the origin of its frame)."""
    against: str = "ground"
    zero: str = "none"
    """"session": one unknown constant a session."""
    frame: str = ""
    """Name of the `InstrumentFrame` of a position or distance."""
    target: str = ""
    """Name of the target, which channels of one position share."""
    at_sigma: float = 0.0
    """Standard uncertainty of each component of `at`, m; 0: known."""

    @property
    def rotates(self) -> bool:
        """Whether it measures a rotation."""
        return self.measures == "rotation"

    @property
    def absolute(self) -> bool:
        """Whether it reads where a target is, not how far it moved."""
        return self.measures in {"position", "distance"}

    @property
    def axis(self) -> int:
        """0 to 5: the one of x y z rx ry rz that it is nearest to."""
        return int(np.argmax(np.abs(self.direction))) + 3 * self.rotates


@dataclass(frozen=True)
class LoadPoint:
    """Where a load is hung or pushed: a point of a body, home coordinates, m; it moves with the body."""

    name: str
    body: str
    at: tuple[float, float, float]


@dataclass(frozen=True)
class Campaign:
    """What a lab hands over; n readings at p poses, SI, axes of {O}. All arrays are read-only."""

    robot: str | None
    """A robot the project knows, or a robot file's path as written; None with predictions."""
    modelled: tuple[str, ...]
    components: str
    pose_names: tuple[str, ...]
    poses: Array
    """(p, k) commanded coordinates; NaN where poses are labels."""
    pose: Indices
    """(n,) which pose."""
    wrench: Array
    """(n, 6) stated wrench at M or at its load's point; NaN for stiffnesses and frequencies, zero where unloaded."""
    quantity: Indices
    """(n,) position in `QUANTITIES`; of a sensor's reading that of its kind and of the axis nearest to it."""
    value: Array
    sigma: Array
    """(n,) standard uncertainty; NaN: unknown."""
    session_names: tuple[str, ...]
    session: Indices
    """(n,) which session."""
    files: tuple[str, ...]
    file: Indices
    """(n,) which file a reading came from."""
    line: Indices
    """(n,) on which line it stands."""
    predictions: dict[str, Array] = field(default_factory=dict[str, "Array"])
    """Predicted values (n,): the model under test under `value`, its rivals under their columns' names."""
    coordinates: tuple[str, ...] = AXES[:3]
    """Names of the k commanded coordinates: those of the tool pose, or `q:JOINT`."""
    sensors: tuple[Sensor, ...] = field(default_factory=tuple[Sensor, ...])
    sensor: Indices = field(default_factory=_no_codes)
    """(n,) position in `sensors`; `AT_TOOL` for quantities at M."""
    loads: tuple[LoadPoint, ...] = field(default_factory=tuple[LoadPoint, ...])
    load: Indices = field(default_factory=_no_codes)
    """(n,) position in `loads`; `AT_TOOL` for a wrench at M."""
    frames: tuple[InstrumentFrame, ...] = field(default_factory=tuple[InstrumentFrame, ...])
    """Those that the sensors name."""
    expected: Array | None = None
    """(n,) from which ``value`` is counted once the robot is known: a position or distance of the rigid robot as
    commanded, zero for other readings; None: values are as they were read."""
    source: Source | None = None
    """Text of the campaign.toml, by which refusals name the line of a key; None where nothing was read."""

    def __post_init__(self) -> None:
        """Replace every array by a read-only copy."""
        for name, known in (("sensor", self.sensors), ("load", self.loads)):
            if not known:
                object.__setattr__(self, name, np.full(len(self.value), AT_TOOL))
        for name in ("poses", "wrench", "value", "sigma"):
            object.__setattr__(self, name, _read_only(np.array(getattr(self, name), dtype=np.float64)))
        for name in ("pose", "quantity", "session", "file", "line", "sensor", "load"):
            object.__setattr__(self, name, _read_only(np.array(getattr(self, name), dtype=np.int64)))
        models = {name: _read_only(np.array(values)) for name, values in self.predictions.items()}
        object.__setattr__(self, "predictions", models)

    def __len__(self) -> int:
        """Return the number of readings."""
        return len(self.value)

    def select(self, rows: Indices) -> Campaign:
        """The campaign with some of its readings (r,)."""
        each = ("pose", "wrench", "quantity", "value", "sigma", "session", "file", "line", "sensor", "load")
        predictions = {name: values[rows] for name, values in self.predictions.items()}
        expected = None if self.expected is None else self.expected[rows]
        chosen = {name: getattr(self, name)[rows] for name in each}
        return replace(self, predictions=predictions, expected=expected, **chosen)

    @property
    def kind(self) -> Indices:
        """(n,) position in `KINDS`."""
        return kind_of(self.quantity)

    @property
    def direction(self) -> Indices:
        """(n,) 0 to 5: x y z rx ry rz, of a sensor the nearest; 0 for frequencies."""
        return np.where(self.kind == FREQUENCY, 0, self.quantity % 6)

    @property
    def relative(self) -> Flags:
        """(n,) whether a reading's error is judged by its own size: stiffnesses, pushes, frequencies."""
        return (self.kind >= STIFFNESS) & (self.kind < POSITION)

    @property
    def is_motion(self) -> Flags:
        """(n,) whether a reading is of a motion: deflections, deviations, positions."""
        return (self.kind <= DEVIATION) | (self.kind == POSITION)

    @property
    def shows_rest(self) -> Flags:
        """(n,) whether a reading shows the weight and errors of the geometry: deviations, positions."""
        return (self.kind == DEVIATION) | (self.kind == POSITION)

    @property
    def kind_numbers(self) -> Indices:
        """(n,) small numbers that readings of one kind by one instrument share."""
        plain = np.where(self.kind == FREQUENCY, 2 * FREQUENCY, 2 * self.kind + self.direction // 3)
        key = np.where(self.sensor >= 0, 10 + 2 * self.sensor + self.shows_rest, plain)
        return np.unique(key, return_inverse=True)[1].ravel()

    def what(self, reading: int) -> str:
        """Return what a reading measures, in the file's words."""
        if self.sensor[reading] >= 0:
            return self.sensors[int(self.sensor[reading])].name
        return QUANTITIES[int(self.quantity[reading])]

    def refuse(self, key: tuple[str, ...], message: str) -> InputError:
        """Error for a key of the campaign.toml."""
        if self.source is None:
            return InputError(f"campaign: {'.'.join(key)}: {message}")
        return self.source.refuse(key, message)

    def where(self, reading: int) -> str:
        """Return the file and line of one reading."""
        return f"{self.files[self.file[reading]]}:{self.line[reading]}"

    @property
    def instruments(self) -> tuple[str, ...]:
        """Names of instruments by `channel`: the sensors, then the axes at M, then the frequencies."""
        return (*(sensor.name for sensor in self.sensors), *AXES, "f")

    @property
    def channel(self) -> Indices:
        """(n,) position in `instruments`."""
        at_tool = len(self.sensors) + np.where(self.kind == FREQUENCY, len(AXES), self.direction)
        return np.where(self.sensor >= 0, self.sensor, at_tool)

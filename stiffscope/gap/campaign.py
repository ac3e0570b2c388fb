"""A campaign: readings, the poses and wrenches they were taken at, and what the nominal model is said to carry."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Codes = NDArray[np.int64]


def _read_only(array: Any) -> Any:
    array.setflags(write=False)
    return array


def _no_models() -> dict[str, Array]:
    return {}


@dataclass(frozen=True)
class Campaign:
    """What a lab hands over; n readings at p poses, SI, axes of {O}. All arrays are read-only."""

    robot: str | None
    """A robot the project knows, or a robot file's path as written; None with predictions."""
    modelled: tuple[str, ...]
    components: str
    pose_names: tuple[str, ...]
    poses: Array
    """(p, 3) commanded tool points; NaN where poses are labels."""
    pose: Codes
    """(n,) which pose."""
    wrench: Array
    """(n, 6) stated wrench at M; NaN for stiffness readings, zero for deviations."""
    quantity: Codes
    """(n,) position in `QUANTITIES`."""
    value: Array
    sigma: Array
    """(n,) standard uncertainty; NaN: unknown."""
    session_names: tuple[str, ...]
    session: Codes
    """(n,) which session."""
    files: tuple[str, ...]
    file: Codes
    """(n,) which file a reading came from."""
    line: Codes
    """(n,) on which line it stands."""
    predictions: dict[str, Array] = field(default_factory=_no_models)
    """Predicted values (n,): the model under test under `value`, its rivals under their columns' names."""

    def __post_init__(self) -> None:
        """Replace every array by a read-only copy."""
        for name in ("poses", "wrench", "value", "sigma"):
            object.__setattr__(self, name, _read_only(np.array(getattr(self, name), dtype=np.float64)))
        for name in ("pose", "quantity", "session", "file", "line"):
            object.__setattr__(self, name, _read_only(np.array(getattr(self, name), dtype=np.int64)))
        models = {name: _read_only(np.array(values)) for name, values in self.predictions.items()}
        object.__setattr__(self, "predictions", models)

    def __len__(self) -> int:
        """Return the number of readings."""
        return len(self.value)

    @property
    def kind(self) -> Codes:
        """(n,) 0 deflection, 1 deviation, 2 stiffness."""
        return self.quantity // 6

    @property
    def direction(self) -> Codes:
        """(n,) 0 to 5: x y z rx ry rz."""
        return self.quantity % 6

    def where(self, reading: int) -> str:
        """Return the file and line of one reading."""
        return f"{self.files[self.file[reading]]}:{self.line[reading]}"

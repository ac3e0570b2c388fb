"""Lines of frequency responses: readings that the robot predicts set-up by set-up.

A line is complex, so that it is two readings; `stiffscope.gap.forward.response_state` predicts all
lines of a set-up together, with nuisances of their own.
"""

from __future__ import annotations

from stiffscope.gap.campaign.kinds.kind import AXES, NO_MODE, Kind, Quantity
from stiffscope.robot.file.quantities import Dimension

_MOVED = Dimension("a receptance", "m/N", "m/N", 1e-18, 1e3)
_TURNED = Dimension("a rotational receptance", "rad/N", "rad/N", 1e-18, 1e3)

RESPONSE = Kind(
    name="response",
    plural="responses",
    called="response",
    quantities=tuple(
        Quantity("", direction, NO_MODE) for direction in range(len(AXES))
    ),
    instrument="response",
    dimensions=(_MOVED, _TURNED),
    gaps=("response", "response", "response"),
    by_column=False,
    wrench="none",
    is_difference=False,
    is_displacement=False,
    is_motion=False,
    is_relative=False,
    is_positive=False,
    is_absolute=False,
    is_steady=False,
    shows_rest=False,
    spare_modes=0,
    noise_group="response",
    gain_sign=0.0,
    force_sign=0.0,
    predictor=None,
)

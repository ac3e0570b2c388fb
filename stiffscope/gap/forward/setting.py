"""Where effects may act in a campaign: its nominal robot at its poses, and its instruments."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.effects.effect import Setting
from stiffscope.gap.campaign.quantities import DEVIATION, PUSH

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.gap.forward.elastic_state import ElasticState

_SOFT = (2e-7, 2e-6)  # m/N, rad/(N·m): of a tool above which added compliances are expected to be larger in proportion
_ROUNDING = 1e-9  # relative


def find_setting(sound: ElasticState, suspect: Callable[[str], bool] = lambda _part: False) -> Setting:
    """Return where effects may act.

    Parameters
    ----------
    sound
        The nominal robot at a campaign's poses.
    suspect
        Whether virtual experiments on a part, which take time, are worth while; by default they are not.

    """
    at, c = sound.at, sound.at.campaign
    diagonal = np.einsum("pii->pi", sound.compliance)
    found = np.array([np.median(diagonal[:, :3]), np.median(diagonal[:, 3:])])
    softness = np.maximum(1.0, np.nan_to_num(found) / np.array(_SOFT))
    moving = c.sensor[c.kind <= DEVIATION]
    return Setting(
        at.robot,
        (float(softness[0]), float(softness[1])),
        {body.name: _turns(sound, body.name) for body in at.mechanism.bodies if body.elastic is None},
        bool(((c.sensor < 0) & (c.kind <= PUSH)).any()),
        {sensor.name: bool((moving == k).any()) for k, sensor in enumerate(c.sensors)},
        suspect,
    )


def _turns(sound: ElasticState, body: str) -> bool:
    """Whether a body turns against gravity from pose to pose."""
    gravity = sound.at.mechanism.gravity
    rotation = sound.at.configurations.frame(body)[0]
    return bool(np.abs(rotation @ gravity - gravity).max() > _ROUNDING * np.abs(gravity).max())

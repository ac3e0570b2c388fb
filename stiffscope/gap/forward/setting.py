"""Candidates' setting in a campaign: its nominal robot at its poses, and its instruments."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.effects.effect import Setting

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.gap.forward.elastic_state import ElasticState
    from stiffscope.runtime.types import Array

_USUAL = (2e-7, 2e-6)  # m/N, rad/(N·m): default for motions that are free or not read
_ROUNDING = 1e-9  # relative


def find_setting(sound: ElasticState, suspect: Callable[[str], bool]) -> Setting:
    """Return the setting in which effects may act.

    Parameters
    ----------
    sound
        The nominal robot at a campaign's poses.
    suspect
        Whether the (slow) virtual experiments on a part are worthwhile.
    """
    at = sound.at
    c = sound.at.campaign
    translation, rotation = np.split(np.einsum("pii->pi", sound.compliance), 2, axis=1)
    moving = c.sensor[c.is_displacement]
    return Setting(
        at.robot,
        (_median(translation, _USUAL[0]), _median(rotation, _USUAL[1])),
        {
            b.name: _turns(sound, b.name)
            for b in at.mechanism.bodies
            if b.elastic is None
        },
        bool(c.at_tool.any()),
        {sensor.name: bool((moving == k).any()) for k, sensor in enumerate(c.sensors)},
        suspect,
    )


def _median(compliances: Array, usual: float) -> float:
    """Return the median of the positive compliances, or the usual value if there are none."""
    known = compliances[compliances > 0.0]
    return float(np.median(known)) if known.size else usual


def _turns(sound: ElasticState, body: str) -> bool:
    """Return whether a body rotates relative to gravity between poses."""
    gravity = sound.at.mechanism.gravity
    rotation = sound.at.configurations.frame(body)[0]
    return bool(
        np.abs(rotation @ gravity - gravity).max() > _ROUNDING * np.abs(gravity).max()
    )

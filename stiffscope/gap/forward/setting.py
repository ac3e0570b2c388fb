"""Candidates' setting in a campaign: its nominal robot at its poses, and its instruments."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.effects.effect import Setting
from stiffscope.gap.forward.load_chains import size_loads

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.gap.forward.elastic_state import ElasticState
    from stiffscope.runtime.types import Array, Indices

_USUAL = (2e-7, 2e-6)  # m/N, rad/(N·m): default for motions that are free or not read
_ROUNDING = 1e-9  # relative
_FEWEST = 3
_MOST = 12  # sizes of loads of a set


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
    loaded = c.is_motion & np.nan_to_num(c.wrench).any(axis=1)
    resting = c.at_tool & c.is_displacement & ~c.is_difference
    along_x, along_y, along_z = (
        bool(np.nan_to_num(c.wrench[loaded, axis]).any()) for axis in range(3)
    )
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
        tool_is_used=bool(c.at_tool.any() or (loaded & (c.load < 0)).any()),
        tool_turns=bool((resting & (c.direction > 2)).any()),
        forces=(along_x, along_y, along_z),
        load_values=_find_values(c.wrench[loaded], c.load[loaded]),
    )


def _find_values(wrenches: Array, points: Indices) -> tuple[tuple[float, str], ...]:
    """Return the sizes of loads and their unit where weights of a set are hung in one way.

    That is where loads of at least three sizes act along one line at one point.
    """
    wrenches = np.nan_to_num(wrenches)
    size = size_loads(wrenches)
    along = np.round(wrenches / size[:, None], 5)
    first = along[np.arange(len(along)), np.argmax(np.abs(along), axis=1)]
    lines = np.column_stack([points, along * np.sign(first)[:, None]])
    values: set[float] = set()
    for line in np.unique(lines, axis=0):
        here = {float(f"{v:.6g}") for v in size[(lines == line).all(axis=1)]}
        values |= here if len(here) >= _FEWEST else set()
    if len(values) > _MOST:
        return ()
    unit = "N" if wrenches[:, :3].any() else "N·m"
    return tuple((value, unit) for value in sorted(values))


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

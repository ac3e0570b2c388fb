"""Columns of a campaign that belong to each other."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.kinds import CODE_ALONG
from stiffscope.gap.campaign.quantities import AXES, WRENCH

if TYPE_CHECKING:
    from collections.abc import Iterable

    from stiffscope.gap.campaign.campaign import Campaign


def swap_columns(campaign: Campaign, pairs: Iterable[tuple[str, str]]) -> Campaign:
    """Return the campaign in which the numbers of pairs of columns belong to each other.

    A pair names two components of the wrench, two axes at M, or two sensors.
    """
    c = campaign
    for first, second in pairs:
        if first in WRENCH:
            order = np.arange(len(WRENCH))
            columns = [WRENCH.index(first), WRENCH.index(second)]
            order[columns] = columns[::-1]
            c = replace(c, wrench=c.wrench[:, order])
        elif first in AXES:
            axes = [AXES.index(first), AXES.index(second)]
            moved = (c.sensor < 0) & c.is_displacement
            direction = np.array(c.direction)
            for one, other in (axes, axes[::-1]):
                direction[moved & (c.direction == one)] = other
            quantity = np.where(moved, CODE_ALONG[c.kind, direction], c.quantity)
            c = replace(c, quantity=quantity)
        else:
            names = [sensor.name for sensor in c.sensors]
            sensors = [names.index(first), names.index(second)]
            sensor = np.array(c.sensor)
            for one, other in (sensors, sensors[::-1]):
                sensor[c.sensor == one] = other
            c = replace(c, sensor=sensor)
    return c

"""Derivatives of a part's 6x6 by virtual experiments: its dimensions, material and foundation, each a little off."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.jobs.experiments import condense_parts
from stiffscope.jobs.orders import order_part
from stiffscope.robot.part_dimensions import FOUNDATION, PartDimension, between, part_parameters, with_parameter
from stiffscope.robot.part_sections import ParametricPart

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.jobs.assembly import Assembled
    from stiffscope.jobs.workshop import Workshop

STEP = 0.06  # of a parameter, to either side
FOUNDATIONS = (2e11, 4e10)  # N/m³: beside a rigid one
SOFTER = (2.0, 0.5)  # times a foundation that yields


def tested_dimensions(nominal: Assembled, shop: Workshop) -> dict[str, Callable[[], tuple[PartDimension, ...]]]:
    """By part whose matrix comes from a virtual experiment, what makes the experiments on its parameters."""
    return {
        name: partial(_dimensions, nominal, name, shop)
        for name, source in nominal.sources.items()
        if source == "fea" and isinstance(nominal.robot.parts[name], ParametricPart)
    }


def _dimensions(nominal: Assembled, name: str, shop: Workshop) -> tuple[PartDimension, ...]:
    robot = nominal.robot
    here = nominal.matrices[name].compliance
    known = {
        key: (value, unit, (1.0 - STEP, 1.0 + STEP)) for key, (value, unit) in part_parameters(robot, name).items()
    }
    foundation = getattr(robot.parts[name], FOUNDATION, None)
    values = {key: (value, *(value * share for share in shares)) for key, (value, _, shares) in known.items()}
    values[FOUNDATION] = (
        (np.inf, *FOUNDATIONS) if foundation is None else (foundation, *(foundation * share for share in SOFTER))
    )
    orders = {
        (key, k): order_part(with_parameter(robot, name, key, value), name, label=f"{name}, {key} {value:.4g}")
        for key, some in values.items()
        for k, value in enumerate(some)
        if k > 0
    }
    solved = dict(zip(orders, condense_parts(list(orders.values()), shop), strict=True))
    out: list[PartDimension] = []
    for key, some in values.items():
        unit = "N/m^3" if key == FOUNDATION else known[key][1]
        matrices = [here, *(solved[key, k].compliance for k in (1, 2))]
        out.append(PartDimension(name, key, some[0], unit, between(some, matrices)))
    return tuple(out)

"""Derivatives of a part's 6x6 by virtual experiments: its dimensions, material and foundation, each a little off."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.cad.materials import Material
from stiffscope.jobs.experiments import condense_parts
from stiffscope.jobs.orders import order_part
from stiffscope.robot.part_dimensions import (
    FOUNDATION,
    PartDimension,
    between,
    on_foundation,
    part_parameters,
    vanishing,
    with_parameter,
)
from stiffscope.robot.part_sections import ParametricPart

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.jobs.assembly import Assembled
    from stiffscope.jobs.workshop import Workshop

    Array = NDArray[np.floating[Any]]

STEP = 0.1  # of a length, or of the wall that it leaves, to either side
MODULUS_STEP = 0.06
POISSON = (-0.9, -0.45, 0.45, 0.9)  # of what Poisson's ratio lacks of 0.5: what changes with a modulus
FOUNDATIONS = tuple(10.0 ** (k / 2) for k in range(26, 19, -1))  # N/m³: beside a rigid one
SOFTER = (4.0, 0.25)  # times a foundation that yields, beside a rigid one


def tested_dimensions(nominal: Assembled, shop: Workshop) -> dict[str, Callable[[], tuple[PartDimension, ...]]]:
    """By part whose matrix comes from a virtual experiment, what makes the experiments on its parameters."""
    return {
        name: partial(_dimensions, nominal, name, shop)
        for name, source in nominal.sources.items()
        if source == "fea" and isinstance(nominal.robot.parts[name], ParametricPart)
    }


def _dimensions(nominal: Assembled, name: str, shop: Workshop) -> tuple[PartDimension, ...]:
    robot, here = nominal.robot, nominal.matrices[name].compliance
    known = part_parameters(robot, name)
    limits = {key: vanishing(robot, name, key) for key in known}
    shares = {key: _shares(robot.material(name), key) for key in known}
    others = {
        key: tuple(limits[key] + (value - limits[key]) * share for share in shares[key])
        for key, (value, _) in known.items()
    }
    foundation = getattr(robot.parts[name], FOUNDATION, None)
    others[FOUNDATION] = FOUNDATIONS if foundation is None else (np.inf, *(foundation * times for times in SOFTER))
    solved = _solved(nominal, name, others, shop)
    out = [
        PartDimension(
            name, key, value, unit, between((value, *others[key]), (here, *solved[key]), limits[key]), limits[key]
        )
        for key, (value, unit) in known.items()
    ]
    yields = dict(zip((foundation or np.inf, *others[FOUNDATION]), (here, *solved[FOUNDATION]), strict=True))
    rigid = yields.pop(np.inf)
    compliance = on_foundation(rigid, tuple(yields), tuple(yields.values()))
    return (*out, PartDimension(name, FOUNDATION, foundation or np.inf, "N/m^3", compliance))


def _shares(material: AnyMaterial | None, key: str) -> tuple[float, ...]:
    """What is tried of a length or modulus (of a length's distance from its limit), over the nominal one."""
    if not key.endswith("modulus"):
        return 1.0 - STEP, 1.0 + STEP
    if not isinstance(material, Material):
        return 1.0 - MODULUS_STEP, 1.0 + MODULUS_STEP
    poisson = material.poisson
    span = min(0.5 - poisson, 0.5 * (1.0 + poisson))  # the latter for what widens when it is stretched
    growth = [1.0 + share * span / (1.0 + poisson) for share in POISSON]
    return tuple(growth if key == "youngs_modulus" else [1.0 / g for g in growth])


def _solved(
    nominal: Assembled, name: str, values: dict[str, tuple[float, ...]], shop: Workshop
) -> dict[str, list[Array]]:
    """Compliances of a part with other values of its parameters, on its own mesh moved along where that can be.

    An error that meshes have in common is in no difference of these.
    """
    orders = [
        order_part(with_parameter(nominal.robot, name, key, value), name, label=f"{name}, {key} {value:.4g}")
        for key, some in values.items()
        for value in some
    ]
    results = iter(condense_parts(orders, shop, {order.label: nominal.results[name] for order in orders}))
    return {key: [next(results).compliance for _ in some] for key, some in values.items()}

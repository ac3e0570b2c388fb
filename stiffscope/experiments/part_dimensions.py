"""Derivatives of a part's 6x6 by perturbed dimensions, material and foundation."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.cad.materials import Material
from stiffscope.errors import InputError
from stiffscope.experiments.experiments import solve_parts
from stiffscope.experiments.orders import order_part
from stiffscope.robot.file.part_sections import ParametricPart
from stiffscope.robot.part_dimensions import (
    FOUNDATION,
    PartDimension,
    find_vanishing,
    interpolate_between,
    on_foundation,
    part_parameters,
    with_parameter,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.experiments.part_order import PartOrder
    from stiffscope.runtime.types import Array
    from stiffscope.runtime.workshop import Workshop

STEP = 0.1  # relative step of a length, or of the remaining wall, either way
MODULUS_STEP = 0.06
POISSON = (
    -0.9,
    -0.45,
    0.45,
    0.9,
)  # steps relative to (0.5 - ν), since ν varies with a modulus
LEAST = 0.2  # smallest reference of the negative steps
FOUNDATIONS = tuple(
    10.0 ** (k / 2) for k in range(26, 19, -1)
)  # N/m³, if the clamp is rigid
SOFTER = (4.0, 0.25)  # times a given foundation's stiffness; a rigid one is tested too


def tested_dimensions(
    nominal: Assembled, shop: Workshop
) -> dict[str, Callable[[], tuple[PartDimension, ...]]]:
    """Return, by part with source "fea", a function that runs experiments on its parameters."""
    return {
        name: partial(_dimensions, nominal, name, shop)
        for name, source in nominal.sources.items()
        if source == "fea" and isinstance(nominal.robot.parts[name], ParametricPart)
    }


def _dimensions(
    nominal: Assembled, name: str, shop: Workshop
) -> tuple[PartDimension, ...]:
    robot = nominal.robot
    here = nominal.matrices[name].compliance
    known = part_parameters(robot, name)
    limits = {key: find_vanishing(robot, name, key) for key in known}
    material = robot.material(name)
    foundation = getattr(robot.parts[name], FOUNDATION, None)
    others: dict[str, tuple[float, ...]] = {}
    for key, (value, _) in known.items():
        away = value - limits[key]
        others[key] = tuple(
            limits[key] + away * share for share in _shares(material, key)
        )
    others[FOUNDATION] = FOUNDATIONS
    if foundation is not None:
        others[FOUNDATION] = (np.inf, *(foundation * times for times in SOFTER))
    tried = _try_values(nominal, name, others, shop)
    out: list[PartDimension] = []
    for key, (value, unit) in known.items():
        tried_values = tried[key]
        if tried_values:
            points = ((value, *tried_values), (here, *tried_values.values()))
            limit = limits[key]
            compliance = interpolate_between(*points, limit, _legal(material, key))
            out.append(
                PartDimension(
                    part=name,
                    parameter=key,
                    nominal=value,
                    unit=unit,
                    compliance=compliance,
                    limit=limit,
                )
            )
    yields = {foundation or np.inf: here, **tried[FOUNDATION]}
    rigid = yields.pop(np.inf, None)
    if rigid is not None and yields:
        compliance = on_foundation(rigid, tuple(yields), tuple(yields.values()))
        out.append(
            PartDimension(name, FOUNDATION, foundation or np.inf, "N/m^3", compliance)
        )
    return tuple(out)


def _legal(material: AnyMaterial | None, key: str) -> tuple[float, float]:
    """Return the admissible range of a modulus: Poisson's ratio must be in (-1, 0.5)."""
    if not isinstance(material, Material) or not key.endswith("modulus"):
        return -np.inf, np.inf
    if key == "youngs_modulus":
        return 0.0, 3.0 * material.shear_modulus
    return material.youngs_modulus / 3.0, np.inf


def _shares(material: AnyMaterial | None, key: str) -> tuple[float, ...]:
    """Return test values relative to nominal, of a modulus or a length's distance to its limit."""
    if not key.endswith("modulus"):
        return 1.0 - STEP, 1.0 + STEP
    if not isinstance(material, Material):
        return 1.0 - MODULUS_STEP, 1.0 + MODULUS_STEP
    poisson = material.poisson
    left = 0.5 * (1.0 + poisson)  # limit for auxetic materials
    above = min(0.5 - poisson, left)
    below = min(max(0.5 - poisson, LEAST), left)
    steps = (share * (above if share > 0.0 else below) for share in POISSON)
    growth = [1.0 + step / (1.0 + poisson) for step in steps]
    return tuple(growth if key == "youngs_modulus" else [1.0 / g for g in growth])


def _try_values(
    nominal: Assembled, name: str, values: dict[str, tuple[float, ...]], shop: Workshop
) -> dict[str, dict[float, Array]]:
    """Return compliances of a part with other parameter values, on its morphed mesh if possible.

    A discretization error common to the meshes cancels in differences. Values for which the part
    cannot be built or solved (e.g. a much too soft foundation) are omitted.
    """
    orders: dict[tuple[str, float], PartOrder] = {}
    for key, value in ((key, value) for key, some in values.items() for value in some):
        with suppress(InputError):
            changed = with_parameter(nominal.robot, name, key, value)
            orders[key, value] = order_part(
                changed, name, label=f"{name}, {key} {value:.9g}"
            )
    near = {order.label: nominal.results[name] for order in orders.values()}
    solved = solve_parts(list(orders.values()), shop, whole=False, near=near, skip=True)
    results = {result.order: result.compliance for result in solved}
    tried: dict[str, dict[float, Array]] = {key: {} for key in values}
    for (key, value), order in orders.items():
        if order in results:
            tried[key][value] = results[order]
    return tried

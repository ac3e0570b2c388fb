"""Derivatives of parts as jobs: from the cache, or computed from the part's experiment."""

from __future__ import annotations

import dataclasses
import json
import time
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.design.sensitivity import poses_of, robot_sensitivity
from stiffscope.experiments.assembly import check_one_interface
from stiffscope.experiments.experiments import solve_parts
from stiffscope.experiments.making import EXPERIMENT
from stiffscope.experiments.orders import order_part
from stiffscope.fea.derivatives import Derivative, PartSensitivity
from stiffscope.fea.experiment import load_experiment
from stiffscope.robot.part_matrices import needed_experiments
from stiffscope.runtime.cache import SENSITIVITY
from stiffscope.runtime.workshop import workshop

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.cad.part import Part
    from stiffscope.design.sensitivity import Sensitivity
    from stiffscope.experiments.part_order import PartOrder
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.part_matrices import Components
    from stiffscope.runtime.cache import Cache
    from stiffscope.runtime.types import Progress
    from stiffscope.runtime.workshop import Workshop

FILE = "sensitivity.json"


def part_sensitivities(
    orders: Sequence[PartOrder], shop: Workshop
) -> list[PartSensitivity]:
    """Return derivatives of parts with respect to dimensions, material constants and foundation.

    Parameters
    ----------
    orders
        The parts' experiments, run unless cached; a STEP file's solid has no dimensions.
    shop
        Workshop with cache, processes and progress.

    Raises
    ------
    InputError
        A part cannot be built, meshed or clamped as requested.
    """
    load = partial(shop.cache.load, [SENSITIVITY], read=read_sensitivity)
    held = {order: load(key=order.key()) for order in dict.fromkeys(orders)}
    missing = [order for order, found in held.items() if found is None]
    if missing:
        solved = {result.order: result.folder for result in solve_parts(missing, shop)}
        jobs = {order.label: (order, solved[order], shop.cache) for order in missing}
        computed = shop.work(_make_sensitivity, jobs)
        held |= {order: read_sensitivity(computed[order.label]) for order in missing}
    return [found for order in orders if (found := held[order]) is not None]


def _make_sensitivity(
    order: PartOrder, experiment: Path, cache: Cache, report: Progress
) -> Path:
    """Compute and cache the derivatives of a part; return their folder. Runs in any process."""
    from stiffscope.fea.sensitivity import part_sensitivity

    begun = time.perf_counter()
    report("cad", 0.05)
    part = order.build()
    lengths = order.solid.lengths().items()
    dimensions = {
        name: (value, partial(_built, order, name)) for name, value in lengths
    }
    built = time.perf_counter() - begun
    report("derivatives", 0.2)
    held = load_experiment(experiment / EXPERIMENT)
    result = part_sensitivity(held, part, order.settings, dimensions)
    result = dataclasses.replace(result, seconds={"cad": built, **result.seconds})
    text = json.dumps(
        {
            "part": result.part,
            "derivatives": {
                name: vars(each) for name, each in result.derivatives.items()
            },
            "notes": result.notes,
            "seconds": result.seconds,
        },
        default=np.ndarray.tolist,
    )
    folder = cache.put(
        SENSITIVITY, order.key(), lambda aside: (aside / FILE).write_text(text)
    )
    report("done", 1.0)
    return folder


def _built(order: PartOrder, name: str, value: float) -> Part:
    """Build the part with another value (m) of a dimension."""
    solid = dataclasses.replace(order.solid, **{name: value})
    return dataclasses.replace(order, solid=solid).build()


def read_sensitivity(folder: Path) -> PartSensitivity:
    """Read the derivatives from a folder of the cache."""
    held = json.loads((folder / FILE).read_text())
    derivatives: dict[str, Derivative] = {}
    for name, fields in held["derivatives"].items():
        arrays = {
            key: np.array(value)
            for key, value in fields.items()
            if isinstance(value, list)
        }
        derivatives[name] = Derivative(**fields | arrays)
    return PartSensitivity(held["part"], derivatives, held["notes"], held["seconds"])


def sensitivity(
    robot: RobotFile,
    part: str | None = None,
    *,
    poses: Sequence[Sequence[float]] | None = None,
    components: Components = None,
) -> PartSensitivity | Sensitivity:
    """Return derivatives of a part or robot with respect to all parameters; cached if possible.

    Parameters
    ----------
    robot
        Robot file from `load_robot`.
    part
        Name of a solid part; by default the whole robot.
    poses
        Tool poses, m and rad; by default those of the robot file.
    components
        Source of the parts' matrices, as in `assemble`.

    Returns
    -------
    PartSensitivity or Sensitivity
        ``derivatives[NAME].compliance`` (6, 6) of a part, with ``error``, ``mass``, …; ``rows`` of
        a robot with ``by.stiffness`` (n, 6, 6), ``by.sag``, ``by.frequency``; SI, per SI unit of
        the parameter.

    Raises
    ------
    InputError
        The part does not exist or is not a solid, or a pose is out of reach.
    """
    with workshop() as shop:
        if part is not None:
            return part_sensitivities([order_part(robot, part)], shop)[0]
        return robot_sensitivities(robot, poses_of(robot, poses), components, shop)


def robot_sensitivities(
    robot: RobotFile, poses: np.ndarray, components: Components, shop: Workshop
) -> Sensitivity:
    """Return derivatives of a robot at commanded poses (n, k), parts as jobs; see `sensitivity`."""
    names = needed_experiments(robot, components)
    for name in names:
        check_one_interface(robot, name)
    orders = [order_part(robot, name) for name in names]
    experiments = dict(zip(names, solve_parts(orders, shop), strict=True))
    by_part = dict(zip(names, part_sensitivities(orders, shop), strict=True))
    derivatives = {name: each.derivatives for name, each in by_part.items()}
    return robot_sensitivity(robot, poses, components, experiments, derivatives)

"""Derivatives of parts as jobs: taken from the cache, or made from the part's experiment and kept there."""

from __future__ import annotations

import dataclasses
import json
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.jobs.experiments import solve_parts
from stiffscope.jobs.results import EXPERIMENT

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from stiffscope.cad.part import Part
    from stiffscope.fea.sensitivity import PartSensitivity
    from stiffscope.jobs.cache import Cache
    from stiffscope.jobs.orders import PartOrder
    from stiffscope.jobs.workshop import Workshop

    Report = Callable[[str, float], None]

KIND, FILE = "sensitivity", "sensitivity.json"


def part_sensitivities(orders: Sequence[PartOrder], shop: Workshop) -> list[PartSensitivity]:
    """Derivatives of parts by their dimensions, material constants and foundation, from the cache or made.

    Parameters
    ----------
    orders
        The parts' experiments, which are made where the cache has none; a STEP file's solid has no dimensions.
    shop
        Where: cache, processes, progress.

    Raises
    ------
    InputError
        A part cannot be built, meshed or held as asked.

    """
    missing = [order for order in dict.fromkeys(orders) if shop.cache.get(KIND, order.key()) is None]
    folders = {}
    if missing:
        solved = {result.order: result.folder for result in solve_parts(missing, shop)}
        jobs = {order.label: (order, solved[order], shop.cache) for order in missing}
        made = shop.work(make_sensitivity, jobs, {label: shop.open_line(label) for label in jobs})
        folders = {order: made[order.label] for order in missing}
    return [read_sensitivity(folders.get(order) or shop.cache.get(KIND, order.key())) for order in orders]


def make_sensitivity(order: PartOrder, experiment: Path, cache: Cache, report: Report) -> Path:
    """Make the derivatives of a part and keep them: their folder. May run in a child process."""
    from stiffscope.fea.experiment import load_experiment
    from stiffscope.fea.sensitivity import part_sensitivity

    begun = time.perf_counter()
    report("cad", 0.05)
    part = order.build()
    lengths = {} if order.step else order.solid.lengths()
    dimensions = {name: (value, partial(_built, order, name)) for name, value in lengths.items()}
    built = time.perf_counter() - begun
    report("derivatives", 0.2)
    found = part_sensitivity(load_experiment(experiment / EXPERIMENT), part, order.settings, dimensions)
    found = dataclasses.replace(found, seconds={"cad": built, **found.seconds})
    folder = cache.put(KIND, order.key(), lambda aside: (aside / FILE).write_text(_to_json(found)))
    report("done", 1.0)
    return folder


def _built(order: PartOrder, name: str, value: float) -> Part:
    """The part with another value (m) of a dimension."""
    return dataclasses.replace(order, solid=dataclasses.replace(order.solid, **{name: value})).build()


def _to_json(found: PartSensitivity) -> str:
    def plain(value: Any) -> Any:
        return value.tolist() if isinstance(value, np.ndarray) else value

    fields = {
        name: {key: plain(value) for key, value in vars(derivative).items()}
        for name, derivative in found.derivatives.items()
    }
    return json.dumps({"part": found.part, "derivatives": fields, "notes": found.notes, "seconds": found.seconds})


def read_sensitivity(folder: Path) -> PartSensitivity:
    """The derivatives that a folder of the cache holds."""
    from stiffscope.fea.sensitivity import Derivative, PartSensitivity

    held = json.loads((folder / FILE).read_text())
    derivatives = {
        name: Derivative(**{key: np.array(v) if isinstance(v, list) else v for key, v in fields.items()})
        for name, fields in held["derivatives"].items()
    }
    return PartSensitivity(held["part"], derivatives, held["notes"], held["seconds"])

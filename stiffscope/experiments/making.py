"""One virtual experiment, run and kept in the cache, perhaps in a process of its own.

That process imports neither robots nor mechanisms: half a second of a processor.
"""

from __future__ import annotations

import json
import logging
import time
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stiffscope.cad.faces import face_geometries
from stiffscope.cad.part import mass_properties
from stiffscope.cad.step import write_step, write_stl
from stiffscope.errors import InputError
from stiffscope.fea.experiment import load_experiment
from stiffscope.fea.export import write_vtu
from stiffscope.fea.mesh import MeshError
from stiffscope.runtime.cache import CONDENSED, MOVED, WHOLE

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from stiffscope.cad.part import Part
    from stiffscope.experiments.part_order import PartOrder
    from stiffscope.fea.experiment import Experiment
    from stiffscope.runtime.cache import Cache
    from stiffscope.runtime.types import Progress

log = logging.getLogger(__name__)

EXPERIMENT = "experiment.npz"
SOLID = "solid.json"
FIELDS = "fields.vtu"


class Neighbour(NamedTuple):
    """A part of slightly different dimensions or material, whose mesh may be moved along."""

    order: PartOrder
    experiment: Experiment


def make_part(
    order: PartOrder,
    cache: Cache,
    report: Progress,
    *,
    whole: bool,
    near: Mapping[str, Neighbour],
    skip: bool,
) -> tuple[Path | None, float]:
    """Run and cache an experiment, perhaps in a child process; return its folder and seconds."""
    begun = time.perf_counter()
    folder = None
    try:
        part, experiment = _test(
            order, cache, report, whole=whole, near=near.get(order.label)
        )
        kind = WHOLE if whole else MOVED if experiment.moved else CONDENSED
        write = partial(_write, part, experiment, whole=whole)
        folder = cache.put(kind, order.key(), write)
    except InputError as error:
        if not skip:
            if isinstance(error, MeshError):  # named like errors of fields
                name = f"{order.label}."
                raise MeshError(name + str(error).removeprefix(name)) from error
            raise
        log.debug("left out: %s", error)
    report("done", 1.0)
    return folder, time.perf_counter() - begun


def _test(
    order: PartOrder,
    cache: Cache,
    report: Progress,
    *,
    whole: bool,
    near: Neighbour | None,
) -> tuple[Part, Experiment]:
    from stiffscope.fea.run import run_experiment

    begun = time.perf_counter()
    report("cad", 0.02)
    part = order.build()
    built = time.perf_counter() - begun
    kinds = [CONDENSED] if whole else []
    former = cache.load(
        kinds,
        order.key(),
        lambda held: load_experiment(held / EXPERIMENT, fields=False),
    )
    moved = near is not None and order.moves_from(near.order)
    experiment = run_experiment(
        part,
        order.settings,
        lambda stage, fraction: report(stage, 0.1 + 0.85 * fraction),
        former=former,
        near=(near.order.build(), near.experiment.mesh) if near and moved else None,
        whole=whole,
    )
    experiment.seconds["cad"] += built
    report("files", 0.97)
    return part, experiment


def _write(part: Part, experiment: Experiment, folder: Path, *, whole: bool) -> None:
    """Write the files of an experiment; fields and solid only if it is whole."""
    experiment.save(folder / EXPERIMENT)
    (folder / SOLID).write_text(json.dumps(describe_solid(part)))
    if whole:
        write_vtu(experiment, folder / FIELDS)
        write_step(part, folder / f"{part.name}.step")
        write_stl(part, folder / f"{part.name}.stl")


def describe_solid(part: Part) -> dict[str, Any]:
    """Return a CAD solid's properties, SI: mass, inertia, clamp's centre, interfaces' faces."""
    solid = mass_properties(part)
    interfaces = (part.clamped, *(port.faces for port in part.loaded))
    held = [face for face in face_geometries(part.solid) if face.index in part.clamped]
    areas = [face.area for face in held]
    centres = [face.centroid for face in held]
    return {
        "mass": solid.mass,
        "mass_centre": list(map(float, solid.centre)),
        "inertia": [list(map(float, row)) for row in solid.inertia],
        "clamped_centre": np.average(centres, axis=0, weights=areas).tolist(),
        "faces": {
            name: sorted(map(int, faces))
            for name, faces in zip(part.names, interfaces, strict=True)
        },
    }

"""Virtual experiments as jobs: read from the cache, or run in parallel and cached."""

from __future__ import annotations

import json
import logging
import time
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.cad.faces import face_geometries
from stiffscope.cad.part import mass_properties
from stiffscope.cad.step import write_step, write_stl
from stiffscope.errors import InputError
from stiffscope.experiments.results import EXPERIMENT, FIELDS, SOLID, PartResult
from stiffscope.fea.experiment import load_experiment
from stiffscope.fea.export import write_vtu
from stiffscope.fea.mesh import MeshError
from stiffscope.runtime.executor import LateError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from stiffscope.cad.part import Part
    from stiffscope.experiments.orders import PartOrder
    from stiffscope.fea.experiment import Experiment
    from stiffscope.runtime.cache import Cache
    from stiffscope.runtime.workshop import Workshop

    Report = Callable[[str, float], None]

log = logging.getLogger(__name__)

AFTER_REFINEMENT = 1.5  # times the limit, to allow for the modes of the last mesh
WHOLE, CONDENSED, MOVED = "experiment", "condensed", "moved"  # kinds of results in the cache


def solve_parts(
    orders: Sequence[PartOrder],
    shop: Workshop,
    *,
    whole: bool = True,
    near: Mapping[str, PartResult] | None = None,
    skip: bool = False,
) -> list[PartResult]:
    """Read virtual experiments from the cache, or run them.

    Parameters
    ----------
    orders
        Experiments to run; equal orders run once, different orders need different labels.
    shop
        Cache, processes and progress.
    whole
        Whether to compute fields, self-weight and natural frequencies too. Without them it takes
        half the time for equal compliances; a later whole experiment reuses the cached mesh.
    near
        Parts of slightly different dimensions or material, by label; their meshes are morphed if
        possible. Such results are cached separately and only reused with `near`.
    skip
        Whether to omit parts that cannot be built, meshed or solved.

    Returns
    -------
    list of PartResult
        One for each order. Cached results import neither CAD nor mesher.

    Raises
    ------
    InputError
        If a part cannot be built, meshed or held as requested.

    """
    kinds = [WHOLE] if whole else [CONDENSED, WHOLE] if near is None else [CONDENSED, WHOLE, MOVED]
    found: dict[PartOrder, PartResult] = {}
    missing: list[PartOrder] = []
    for order in dict.fromkeys(orders):
        begun = time.perf_counter()
        held = shop.cache.load(kinds, order.key(), partial(_read, order, whole=whole, reused=True))
        if held is None:
            missing.append(order)
        else:
            found[order] = replace(held, seconds=time.perf_counter() - begun)
    if missing:
        make = partial(_make_part, whole=whole, near=near or {}, skip=skip)
        for order, (folder, seconds) in _make_missing(missing, shop, make).items():
            if folder is not None:
                found[order] = replace(_read(order, folder, whole=whole, reused=False), seconds=seconds)
    return [found[order] for order in orders if order in found]


def _make_missing(missing: Sequence[PartOrder], shop: Workshop, make: Callable[..., Any]) -> dict[PartOrder, Any]:
    jobs = {order.label: (order, shop.cache) for order in missing}
    if len(jobs) < len(missing):
        raise ValueError("experiments that differ have the same label")
    limits = {  # refinement checks its own time, and modes follow it
        each.label: each.settings.time_limit * (1.0 if each.settings.tolerance is None else AFTER_REFINEMENT)
        for each in missing
    }
    try:
        made = shop.work(make, jobs, limits)
    except LateError as late:
        cure = "choose a larger mesh.size, or a longer mesh.time_limit"
        raise InputError(f"{late.job}.mesh.time_limit: {str(late).partition(': ')[2]}; {cure}") from late
    return {order: made[order.label] for order in missing}


def _read(order: PartOrder, folder: Path, *, whole: bool, reused: bool) -> PartResult:
    solid = json.loads((folder / SOLID).read_text())
    for name, shape in {"mass": (), "mass_centre": (3,), "clamped_centre": (3,), "inertia": (3, 3)}.items():
        if np.shape(solid[name]) != shape or not np.isfinite(solid[name]).all():
            raise ValueError(f"expected finite numbers of {name}")
    experiment = load_experiment(folder / EXPERIMENT, fields=whole)
    return PartResult(order, order.key(), folder, experiment, solid, reused, 0.0)


def _make_part(
    order: PartOrder, cache: Cache, report: Report, *, whole: bool, near: Mapping[str, PartResult], skip: bool
) -> tuple[Path | None, float]:
    """Run and cache an experiment, perhaps in a child process; return its folder and seconds."""
    begun = time.perf_counter()
    try:
        with _name_refusals(order):
            part, experiment = _test(order, cache, report, whole=whole, near=near.get(order.label))
            kind = WHOLE if whole else MOVED if experiment.moved else CONDENSED
            folder = cache.put(kind, order.key(), lambda aside: _write(part, experiment, aside, whole=whole))
    except InputError as error:
        if not skip:
            raise
        log.debug("left out: %s", error)
        folder = None
    report("done", 1.0)
    return folder, time.perf_counter() - begun


@contextmanager
def _name_refusals(order: PartOrder) -> Iterator[None]:
    """Prefix mesh and solver errors with the part's name, like errors of fields."""
    try:
        yield
    except MeshError as error:
        raise MeshError(f"{order.label}.{str(error).removeprefix(f'{order.label}.')}") from error


def _test(
    order: PartOrder, cache: Cache, report: Report, *, whole: bool, near: PartResult | None
) -> tuple[Part, Experiment]:
    from stiffscope.fea.run import run_experiment

    begun = time.perf_counter()
    report("cad", 0.02)
    part = order.build()
    built = time.perf_counter() - begun
    kinds = [CONDENSED] if whole else []
    former = cache.load(kinds, order.key(), lambda held: load_experiment(held / EXPERIMENT, fields=False))
    experiment = run_experiment(
        part,
        order.settings,
        lambda stage, fraction: report(stage, 0.1 + 0.85 * fraction),
        former=former,
        near=(near.order.build(), near.experiment.mesh) if near and order.moves_from(near.order) else None,
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
    """Return a CAD solid's properties, SI: mass, inertia, clamped faces and their centre."""
    solid = mass_properties(part)
    held = [face for face in face_geometries(part.solid) if face.index in set(map(int, part.clamped))]
    return {
        "mass": solid.mass,
        "mass_centre": list(map(float, solid.centre)),
        "inertia": [list(map(float, row)) for row in solid.inertia],
        "clamped_centre": np.average([f.centroid for f in held], axis=0, weights=[f.area for f in held]).tolist(),
        "faces": {
            "clamped": sorted(int(face) for face in part.clamped),
            "loaded": sorted(int(face) for port in part.loaded for face in port.faces),
        },
    }

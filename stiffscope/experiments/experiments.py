"""Virtual experiments as jobs: taken from the cache, or made side by side and kept there."""

from __future__ import annotations

import json
import logging
import time
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from stiffscope.errors import InputError
from stiffscope.experiments.results import EXPERIMENT, FIELDS, SOLID, CondensedPart, PartResult
from stiffscope.runtime.workers import LateError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from stiffscope.cad.part import Part
    from stiffscope.experiments.orders import PartOrder
    from stiffscope.fea.experiment import Experiment
    from stiffscope.runtime.cache import Cache
    from stiffscope.runtime.workshop import Workshop

    Report = Callable[[str, float], None]
    Result = TypeVar("Result", bound=CondensedPart)

log = logging.getLogger(__name__)

AFTER_REFINEMENT = 1.5  # times the limit, until the modes of the last mesh are there
WHOLE, CONDENSED, MOVED = "experiment", "condensed", "moved"  # kinds of results in the cache


def solve_parts(orders: Sequence[PartOrder], shop: Workshop) -> list[PartResult]:
    """Take virtual experiments from the cache, or make them.

    Parameters
    ----------
    orders
        What to test; equal orders are made once, those that differ need different labels.
    shop
        Where: cache, processes, progress.

    Returns
    -------
    list of PartResult
        One for each order. Neither CAD nor mesher is imported for what the cache has.

    Raises
    ------
    InputError
        A part cannot be built, meshed or held as asked.

    """
    found = _found(orders, shop, (WHOLE,), make_part, _whole)
    return [found[order] for order in orders]


def condense_parts(
    orders: Sequence[PartOrder], shop: Workshop, near: Mapping[str, CondensedPart] | None = None
) -> list[CondensedPart]:
    """As `solve_parts`, but without what only fields and natural frequencies need, in half of the time.

    The compliances are the same: `solve_parts` takes up the mesh that this leaves in the cache.

    Parameters
    ----------
    near
        By label, parts of slightly other dimensions or material, whose meshes are moved along where they can be. What
        comes of such a mesh is kept apart: nothing else takes it up.

    """
    kinds = (CONDENSED, WHOLE) if near is None else (CONDENSED, WHOLE, MOVED)
    found = _found(orders, shop, kinds, partial(make_condensed, near=near or {}), _condensed)
    return [found[order] for order in orders]


def try_parts(
    orders: Sequence[PartOrder], shop: Workshop, near: Mapping[str, CondensedPart]
) -> list[CondensedPart | None]:
    """As `condense_parts`; None for a part that cannot be built, meshed or solved."""
    found = _found(orders, shop, (CONDENSED, WHOLE, MOVED), partial(_try_condensed, near=near), _condensed)
    return [found.get(order) for order in orders]


def _try_condensed(
    order: PartOrder, cache: Cache, report: Report, near: Mapping[str, CondensedPart]
) -> tuple[Path | None, float]:
    try:
        return make_condensed(order, cache, report, near)
    except InputError as error:
        log.debug("left out: %s", error)
        report("done", 1.0)
        return None, 0.0


def _found(
    orders: Sequence[PartOrder],
    shop: Workshop,
    kinds: tuple[str, ...],
    make: Callable[[PartOrder, Cache, Report], tuple[Path | None, float]],
    read: Callable[[PartOrder, Path, float, bool], Result],
) -> dict[PartOrder, Result]:
    """What the cache holds of some kind by order, made first where it holds nothing; without what is not made."""
    found: dict[PartOrder, Result] = {}
    missing: list[PartOrder] = []
    for order in dict.fromkeys(orders):
        begun, key = time.perf_counter(), order.key()
        folder = next((held for kind in kinds if (held := shop.cache.get(kind, key)) is not None), None)
        if folder is None:
            missing.append(order)
        else:
            found[order] = read(order, folder, time.perf_counter() - begun, True)
    if missing:
        jobs = {order.label: (order, shop.cache) for order in missing}
        if len(jobs) < len(missing):
            raise ValueError("experiments that differ have the same label")
        lines = {label: shop.open_line(label) for label in jobs}
        limits = {each.label: _limit(each) for each in missing}
        try:
            made = shop.work(make, jobs, lines, limits)
        except LateError as late:
            cure = "choose a larger mesh.size, or a longer mesh.time_limit"
            raise InputError(f"{late.job}.mesh.time_limit: {str(late).partition(': ')[2]}; {cure}") from late
        for order in missing:
            folder, seconds = made[order.label]
            if folder is not None:
                found[order] = read(order, folder, seconds, False)
    return found


def _limit(order: PartOrder) -> float:
    """Seconds after which the whole experiment is ended; refinement checks its own time, and modes follow it."""
    return order.settings.time_limit * (1.0 if order.settings.tolerance is None else AFTER_REFINEMENT)


def _whole(order: PartOrder, folder: Path, seconds: float, reused: bool) -> PartResult:
    from stiffscope.fea.experiment import load_experiment

    solid = json.loads((folder / SOLID).read_text())
    return PartResult(order, order.key(), folder, load_experiment(folder / EXPERIMENT), solid, reused, seconds)


def _condensed(order: PartOrder, folder: Path, seconds: float, reused: bool) -> CondensedPart:
    from stiffscope.fea.experiment import load_experiment

    solid = json.loads((folder / SOLID).read_text())
    return CondensedPart(
        order, order.key(), folder, load_experiment(folder / EXPERIMENT, fields=False), solid, reused, seconds
    )


def make_part(order: PartOrder, cache: Cache, report: Report) -> tuple[Path, float]:
    """Make an experiment and keep it: its folder, and the seconds that it took. May run in a child process."""
    begun = time.perf_counter()
    held = cache.get(CONDENSED, order.key())
    with _named(order):
        folder = cache.put(WHOLE, order.key(), lambda aside: _write(order, aside, report, held))
    report("done", 1.0)
    return folder, time.perf_counter() - begun


def make_condensed(
    order: PartOrder, cache: Cache, report: Report, near: Mapping[str, CondensedPart]
) -> tuple[Path, float]:
    """As `make_part`, of a part that is condensed only."""
    begun = time.perf_counter()
    former = near.get(order.label)
    if former is not None and not order.moves_from(former.order):
        former = None
    with _named(order):
        part, condensed = _condense(order, report, former)
        kind = MOVED if condensed.moved else CONDENSED
        folder = cache.put(kind, order.key(), lambda aside: _write_condensed(part, condensed, aside))
    report("done", 1.0)
    return folder, time.perf_counter() - begun


@contextmanager
def _named(order: PartOrder) -> Iterator[None]:
    """Let every refusal of the mesh or the solution begin with its part's name, as those of fields do."""
    from stiffscope.fea.mesh import MeshError

    try:
        yield
    except MeshError as error:
        raise MeshError(f"{order.label}.{str(error).removeprefix(f'{order.label}.')}") from error


def _write(order: PartOrder, folder: Path, report: Report, held: Path | None) -> None:
    from stiffscope.cad.step import write_step, write_stl
    from stiffscope.fea.experiment import load_experiment
    from stiffscope.fea.export import write_vtu
    from stiffscope.fea.run import run_experiment

    part, stage, built = _built(order, report)
    former = None if held is None else load_experiment(held / EXPERIMENT, fields=False)
    experiment = run_experiment(part, order.settings, stage, former=former)
    experiment.seconds["cad"] += built
    report("files", 0.97)
    experiment.save(folder / EXPERIMENT)
    write_vtu(experiment, folder / FIELDS)
    write_step(part, folder / f"{part.name}.step")
    write_stl(part, folder / f"{part.name}.stl")
    (folder / SOLID).write_text(json.dumps(_solid(part)))


def _condense(order: PartOrder, report: Report, former: CondensedPart | None) -> tuple[Part, Experiment]:
    from stiffscope.fea.run import run_experiment

    part, stage, built = _built(order, report)
    near = None if former is None else (former.order.build(), former.experiment.mesh)
    condensed = run_experiment(part, order.settings, stage, near=near, whole=False)
    condensed.seconds["cad"] += built
    return part, condensed


def _write_condensed(part: Part, condensed: Experiment, folder: Path) -> None:
    condensed.save(folder / EXPERIMENT)
    (folder / SOLID).write_text(json.dumps(_solid(part)))


def _built(order: PartOrder, report: Report) -> tuple[Part, Report, float]:
    """The part, how its experiment reports, and the seconds that CAD took."""
    begun = time.perf_counter()
    report("cad", 0.02)
    part = order.build()
    return part, lambda stage, fraction: report(stage, 0.1 + 0.85 * fraction), time.perf_counter() - begun


def _solid(part: Part) -> dict[str, Any]:
    """What cad tells of a part's solid, SI."""
    from stiffscope.cad.faces import face_geometries
    from stiffscope.cad.part import mass_properties

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

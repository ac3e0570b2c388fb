"""Virtual experiments as jobs, read from the cache or run in parallel, and their results."""

from __future__ import annotations

import json
import logging
import time
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError, require
from stiffscope.experiments.making import EXPERIMENT, SOLID, Neighbour, make_part
from stiffscope.fea.experiment import load_experiment
from stiffscope.robot.part_matrices import beam_compliance
from stiffscope.runtime.cache import CONDENSED, MOVED, WHOLE
from stiffscope.runtime.executor import LateError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from stiffscope.experiments.part_order import PartOrder
    from stiffscope.fea.experiment import Experiment
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.workshop import Workshop

log = logging.getLogger(__name__)

AFTER_REFINEMENT = 1.5  # times the limit, to allow for the modes of the last mesh
DYNAMICS = (
    "self_weight",
    "self_weight_error",
    "frequencies",
    "frequency_error",
    "mode_squares",
    "mode_squares_error",
    "condensed_mass",
)


@dataclass(frozen=True)
class PartResult:
    """A part's virtual experiment and its cached files.

    Attributes
    ----------
    order, key : order of the experiment, and its cache key.
    folder : its files: experiment (npz) and, if whole, fields (vtu) and solid (STEP, STL).
    experiment : response to unit wrenches; no fields and modes if only the compliance was computed.
    solid : CAD properties: mass in kg, mass_centre in m, inertia in kg·m², clamped_centre (of the
        clamped faces) in m, face numbers.
    reused, seconds : whether it was cached, and the time it took now.
    """

    order: PartOrder
    key: str
    folder: Path
    experiment: Experiment
    solid: dict[str, Any]
    reused: bool
    seconds: float

    @property
    def name(self) -> str:
        """Name of the part."""
        return self.order.name

    @property
    def compliance(self) -> np.ndarray:
        """Compliance (6m, 6m) of the m loaded ends at their reference points, part axes."""
        return self.experiment.full_compliance

    @property
    def error(self) -> np.ndarray:
        """95 % bounds (6m, 6m) on the compliance."""
        return self.experiment.full_error

    @property
    def note(self) -> str:
        """One line on why a requested tolerance was not met; empty if met or not requested."""
        return self.experiment.note

    @property
    def accuracy(self) -> dict[str, Any]:
        """Requested tolerance, largest bound, reason if it exceeds the tolerance, and mesh size."""
        mesh = self.experiment.mesh
        return {
            "tolerance": self.order.settings.tolerance,
            "relative_bound": self.experiment.relative_bound,
            "note": self.note,
            "mesh": {
                "nodes": len(mesh.points),
                "tetrahedra": len(mesh.cells),
                "order": 2,
            },
        }

    @property
    def own_shape(self) -> bool:
        """Whether the solid is the robot file's parametric shape, not a STEP file's."""
        return self.order.step is None

    @property
    def mass(self) -> float:
        """Mass of the solid, kg."""
        return self.solid["mass"]

    @property
    def length(self) -> float:
        """Distance from the clamped faces to the reference point along the part's x, m."""
        return float(
            self.experiment.reference_point[0] - self.solid["clamped_centre"][0]
        )

    @property
    def facts(self) -> dict[str, Any]:
        """Results of a whole experiment except its fields, as plain numbers, SI."""
        experiment = self.experiment
        order = self.order

        def read(*names: str) -> dict[str, Any]:
            return {name: getattr(experiment, name) for name in names}

        together: dict[str, Any] = {}
        if len(experiment.reference_points) > 1:
            together = {
                "interfaces": list(experiment.interfaces),
                **read("places", "reference_points"),
                "flexibility": experiment.full_compliance,
                "flexibility_error": experiment.full_error,
                **read("stiffness", "stiffness_error"),
            }
        return {
            "part": self.name,
            **read("compliance", "error", "reference_point"),
            **together,
            **read("interface"),
            "foundation": order.settings.foundation,
            **self.accuracy,
            "axes": order.axes,
            "solid": order.step.path.name if order.step else "parametric",
            **read("volume", "cad_volume"),
            **{name: self.solid[name] for name in ("mass", "mass_centre", "inertia")},
            **read(*DYNAMICS, "seconds"),
        }


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
    kinds = (
        [WHOLE]
        if whole
        else [CONDENSED, WHOLE]
        if near is None
        else [CONDENSED, WHOLE, MOVED]
    )
    results: dict[PartOrder, PartResult] = {}
    missing: list[PartOrder] = []
    for order in dict.fromkeys(orders):
        begun = time.perf_counter()
        held = shop.cache.load(
            kinds, order.key(), partial(_read, order, whole=whole, reused=True)
        )
        if held is None:
            missing.append(order)
        else:
            results[order] = replace(held, seconds=time.perf_counter() - begun)
    if missing:
        neighbours = {
            label: Neighbour(result.order, result.experiment)
            for label, result in (near or {}).items()
        }
        make = partial(make_part, whole=whole, near=neighbours, skip=skip)
        for order, (folder, seconds) in _make_missing(missing, shop, make).items():
            if folder is not None:
                result = _read(order, folder, whole=whole, reused=False)
                results[order] = replace(result, seconds=seconds)
    return [results[order] for order in orders if order in results]


def _make_missing(
    missing: Sequence[PartOrder], shop: Workshop, make: Callable[..., Any]
) -> dict[PartOrder, Any]:
    jobs = {order.label: (order, shop.cache) for order in missing}
    if len(jobs) < len(missing):
        raise ValueError("experiments that differ have the same label")
    limits = {order.label: order.settings.time_limit for order in missing}
    for order in missing:  # refinement checks its own time, and modes follow it
        limits[order.label] *= (
            1.0 if order.settings.tolerance is None else AFTER_REFINEMENT
        )
    try:
        results = shop.work(make, jobs, limits)
    except LateError as late:
        message = str(late).partition(": ")[2]
        cure = "choose a larger mesh.size, or a longer mesh.time_limit"
        raise InputError(f"{late.job}.mesh.time_limit: {message}; {cure}") from late
    return {order: results[order.label] for order in missing}


def _read(order: PartOrder, folder: Path, *, whole: bool, reused: bool) -> PartResult:
    solid = json.loads((folder / SOLID).read_text())
    shapes = {
        "mass": (),
        "mass_centre": (3,),
        "clamped_centre": (3,),
        "inertia": (3, 3),
    }
    for name, shape in shapes.items():
        require(
            np.shape(solid[name]) == shape and np.isfinite(solid[name]).all(),
            "",
            f"finite numbers of {name}",
        )
    experiment = load_experiment(folder / EXPERIMENT, fields=whole)
    return PartResult(
        order=order,
        key=order.key(),
        folder=folder,
        experiment=experiment,
        solid=solid,
        reused=reused,
        seconds=0.0,
    )


def compliance_json(robot: RobotFile, result: PartResult) -> dict[str, Any]:
    """Return a part's results as JSON data; beam theory for the shapes that have one."""
    theory = result.own_shape and "beam" in robot.part(result.name).sources
    beam = beam_compliance(robot, result.name) if theory else None
    return {**result.facts, "beam": beam, "cached": result.reused}

"""Adaptive refinement until the error bound of every significant entry meets the tolerance."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.experiment import largest_relative_bound
from stiffscope.fea.mesh import EDGES, Floats, MeshError, TetMesh, edge_length
from stiffscope.fea.refine import bisect
from stiffscope.fea.singular import singular_edges
from stiffscope.fea.solution import Solution, solve_specimen
from stiffscope.fea.specimen import GRADING_RATIO, PATIENCE, Specimen, mesh_specimen

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.fea.settings import Settings

logger = logging.getLogger(__name__)

SHAPE_SHARE = 0.5  # of the tolerance: beyond, a geometric error requires a finer mesh
FINER = 0.6  # ratio of new to old mesh size
REMAINS = (
    0.15  # of an element's error after refinement: 0.25^(2λ) = 0.14 at singular edges
)
AIM = 0.9  # of the tolerance
LEAST_LEFT = 0.05  # share of the error that unrefined elements may always keep
WITH_MODES = (
    2.0  # ratio of total time with natural frequencies to that of the solution alone
)
GROWTH = 6.0  # largest ratio of element counts after and before a round


def solve_within(
    specimen: Specimen,
    mesh: TetMesh,
    settings: Settings,
    progress: Callable[[str, float], None],
    left: float,
    *,
    modes: bool = True,
) -> tuple[TetMesh, Solution, str]:
    """Solve; with a tolerance, refine and solve again until it is met or a limit is reached.

    Parameters
    ----------
    left : seconds left of the settings' time limit.
    modes : whether natural frequencies follow, for which time is reserved.

    Returns
    -------
    The last mesh, its solution, and one line on why the tolerance is not met (empty if it is).
    """

    def stop_at(limit: str, why: str) -> tuple[TetMesh, Solution, str]:
        return mesh, solution, _shortfall(solution, settings, limit, why)

    begun = time.perf_counter()
    solution = solve_on(specimen, mesh, settings)
    tolerance = settings.tolerance
    if tolerance is None:
        return mesh, solution, ""
    size = settings.size or edge_length(mesh)
    rounds = 0
    spent = time.perf_counter() - begun
    while (
        bound := largest_relative_bound(solution.compliance, solution.error)[0]
    ) > tolerance:
        rounds += 1
        progress("refine", min(1.0, tolerance / bound))
        shape = largest_relative_bound(
            solution.compliance, solution.extrapolated.geometry
        )[0]
        if shape > SHAPE_SHARE * tolerance:
            size = size * FINER
            why = f"the mesh's shape alone leaves {100 * shape:.2g} %"
            try:
                rest = left - (time.perf_counter() - begun)
                again = replace(settings, size=size, envelope=None)
                finer = make_mesh(specimen, again, rest, rest / 4)
            except MeshError as error:
                return stop_at(
                    "the mesher's limit", f"{why}; {str(error).partition(';')[0]}"
                )
        else:
            finer = refine_mesh(specimen, mesh, solution.indicator, settings, bound)
            why = ""
        growth = len(finer.cells) / len(mesh.cells)
        elapsed = time.perf_counter() - begun
        if growth * solution.unknowns > settings.most_unknowns:
            return stop_at(f"the limit of {settings.most_unknowns} unknowns", why)
        if elapsed + (WITH_MODES if modes else 1.0) * 1.5 * growth * spent > left:
            return stop_at(f"the limit of {settings.time_limit:g} s", why)
        started = time.perf_counter()
        try:
            solution = solve_on(specimen, finer, settings)
            mesh = finer
        except MeshError as error:
            return stop_at("the last mesh that could be solved", str(error))
        spent = time.perf_counter() - started
        told = specimen.name, rounds, len(mesh.cells), bound
        logger.info("%s: round %d, %d tetrahedra, bound was %.3g", *told)
    return mesh, solution, ""


def solve_on(specimen: Specimen, mesh: TetMesh, settings: Settings) -> Solution:
    """Solve on one mesh without refinement.

    Parameters
    ----------
    specimen, mesh
        Part as plain numbers, and its mesh.
    settings
        Interface, solver and foundation; its tolerance has no effect.
    """
    flat = specimen.slender or specimen.flatness_on(mesh) > 1
    solver = "direct" if settings.solver == "auto" and flat else settings.solver
    return solve_specimen(
        specimen, mesh, settings.interface, solver, settings.foundation
    )


def make_mesh(
    specimen: Specimen, settings: Settings, left: float, patience: float = PATIENCE
) -> TetMesh:
    """Mesh a specimen with its settings.

    Parameters
    ----------
    left : seconds left of the settings' time limit.
    patience : seconds after which no further attempt at a better geometry starts.
    """
    return mesh_specimen(
        specimen,
        size=settings.size,
        envelope=settings.envelope,
        layers=settings.layers,
        rigid=settings.interface == "rigid",
        time_limit=max(left, 1.0),
        threads=settings.threads,
        patience=patience,
        tolerance=settings.tolerance,
    )


def _on_singular_edges(
    specimen: Specimen, mesh: TetMesh, settings: Settings
) -> np.ndarray:
    """Return which vertices lie on singular edges, (nodes,)."""
    edges, _ = singular_edges(
        mesh, specimen.list_fixed(rigid=settings.interface == "rigid")
    )
    return np.isin(np.arange(len(mesh.points)), edges)


def refine_mesh(
    specimen: Specimen,
    mesh: TetMesh,
    indicator: Floats,
    settings: Settings,
    bound: float,
) -> TetMesh:
    """Return the mesh with the fewest elements refined that should meet the tolerance.

    Edges that leave a singular edge are cut near it; elsewhere the long edges are halved.

    Parameters
    ----------
    specimen
        Solid, faces and material as plain numbers.
    mesh
        Quadratic tetrahedra of the solid.
    indicator
        Error of each element.
    settings
        Mesh, interface and solver settings.
    bound
        Relative bound of the present solution.
    """
    left = (AIM * (settings.tolerance or bound) / bound - REMAINS) / (1 - REMAINS)
    order = np.argsort(-indicator)
    rest = 1 - np.cumsum(indicator[order]) / indicator.sum()
    count = int(np.searchsorted(-rest, -max(left, LEAST_LEFT))) + 1
    chosen = order[: min(count, max(1, int(GROWTH / 8 * len(order))))]
    on_chain = _on_singular_edges(specimen, mesh, settings)
    pairs = mesh.cells[chosen][:, EDGES]  # (k, 6, 2)
    touched = np.take(on_chain, mesh.cells[chosen, :4])  # (k, 4)
    touching = touched.any(axis=1) & ~touched.all(axis=1)
    leaving = pairs[touching].reshape(-1, 2)
    leaving = leaving[on_chain[leaving].sum(axis=1) == 1]
    leaving = np.where(on_chain[leaving[:, :1]], leaving, leaving[:, ::-1])
    length = np.linalg.norm(
        mesh.points[pairs[..., 0]] - mesh.points[pairs[..., 1]], axis=2
    )
    is_long = length > 0.6 * length.max(axis=1, keepdims=True)
    halved = pairs[is_long & np.logical_not(touching)[:, None]]
    halved = halved[on_chain[halved].sum(axis=1) != 1]
    marked = np.unique(np.vstack([leaving, np.sort(halved, axis=1)]), axis=0)
    at = np.where(on_chain[marked].sum(axis=1) == 1, GRADING_RATIO, 0.5)
    return bisect(mesh, marked, at)


def _shortfall(solution: Solution, settings: Settings, limit: str, why: str) -> str:
    """Return the bound reached, the limit and the reason; by default the error's location."""
    bound, (i, j) = largest_relative_bound(solution.compliance, solution.error)
    if not why:
        mesh = solution.system.mesh
        indicator = solution.indicator
        near = _on_singular_edges(solution.system.specimen, mesh, settings)[
            mesh.cells
        ].any(axis=1)
        share = indicator[near].sum() / indicator.sum()
        why = f"{share:.0%} of the estimated error is at borders of fixed faces and re-entrant edges"
    reached = f"the bound of C{i + 1}{j + 1} reached {bound:.3g} at {limit}"
    return f"tolerance {settings.tolerance:.3g} not met: {reached}; {why}"

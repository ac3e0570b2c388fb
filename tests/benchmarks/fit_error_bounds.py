"""Fit the constants of the error bounds in ``stiffscope.fea.solution`` to random parts, and print them.

``STIFFSCOPE_PARTS=49 STIFFSCOPE_SEED=3 python -m tests.benchmarks.fit_error_bounds``. Each part is solved on its
default mesh and on one refined until its own bound is FINER times tighter. With the errors of the cubic compliance C
against the finer one, all in parts of sqrt(C_ii C_jj), the theory's estimate a at singular edges and the gain g of
cubic on quadratic elements:

- AT_EDGES and ELSEWHERE are the non-negative least squares of C_ii,finer - C_ii = AT_EDGES a_ii + ELSEWHERE g_ii, each
  row divided by its estimate a_ii + g_ii, so that small errors count as much as large ones;
- SPREAD_ELSEWHERE is ELSEWHERE (its lower limit is zero), and SPREAD_AT_EDGES the 95 % quantile of what residuals
  exceed that by, over a_ii;
- CROSS_TERMS is the 95 % quantile of what the residuals of off-diagonal entries exceed both spreads by, over the
  geometric mean of the two remaining errors.

The finer solution is extrapolated with the present constants, which the fit therefore confirms to some 1 / FINER only.
"""

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from scipy.optimize import nnls

from stiffscope.fea import solution
from stiffscope.fea.mesh import MeshError
from stiffscope.fea.run import run_experiment, specimen_of
from stiffscope.fea.settings import Settings
from tests.benchmarks.random_parts import draw

PARTS, SEED = (
    int(os.environ.get(f"STIFFSCOPE_{name}", value))
    for name, value in (("PARTS", 49), ("SEED", 3))
)
FINER = 8
COVERED = 0.95
UPPER = np.triu_indices(6, 1)


def errors(number):
    """True error, estimate at edges and gain (6, 6) of a random part's cubic compliance, relative; and a line."""
    rng = np.random.default_rng([SEED, number])
    while True:
        part, interface = draw(rng)
        try:
            ours = run_experiment(part, Settings(interface=interface))
            wanted = max(ours.relative_bound / FINER, 2e-5)
            finer = run_experiment(
                part, Settings(interface=interface, tolerance=wanted)
            ).compliance
            found = solution.solve_specimen(
                specimen_of(part, Settings()), ours.mesh, interface, "auto"
            )
        except MeshError:
            continue
        scale = np.sqrt(np.outer(finer.diagonal(), finer.diagonal()))
        rows = tuple(
            values / scale
            for values in (finer - found.cubic, found.at_edges, found.gain)
        )
        return (
            rows,
            f"{number:3d} {part.name:7s} {interface:12s} bound {ours.relative_bound:.1e}, finer {wanted:.1e}",
        )


def fit(true, at_edges, gain):
    """The constants by name, from (n, 6, 6) arrays."""
    true_own, edge_own, gain_own = (
        np.diagonal(x, axis1=1, axis2=2).ravel() for x in (true, at_edges, gain)
    )
    weight = 1 / np.maximum(edge_own + gain_own, 1e-9)
    (edge, other), _ = nnls(
        np.stack([edge_own, gain_own], 1) * weight[:, None], true_own * weight
    )
    touched = (
        edge_own > 0.05 * gain_own
    )  # else the edges are not what the error is made of
    rest = np.abs(true_own - edge * edge_own - other * gain_own) - other * gain_own
    spread = max(
        0.0, np.quantile((rest / np.maximum(edge_own, 1e-12))[touched], COVERED)
    )
    remaining = edge * at_edges + other * gain
    roots = np.sqrt(np.maximum(np.diagonal(remaining, axis1=1, axis2=2), 1e-24))
    means = roots[:, :, None] * roots[:, None, :]
    excess = np.abs(true - remaining) - spread * np.abs(at_edges) - other * np.abs(gain)
    cross = max(0.0, np.quantile((excess / means)[:, *UPPER], COVERED))
    return {
        "AT_EDGES": edge,
        "SPREAD_AT_EDGES": spread,
        "ELSEWHERE": other,
        "SPREAD_ELSEWHERE": other,
        "CROSS_TERMS": cross,
    }


def main():
    """Print a line a part, then the constants beside those in use."""
    rows = []
    os.environ["OMP_NUM_THREADS"] = "1"  # two parts at once
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        for row, said in pool.map(errors, range(1, PARTS + 1)):
            rows.append(row)
            print(said, flush=True)
    for name, value in fit(*np.transpose(rows, (1, 0, 2, 3))).items():
        print(f"{name:16s} fitted {value:.3f}, in use {getattr(solution, name)}")


if __name__ == "__main__":
    main()

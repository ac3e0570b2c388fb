"""Do the bounds hold, and are they tight? Random parts against a much finer solution of each.

``STIFFSCOPE_PARTS=50 STIFFSCOPE_SEED=5 pytest -m benchmark -s tests/benchmarks/test_fea_coverage.py``.
The finer solution has 0.7 of the element size and three thin layers at singular edges where the default has one:
its own bound is two to five times tighter, least at re-entrant edges, so that true errors there are underrated.

Measured with that command: 473 of 473 significant entries and 99.1 % of 577 small ones are covered, the median of
bound over true error is 3.7, the median true error 4e-4, the worst 1.8e-2 (a coupling term of a slider of 26 faces,
bound 4.4e-2). Constants 0.25 and 0.02 (``MISSING_AT_MOST``, ``CROSS_TERMS``) in place of 0.30 and 0.05 covered 94.7 %
of 133 entries of the first 14 parts, median 2.6.
"""

import os
import time

import numpy as np
import pytest

from cad.part import mass_properties
from fea.adapt import SIGNIFICANT
from fea.experiment import Settings, run_experiment
from fea.mesh import MeshError, default_size
from tests.benchmarks.random_parts import draw

PARTS, SEED = (int(os.environ.get(f"STIFFSCOPE_{name}", value)) for name, value in (("PARTS", 12), ("SEED", 6)))


def compare(part, interface):
    """Return true errors, bounds and sizes (21,) of the entries i <= j by sqrt(C_ii C_jj), and both experiments."""
    ours = run_experiment(part, Settings(interface=interface))
    size = 0.7 * default_size(mass_properties(part).volume, sum(face.area for face in part.faces))
    finer = run_experiment(part, Settings(size=size, layers=3, interface=interface, time_limit=300))
    scale = np.sqrt(np.outer(finer.compliance.diagonal(), finer.compliance.diagonal()))
    upper = np.triu_indices(6)
    return (
        (np.abs(ours.compliance - finer.compliance) / scale)[upper],
        (ours.error / scale)[upper],
        (np.abs(finer.compliance) / scale)[upper],
        ours,
        finer,
    )


def _square(flags):
    square = np.zeros((6, 6), dtype=bool)
    square[np.triu_indices(6)] = flags
    return square


@pytest.mark.benchmark
def test_bounds_cover_the_true_error_and_are_not_far_above_it():
    rng = np.random.default_rng(SEED)
    rows, begun = [], time.perf_counter()
    while len(rows) < PARTS:
        part, interface = draw(rng)
        try:
            true, bound, size, ours, finer = compare(part, interface)
        except MeshError as refused:
            print(f"{part.name} {interface}: {refused}")
            continue
        large = size > SIGNIFICANT
        rows.append((true, bound, large, size))
        missed = [f"C{i + 1}{j + 1}" for i, j in np.argwhere(_square((true > bound) & large))]
        print(
            f"{len(rows):3d} {part.name:7s} {interface:12s} {len(part.faces):3d} faces "
            f"{ours.unknowns:7d} unknowns {sum(ours.seconds.values()):5.1f} s | finer {finer.unknowns:7d} "
            f"{sum(finer.seconds.values()):5.1f} s | worst true {(true / size)[large].max():.2e} "
            f"bound {(bound / size)[large].max():.2e} | covered {(true <= bound)[large].sum()}/{large.sum()}, "
            f"small {(true <= bound)[~large].sum()}/{(~large).sum()}, "
            f"bound/true {np.median((bound / np.maximum(true, 1e-15))[large]):.1f} finer's bound "
            f"{(np.abs(finer.error) / np.abs(finer.compliance))[np.triu_indices(6)][large].max():.1e} missed {missed}",
            flush=True,
        )
    true, bound, large, size = (np.concatenate(column) for column in zip(*rows, strict=True))
    covered, small = (true <= bound)[large].mean(), (true <= bound)[~large].mean()
    ratio = np.median((bound / np.maximum(true, 1e-15))[large])
    print(
        f"{PARTS} parts in {time.perf_counter() - begun:.0f} s: {covered:.1%} of {large.sum()} entries covered "
        f"({small:.1%} of {(~large).sum()} small ones); median bound / true {ratio:.1f}; "
        f"median true error {np.median((true / size)[large]):.1e}, worst {(true / size)[large].max():.1e}"
    )
    assert covered >= 0.95
    assert ratio <= 5

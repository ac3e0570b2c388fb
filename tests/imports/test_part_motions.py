"""What two parts of many leave each other free: the reduced network against the null space of all constraints."""

from __future__ import annotations

import numpy as np
import pytest

from stiffscope.imports.part_motions import relative_freedom
from stiffscope.vjm.model.screws import shift


@pytest.mark.parametrize("seed", range(12))
def test_the_reduced_network_leaves_what_all_constraints_leave(seed):
    random = np.random.default_rng(seed)
    count = int(random.integers(3, 9))
    pairs = [
        tuple(random.choice(count, 2, replace=False))
        for _ in range(int(random.integers(count, 2 * count)))
    ]
    holds = []
    for one, other in pairs:
        held = random.permutation(6)[: int(random.choice([2, 4, 5, 5, 6]))]
        holds.append(
            (
                int(one),
                int(other),
                np.eye(6)[held] @ shift(random.integers(-1, 2, 3).astype(float)),
            )
        )
    blocks = []
    for one, other, rows in holds:
        block = np.zeros((len(rows), 6 * count))
        block[:, 6 * one : 6 * one + 6] = -rows
        block[:, 6 * other : 6 * other + 6] = rows
        blocks.append(block)
    _, values, vt = np.linalg.svd(np.vstack(blocks))
    free = vt[int(np.sum(values > 1e-9)) :].T
    found = relative_freedom(holds, 0, 1)
    wanted, sizes, _ = np.linalg.svd(free[6:12] - free[:6])
    wanted = wanted[:, : int(np.sum(sizes > 1e-9))]
    assert np.abs(found @ found.T - wanted @ wanted.T).max() < 1e-9

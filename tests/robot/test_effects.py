"""Mechanical effects: what each changes, whatever its parameters."""

import numpy as np
import pytest

from stiffscope.robot.effects import mechanical_effects
from tests.robots import nominal_robot


def test_a_part_with_any_entries_stays_positive_definite():
    """Laws of C = L phi(E) L': no change at zero, the entries round trip, and no parameters make energy."""
    robot = nominal_robot()
    rng = np.random.default_rng(4)
    matrices = [e for e in mechanical_effects(robot) if e.names[0] == "c11"]
    assert {len(e.names) for e in matrices} == {8, 21}
    for effect in matrices:
        here = robot.compliances[effect.members[0]]
        assert not effect.changes(np.zeros(len(effect.names)))[effect.members[0]].compliance.any()
        for size in (0.1, 3.0, 30.0):
            values = size * rng.standard_normal(len(effect.names))
            added = effect.changes(values)[effect.members[0]].compliance
            root = np.sqrt(np.diagonal(here))
            assert np.linalg.eigvalsh((here + added) / np.outer(root, root)).min() > 0.0
            assert effect.internal(effect.physical(values)) == pytest.approx(values, rel=1e-5, abs=1e-6 * size)

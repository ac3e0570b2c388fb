"""Speed of the search over sets of effects, on a linear forward model that costs nothing itself."""

import time

import numpy as np
import pytest

from stiffscope.gap.diagnose import conclude
from stiffscope.gap.findings import find
from tests.gap.synthetic import linear_model
from tests.gap.test_inference import planted


@pytest.mark.benchmark
@pytest.mark.parametrize(("poses", "loads", "effects", "limit"), [(111, 12, 200, 30.0), (14, 6, 200, 5.0)])
def test_four_effects_among_two_hundred(poses, loads, effects, limit):
    model = linear_model(np.random.default_rng(1), poses, loads, effects)
    model = planted(model, e0=(0.2,), e7=(0.1, 0.1), e20=(0.1, -0.1, 0.2), e51=(0.15,))
    before = time.process_time()
    diagnosis = conclude(find(model))
    taken = time.process_time() - before
    print(f"{len(model.campaign)} readings, {effects} effects: {taken:.1f} s of processor time, {diagnosis.verdict}")
    assert {e.effect for e in diagnosis.effects} == {"effect-0", "effect-7", "effect-20", "effect-51"}
    assert taken < limit

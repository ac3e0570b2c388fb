"""How often the diagnosis is right, honest and falsely certain in the second laboratory."""

import time
from collections import Counter

import pytest

from stiffscope.gap.diagnose import conclude
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.inference.find import find
from tests.benchmarks.second_lab import CYCLE, SPREAD, campaign_of, names_of, scored

pytestmark = pytest.mark.slow

ROUNDS = 2


@pytest.mark.benchmark
@pytest.mark.parametrize("seed", [1])
def test_single_effects_with_sizes_over_decades(seed):
    """Single effects on six robots, and sound ones: 84 campaigns of 180 readings in two rounds."""
    count = Counter()
    began = time.process_time()
    for number in range(ROUNDS * len(CYCLE)):
        for robot in SPREAD:
            campaign, planted, nominal = campaign_of(robot, number, seed)
            model = RobotModel(campaign, nominal)
            found = conclude(find(model))
            score = scored(
                found, names_of(model, planted.name) if planted.name else set()
            )
            count[score] += 1
            if score != "right":
                named = [
                    (
                        f"{e.effect} @ {e.place}",
                        round(e.probability, 2),
                        e.confused_with,
                    )
                    for e in found.effects
                ]
                print(
                    f"{score}: {nominal.robot.name}, {planted.name} {planted.size}: {found.verdict} {named}"
                )
    total = sum(count.values())
    print(
        f"{dict(count)} of {total} in {time.process_time() - began:.0f} s of processor"
    )
    assert (
        count["right"] >= 0.8 * total
    )  # a strut's drive, part, foot and head are one to all readings at M
    assert count["right"] + count["honest"] >= 0.95 * total
    assert count["false"] <= 0.02 * total

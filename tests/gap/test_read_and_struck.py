"""Static readings and frequency responses of one simulated machine, apart and in one posterior."""

from dataclasses import dataclass

import numpy as np
import pytest

from stiffscope.gap.campaign.measured_responses import load_responses
from stiffscope.gap.campaigns import open_case, rough_mechanism
from stiffscope.gap.diagnose import conclude, forward_model
from stiffscope.gap.inference.find import find
from stiffscope.gap.inference.findings import Findings
from stiffscope.robot.nominal import NominalRobot
from tests.benchmarks.knocks import write

pytestmark = [pytest.mark.slow, pytest.mark.extended]


@dataclass(frozen=True)
class Answer:
    """A search and its diagnosis, of readings, of responses or of both."""

    found: Findings
    said: object

    @property
    def growth(self):
        """Internal parameter of the only effect, with its standard deviation."""
        known = self.found.fit_effects(self.found.best.words)
        return float(known.values[0]), float(np.sqrt(known.covariance[0, 0]))

    def leave(self, name, value):
        """χ² per reading that an effect with this parameter leaves."""
        model = self.found.model
        effect = next(c for c in model.library if c.name == name)
        values = model.predict(((effect, (value,)),)).values
        left = (model.campaign.value - values) / self.found.problem.noise.sigma
        return float(np.mean(left[self.found.used_readings] ** 2))


def answer(folder, *, read, struck):
    case = open_case(folder)
    nominal = NominalRobot(rough_mechanism(case.robot), case.robot)
    responses = load_responses(folder, case.campaign, case.robot, nominal.mechanism)
    campaign = case.campaign if read else case.campaign.select(np.zeros(0, dtype=int))
    model = forward_model(campaign, nominal, responses if struck else ())
    found = find(model)
    return Answer(found, conclude(found))


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    folder = tmp_path_factory.mktemp("machine")
    write(folder, "delta", "drive", 921, read=True)
    return {
        "read": answer(folder, read=True, struck=False),
        "struck": answer(folder, read=False, struck=True),
        "both": answer(folder, read=True, struck=True),
    }


def test_apart_and_together_they_find_one_cause(answers):
    names = {
        tuple(f"{e.effect} @ {e.place}" for e in each.said.effects)
        for each in answers.values()
    }
    assert len(names) == 1
    assert {each.said.verdict for each in answers.values()} == {"identified"}


def test_apart_they_agree_and_predict_each_other(answers):
    read = answers["read"]
    struck = answers["struck"]
    (effect,) = read.said.effects
    name = f"{effect.effect} @ {effect.place}"
    (one, wide), (other, narrow) = read.growth, struck.growth
    assert abs(one - other) < 2.0 * np.hypot(wide, narrow)
    assert read.leave(name, other) < 1.3
    within = np.linspace(one - 2.0 * wide, one + 2.0 * wide, 9)
    assert min(struck.leave(name, value) for value in (*within, other)) < 1.3
    assert read.leave(name, 0.0) > 10.0
    assert struck.leave(name, 0.0) > 10.0


def test_together_they_are_no_less_certain_and_both_are_held_out(answers):
    sigmas = {key: each.growth[1] for key, each in answers.items()}
    assert sigmas["both"] <= 1.01 * min(sigmas["read"], sigmas["struck"])
    gaps = answers["both"].said.gap.absolute
    for kind in ("displacement", "response", "frequency"):
        gap = gaps[kind]
        assert 0.95 * gap.after < gap.held_out < 1.2 * gap.after
        assert gap.held_out < 0.2 * gap.before

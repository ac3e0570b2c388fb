"""Hammer tests of robots with close modes, and of machines far from their model.

Responses are those of the laboratory's dense model (``tests.benchmarks.knocks``).
"""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.gap.campaign.measured_responses import load_responses
from stiffscope.gap.campaigns import diagnose, open_case, rough_mechanism
from stiffscope.gap.diagnose import forward_model
from stiffscope.robot.nominal import NominalRobot
from tests.benchmarks import knocks

pytestmark = pytest.mark.slow


@pytest.mark.extended
def test_damping_of_close_modes_fitted_in_shorter_steps_is_no_better(tmp_path):
    knocks.write(tmp_path, "orthoglide", "nothing", 6101)
    case = open_case(tmp_path)
    nominal = NominalRobot(rough_mechanism(case.robot), case.robot)
    responses = load_responses(tmp_path, case.campaign, case.robot, nominal.mechanism)
    model = forward_model(case.campaign, nominal, responses)
    for state in model.predict().states:

        def measure(own):
            block = own.block
            seen = np.concatenate([block.value.real.ravel(), block.value.imag.ravel()])
            sigma = np.tile(block.sigma.ravel(), 2)
            return float(np.sum(((seen - own.values) / sigma) ** 2))

        shorter = replace(state.settings, step=0.3, rounds=60)
        patient = measure(replace(state, settings=shorter, _fields={}))
        assert measure(state) < patient + 4.0  # two standard deviations
        assert measure(state) < 1.05 * len(state.block)


@pytest.mark.long
def test_a_base_that_moves_modes_far_is_found(tmp_path):
    knocks.write(tmp_path, "delta", "base", 6101)
    found = diagnose(tmp_path)
    assert found.verdict == "identified"
    assert [effect.effect for effect in found.effects] == ["base-compliance"]

"""The bundled hammer test is what the laboratory measures, and shows its withheld cause."""

from pathlib import Path

import numpy as np
import pytest

from stiffscope.gap.campaigns import campaign_names, diagnose
from stiffscope.responses.uff import read_uff
from tests.lab import knock

BUNDLED = Path(__file__).parents[2] / "data" / "campaigns" / "knock"

pytestmark = pytest.mark.slow


def test_the_bundled_file_is_that_of_the_laboratory(tmp_path):
    knock.make(tmp_path)
    assert (tmp_path / "campaign.toml").read_text() == (
        BUNDLED / "campaign.toml"
    ).read_text()
    made, kept = (read_uff(each / "tap.uff") for each in (tmp_path, BUNDLED))
    assert len(kept.responses) == 24
    assert (BUNDLED / "tap.uff").stat().st_size < 300_000
    for ours, theirs in zip(made.responses, kept.responses, strict=True):
        assert (ours.force, ours.motion) == (theirs.force, theirs.motion)
        size = np.abs(theirs.receptance).max()
        assert ours.receptance == pytest.approx(theirs.receptance, abs=1e-6 * size)


@pytest.mark.extended
def test_the_withheld_cause_is_found():
    assert "knock" in campaign_names()
    found = diagnose("knock")
    assert found.verdict == "identified"
    (effect,) = found.effects
    word, place, truth = knock.CAUSE
    assert effect.effect == word
    assert f"{word} @ {place}" in {f"{word} @ {effect.place}", *effect.confused_with}
    factor = effect.parameters["factor"]
    assert factor.value == pytest.approx(truth["factor"], abs=3 * factor.sigma)
    assert factor.sigma < 1e-3
    (modes,) = found.responses.values()
    assert all(mode.mac_after > 0.9 for mode in modes.modes if mode.mac_before > 0.7)

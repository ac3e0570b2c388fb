"""What the diagnosis names on synthetic humanoids, seen by a camera that stands anywhere."""

import time

import pytest

import stiffscope as ss
from tests.benchmarks.humanoid import write_campaign

pytestmark = pytest.mark.slow

POSES = 200
CASES = {
    "all wrong": (
        {},
        {
            "geometry @ robot",
            "actuator-stiffness @ torso",
            "actuator-stiffness @ shoulders",
        },
    ),
    "geometry alone": ({"soft": False}, {"geometry @ robot"}),
    "nothing wrong": ({"soft": False, "bent": False}, set()),
}


@pytest.mark.benchmark
@pytest.mark.parametrize("seed", range(1, 11))
@pytest.mark.parametrize("case", CASES)
def test_humanoid(case, seed, tmp_path):
    """Positions of both hands of a tree of 18 drives: soft groups and geometry by name, and nothing else."""
    changes, expected = CASES[case]
    folder = write_campaign(tmp_path / "humanoid", seed, poses=POSES, **changes)
    began = time.process_time()
    found = ss.diagnose(folder)
    gap = found.gap.absolute["position"]
    seconds = time.process_time() - began
    print(
        f"{case}, seed {seed}: {found.verdict}, held out {1e3 * gap.held_out:.2f} mm, {seconds:.0f} s of processor"
    )
    assert {f"{each.effect} @ {each.place}" for each in found.effects} == expected
    assert gap.held_out < 1.2 * gap.noise

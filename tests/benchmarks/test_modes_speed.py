"""Natural frequencies a second, every pose by itself, loops closed.

pytest -m benchmark tests/benchmarks/test_modes_speed.py -s
"""

import time

import numpy as np
import pytest

import stiffscope as ss
from stiffscope.vjm.vibration.modes import frequencies
from tests.robots import random_poses
from tests.vjm.test_modes import rigid_hexapod

pytestmark = pytest.mark.benchmark


def test_first_six_frequencies_of_many_poses(rng, capsys):
    hexapod = rigid_hexapod(rng)
    robots = {
        "Biglide, published matrices": (
            ss.assemble(ss.load_robot("biglide"), "published"),
            random_poses(rng, 1000),
        ),
        "Biglide, beams with six modes": (
            ss.assemble(ss.load_robot("biglide"), "beam"),
            random_poses(rng, 1000),
        ),
        "hexapod of rigid legs": (
            hexapod,
            hexapod.tool.home + rng.uniform(-0.01, 0.01, (1000, 6)),
        ),
    }
    for name, (m, poses) in robots.items():
        wall = time.perf_counter()
        cpu = time.process_time()
        found = frequencies(m, poses, 6)
        wall = time.perf_counter() - wall
        cpu = time.process_time() - cpu
        alone = np.array([frequencies(m, pose, 6)[0] for pose in poses[:20]])
        with capsys.disabled():
            print(
                f"\n{name}: {len(poses)} poses in {wall:.2f} s ({cpu:.2f} s CPU), f1 {np.nanmin(found[:, 0]):.1f} to "
                f"{np.nanmax(found[:, 0]):.1f} Hz"
            )
        assert found[:20] == pytest.approx(alone, rel=1e-9, nan_ok=True)

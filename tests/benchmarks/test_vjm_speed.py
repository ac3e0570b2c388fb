"""Poses a second: the whole 6x6 without gravity, with exact gravity, a map, and a loop of a frame-analysis library.

pytest -m benchmark tests/benchmarks/test_vjm_speed.py -s
"""

import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from stiffscope.vjm.analysis import stiffness
from stiffscope.vjm.biglide import pose_at
from stiffscope.vjm.maps import workspace_map
from tests.robots import DRIVE, GEOMETRY, euler_bernoulli, random_poses

pytestmark = pytest.mark.benchmark
UNIT_LOADS = ("FX", "FY", "FZ", "MX", "MY", "MZ")


def timed(work, repeats=3):
    """Best wall time of a few runs, s."""
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - start)
    return best


def many(n):
    """Reachable tool points, all at different heights."""
    return random_poses(np.random.default_rng(1), n)


def test_poses_per_second(robot, capsys):
    plain, loaded = many(200_000), many(20_000)
    each = robot.edited(lambda tree: tree)  # whose poses may all differ: none is told from others
    rates = {
        "6x6 without gravity": len(plain) / timed(lambda: stiffness(robot, plain)),
        "6x6 with exact gravity": len(loaded) / timed(lambda: stiffness(robot, loaded, gravity="exact")),
        "without gravity, each pose alone": len(plain) / timed(lambda: stiffness(each, plain)),
        "exact gravity, each pose alone": len(loaded) / timed(lambda: stiffness(each, loaded, gravity="exact")),
    }
    seconds = timed(lambda: workspace_map(robot, (0.62, 1.12), size=(200, 200), gravity="none"))
    with capsys.disabled():
        print()
        for name, rate in rates.items():
            print(f"{name:34s} {rate:12,.0f} poses/s")
        print(f"{'map 200 x 200 x 1':34s} {seconds:12.3f} s")


TEN_MILLION = """
import resource
import numpy as np
from tests.robots import published_robot
from stiffscope.vjm.analysis import batches
poses = np.random.default_rng(1).uniform((-0.02, -0.3, 0.3), (0.02, 0.3, 0.5), (10_000_000, 3))
worst = np.inf
for some, matrix in batches(published_robot(), poses):
    worst = min(worst, matrix[:, 2, 2].min())
print(len(poses), worst, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""


def test_ten_million_poses_fit_in_two_gigabytes(capsys):
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", TEN_MILLION], capture_output=True, text=True, check=True)
    count, worst, peak = (float(word) for word in done.stdout.split())
    with capsys.disabled():
        seconds = time.perf_counter() - start
        print(f"\n{count:,.0f} poses in {seconds:.0f} s, peak {peak / 1e9:.2f} GB, least K_tz {worst:.3g} N/m")
    assert peak < 2e9


def test_against_a_loop_of_a_frame_analysis_library(robot, capsys):
    pynite = pytest.importorskip("Pynite", reason="PyNiteFEA is not installed")
    angles = np.radians(np.linspace(25, 65, 5))
    slow = timed(lambda: [frame_stiffness(pynite, q) for q in angles], repeats=1) / len(angles)
    poses = many(100_000)
    fast = timed(lambda: stiffness(robot, poses)) / len(poses)
    reference = frame_stiffness(pynite, np.radians(36))
    ours = stiffness(replace(robot, slider=np.zeros((6, 6))), pose_at(GEOMETRY, np.radians(36)))[0]
    with capsys.disabled():
        print(f"\nPyNite {1 / slow:.1f} poses/s, ours {1 / fast:,.0f} poses/s, ratio {slow / fast:,.0f}")
        print(f"largest difference on the diagonal {np.abs(np.diagonal(reference) / np.diagonal(ours) - 1).max():.1e}")
    assert np.allclose(np.diagonal(reference), np.diagonal(ours), rtol=2e-3)  # its bodies are stiff, not rigid


def frame_stiffness(pynite, q):
    """Stiffness at M with rigid sliders: links as released members, bodies as stiff ones, springs for drives."""
    g, model = GEOMETRY, pynite.FEModel3D()
    c = euler_bernoulli()
    area, inertia = g.L / (211e9 * c[0, 0]), g.L / (211e9 * c[4, 4])
    model.add_material("steel", 211e9, 81e9, 0.3, 0.0)
    model.add_section("rod", area, inertia, inertia, 2 * inertia)
    model.add_section("body", 1e3 * area, 1e4 * inertia, 1e4 * inertia, 1e4 * inertia)
    model.add_node("M", 0, 0, 0)
    for i, side in ((1, 1.0), (2, -1.0)):
        along = np.array([side * np.cos(q), 0, np.sin(q)])
        corner = np.array([-side * g.l, 0, -g.l2])
        model.add_node(f"A{i}", *(corner - g.L * along))
        model.def_support(f"A{i}", False, True, True, True, True, True)
        model.def_support_spring(f"A{i}", "DX", DRIVE)
        for j, foot in enumerate(([-side * g.h, 0, 0], [side * g.h, g.d, 0], [side * g.h, -g.d, 0])):
            model.add_node(f"A{i}{j}", *(corner + foot - g.L * along))
            model.add_node(f"B{i}{j}", *(corner + foot))
            model.add_member(f"C{i}{j}", f"A{i}", f"A{i}{j}", "steel", "body")
            model.add_member(f"L{i}{j}", f"A{i}{j}", f"B{i}{j}", "steel", "rod")
            model.def_releases(f"L{i}{j}", Ryi=True, Ryj=True)
            model.add_member(f"P{i}{j}", f"B{i}{j}", "M", "steel", "body")
    for name in UNIT_LOADS:
        model.add_load_combo(name, {name: 1.0})
        model.add_node_load("M", name, 1.0, case=name)
    model.analyze_linear(log=False, check_stability=False)
    node = model.nodes["M"]
    moved = (node.DX, node.DY, node.DZ, node.RX, node.RY, node.RZ)
    compliance = np.array([[component[name] for name in UNIT_LOADS] for component in moved])
    compliance[1, 1] += 1.0 / DRIVE  # the stage, in series
    return np.linalg.inv(compliance)

"""Limits of a cut a second: lobes of many poses, and the worst speed over a workspace.

pytest -m benchmark tests/benchmarks/test_chatter_speed.py -s
"""

import time

import numpy as np
import pytest

from stiffscope.experiments.assembly import assemble_robots
from stiffscope.lobes.chatter import (
    cutting_of,
    damping_of,
    method_of,
    respond,
    speed_range,
    stretch_of,
)
from stiffscope.lobes.methods import limits_at, sweep_limits
from stiffscope.lobes.workspace import map_depth
from stiffscope.path.job import load_job
from stiffscope.runtime.workshop import workshop

pytestmark = pytest.mark.benchmark


@pytest.fixture(scope="module")
def job():
    return load_job("examples/pocket/lobes.toml")


@pytest.fixture(scope="module")
def assembled(job):
    with workshop() as shop:
        robots = {"arm": job.robot}
        return assemble_robots(robots, job.section.components, shop)["arm"]


def timed(task):
    """Return what a task returns, its seconds by the clock, and those of the processor."""
    wall = time.perf_counter()
    cpu = time.process_time()
    result = task()
    return result, time.perf_counter() - wall, time.process_time() - cpu


def test_lobes_of_a_hundred_poses(job, assembled, rng, capsys):
    """400 speeds at each: those between are interpolated where the limit is smooth."""
    cutting = cutting_of(job)
    stretch = stretch_of(job, assembled, 100)
    rated = damping_of(job, assembled)
    response, _ = respond(assembled, stretch.found, stretch.axes, rated)
    speeds = np.linspace(*speed_range(job, cutting), 400)
    method = method_of(job, cutting.cut)
    swept, wall, cpu = timed(
        lambda: sweep_limits(response, cutting.cut, speeds, method)
    )
    with capsys.disabled():
        print(
            f"\n{len(response)} poses, 400 speeds: {wall:.2f} s ({cpu:.2f} s of processor)"
        )
    pose = rng.integers(0, len(response), 300)
    place = rng.integers(0, 400, 300)
    alone = limits_at(response[pose], cutting.cut, speeds[place][:, None], method)
    ratio = swept.depth[pose, place] / alone.depth[:, 0]
    assert np.quantile(np.abs(ratio - 1.0), 0.99) < 0.01


def test_the_worst_speed_over_a_workspace(job, assembled, capsys):
    """The map of `lobes --map`, with its bands."""
    swept, wall, cpu = timed(lambda: map_depth(job, assembled, 45))
    depth = swept.more["critical_depth"].values
    with capsys.disabled():
        print(
            f"\nmap of {np.isfinite(depth).sum()} poses: {wall:.1f} s ({cpu:.1f} s of processor)"
        )
    low = swept.more["critical_low"].values
    assert (low < depth)[np.isfinite(depth)].all()

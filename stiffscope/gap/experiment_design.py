"""What to measure next: the pose and wrench that best separate two rival explanations."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.diagnosis import NextMeasurement
from stiffscope.gap.state import Bench
from stiffscope.gap.vocabulary import DEFLECTION, DEVIATION
from stiffscope.vjm.biglide import reachable
from stiffscope.vjm.maps import reachable_box

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.gap.noise import Data
    from stiffscope.gap.readings import Campaign
    from stiffscope.gap.search import Hypothesis

    Array = NDArray[np.floating[Any]]

FORCE, MOMENT = 500.0, 100.0  # N, N·m: the range of loads where the campaign shows none
DISPLACEMENT, ROTATION = 1e-6, 5e-6  # m, rad: the instrument where the campaign shows none
LEAST = 1e-3  # ln-odds


def next_measurement(bench: Bench, data: Data, first: Hypothesis, second: Hypothesis) -> NextMeasurement | None:
    """The reading of six displacements, within reach and the campaign's loads, with the greatest expected ln-odds.

    The expected ln-odds between two explanations is half the squared distance of their predictions in sigmas. None
    where no reading tells them apart.
    """
    trial = _candidates(bench)
    ahead = Bench(trial, bench.robot)
    gap = ahead.state(first.setting).prediction - ahead.state(second.setting).prediction
    sigma = _sigma(bench.campaign, data)[trial.direction]
    gain = 0.5 * ((gap / sigma) ** 2).reshape(-1, 6).sum(axis=1)
    best = int(np.argmax(gain))
    separates = tuple(" + ".join(sorted(h.names)) for h in (first, second))
    if not gain[best] > LEAST:
        return None
    row = 6 * best
    x, y, z = (float(v) for v in trial.poses[trial.pose[row]])
    wrench = tuple(float(w) for w in trial.wrench[row])
    quantity = "deviation" if trial.kind[row] == DEVIATION else "deflection"
    return NextMeasurement(separates, float(gain[best]), (x, y, z), wrench, None, quantity)


def _sigma(campaign: Campaign, data: Data) -> Array:
    """Noise of a displacement in each direction (6,), as the campaign's own readings have it."""
    out = np.array([DISPLACEMENT] * 3 + [ROTATION] * 3)
    for group, half in ((slice(0, 3), campaign.direction < 3), (slice(3, 6), campaign.direction >= 3)):
        mine = half & (campaign.kind <= DEVIATION)
        if mine.any():
            out[group] = np.median(data.sigma[mine])
    return out


def _candidates(bench: Bench) -> Campaign:
    """Every wrench along an axis at its largest, and none, at tool points all over the workspace."""
    c = bench.campaign
    box = reachable_box(bench.robot.geometry)
    grid = np.stack(
        np.meshgrid(np.linspace(box.x_min, box.x_max, 9), [0.0], np.linspace(box.z_min, box.z_max, 9)), axis=-1
    )
    poses = grid.reshape(-1, 3)[reachable(bench.robot.geometry, grid.reshape(-1, 3))]
    poses[:, 1] = float(np.median(c.poses[:, 1]))
    loads = np.nan_to_num(c.wrench[c.kind == DEFLECTION])
    seen = np.abs(loads).max(axis=0) if len(loads) else np.zeros(6)
    size = np.where(seen > 0.0, seen, np.array([FORCE] * 3 + [MOMENT] * 3) * (0.0 if seen.any() else 1.0))
    wrenches = np.vstack([np.zeros(6), np.diag(size)])
    pose = np.repeat(np.arange(len(poses)), len(wrenches) * 6)
    wrench = np.tile(np.repeat(wrenches, 6, axis=0), (len(poses), 1))
    kind = np.where(np.abs(wrench).max(axis=1) > 0.0, DEFLECTION, DEVIATION)
    n = len(pose)
    return replace(
        c,
        pose_names=tuple(str(k) for k in range(len(poses))),
        poses=poses,
        pose=pose,
        wrench=wrench,
        quantity=6 * kind + np.tile(np.arange(6), n // 6),
        value=np.zeros(n),
        sigma=np.ones(n),
        session=np.zeros(n),
        file=np.zeros(n),
        line=np.arange(n),
    )

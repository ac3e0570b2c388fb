"""Priors of effect sizes: scales derived from the robot, heavy tails and sparse parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise, product
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.inference.settings import PRIORS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.runtime.types import Array, Flags


@dataclass(frozen=True)
class Spreads:
    """Prior of one effect's parameters: a mixture of normals with c scales."""

    scales: Array
    """Scales (c, k)."""
    log_weight: Array
    """Ln probability (c,) of each."""
    dense: int | None = None
    """Number of the first of them in which no parameter is zero; None: all."""

    def without_zeros(self) -> Spreads:
        """Return the prior in which no parameter is zero."""
        return Spreads(self.scales[: self.dense], self.log_weight[: self.dense])


def spread_groups(
    scale: Array, positive: Flags, groups: Sequence[int], sizes: Array
) -> list[Spreads]:
    """Return the prior of each group of parameters that share one size; see `spread_priors`.

    In several groups those of many parameters have the sizes, and then finer ones between them.

    Parameters
    ----------
    scale, positive
        Scales and signs (k,) of all parameters.
    groups
        Numbers of consecutive parameters in each group; empty: one group of all.
    sizes
        Sizes (s,).
    """
    ends = np.cumsum([0, *(groups or (len(scale),))]).tolist()
    step = np.array(
        [k for k in range(PRIORS.finer * (len(sizes) - 1)) if k % PRIORS.finer]
    )
    between = np.exp(
        np.interp(step / PRIORS.finer, np.arange(len(sizes)), np.log(sizes))
    )
    finer = np.concatenate([sizes, between])
    own = (
        (slice(a, b), finer if groups and b - a > 1 else sizes)
        for a, b in pairwise(ends)
    )
    return [spread_priors(scale[mine], positive[mine], tried) for mine, tried in own]


def spread_priors(scale: Array, positive: Flags, sizes: Array) -> Spreads:
    """Return scales of an effect's parameters: one unknown size in their own units, heavy-tailed.

    The size is half-Cauchy: log-uniform about one, with probability falling in proportion beyond.
    If parameters cannot be negative, some may be exactly zero, e.g. for a bearing that only tilts.

    Parameters
    ----------
    scale
        Unit (k,) of each parameter.
    positive
        (k,) whether parameters cannot be negative; if so for all, subsets may be zero.
    sizes
        Sizes (s,) on a geometric grid.
    """
    if not len(scale):
        return Spreads(np.zeros((1, 0)), np.zeros(1))
    weight = 1.0 / np.cosh(np.log(sizes))
    log = np.log(weight / weight.sum())
    whole = sizes[:, None] * scale
    few = (
        _subsets(len(scale))
        if positive.all()
        else np.zeros((0, len(scale)), dtype=np.bool_)
    )
    if not len(few):
        return Spreads(whole, log)
    count = few.sum(axis=1)
    alike = np.array([np.sum(count == c) for c in count])
    share = np.log(PRIORS.sparse / len(np.unique(count)) / alike)
    left = sizes[:, None] * np.where(few, scale, PRIORS.absent * scale)[:, None, :]
    scales = np.concatenate([whole, left.reshape(-1, len(scale))])
    logs = [np.log1p(-PRIORS.sparse) + log, (share[:, None] + log).ravel()]
    return Spreads(scales, np.concatenate(logs), len(sizes))


def choose_near(priors: Sequence[Spreads], near: Array | None) -> Sequence[Spreads]:
    """Return priors restricted to the scales nearest to given ones (k,); by default all."""
    if near is None:
        return priors
    out: list[Spreads] = []
    for prior in priors:
        count = prior.scales.shape[1]
        own = near[:count]
        near = near[count:]
        away = np.abs(np.log(prior.scales / own)).max(axis=1, initial=0.0)
        kept = away <= away.min() + PRIORS.same
        out.append(
            Spreads(
                prior.scales[kept],
                prior.log_weight[kept],
                int(kept[: prior.dense].sum()),
            )
        )
    return out


@cache
def _subsets(count: int) -> Flags:
    """Return subsets (m, count) of non-zero parameters; for many, single ones and halves."""
    if count > PRIORS.apart:
        half = np.arange(count) < count // 2
        return np.concatenate([np.eye(count, dtype=np.bool_), [half, ~half]])
    proper = [*product([False, True], repeat=count)][1:-1]
    return np.array(proper, dtype=np.bool_).reshape(-1, count)[:, ::-1]

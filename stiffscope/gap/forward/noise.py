"""Noise level of a campaign, and gross outliers."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np
from scipy.special import chdtri, pdtrc  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

from stiffscope.gap.campaign.copies import find_copies
from stiffscope.gap.campaign.scatter import SCATTER, find_scatter
from stiffscope.gap.forward.forward_model import Noise

if TYPE_CHECKING:
    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.forward.forward_model import Candidate, ForwardModel
    from stiffscope.runtime.types import Array, Flags, Indices


@dataclass(frozen=True)
class NoiseSettings:
    """How the noise of readings is estimated, and what is an outlier."""

    outlying: float = 6.0
    """Robust standard deviations beyond which a reading is a gross outlier."""
    passes: int = 6
    """Of the joint fit, each with less weight on what stood out: it has settled by then."""
    loose: float = 3.0
    """Prior size of parameters in the joint fit over their own: a large effect is no noise."""
    overstated: float = 0.8
    """Ratio of observed to stated noise below which the latter is scaled down."""
    largest: int = 1000
    """Most readings used for the first guess of unknown noise: a matrix of their square is
    decomposed."""
    fractions: Array = field(default_factory=lambda: np.geomspace(1e-5, 2.0, 80))
    """Candidate ratios (80,) of noise to gap."""
    least_free: float = 1e-6
    """Least share of the variance of a reading that a joint fit leaves: rounding."""
    alike: float = 4.0
    """Readings as which it counts that noise is alike in a unit, and in all."""
    usual: float = 0.01
    """Usual noise over the gap,"""
    within: float = 2.0
    """and its standard deviation in logarithms."""
    told: float = 3.0
    """Least degrees of freedom that tell the noise."""
    sure: int = 10
    """Readings beyond the columns of all effects below which noise is found with the effects."""
    rank: float = 1e-6
    """Of the largest singular value: a column that readings show."""
    unsure: Array = field(default_factory=lambda: np.geomspace(0.3, 10.0, 24))
    """Factors (24,) on the first estimate, which all effects share and so take from the noise."""
    efficiency: float = 0.5
    """Of the robust scatter: share of the degrees of freedom that it uses."""
    most: float = 0.4
    """Of the readings: degrees of freedom of all effects beyond which some give way."""
    enough: float = 0.5
    """Of the readings: beyond, a joint fit of all effects shows no outliers."""
    together: float = 1e-3
    """Probability below which it is no chance that outliers share their loads: one false alarm in
    a thousand campaigns."""


NOISE = NoiseSettings()


@dataclass(frozen=True)
class _Fit:
    """Joint fit: residuals (n,) in sigmas, of which the fit leaves a share (n,) of the variance."""

    residual: Array
    free: Array


@dataclass(frozen=True)
class _Columns:
    """Columns (n, k) in sigmas, with cached inner products."""

    values: Array

    @cached_property
    def _gram(self) -> Array:
        return self.values.T @ self.values

    def gram(self, weight: Array) -> Array:
        """Return inner products (k, k) with weights (n,), most of which are one."""
        rest = self.values[weight != 1.0]
        return self._gram - rest.T @ (rest * (1.0 - weight[weight != 1.0])[:, None])


def noise_of(model: ForwardModel) -> Noise:
    """Estimate noise and outliers from a robust joint fit of all effects.

    Unknown sigmas are estimated by kind of reading. Stated ones are reduced if all are too large,
    but never increased, because the excess scatter may be an unknown effect.
    """
    campaign = model.campaign
    prediction = model.predict(
        tuple((c, ()) for c in model.library if c.assumed and not c.scale)
    )
    joint = [c for c in model.library if c.scale and _joins(c)]
    gap = campaign.value - prediction.values
    unknown = np.isnan(campaign.sigma)
    once = find_copies(campaign)[0]
    for chosen in (joint, [c for c in joint if not c.gives_way]):
        x = np.hstack([prediction.columns(c) * np.array(c.scale) for c in chosen])
        guess = _first_guess(campaign, gap, x, np.flatnonzero(once))
        sigma = np.where(unknown, guess, campaign.sigma)
        freedom = _count_freedom(x / sigma[:, None])
        if freedom <= NOISE.most * len(gap):
            break
    none = np.zeros(len(gap), dtype=np.bool_)
    noise = Noise(sigma, once, none, np.ones(1))
    if freedom > NOISE.enough * len(gap) and not unknown.any():
        count = f"{len(gap)} readings for {freedom:.0f} unknowns of the possible causes"
        return replace(noise, remarks=(f"{count}: outliers were not sought",))
    fit = _Fit(np.zeros(len(gap)), np.ones(len(gap)))
    columns = _Columns(NOISE.loose * x / sigma[:, None])
    for _ in range(NOISE.passes):
        fit = _joint_fit(columns, gap / noise.sigma, noise.used, fit)
        before = noise.sigma
        noise, fit = _judge_noise(campaign, noise, fit, once)
        if not np.array_equal(before, noise.sigma):
            columns = _Columns(NOISE.loose * x / noise.sigma[:, None])
    noise = replace(noise, used=noise.used | _find_loaded(campaign, once & ~noise.used))
    if unknown.any():
        noise = _limit_to_scatter(campaign, noise, unknown, once)
    one_pose = len(campaign.pose_names) == 1
    if noise.freedom < NOISE.told or (unknown.any() and one_pose and not noise.remarks):
        remark = f"{len(gap)} readings do not tell their noise, which is guessed: state sigma"
        if not unknown.all():
            return Noise(sigma, once, none, np.ones(1), (remark,), NOISE.told)
        return Noise(sigma, once, unknown, NOISE.unsure, (remark,), NOISE.told)
    free = int(once.sum()) - _count_independent(columns.values[once])
    if unknown.all() and free < NOISE.sure and not noise.remarks:
        remark = f"{len(gap)} readings tell little of their noise: state sigma"
        remarks = (*noise.remarks, remark)
        return replace(noise, scaled=unknown, factors=NOISE.unsure, remarks=remarks)
    return _add_remarks(campaign, noise, fit, once)


def _joins(candidate: Candidate) -> bool:
    """Return whether an effect is among those that are fitted together."""
    return candidate.joins_noise and not (candidate.flexible or candidate.swarming)


def _count_freedom(columns: Array) -> float:
    """Return the degrees of freedom that columns (n, k), in sigmas, take from the readings.

    Columns that repeat others, or that readings do not show, take none: how many effects there are
    in the library does not count.
    """
    small = columns if columns.shape[1] < len(columns) else columns.T
    size = np.linalg.eigvalsh(NOISE.loose**2 * small.T @ small).clip(min=0.0)
    return float(np.sum(size / (size + 1.0)))


def _first_guess(c: Campaign, gap: Array, x: Array, rows: Indices) -> Array:
    """Return initial sigmas (n,): the likeliest fraction of their kind's gap, all effects free.

    rows: readings (m,) that are no copies.
    """
    like = _number_units(c)
    size = np.where(c.relative, np.abs(c.value), 1.0)
    mean = np.sqrt(
        np.bincount(like, (gap / size) ** 2) / np.maximum(np.bincount(like), 1)
    )
    least = 1e-12 * float(np.abs(c.value).max())
    unit = np.maximum(
        size * mean[like], np.where(c.relative, 1e-6 * size, max(least, 1e-300))
    )
    some = rows[
        np.unique(
            np.linspace(0, len(rows) - 1, min(len(rows), NOISE.largest)).astype(
                np.int64
            )
        )
    ]
    a = x[some] / unit[some, None]
    y = gap[some] / unit[some]
    values, vectors = np.linalg.eigh(a @ a.T)
    q = vectors.T @ y
    spread = values.clip(min=0.0)[:, None] + NOISE.fractions**2
    likelihood = -0.5 * np.sum(q[:, None] ** 2 / spread + np.log(spread), axis=0)
    usual = -0.5 * (np.log(NOISE.fractions / NOISE.usual) / NOISE.within) ** 2
    return unit * NOISE.fractions[int(np.argmax(likelihood + usual))]


def _joint_fit(columns: _Columns, y: Array, used: Flags, before: _Fit) -> _Fit:
    """Fit all effects jointly, with less weight on readings with large previous residuals."""
    a = columns.values
    weight = used / np.maximum(1.0, np.abs(before.residual) / 2.0)
    values, vectors = np.linalg.eigh(columns.gram(weight))
    turned = a @ (
        vectors / np.sqrt(values.clip(min=0.0) + 1.0)
    )  # their prior has unit size
    residual = y - turned @ (turned.T @ (weight * y))
    return _Fit(
        residual, (1.0 - weight * np.sum(turned**2, axis=1)).clip(min=NOISE.least_free)
    )


def _judge_noise(
    c: Campaign, noise: Noise, fit: _Fit, once: Flags
) -> tuple[Noise, _Fit]:
    """Estimate unknown noise from the robust scatter of its instrument, and flag outliers.

    Few readings tell little of an instrument's noise. Relative to the size of readings, it is like
    that of others in its unit, and of all.
    """
    unknown = np.isnan(c.sigma)
    like = c.kind_numbers
    unit = _number_units(c)
    free = np.where(noise.used, fit.free, 0.0)
    residual = fit.residual / np.sqrt(fit.free)
    scatter = np.ones(len(c))
    for group in np.unique(like):
        scatter[like == group] = max(
            _scatter(residual[(like == group) & noise.used]), 1e-6
        )
    mean = np.bincount(unit, c.value**2) / np.maximum(np.bincount(unit), 1)
    size = np.where(c.relative, np.abs(c.value), np.sqrt(mean)[unit]) + 1e-300
    few = np.bincount(like, free).clip(min=1.0)[like]
    share = (
        np.log(scatter * noise.sigma / size) + 0.5 / few
    )  # the mean logarithm of few is less
    usual = np.full(len(c), np.average(share, weights=free + 1e-9))
    for groups in (unit, like):
        count = np.bincount(groups, free)
        total = np.bincount(groups, free * share)
        usual = (total[groups] + NOISE.alike * usual) / (count[groups] + NOISE.alike)
    scatter = np.where(unknown, np.exp(usual) * size / noise.sigma, scatter)
    residual = np.where(unknown, residual / scatter, fit.residual)
    used = once & (np.abs(residual) < NOISE.outlying * np.where(unknown, 1.0, scatter))
    sigma = np.where(unknown, noise.sigma * scatter, noise.sigma)
    freedom = NOISE.efficiency * float(free[unknown].sum()) if unknown.any() else np.inf
    return replace(noise, sigma=sigma, used=used, freedom=freedom), replace(
        fit, residual=residual
    )


def _find_loaded(c: Campaign, outlying: Flags) -> Flags:
    """Return which outlying readings (n,) are what the machine does under a load, and no slips.

    Slips of single readings happen under any load. Where too many readings of one instrument under
    the same load stand out at several poses, the machine answers to that load in another way:
    beyond a knee, say.
    """
    none = np.zeros(len(c), dtype=np.bool_)
    count = int(outlying.sum())
    applied = np.column_stack([c.load, np.nan_to_num(c.wrench)])
    load = np.unique(applied, axis=0, return_inverse=True)[1].ravel()
    cell = np.column_stack([load, c.kind, c.channel])
    cells = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
    size = np.bincount(cells)
    found = np.bincount(cells, outlying)
    pairs = 0.5 * float(np.sum(found * (found - 1.0)))
    # pairs that share a cell by chance: C(m, 2) Σ s (s - 1) / (n (n - 1))
    alike = float(np.sum(size * (size - 1.0))) / max(len(c) * (len(c) - 1.0), 1.0)
    expected = 0.5 * count * (count - 1.0) * alike
    if pairs < 1.0 or float(pdtrc(pairs - 1.0, expected)) >= NOISE.together:
        return none
    return outlying & (found[cells] > 1.0)


def _number_units(c: Campaign) -> Indices:
    """Return group numbers (n,) of readings in m, in rad, and relative to their size."""
    return c.unit_numbers


def _count_independent(columns: Array) -> int:
    """Return the rank of columns (n, k) of equal length."""
    length = np.linalg.norm(columns, axis=0)
    unit = columns[:, length > 0.0] / length[length > 0.0]
    if not unit.size:
        return 0
    return int(np.linalg.matrix_rank(unit, tol=NOISE.rank * np.sqrt(unit.shape[1])))


def _limit_to_scatter(c: Campaign, noise: Noise, unknown: Flags, once: Flags) -> Noise:
    """Return noise that is no more than the scatter of repeats, and about smooth load curves.

    A joint fit of all effects takes what none of them explains as noise, also a smooth curve.
    """
    like = c.kind_numbers
    sigma = np.array(noise.sigma)
    freedom = 0.0
    for group in np.unique(like[unknown]):
        mine = unknown & once & (like == group)
        size = np.where(c.relative, np.abs(c.value), 1.0)
        squares, count = find_scatter(c, np.flatnonzero(mine), size)
        if count < SCATTER.least:
            continue
        told = np.sqrt(squares / count)
        own = float(np.median(noise.sigma[mine] / size[mine]))
        # σ² is at most S/χ² of the lower tail, were the scatter all noise
        if count * (told / own) ** 2 < chdtri(count, SCATTER.sure):
            sigma = np.where(unknown & (like == group), told * size, sigma)
            freedom += count
    if not freedom:
        return noise
    used = noise.used | (once & (sigma != noise.sigma))
    remark = "noise from repeated readings and smooth load curves"
    return replace(noise, sigma=sigma, used=used, remarks=(remark,), freedom=freedom)


def _add_remarks(c: Campaign, noise: Noise, fit: _Fit, once: Flags) -> Noise:
    known = ~np.isnan(c.sigma)
    sigma = noise.sigma
    remarks = list(noise.remarks)
    if known.any():
        ratio = _scatter((fit.residual / np.sqrt(fit.free))[known & noise.used])
        if ratio < NOISE.overstated:
            sigma = np.where(known, ratio * sigma, sigma)
            times = f"{1 / ratio:.2g} times the observed scatter"
            remarks.append(f"uncertainties {times} were scaled down")
    outlying = int((once & ~noise.used).sum())
    if outlying:
        remarks.append(f"{outlying} gross outliers were left out")
    return replace(noise, sigma=sigma, remarks=tuple(remarks))


def _scatter(residual: Array) -> float:
    """Return the standard deviation estimated from the median absolute value."""
    return 1.4826 * float(cast("Array", np.median(np.abs(residual))))

"""Noise level of a campaign, and gross outliers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from stiffscope.effects.joint_axis import JointAxis
from stiffscope.effects.sensor_sign import SensorSign
from stiffscope.effects.unit import Unit
from stiffscope.gap.forward.forward_model import Noise

if TYPE_CHECKING:
    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.forward.forward_model import ForwardModel
    from stiffscope.runtime.types import Array, Flags


OUTLYING = 6.0  # robust standard deviations
PASSES = 6
LOOSE = 3.0  # prior size of parameters in the joint fit over their own
OVERSTATED = 0.8  # ratio of observed to stated noise below which the latter is scaled down
LARGEST = 1000  # most readings used for the initial guess of unknown noise
FRACTIONS = np.geomspace(1e-5, 2.0, 80)  # candidate ratios of noise to gap


_DOUBTED = {Unit.word, SensorSign.word}  # if suspected, assumed present for the noise estimate
_MOST = 0.4  # most columns per reading in the joint fit


@dataclass(frozen=True)
class _Fit:
    """Joint fit: residuals in sigmas, and the fraction of degrees of freedom left."""

    residual: Array
    free: float


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
    prediction = model.predict(tuple((c, ()) for c in model.library if c.effect in _DOUBTED))
    joint = [c for c in model.library if c.scale and not (c.flexible or c.swarming)]
    if sum(len(c.scale) for c in joint) > _MOST * len(campaign):  # axes fit almost anything
        joint = [c for c in joint if c.effect != JointAxis.word]
    x = np.hstack([prediction.columns(c) * np.array(c.scale) for c in joint])
    gap = campaign.value - prediction.values
    unknown = np.isnan(campaign.sigma)
    sigma = np.where(unknown, _first_guess(campaign, gap, x), campaign.sigma)
    every = np.ones(len(gap), dtype=np.bool_)
    noise = Noise(sigma, every, ~every, np.ones(1))
    if len(gap) <= 2 * x.shape[1]:
        return noise
    fit, columns = _Fit(np.zeros(len(gap)), 1.0), _Columns(LOOSE * x / sigma[:, None])
    for _ in range(PASSES):
        fit = _joint_fit(columns, gap / noise.sigma, noise.used, fit)
        before = noise.sigma
        noise, fit = _judge_noise(campaign, noise, fit)
        if not np.array_equal(before, noise.sigma):
            columns = _Columns(LOOSE * x / noise.sigma[:, None])
    return _add_remarks(campaign, noise, fit)


def _first_guess(c: Campaign, gap: Array, x: Array) -> Array:
    """Return initial sigmas (n,): the likeliest fraction of their kind's gap, all effects free."""
    like = c.kind_numbers
    size = np.where(c.relative, np.abs(c.value), 1.0)
    mean = np.sqrt(np.bincount(like, (gap / size) ** 2) / np.maximum(np.bincount(like), 1))
    least = 1e-12 * float(np.abs(c.value).max())
    unit = np.maximum(size * mean[like], np.where(c.relative, 1e-6 * size, max(least, 1e-300)))
    some = np.unique(np.linspace(0, len(gap) - 1, min(len(gap), LARGEST)).astype(np.int64))
    a, y = x[some] / unit[some, None], gap[some] / unit[some]
    values, vectors = np.linalg.eigh(a @ a.T)
    q = vectors.T @ y
    spread = values.clip(min=0.0)[:, None] + FRACTIONS**2
    likelihood = -0.5 * np.sum(q[:, None] ** 2 / spread + np.log(spread), axis=0)
    return unit * FRACTIONS[int(np.argmax(likelihood))]


def _joint_fit(columns: _Columns, y: Array, used: Flags, before: _Fit) -> _Fit:
    """Fit all effects jointly, with less weight on readings with large previous residuals."""
    a, weight = columns.values, used / np.maximum(1.0, np.abs(before.residual) / 2.0)
    values, vectors = np.linalg.eigh(columns.gram(weight))
    keep = values > 1e-8 * values[-1]
    inverse = (vectors[:, keep] / values[keep]) @ vectors[:, keep].T
    residual = y - a @ (inverse @ (a.T @ (weight * y)))
    return _Fit(residual, max(1.0 - float(keep.sum()) / max(float(used.sum()), 1.0), 0.1))


def _judge_noise(c: Campaign, noise: Noise, fit: _Fit) -> tuple[Noise, _Fit]:
    """Estimate unknown noise from the robust scatter of its kind, and flag outliers."""
    unknown = np.isnan(c.sigma)
    like = c.kind_numbers
    scatter = np.ones(len(c))
    for group in np.unique(like):
        mine = (like == group) & noise.used
        if mine.any():
            scatter[like == group] = max(_scatter(fit.residual[mine]) / np.sqrt(fit.free), 1e-6)
    residual = np.where(unknown, fit.residual / scatter, fit.residual)
    used = np.abs(residual) < OUTLYING * np.where(unknown, 1.0, scatter)
    sigma = np.where(unknown, noise.sigma * scatter, noise.sigma)
    return replace(noise, sigma=sigma, used=used), replace(fit, residual=residual)


def _add_remarks(c: Campaign, noise: Noise, fit: _Fit) -> Noise:
    known = ~np.isnan(c.sigma)
    sigma, remarks = noise.sigma, list(noise.remarks)
    if known.any():
        ratio = _scatter(fit.residual[known & noise.used]) / np.sqrt(fit.free)
        if ratio < OVERSTATED:
            sigma = np.where(known, ratio * sigma, sigma)
            times = f"{1 / ratio:.2g} times the observed scatter"
            remarks.append(f"uncertainties {times} were scaled down")
    if not noise.used.all():
        remarks.append(f"{int((~noise.used).sum())} gross outliers were left out")
    return replace(noise, sigma=sigma, remarks=tuple(remarks))


def _scatter(residual: Array) -> float:
    """Return the standard deviation estimated from the median absolute value."""
    return 1.4826 * float(cast("Array", np.median(np.abs(residual))))

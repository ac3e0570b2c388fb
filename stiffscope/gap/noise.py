"""How large the noise of a campaign is, and which readings are gross outliers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from stiffscope.gap.vocabulary import STIFFNESS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.effects import Effect
    from stiffscope.gap.state import Bench

    Array = NDArray[np.floating[Any]]
    Flags = NDArray[np.bool_]

OUTLYING = 6.0  # robust standard deviations
PASSES = 6
LOOSE = 3.0  # times the prior size that a parameter has in the joint fit
OVERSTATED = 0.8  # share of the stated noise below which it is scaled down
LARGEST = 1000  # readings from which the first guess of unknown noise is made
FRACTIONS = np.geomspace(1e-5, 2.0, 80)  # of the gap, that may be noise


@dataclass(frozen=True)
class Data:
    """Noise of the readings ``sigma`` (n,), which are no gross outliers, and what to remark about that."""

    sigma: Array
    good: Flags
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Fit:
    """The joint fit: residuals in sigmas, and the share of the readings' freedom that it leaves."""

    residual: Array
    free: float


def noise_of(bench: Bench, library: Sequence[Effect]) -> Data:
    """Noise and outliers as the fit of all effects at once shows them, robustly.

    Unknown sigmas are estimated by kind of reading. Stated ones that are all too large are brought down; ones that
    are too small are left, since what they do not cover may be an effect that nobody knows.
    """
    campaign, state = bench.campaign, bench.state()
    joint = [e for e in library if len(e.scale) > 0 and e.names[0] != "c11"]
    x = np.hstack([state.columns(e) * np.array(e.scale) for e in joint])
    gap = campaign.value - state.prediction
    unknown = np.isnan(campaign.sigma)
    sigma = np.where(unknown, _first_guess(bench, gap, x), campaign.sigma)
    data = Data(sigma, np.ones(len(gap), dtype=np.bool_))
    if len(gap) <= 2 * x.shape[1]:
        return data
    fit = _Fit(np.zeros(len(gap)), 1.0)
    for _ in range(PASSES):
        fit = _joint_fit(LOOSE * x / data.sigma[:, None], gap / data.sigma, data.good, fit)
        data, fit = _judged(bench, data, fit)
    return _remarked(bench, data, fit)


def _first_guess(bench: Bench, gap: Array, x: Array) -> Array:
    """Unknown sigmas (n,) as one share of the gap of their kind: the likeliest with all effects free."""
    c = bench.campaign
    like = c.kind * 2 + c.direction // 3
    size = np.where(c.kind == STIFFNESS, np.abs(c.value), 1.0)
    mean = np.sqrt(np.bincount(like, (gap / size) ** 2) / np.maximum(np.bincount(like), 1))
    least = 1e-12 * float(np.abs(c.value).max())
    unit = np.maximum(size * mean[like], np.where(c.kind == STIFFNESS, 1e-6 * size, max(least, 1e-300)))
    some = np.unique(np.linspace(0, len(gap) - 1, min(len(gap), LARGEST)).astype(np.int64))
    a, y = x[some] / unit[some, None], gap[some] / unit[some]
    values, vectors = np.linalg.eigh(a @ a.T)
    q = vectors.T @ y
    spread = values.clip(min=0.0)[:, None] + FRACTIONS**2
    likelihood = -0.5 * np.sum(q[:, None] ** 2 / spread + np.log(spread), axis=0)
    return unit * FRACTIONS[int(np.argmax(likelihood))]


def _joint_fit(a: Array, y: Array, good: Flags, before: _Fit) -> _Fit:
    """All effects at once, readings that stood off before with less weight."""
    weight = good / np.maximum(1.0, np.abs(before.residual) / 2.0)
    gram = a.T @ (a * weight[:, None])
    values, vectors = np.linalg.eigh(gram)
    keep = values > 1e-8 * values[-1]
    hat = (vectors[:, keep] / values[keep]) @ vectors[:, keep].T
    rank = float(np.sum((a @ hat) * a * weight[:, None]))
    residual = y - a @ (hat @ (a.T @ (weight * y)))
    return _Fit(residual, max(1.0 - rank / max(float(good.sum()), 1.0), 0.1))


def _judged(bench: Bench, data: Data, fit: _Fit) -> tuple[Data, _Fit]:
    """Unknown noise by the robust scatter of its kind; outliers by the same measure."""
    c = bench.campaign
    unknown = np.isnan(c.sigma)
    like = c.kind * 2 + c.direction // 3
    scatter = np.ones(len(c))
    for group in np.unique(like):
        mine = (like == group) & data.good
        if mine.any():
            scatter[like == group] = max(_scatter(fit.residual[mine]) / np.sqrt(fit.free), 1e-6)
    residual = np.where(unknown, fit.residual / scatter, fit.residual)
    good = np.abs(residual) < OUTLYING * np.where(unknown, 1.0, scatter)
    return replace(data, sigma=np.where(unknown, data.sigma * scatter, data.sigma), good=good), replace(
        fit, residual=residual
    )


def _remarked(bench: Bench, data: Data, fit: _Fit) -> Data:
    known = ~np.isnan(bench.campaign.sigma)
    sigma, remarks = data.sigma, list(data.remarks)
    if known.any():
        label = _scatter(fit.residual[known & data.good]) / np.sqrt(fit.free)
        if label < OVERSTATED:
            sigma = np.where(known, label * sigma, sigma)
            remarks.append(
                f"the stated uncertainties, {1 / label:.2g} times what the readings scatter, were scaled down"
            )
    if not data.good.all():
        remarks.append(f"{int((~data.good).sum())} gross outliers were left out")
    return Data(sigma, data.good, tuple(remarks))


def _scatter(residual: Array) -> float:
    """Standard deviation by the median of absolute values."""
    return 1.4826 * float(cast("Array", np.median(np.abs(residual))))

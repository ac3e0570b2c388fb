"""Exact evidence of linear hypotheses under Gaussian noise, part of which may be of unknown size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Fit:
    """What is known of a hypothesis y = X δ + noise after the data."""

    evidence: float
    """ln p(y), the sizes of δ and of the noise averaged over their priors."""
    mean: Array
    """(k,) of δ."""
    covariance: Array
    """(k, k) of δ."""
    noise: float
    """Posterior mean (geometric) of the unknown noise factor; 1 if all sigmas are stated."""


def fit(y: Array, X: Array, prior: Array, unknown: Flags, noises: Array) -> Fit:
    """Return the exact posterior of δ ~ N(0, diag prior²) for y (n,) in units of its noise, X (n, k).

    unknown: (n,) readings whose unit is multiplied by one common factor, of which `noises` (m,) is a grid with equal
    prior weights. The factor is integrated out.
    """
    k = X.shape[1]
    grid: Array = noises if unknown.any() else np.ones(1)
    parts = [_moments(y[pick], X[pick]) for pick in (~unknown, unknown)]
    known = int(np.count_nonzero(~unknown))
    free = len(y) - known
    precision = np.diag(1 / prior**2)
    logs: list[float] = []
    means: list[Array] = []
    covariances: list[Array] = []
    for tau in grid:
        w = tau**-2
        A = parts[0][0] + w * parts[1][0]
        b = parts[0][1] + w * parts[1][1]
        total = parts[0][2] + w * parts[1][2]
        covariance: Array = np.asarray(np.linalg.inv(precision + A), dtype=np.float64)
        mean = covariance @ b
        _, volume = np.linalg.slogdet(np.eye(k) + (prior**2)[:, None] * A)
        size = len(y) * np.log(2 * np.pi) + 2 * free * np.log(tau)
        logs.append(float(-0.5 * (size + volume + total - b @ mean)))
        means.append(mean)
        covariances.append(covariance)
    log = np.array(logs)
    weight: Array = np.exp(log - log.max())
    evidence = float(log.max()) + float(np.log(weight.sum() / len(weight)))
    weight /= weight.sum()
    mean = np.einsum("m,mk->k", weight, np.array(means))
    spread = np.array(means) - mean
    covariance = np.einsum("m,mij->ij", weight, np.array(covariances))
    covariance += np.einsum("m,mi,mj->ij", weight, spread, spread)
    return Fit(evidence, mean, covariance, float(np.exp(weight @ np.log(grid))))


def _moments(y: Array, X: Array) -> tuple[Array, Array, float]:
    return X.T @ X, X.T @ y, float(y @ y)

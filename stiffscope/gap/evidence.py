"""Evidence and posterior of linearized hypotheses under Gaussian noise, part of which may be of unknown size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.gap.forward_model import Noise

    Array = NDArray[np.floating[Any]]
    Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Posterior:
    """What is known of the parameters u (k,) of ``y = X u + noise`` after the data."""

    log_evidence: float
    """ln p(y), up to what is the same for all hypotheses."""
    mean: Array
    """(k,) of u."""
    covariance: Array
    """(k, k) of u."""
    noise_factor: float = 1.0
    """Geometric mean of the common unknown factor on the noise."""


def posterior(y: Array, x: Array, scale: Array, positive: Flags, noise: Noise, sizes: Array) -> Posterior:
    """Posterior of u for a linear hypothesis, on the readings that are used.

    The prior is ``u ~ N(0, diag(m scale)²)`` with a common size m from a grid, equally likely; where u cannot be
    negative it is the half above zero. An unknown noise factor is integrated over its grid. Laplace's approximation at
    the constrained optimum, exact without constraints.

    Parameters
    ----------
    y
        (n,) in units of ``noise.sigma``.
    x
        (n, k) in the same units.
    scale, positive
        (k,) prior size, and whether negative values are impossible.
    noise
        Which readings are used, and whose sigma takes an unknown factor.
    sizes
        (s,) grid of m.

    References
    ----------
    MacKay, Information Theory, Inference, and Learning Algorithms, ch. 28 (Occam factors).

    """
    stated, open_ = noise.used & ~noise.scaled, noise.used & noise.scaled
    factors = noise.factors if open_.any() else np.ones(1)
    (gram, pull, total), (more_gram, more_pull, more) = (_moments(x[pick], y[pick]) for pick in (stated, open_))
    weights = factors**-2.0
    grams = gram + weights[:, None, None] * more_gram  # (m, k, k)
    pulls, totals = pull + weights[:, None] * more_pull, total + weights * more
    scales = sizes[:, None] * scale  # (s, k)
    cores = scales[:, :, None] * grams[:, None] * scales[:, None, :]  # (m, s, k, k)
    cores += np.eye(len(scale)) * (1.0 + 1e-12 * np.trace(cores, axis1=-2, axis2=-1))[..., None, None]
    b = scales * pulls[:, None]
    u, halves = _minima(cores, b, positive)
    fit = 2.0 * np.sum(u * b, axis=-1) - np.einsum("msi,msij,msj->ms", u, cores, u)
    pivots = np.diagonal(cast("Array", np.linalg.cholesky(cores)), axis1=-2, axis2=-1)
    volume = np.log(pivots).sum(axis=-1) + (int(open_.sum()) * np.log(factors))[:, None]
    log = -0.5 * (totals[:, None] - fit) - volume + np.log(2.0) * halves
    shares = np.exp(log - log.max())
    log_evidence = float(log.max()) + float(np.log(shares.mean()))
    best = int(np.argmax(shares.sum(axis=0)))  # size
    covariances = scales[best][:, None] * cast("Array", np.linalg.inv(cores[:, best])) * scales[best]
    share = shares[:, best] / shares[:, best].sum()
    means = scales[best] * u[:, best]
    mean = share @ means
    covariance = np.einsum("m,mij->ij", share, covariances)
    covariance += np.einsum("m,mi,mj->ij", share, means - mean, means - mean)
    return Posterior(log_evidence, mean, covariance, float(np.exp(share @ np.log(factors))))


def _moments(x: Array, y: Array) -> tuple[Array, Array, float]:
    return x.T @ x, x.T @ y, float(y @ y)


def _minima(matrices: Array, pulls: Array, positive: Flags) -> tuple[Array, Array]:
    """Constrained minima (m, s, k), and in how many constrained directions (m, s) each is free."""
    if not positive.any():
        return np.linalg.solve(matrices, pulls[..., None])[..., 0], np.zeros(pulls.shape[:-1])
    u, halves = np.zeros(pulls.shape), np.zeros(pulls.shape[:-1])
    for at in np.ndindex(*halves.shape):
        u[at], free = constrained_minimum(matrices[at], pulls[at], positive)
        halves[at] = (positive & free).sum()
    return u, halves


def constrained_minimum(matrix: Array, pull: Array, positive: Flags) -> tuple[Array, Flags]:
    """Minimum of ``½ uᵀ A u - bᵀ u`` with some u ≥ 0, the most negative dropped one at a time; and which are free.

    Not `scipy.optimize.nnls`, which takes a factor of A and constrains every parameter.
    """
    free = np.ones(len(pull), dtype=np.bool_)
    u = np.zeros(len(pull))
    while free.any():
        u = np.zeros(len(pull))
        u[free] = np.linalg.solve(matrix[np.ix_(free, free)], pull[free])
        wrong = np.where(positive & free, u * np.sqrt(np.diagonal(matrix)), 0.0)
        if wrong.min() >= 0.0:
            break
        free[int(np.argmin(wrong))] = False
        u[~free] = 0.0
    return u, free

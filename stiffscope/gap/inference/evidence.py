"""Evidence and posterior of linearized hypotheses with Gaussian noise and an unknown discrepancy.

All results follow from inner products of whitened columns (Gram matrices), which are computed once
and indexed by hypothesis; the discrepancy enters by the Woodbury identity.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from scipy.special import erfc, erfcx  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

from stiffscope.gap.inference.settings import EVIDENCE

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.forward.forward_model import Noise
    from stiffscope.gap.inference.priors import Spreads
    from stiffscope.runtime.types import Array, Flags, Indices


@dataclass(frozen=True)
class Projection:
    """Columns (n, c) split for inner products: rests with stated and scaled noise, and features.

    Squares of the parts sum to that of a column, so inner products are sums with positive weights;
    a difference would be lost to rounding if few readings are far more certain than others.
    """

    stated: Array
    scaled: Array
    features: Array
    """Components (f, c) along the unit features."""


@dataclass(frozen=True)
class Errors:
    """Distribution of readings about a hypothesis, over sigma, for q settings of its unknowns.

    Covariance of a setting: ``diag(factor² if scaled, else 1) + size² Σ φ φᵀ`` with orthogonal
    features φ, each of which covers the readings of one kind at one pose in one direction.
    """

    noise: Noise
    group: Indices
    """Index (n,) of the pair of features that covers a reading."""
    shape: Array
    """Values (n, 2) of the features."""
    norms: Array
    """Squared lengths (f,) of the features over the readings used."""
    factors: Array
    """Common factors (q,) on the noise."""
    sizes: Array
    """Sizes (q,) of the discrepancy, relative to the readings."""
    log_weight: Array
    """Log of prior and determinant of the covariance (q,)."""

    def project(self, columns: Array) -> Projection:
        """Return columns (n, c) prepared for inner products."""
        used = self.noise.used
        scaled = self.noise.scaled
        if not len(self.norms):
            return Projection(
                columns[used & ~scaled], columns[used & scaled], columns[:0]
            )
        here = columns[used]
        group = self.group[used]
        shape = self.shape[used]
        order = np.argsort(group, kind="stable")
        starts = np.searchsorted(group[order], np.arange(len(self.norms) // 2))
        length = np.sqrt(self.norms).reshape(2, -1)
        parts: list[Array] = []
        for j in (0, 1):
            size = length[j, group]
            unit = np.divide(
                shape[:, j], size, out=np.zeros(len(group)), where=size > 0.0
            )
            parts.append(
                np.add.reduceat(unit[order, None] * here[order], starts, axis=0)
            )
            here = here - unit[:, None] * parts[j][group]
        return Projection(here, here[:0], np.concatenate(parts))

    def inner(self, left: Projection, right: Projection) -> Array:
        """Return inner products (q, c, d) under the inverse covariance of every setting."""
        weights = self.factors[:, None, None] ** -2.0
        out = left.stated.T @ right.stated + weights * (left.scaled.T @ right.scaled)
        for k, size in enumerate(self.sizes):
            out[k] += left.features.T @ (
                right.features / (1.0 + size**2 * self.norms)[:, None]
            )
        return out

    def inner_at(self, setting: int, columns: Array) -> Array:
        """Return inner products (c, c) of columns (n, c) in one setting."""
        here = slice(setting, setting + 1)
        one = replace(self, factors=self.factors[here], sizes=self.sizes[here])
        projected = one.project(columns)
        return one.inner(projected, projected)[0]


def errors_of(campaign: Campaign, noise: Noise, log_odds: float) -> Errors:
    """Return the distribution of the readings about a hypothesis.

    If the noise is known up to a factor, that factor covers all unknowns. Otherwise there may be a
    discrepancy with prior log-odds ``log_odds`` and a size uniform on a grid: by pose, kind and
    direction, independent shares of the readings' values and of their rms in that direction.

    References
    ----------
    Kennedy and O'Hagan, Bayesian calibration of computer models, J. R. Statist. Soc. B 63 (2001).
    """
    none = (
        np.zeros(len(campaign), dtype=np.int64),
        np.zeros((len(campaign), 2)),
        np.zeros(0),
    )
    if noise.scaled.any() or not noise.used.any():
        factors = noise.factors if (noise.used & noise.scaled).any() else np.ones(1)
        weight = -float((noise.used & noise.scaled).sum()) * np.log(factors) - np.log(
            len(factors)
        )
        return Errors(noise, *none, factors, np.zeros(len(factors)), weight)
    if not (noise.used & ~campaign.in_blocks).any():
        return Errors(noise, *none, np.ones(1), np.zeros(1), np.zeros(1))
    group, shape, norms = _features(campaign, noise)
    sizes = np.concatenate([[0.0], EVIDENCE.discrepancies])
    volume = -0.5 * np.log1p(sizes[:, None] ** 2 * norms).sum(axis=1)
    prior = np.where(sizes > 0.0, log_odds - np.log(len(EVIDENCE.discrepancies)), 0.0)
    return Errors(
        noise=noise,
        group=group,
        shape=shape,
        norms=norms,
        factors=np.ones(len(sizes)),
        sizes=sizes,
        log_weight=volume + prior,
    )


def _without_scatter(c: Campaign, noise: Noise) -> Array:
    """Return readings (n,) averaged over repetitions, whose scatter is not a discrepancy."""
    taken = np.column_stack(
        [c.pose, c.quantity, c.sensor, c.load, np.nan_to_num(c.wrench)]
    )
    same = np.unique(taken, axis=0, return_inverse=True)[1].ravel()
    total = np.bincount(same, np.where(noise.used, c.value, 0.0))
    return (total / np.maximum(np.bincount(same, noise.used), 1.0))[same]


def _features(c: Campaign, noise: Noise) -> tuple[Indices, Array, Array]:
    """Return groups (n,), two features (n, 2) orthogonal within groups, and squared lengths."""
    axis = c.kind * 6 + c.direction
    used = noise.used & ~c.in_blocks  # lines have nuisances of their own
    cell = np.where(used, c.pose * (axis.max() + 1) + axis, -1)
    group = np.unique(cell, return_inverse=True)[1].ravel()
    group = (group - (0 if used.all() else 1)).astype(np.int64)
    safe = group.clip(min=0)
    count = int(group.max()) + 1
    value = np.where(noise.used, _without_scatter(c, noise), 0.0)
    mean = np.sqrt(
        np.bincount(axis, value**2) / np.maximum(np.bincount(axis, noise.used), 1)
    )
    raw = np.stack([mean[axis], value], axis=1) * (used / noise.sigma)[:, None]
    gram = np.zeros((count, 2, 2))
    np.add.at(gram, safe, raw[:, :, None] * raw[:, None, :])
    norms, turn = np.linalg.eigh(gram)
    norms = np.where(norms > EVIDENCE.parallel * norms[:, 1:], norms, 0.0)
    return safe, np.einsum("ni,nij->nj", raw, turn[safe]), norms.T.ravel()


@dataclass(frozen=True)
class Posterior:
    """Posterior of the parameters u (k,) of ``y = X u + errors``."""

    log_evidence: float
    """ln p(y), up to a constant common to all hypotheses."""
    mean: Array
    """Mean (k,) of u."""
    find_covariance: Callable[[], Array]
    """Function that evaluates `covariance`, which is rarely needed."""
    scales: Array
    """Most likely prior scales (k,)."""
    averaging: float
    """Contribution of averaging over prior scales to ``log_evidence``."""
    settings: Array
    """Probabilities (q,) of the settings of errors."""
    plain: float
    """ln p(y) without a discrepancy."""
    noise_factor: float = 1.0
    """Geometric mean of the common unknown factor on the noise."""
    discrepancy: float = 0.0
    """Rms of the discrepancy's relative size."""

    @cached_property
    def covariance(self) -> Array:
        """Covariance (k, k) of u."""
        return self.find_covariance()


def posterior(
    errors: Errors, y: Array, x: Array, priors: Sequence[Spreads], positive: Flags
) -> Posterior:
    """Return the posterior of u for a linear hypothesis, from the readings used.

    The prior is normal, with one of several scales for every effect, and half-normal if u cannot be
    negative. Settings of the errors are marginalized. Scales are averaged effect by effect about
    the likeliest (exact for one effect), which widens each effect's uncertainties. The result is
    Laplace's approximation at the constrained optimum, exact without constraints.

    Parameters
    ----------
    errors
        Distribution of y about X u.
    y
        (n,) in units of sigma.
    x
        (n, k) in the same units.
    priors
        Prior of each effect, or each group of its parameters that shares a size, in column order.
    positive
        (k,) whether parameters cannot be negative.

    References
    ----------
    MacKay, Information Theory, Inference, and Learning Algorithms, ch. 28 (Occam factors).
    """
    projected = errors.project(np.column_stack([x, y]))
    inner = errors.inner(projected, projected)
    k = x.shape[1]
    products = inner[:, :k, :k], inner[:, :k, k], inner[:, k, k], errors.log_weight
    ends = np.cumsum([prior.scales.shape[1] for prior in priors], dtype=np.int64)
    own = np.split(np.arange(k, dtype=np.int64), ends)[:-1]

    def alone(chosen: Array, mine: Indices, scales: Array) -> Array:
        """Return ln evidence (s,) if only some prior scales change, to (s, m)."""
        gone = ~positive
        gone[mine] = False
        left, log = eliminate(inner, np.append(gone, False), chosen[gone])
        rest = (
            left[:, :-1, :-1],
            left[:, :-1, -1],
            left[:, -1, -1],
            errors.log_weight + log,
        )
        tried = _with(chosen, mine, scales)[:, ~gone]
        return log_sum(log_evidences(*rest, tried, positive[~gone])[0], axis=0)

    count = min((len(prior.scales) for prior in priors), default=1)
    averaging = 0.0
    tried = np.hstack(
        [np.zeros((count, 0)), *(prior.scales[:count] for prior in priors)]
    )
    logs = log_sum(log_evidences(*products, tried, positive)[0], axis=0)
    chosen = tried[
        int(np.argmax(logs))
    ]  # of scales with the same grid index for all effects
    for _ in range(EVIDENCE.sweeps if len(priors) > 1 else len(priors)):
        averaging = 0.0
        before = chosen
        for prior, mine in zip(priors, own, strict=True):
            logs = alone(chosen, mine, prior.scales)
            best = int(np.argmax(logs + prior.log_weight))
            chosen = _with(chosen, mine, prior.scales[best : best + 1])[0]
            averaging += float(log_sum(logs + prior.log_weight) - logs[best])
        if np.array_equal(before, chosen):
            break
    logs, means, _ = log_evidences(*products, chosen[None], positive)
    log = logs[:, 0]
    share = np.exp(log - log_sum(log))
    mean = share @ means[:, 0]

    def find_covariance() -> Array:
        few = share > EVIDENCE.negligible
        grams, pulls, totals, log_weight = (each[few] for each in products)
        part = grams, pulls, totals, log_weight
        covariance = _find_moment(
            *log_evidences(*part, chosen[None], positive), chosen[None], mean
        )
        moments: list[Array] = []
        for prior, mine in zip(
            priors, own, strict=True
        ):  # nor is its prior scale known
            tried = _with(chosen, mine, prior.scales)
            logs, means, cores = log_evidences(*part, tried, positive)
            moments.append(
                _find_moment(logs + prior.log_weight, means, cores, tried, mean)
            )
        return _widen(covariance, moments)

    whole, plain = (
        float(log_sum(each)) + averaging for each in (log, log[errors.sizes == 0.0])
    )
    factor = float(np.exp(share @ np.log(errors.factors)))
    size = float(np.sqrt(share @ errors.sizes**2))
    return Posterior(
        log_evidence=whole,
        mean=mean,
        find_covariance=find_covariance,
        scales=chosen,
        averaging=averaging,
        settings=share,
        plain=plain,
        noise_factor=factor,
        discrepancy=size,
    )


def eliminate(inner: Array, gone: Flags, scales: Array) -> tuple[Array, Array]:
    """Return inner products (q, l, l) with normal parameters (g,) of prior scales marginalized.

    The last column holds the readings. Also returns the contribution to ln evidence (q,).

    Parameters
    ----------
    inner
        Inner products (q, m, m) of columns, the last being the readings.
    gone
        Flags (m,) of the g columns to marginalize.
    scales
        Prior standard deviations (g,) of their parameters.
    """
    find_share, log = marginalize(inner[:, gone][:, :, gone], scales)
    share = find_share(inner[:, ~gone][:, :, gone])
    rest = inner[:, ~gone][:, :, ~gone]
    return rest * (
        1.0 + EVIDENCE.rounding * np.diag([*np.ones(rest.shape[1] - 1), 0.0])
    ) - share @ share.mT, log


def marginalize(inner: Array, scales: Array) -> tuple[Callable[[Array], Array], Array]:
    """Return the share of other columns that normal parameters explain, and ln evidence (q,).

    The share (q, c, g) follows from inner products (q, c, g) of the columns with theirs; products
    of columns A and B, marginalized, are ``AᵀB - share(A) share(B)ᵀ``.

    Parameters
    ----------
    inner
        Inner products (q, g, g) of the parameters' columns.
    scales
        Prior standard deviations (g,).
    """
    unit = np.eye(len(scales))
    whole = (scales[:, None] * inner * scales + unit) * (1.0 + EVIDENCE.rounding * unit)
    size = np.sqrt(np.diagonal(whole, axis1=1, axis2=2))[..., None]
    root = np.linalg.cholesky(
        whole / size / size.mT
    )  # equal diagonals keep the rest definite

    def find_share(products: Array) -> Array:
        return np.linalg.solve(root, scales[:, None] * products.mT / size).mT

    return find_share, -np.log(size[..., 0] * np.diagonal(root, axis1=1, axis2=2)).sum(
        axis=1
    )


def _with(chosen: Array, mine: Indices, scales: Array) -> Array:
    """Return prior scales (s, k): the chosen ones (k,) with some replaced by each of (s, m)."""
    tried = np.tile(chosen, (len(scales), 1))
    tried[:, mine] = scales
    return tried


def _widen(covariance: Array, moments: Sequence[Array]) -> Array:
    """Return a covariance (k, k) with what second moments (k, k) exceed it by, direction by direction.

    Sums of parameters that readings show well stay so, however little these are known alone.
    """
    if not len(covariance):
        return covariance
    unit = np.sqrt(np.diagonal(covariance))
    values, vectors = np.linalg.eigh(covariance / unit / unit[:, None])
    root = unit[:, None] * vectors * np.sqrt(values.clip(min=EVIDENCE.rounding))
    inverse = np.linalg.inv(root)
    out = np.eye(len(covariance))
    for moment in moments:
        more, axes = np.linalg.eigh(inverse @ moment @ inverse.T)
        out += (axes * (more - 1.0).clip(min=0.0)) @ axes.T
    return root @ out @ root.T


def _find_moment(
    log: Array, means: Array, cores: Array, scales: Array, about: Array
) -> Array:
    """Return the second moment (k, k) about a point (k,) over settings and prior scales (s, k)."""
    weight = np.exp(log - log_sum(log))
    counted = np.argwhere(weight > EVIDENCE.negligible)
    out = np.zeros((len(about), len(about)))
    for q, s in counted:
        away = means[q, s] - about
        covariance = scales[s][:, None] * np.linalg.inv(cores[q, s]) * scales[s]
        out += weight[q, s] * (covariance + np.outer(away, away))
    return out / weight[tuple(counted.T)].sum()


def log_evidences(
    grams: Array,
    pulls: Array,
    totals: Array,
    log_weight: Array,
    scales: Array,
    positive: Flags,
) -> tuple[Array, Array, Array]:
    """Return ln evidence of linear hypotheses for all settings of the errors and prior sizes.

    Parameters
    ----------
    grams, pulls, totals
        Inner products (..., q, k, k), (..., q, k), (..., q) of columns and readings.
    log_weight
        Log weights (q,) of the settings.
    scales
        Prior sizes (..., s, k).
    positive
        (k,) whether parameters cannot be negative.

    Returns
    -------
        Ln evidence (..., q, s), means (..., k), posterior over prior precision (..., k, k).
    """
    wide = scales[..., None, :, :]  # (..., 1, s, k)
    cores = wide[..., :, None] * grams[..., :, None, :, :] * wide[..., None, :]
    ridge = 1.0 + EVIDENCE.rounding * np.trace(cores, axis1=-2, axis2=-1)
    cores = cores + np.eye(scales.shape[-1]) * ridge[..., None, None]
    b = wide * pulls[..., :, None, :]
    u, free = constrained_minima(cores, b, positive)
    at = (cores @ u[..., None])[..., 0]
    fit = np.sum(u * (2.0 * b - at), axis=-1)
    last = np.argsort(positive, kind="stable")  # those that cannot be negative
    root = cast("Array", np.linalg.cholesky(cores[..., last[:, None], last]))
    pivots = np.diagonal(root, axis1=-2, axis2=-1)
    log = (
        -0.5 * (totals[..., None] - fit)
        - np.log(pivots).sum(axis=-1)
        + log_weight[:, None]
    )
    if positive.any():
        beside = np.sqrt(np.diagonal(cores, axis1=-2, axis2=-1))
        pull = ((b - at) / beside)[..., positive]
        count = int(positive.sum())
        own = root[..., -count:, -count:]
        log = log + _above_zero(own, u[..., positive], pull, free[..., positive])
    return log, wide * u, cores


def _above_zero(root: Array, u: Array, pull: Array, free: Flags) -> Array:
    """Return the log correction (...) of Laplace's approximation for non-negative parameters.

    For each, the fraction of its Gaussian above zero over the prior's half: the marginal one if
    free, the conditional one if held at zero. Exact for independent parameters.

    Parameters
    ----------
    root
        Cholesky factor (..., p, p) of their precision with all others marginalized.
    u
        Parameters (..., p).
    pull
        Slopes (..., p) of the log posterior at u, in conditional standard deviations.
    free
        Which (..., p) are not held at zero.
    """
    deviation = np.linalg.norm(np.linalg.inv(root), axis=-2)  # of (L Lᵀ)⁻¹
    away = np.abs(np.where(free, u / deviation, pull)) / np.sqrt(2.0)
    share = np.asarray(np.where(free, erfc(-away), erfcx(away)), dtype=float)
    return np.log(share).sum(axis=-1)


def constrained_minima(
    matrices: Array, pulls: Array, positive: Flags
) -> tuple[Array, Flags]:
    """Return minima (..., k) of ``½ uᵀ A u - bᵀ u`` with some u ≥ 0, and which u are free.

    Eliminates the others, then fixes the most negative one at a time; `scipy.optimize.nnls` takes
    one factor and bounds all u.

    Parameters
    ----------
    matrices, pulls
        A (..., k, k), positive definite, and b (..., k).
    positive
        Flags (k,) of the u that must not be negative.
    """
    shape = pulls.shape
    k = pulls.shape[-1]
    free = np.ones(shape, dtype=np.bool_)
    if k == 0:
        return pulls, free
    if not positive.any():
        return np.linalg.solve(matrices, pulls[..., None])[..., 0], free
    a = matrices.reshape(-1, k, k)
    b = pulls.reshape(-1, k)
    root = np.sqrt(np.diagonal(a, axis1=1, axis2=2))[:, positive]
    own = a[:, positive]
    mixed = own[:, :, ~positive]
    beside = a[:, ~positive][:, :, ~positive]
    right = np.concatenate([mixed.mT, b[:, ~positive, None]], axis=2)
    share = np.linalg.solve(
        beside, right
    )  # of the others: per unit of these, and alone
    least, held = _minimize_above_zero(
        own[:, :, positive] - mixed @ share[:, :, :-1],
        b[:, positive] - (mixed @ share[:, :, -1:])[..., 0],
        root,
    )
    u = np.empty(b.shape)
    u[:, positive] = least
    u[:, ~positive] = share[:, :, -1] - (share[:, :, :-1] @ least[..., None])[..., 0]
    free[..., positive] = ~held.reshape(*shape[:-1], -1)
    return u.reshape(shape), free


def _minimize_above_zero(a: Array, b: Array, root: Array) -> tuple[Array, Flags]:
    """Return minima (n, k) of ``½ uᵀ A u - bᵀ u`` with u ≥ 0, and which u are held at zero.

    root: inverse units (n, k) in which the most negative one is sought.
    """
    k = b.shape[1]
    u = np.linalg.solve(a, b[..., None])[..., 0]
    free = np.ones(b.shape, dtype=np.bool_)
    left = np.arange(len(b))
    while len(left):
        wrong = np.where(free[left], u[left] * root[left], 0.0)
        bad = wrong.min(axis=1) < 0.0
        left = left[bad]
        free[left, np.argmin(wrong, axis=1)[bad]] = False
        keep = free[left]
        both = keep[:, :, None] & keep[:, None, :]
        held = np.where(both, a[left], 0.0) + np.eye(k) * ~keep[:, None, :]
        pulls = np.where(keep, b[left], 0.0)
        u[left] = np.linalg.solve(held, pulls[..., None])[..., 0]
    return u, ~free


def log_sum(logs: Array, axis: int | None = None) -> Any:
    """Return the log-sum-exp."""
    return np.logaddexp.reduce(logs.ravel() if axis is None else logs, axis=axis or 0)

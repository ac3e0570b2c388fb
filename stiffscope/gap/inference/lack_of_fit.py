"""Whether residuals show more than the noise, in all and by direction, pose, load and session."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtrc  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

if TYPE_CHECKING:
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array, Indices


SIGNIFICANCE = 1e-3  # of the χ² tests
CORROBORATED = 0.05  # significance of χ² in all that suffices where residuals are correlated within groups
NEGLIGIBLE = 1.03  # χ² per degree of freedom below which lack of fit is ignored
MODEL_ERROR = 0.002  # share of the explained χ² that the forward model's own small errors may leave,
MODEL_NOISE = 1.2  # as long as that is at most so many times the noise
ENOUGH = 60  # readings from which group means are tested
_OBSERVABLE = 0.05  # share of a group mean that the fit has left to be seen


def lack_of_fit(found: Findings, hypothesis: Hypothesis) -> str:
    """What the residuals of a hypothesis show beyond the noise; empty if they are as large as the noise.

    A lack of fit that is negligible beside the gap that the hypothesis closes is left to the model's own small errors.
    Correlated residuals alone are none: the gap is then at the noise, and the discrepancy widens the intervals.
    """
    dof, total = _degrees(found, hypothesis), found.chi2(hypothesis)
    p = _tail(total, dof)
    if total - dof <= max((NEGLIGIBLE - 1.0) * dof, model_errors(found, hypothesis)) or p >= CORROBORATED:
        return ""
    together = correlation(found, hypothesis)
    if p >= SIGNIFICANCE and not together:
        return ""
    left = f"the residuals are {np.sqrt(total / dof):.3g} times the noise"
    return f"{left}; {together}" if together else left


def correlation(found: Findings, hypothesis: Hypothesis) -> str:
    """How the residuals of a hypothesis are correlated, which noise is not; empty if they are not."""
    c, used = found.campaign, found.used_readings
    r = found.residual(hypothesis)[used]
    if len(r) < ENOUGH or np.isnan(c.sigma).any():
        return ""
    applied = np.column_stack([c.load, np.nan_to_num(c.wrench)])[used]
    loads = np.unique(applied, axis=0, return_inverse=True)[1].ravel()
    axis, kind = c.direction[used], c.kind[used]
    groups = {
        "direction": kind * 6 + axis,
        "pose and direction": c.pose[used] * 6 + axis,
        "load and direction": loads * 6 + axis,
        "session and direction": c.session[used] * 6 + axis,
    }
    x = found.slopes(hypothesis)[used]
    ignored = model_errors(found, hypothesis)
    for name, group in groups.items():
        total, dof = _of_group_means(r, group, x)
        p = _tail(total, dof)
        if p * len(groups) < SIGNIFICANCE and total - dof > ignored:
            return f"the residuals are correlated within each {name} (p = {p:.1g})"
    return ""


def _degrees(found: Findings, hypothesis: Hypothesis) -> int:
    return max(int(found.used_readings.sum()) - len(hypothesis.values), 1)


def model_errors(found: Findings, hypothesis: Hypothesis) -> float:
    """Excess of χ² that is left to the forward model's own errors."""
    dof = _degrees(found, hypothesis)
    return float(np.clip(MODEL_ERROR * (found.chi2(found.none) - dof), 0.0, (MODEL_NOISE**2 - 1.0) * dof))


def _tail(total: float, dof: int) -> float:
    return float(chdtrc(max(dof, 1), total))


def _of_group_means(r: Array, group: Indices, x: Array) -> tuple[float, int]:
    """χ² of the groups' mean residuals, the directions of the fit projected out, and its degrees of freedom."""
    _, index, count = np.unique(group, return_inverse=True, return_counts=True)
    root = np.sqrt(count)
    sums = np.bincount(index.ravel(), r) / root
    design = np.zeros((len(count), x.shape[1]))
    for k in range(x.shape[1]):
        design[:, k] = np.bincount(index.ravel(), x[:, k]) / root
    covariance = np.eye(len(count)) - design @ np.linalg.pinv(x.T @ x, rcond=1e-10) @ design.T
    values, vectors = np.linalg.eigh(covariance)
    keep = values > _OBSERVABLE
    return float(np.sum((vectors[:, keep].T @ sums) ** 2 / values[keep])), int(keep.sum())

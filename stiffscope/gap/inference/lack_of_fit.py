"""Tests of residuals against the noise: overall, and by direction, pose, load and session."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtrc, fdtrc  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

from stiffscope.gap.inference.settings import TESTS

if TYPE_CHECKING:
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array, Indices


def lack_of_fit(found: Findings, hypothesis: Hypothesis) -> str:
    """Return a description of residuals beyond the noise; empty if they agree with it.

    A lack of fit that is negligible compared to the closed gap is attributed to small model errors.
    Correlation alone is no lack of fit: the gap is at the noise; the discrepancy widens intervals.
    """
    dof = _degrees(found, hypothesis)
    total = found.chi2(hypothesis)
    known = min(found.problem.noise.freedom, TESTS.sure)
    p = float(fdtrc(dof, known, total / dof))  # of χ² if the noise is known
    ignored = max((TESTS.negligible - 1.0) * dof, model_errors(found, hypothesis))
    if total - dof <= ignored or p >= TESTS.corroborated:
        return ""
    together = correlation(found, hypothesis)
    if p >= TESTS.significance and not together:
        return ""
    left = f"the residuals are {np.sqrt(total / dof):.3g} times the noise"
    return f"{left}; {together}" if together else left


def agrees(found: Findings, left: Array) -> bool:
    """Return whether residuals (n,), in the readings' units, are no more than the noise."""
    used = found.used_readings
    dof = max(int(used.sum()), 1)
    total = float(np.sum((left / found.sigma)[used] ** 2))
    known = min(found.problem.noise.freedom, TESTS.sure)
    few = total - dof <= (TESTS.negligible - 1.0) * dof
    return few or float(fdtrc(dof, known, total / dof)) >= TESTS.significance


def misses_lines(found: Findings, hypothesis: Hypothesis) -> str:
    """Return a description of lines of responses left far beyond their noise; empty if none are."""
    lines = found.used_readings & found.campaign.in_blocks
    if not lines.any():
        return ""
    square = float(np.mean(found.residual(hypothesis)[lines] ** 2))
    if square <= TESTS.missed:
        return ""
    size = f"{np.sqrt(square):.3g} times their noise"
    return f"the lines of responses are left at {size}: nothing is certain"


def correlation(found: Findings, hypothesis: Hypothesis) -> str:
    """Return a description of correlated residuals, unlike noise; empty if there is none."""
    c = found.campaign
    used = found.used_readings
    r = found.residual(hypothesis)[used]
    if len(r) < TESTS.enough or np.isnan(c.sigma).any():
        return ""
    applied = np.column_stack([c.load, np.nan_to_num(c.wrench)])[used]
    loads = np.unique(applied, axis=0, return_inverse=True)[1].ravel()
    axis = c.direction[used]
    kind = c.kind[used]
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
        p = float(chdtrc(max(dof, 1), total))
        if p * len(groups) < TESTS.significance and total - dof > ignored:
            return f"the residuals are correlated within each {name} (p = {p:.1g})"
    return ""


def _degrees(found: Findings, hypothesis: Hypothesis) -> int:
    return max(int(found.used_readings.sum()) - len(hypothesis.values), 1)


def model_errors(found: Findings, hypothesis: Hypothesis) -> float:
    """Return the excess of χ² attributed to errors of the forward model itself."""
    dof = _degrees(found, hypothesis)
    excess = TESTS.model_error * (found.chi2(found.none) - dof)
    return float(np.clip(excess, 0.0, (TESTS.model_noise**2 - 1.0) * dof))


def _of_group_means(r: Array, group: Indices, x: Array) -> tuple[float, int]:
    """Return χ² of group mean residuals, with the fit projected out, and degrees of freedom."""
    _, index, count = np.unique(group, return_inverse=True, return_counts=True)
    sums, *columns = (
        np.bincount(index.ravel(), each) / np.sqrt(count) for each in (r, *x.T)
    )
    design = np.column_stack([np.zeros((len(count), 0)), *columns])
    covariance = (
        np.eye(len(count)) - design @ np.linalg.pinv(x.T @ x, rcond=1e-10) @ design.T
    )
    values, vectors = np.linalg.eigh(covariance)
    keep = values > TESTS.observable
    return float(np.sum((vectors[:, keep].T @ sums) ** 2 / values[keep])), int(
        keep.sum()
    )

"""Plausibility of the parameters of fitted effects."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.gap.forward.forward_model import Candidate
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array


SIGNIFICANT = 3.0  # least significant deviation from the plausible range, standard deviations


def physical_sigma(candidate: Candidate, internal: Array, covariance: Array) -> Array:
    """Return standard uncertainties (k,) of physical parameters by linear propagation."""
    steps = 1e-6 * np.array(candidate.scale)
    slopes = [
        (candidate.physical(internal + d) - candidate.physical(internal - d)) / (2.0 * step)
        for d, step in zip(np.diag(steps), steps, strict=True)
    ]
    jacobian = np.stack(slopes, axis=1)
    return np.sqrt(np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian).clip(min=0.0))


def own_part(hypothesis: Hypothesis, name: str) -> tuple[Array, Array]:
    """Return internal parameters (k,) of an effect of a hypothesis, and covariance (k, k)."""
    ends = np.cumsum([0, *(len(values) for _, values in hypothesis.parameters)])
    for (candidate, values), (start, end) in zip(hypothesis.parameters, pairwise(ends), strict=True):
        if candidate.name == name:
            return np.array(values), hypothesis.covariance[start:end, start:end]
    raise KeyError(name)


def plausible(candidate: Candidate, values: Array, sigma: Array) -> list[bool]:
    """Return whether each physical parameter is within its range or insignificantly beyond."""
    return [
        bool(low - SIGNIFICANT * s <= v <= high + SIGNIFICANT * s)
        for v, s, (low, high) in zip(values, sigma, candidate.plausible, strict=True)
    ]


def implausible(candidate: Candidate, hypothesis: Hypothesis) -> list[str]:
    """Return messages on implausible parameters of an effect."""
    if not candidate.scale:
        return []
    values = candidate.physical(np.array(next(v for c, v in hypothesis.parameters if c.name == candidate.name)))
    if all(plausible(candidate, values, np.zeros(len(values)))):
        return []
    sigma = physical_sigma(candidate, *own_part(hypothesis, candidate.name))
    rows = zip(candidate.names, candidate.units, values, plausible(candidate, values, sigma), strict=True)
    return [f"{candidate.name}: {name} of {v:.3g} {unit} is not plausible" for name, unit, v, fine in rows if not fine]

"""Whether the parameters of a fitted effect are plausible."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.gap.forward.forward_model import Candidate
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array


SIGNIFICANT = 3.0  # standard deviations by which a parameter must leave its plausible range to count


def physical_sigma(candidate: Candidate, internal: Array, covariance: Array) -> Array:
    """Standard uncertainties (k,) of an effect's physical parameters, by the derivatives of the conversion."""
    steps = 1e-6 * np.array(candidate.scale)
    slopes = [
        (candidate.physical(internal + d) - candidate.physical(internal - d)) / (2.0 * step)
        for d, step in zip(np.diag(steps), steps, strict=True)
    ]
    jacobian = np.stack(slopes, axis=1)
    return np.sqrt(np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian).clip(min=0.0))


def own_part(hypothesis: Hypothesis, name: str) -> tuple[Array, Array]:
    """Internal parameters (k,) of one effect of a hypothesis, and their covariance (k, k)."""
    ends = np.cumsum([0, *(len(values) for _, values in hypothesis.parameters)])
    for (candidate, values), (start, end) in zip(hypothesis.parameters, pairwise(ends), strict=True):
        if candidate.name == name:
            return np.array(values), hypothesis.covariance[start:end, start:end]
    raise KeyError(name)


def plausible(candidate: Candidate, values: Array, sigma: Array) -> list[bool]:
    """Whether each physical parameter is within its plausible range or insignificantly beyond."""
    return [
        bool(low - SIGNIFICANT * s <= v <= high + SIGNIFICANT * s)
        for v, s, (low, high) in zip(values, sigma, candidate.plausible, strict=True)
    ]


def implausible(candidate: Candidate, hypothesis: Hypothesis) -> list[str]:
    """What is wrong with the parameters of an effect."""
    if not candidate.scale:
        return []
    values = candidate.physical(np.array(next(v for c, v in hypothesis.parameters if c.name == candidate.name)))
    if all(plausible(candidate, values, np.zeros(len(values)))):
        return []
    sigma = physical_sigma(candidate, *own_part(hypothesis, candidate.name))
    rows = zip(candidate.names, candidate.units, values, plausible(candidate, values, sigma), strict=True)
    return [f"{candidate.name}: {name} of {v:.3g} {unit} is not plausible" for name, unit, v, fine in rows if not fine]

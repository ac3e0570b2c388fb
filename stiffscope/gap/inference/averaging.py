"""Averages over the hypotheses that compete, of which one alone understates its uncertainties.

References
----------
Hoeting et al., Bayesian model averaging: a tutorial, Statistical Science 14 (1999).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri_exp  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

from stiffscope.gap.inference.evidence import posterior
from stiffscope.gap.inference.hypothesis import positive_of, split
from stiffscope.gap.inference.plausibility import find_plausible
from stiffscope.gap.inference.settings import GROUPS

if TYPE_CHECKING:
    from collections.abc import Collection

    from stiffscope.gap.forward.forward_model import Candidate
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.gap.inference.fitting import Problem
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array

    Averaged = list[tuple[Hypothesis, float]]

TAILS = (0.025, 0.975)
_POINTS = 1000  # between the ends of intervals, to find that of their mixture


def average_over(
    found: Findings, joint: Hypothesis, named: Collection[Candidate]
) -> Averaged:
    """Return hypotheses with weights that sum to 1, over which parameters are averaged.

    They contain the named effects in any form, and have at least `GROUPS.competing` of the best one's
    evidence. One in which some parameters are zero is also taken with none of them zero.

    Parameters
    ----------
    found
        The search.
    joint
        The only hypothesis if no effect is named.
    named
        Named effects.
    """
    known = {(c.name, c.names) for c in named}
    if not known:
        return [(joint, 1.0)]
    able = [
        h
        for h in found.fitted.values()
        if known <= {(c.name, c.names) for c in h.candidates}
    ]
    best = max(h.evidence for h in able)
    close = [h for h in able if h.evidence > best + np.log(GROUPS.competing)]
    close += [dense for h in close if (dense := _without_zeros(found.problem, h))]
    weights = np.exp([h.evidence - best for h in close])
    return list(zip(close, (weights / weights.sum()).tolist(), strict=True))


def _without_zeros(problem: Problem, hypothesis: Hypothesis) -> Hypothesis | None:
    """Return a hypothesis under the prior in which no parameter is zero; None if that is its own."""
    priors = [
        prior.without_zeros()
        for c in hypothesis.candidates
        if c.scale
        for prior in problem.spreads_of(c)
    ]
    ends = pairwise(
        np.cumsum([0, *(prior.scales.shape[1] for prior in priors)]).tolist()
    )
    chosen = (hypothesis.known.scales[a:b] for a, b in ends)
    pairs = zip(priors, chosen, strict=True)
    if hypothesis.local or all(
        (prior.scales == own).all(axis=1).any() for prior, own in pairs
    ):
        return None
    y = hypothesis.linear
    x = hypothesis.slopes
    known = posterior(problem.errors, y, x, priors, positive_of(hypothesis.candidates))
    log = hypothesis.evidence + known.log_evidence - hypothesis.known.log_evidence
    dense = replace(
        hypothesis, parameters=split(hypothesis.candidates, known.mean), known=known
    )
    u, cost = find_plausible(dense) or (known.mean, 0.0)
    return replace(
        dense,
        parameters=split(hypothesis.candidates, u),
        residual=y - x @ u,
        evidence=log - cost,
    )


def mix_intervals(ends: Array, weights: Array) -> tuple[float, float]:
    """Return the 95 % interval of a mixture of normal distributions with their own intervals (m, 2)."""
    if len(weights) == 1:
        return float(ends[0, 0]), float(ends[0, 1])
    middle, width = ends.mean(axis=1)[:, None], np.ptp(ends, axis=1)[:, None]
    deviation = (width / np.ptp(quantiles(0.0, 1.0))).clip(
        min=1e-12 * np.ptp(ends) + 1e-300
    )

    def find_end(tail: float, own: Array) -> float:
        at: Array = np.linspace(float(own.min()), float(own.max()), _POINTS)
        return float(np.interp(tail, weights @ ndtr((at - middle) / deviation), at))

    return find_end(TAILS[0], ends[:, 0]), find_end(TAILS[1], ends[:, 1])


def quantiles(mean: float, deviation: float, lowest: float = -np.inf) -> Array:
    """Return the 95 % interval (2,) of a normal distribution truncated below ``lowest``."""
    above = np.log1p(-np.array(TAILS)) + log_ndtr(
        (mean - lowest) / deviation
    )  # ln of upper tails
    return mean - deviation * np.asarray(ndtri_exp(above), dtype=float)

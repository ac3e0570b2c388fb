"""Plausibility of the parameters of fitted effects."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.inference.hypothesis import bound_parameters, positive_of, split
from stiffscope.gap.inference.settings import PLAUSIBLE

if TYPE_CHECKING:
    from stiffscope.gap.forward.forward_model import Candidate
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array


_DISTANCES = np.linspace(0.05, 1.0, 20) * PLAUSIBLE.significant


def physical_sigma(candidate: Candidate, internal: Array, covariance: Array) -> Array:
    """Return standard uncertainties (k,) of physical parameters by linear propagation."""
    steps = 1e-6 * np.array(candidate.scale)
    slopes = [
        (candidate.physical(internal + d) - candidate.physical(internal - d))
        / (2.0 * step)
        for d, step in zip(np.diag(steps), steps, strict=True)
    ]
    jacobian = np.stack(slopes, axis=1)
    return np.sqrt(
        np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian).clip(min=0.0)
    )


def own_part(hypothesis: Hypothesis, name: str) -> tuple[Array, Array]:
    """Return internal parameters (k,) of an effect of a hypothesis, and covariance (k, k)."""
    own = hypothesis.mark(lambda c: c.name == name)
    return hypothesis.values[own], hypothesis.covariance[np.ix_(own, own)]


Ranges = tuple[tuple[float, float], ...]


def plausible(
    candidate: Candidate, values: Array, sigma: Array, ranges: Ranges = ()
) -> list[bool]:
    """Return whether each physical parameter is within its range or insignificantly beyond.

    An uncertainty far above the range excuses none: the centre of a payload without mass has it.
    ranges: by default the plausible ones.
    """
    known = zip(values, sigma, ranges or candidate.plausible, strict=True)
    rows = (
        (
            v,
            PLAUSIBLE.significant * s if s < PLAUSIBLE.sensible * (high - low) else 0.0,
            low,
            high,
        )
        for v, s, (low, high) in known
    )
    return [bool(low - away <= v <= high + away) for v, away, low, high in rows]


def implausible(
    candidate: Candidate,
    hypothesis: Hypothesis,
    other: Candidate | None = None,
    rate: float = 1.0,
    ranges: Ranges = (),
) -> list[str]:
    """Return messages on implausible parameters of an effect, or of a twin in its place.

    ranges: by default the plausible ones.
    """
    if not candidate.scale:
        return []
    other = other or candidate
    values = other.physical(
        rate * hypothesis.values[hypothesis.mark(lambda c: c is candidate)]
    )
    if all(plausible(other, values, np.zeros(len(values)), ranges)):
        return []
    internal, covariance = own_part(hypothesis, candidate.name)
    sigma = physical_sigma(other, rate * internal, rate**2 * covariance)
    fine = plausible(other, values, sigma, ranges)
    rows = zip(other.names, other.units, values, strict=True)
    if other.sums and not all(fine[1:]):  # a ratio of two values that may both be noise
        return [f"{other.name}: a moment without a mass on the body is not plausible"]
    strange = (
        f"{name} of {v:.3g} {unit}"
        for (name, unit, v), good in zip(rows, fine, strict=True)
        if not good
    )
    return [f"{other.name}: {each} is not plausible" for each in strange]


def impossible(candidate: Candidate, hypothesis: Hypothesis) -> list[str]:
    """Return messages on parameters of an effect by which it is no cause."""
    return implausible(candidate, hypothesis, ranges=candidate.possible)


def find_plausible(hypothesis: Hypothesis) -> tuple[Array, float] | None:
    """Return near internal parameters (k,) that are plausible, and the ln of evidence that they cost.

    A mass that readings hardly show may be zero in a fit, and its centre anywhere. A positive parameter is
    therefore increased by at most `PLAUSIBLE.significant` standard deviations, with the others at their expectation for
    that value. None if the fit is plausible, or if none of these are. Where none is plausible, a possible one.
    """
    return _find_within(hypothesis, False) or _find_within(hypothesis, True)


def _find_within(hypothesis: Hypothesis, wide: bool) -> tuple[Array, float] | None:
    """Return near internal parameters (k,) in their ranges, plausible or (wide) possible, and their cost."""
    candidates = hypothesis.candidates

    def fits(c: Candidate, values: Array) -> bool:
        ranges = c.possible if wide else c.plausible
        return all(plausible(c, values, np.zeros(len(values)), ranges))

    wrong = [
        c
        for c, own in hypothesis.parameters
        if c.couplings and not fits(c, c.physical(np.array(own)))
    ]
    for j in (
        np.flatnonzero(hypothesis.mark(lambda c: c in wrong) & positive_of(candidates))
        if wrong
        else ()
    ):
        along = hypothesis.covariance[:, j] / np.sqrt(hypothesis.covariance[j, j])
        for distance in _DISTANCES:
            there = hypothesis.values + distance * along
            moved = (
                (c, c.physical(np.array(own)))
                for c, own in split(candidates, there)
                if c in wrong
            )
            if all(fits(c, values) for c, values in moved):
                possible = np.allclose(
                    there, bound_parameters(candidates, there), rtol=1e-12, atol=0.0
                )
                return (there, 0.5 * float(distance) ** 2) if possible else None
    return None
